"""The paper in 200 lines is the paper's: its mathematics is that of the package, to rounding, and it stands alone."""

from __future__ import annotations

import ast
import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch

from geodesic_motion_ros.geometry.fitted_spline import fitted_spline
from geodesic_motion_ros.learning.densities import antipodal_log_density, divergence_from_normal, gaussian_log_density
from geodesic_motion_ros.learning.networks import RadialBasisNetwork
from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_ros.manifold.pose_graph import MetricSettings, PoseGraph
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.paper.dense_graph import dense_graph
from geodesic_motion_ros.paper.literal_search import LiteralSearch
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.tools.metric import AmbientFactor

FILE = Path(__file__).resolve().parents[1] / "examples" / "paper_in_200_lines.py"
SHAPE = (30, 30)
RADIUS, STRENGTH = 0.04, 1000.0
#: Rounding, of values of order one.
SAME = {"rtol": 1e-9, "atol": 1e-9}


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("paper_in_200_lines", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def skill() -> Skill:
    """A shipped skill whose metric counts sigma once, as the paper does."""
    return replace(Skill.load("panda_pouring"), metric=MetricSettings(sigma_weight=1.0))


@pytest.fixture(scope="module")
def product(skill) -> tuple[PoseGraph, WeightedGraph]:
    return dense_graph(skill, SHAPE)


@pytest.fixture(scope="module")
def f(example, product) -> np.ndarray:
    """The example's features (n, 11) of the nodes as the package decodes them."""
    decoded = product[0].decoded
    return example.features(decoded.positions, decoded.sigma, decoded.quaternions, decoded.kappa)


@pytest.fixture(scope="module")
def ends(skill, product) -> tuple[int, int]:
    """Nodes at the first and last code of a demonstration."""
    return tuple(int(product[0].nodes_near(skill.codes[0, end], 1)[0]) for end in (0, -1))


@pytest.fixture(scope="module")
def centre(example, product, f, ends) -> np.ndarray:
    """An obstacle's, (3,) [m], in the middle of the path without it."""
    graph, _ = product
    path, _ = example.shortest_path(graph.edges, example.edge_weights(graph.edges, f, np.ones(len(f))), *ends)
    return graph.decoded.positions[path[len(path) // 2]]


# ---------------------------------------------------------------- it stands alone


def test_it_has_no_more_than_200_lines():
    assert len(FILE.read_text().splitlines()) <= 200


def test_it_imports_libraries_only():
    nodes = list(ast.walk(ast.parse(FILE.read_text())))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} <= {"argparse", "math", "matplotlib", "numpy", "scipy", "torch"}


def test_its_help_holds_the_equations(example, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [str(FILE), "--help"])
    with pytest.raises(SystemExit) as stopped:
        example.main()
    assert stopped.value.code == 0
    assert "m(p) = 1 + zeta exp(-|p - o|^2 / (2 r^2))" in capsys.readouterr().out


def test_what_it_learns_is_finite(example):
    x, q = example.demonstrations(count=2, samples=30)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0)
    vae, codes = example.train(x.reshape(-1, 3), q.reshape(-1, 4), steps=20, kernels=10)
    assert codes.shape == (x[..., 0].size, 2)
    nodes, features = example.decode_grid(vae, codes, shape=(5, 6))
    assert nodes.shape == (30, 2)
    assert features.shape == (30, 11)
    assert np.all(np.isfinite(features))


# ---------------------------------------------------------------- its mathematics is the package's


def test_the_evidence_lower_bound_is_the_packages(example):
    x, q = (torch.tensor(values.reshape(-1, values.shape[-1])) for values in example.demonstrations(2, 20))
    torch.manual_seed(1)
    vae = example.PoseVAE(x, q).double().requires_grad_(False)
    vae.place_kernels(vae.encode(x, q)[0], 10)
    torch.manual_seed(2)
    bound = vae.elbo(x, q)
    torch.manual_seed(2)
    mean, log_variance = vae.encode(x, q)
    mu, sigma, nu, kappa = vae.decode(mean + torch.exp(0.5 * log_variance) * torch.randn_like(mean))
    likelihood = gaussian_log_density(x, mu, 1.0 / sigma) + antipodal_log_density(q, nu, kappa)
    divergence = divergence_from_normal(mean, log_variance, torch.zeros(2), torch.ones(2))
    torch.testing.assert_close(bound, (likelihood - divergence).mean(), rtol=1e-9, atol=1e-9)


def test_sigma_and_kappa_are_those_of_the_packages_network(example):
    x, q = (torch.tensor(values.reshape(-1, values.shape[-1])) for values in example.demonstrations(2, 20))
    torch.manual_seed(1)
    vae = example.PoseVAE(x, q).double().requires_grad_(False)
    vae.place_kernels(vae.encode(x, q)[0], 10)
    rate = torch.tensor(0.5 / vae.width**2)
    network = RadialBasisNetwork(vae.centres, rate, example.FAR, example.FIXED).requires_grad_(False)
    network.weights = vae.log_weights.exp().T
    z = torch.randn(50, 2, dtype=torch.float64)
    _, sigma, _, kappa = vae.decode(z)
    torch.testing.assert_close(torch.cat([1.0 / sigma, kappa[:, None]], dim=1), network(z), rtol=1e-9, atol=1e-9)


def test_the_grid_is_the_packages(example, skill, product, f):
    def decode(z):
        decoded = skill.decoder.decode(z.numpy())
        return decoded.positions, decoded.sigma, decoded.quaternions, decoded.kappa

    codes = np.stack([skill.latent_lower, skill.latent_upper])
    nodes, features = example.decode_grid(SimpleNamespace(decode=decode), codes, SHAPE, margin=0.0)
    np.testing.assert_allclose(nodes, LatentGrid(skill.latent_lower, skill.latent_upper, SHAPE).nodes(), **SAME)
    np.testing.assert_allclose(features, f, **SAME)
    assert {frozenset(edge) for edge in example.grid_edges(SHAPE)} == {frozenset(edge) for edge in product[0].edges}
    assert len(example.grid_edges(SHAPE)) == len(product[0].edges)


def test_edges_cost_the_same_without_an_obstacle(example, product, f):
    graph, weights = product
    np.testing.assert_allclose(example.edge_weights(graph.edges, f, np.ones(len(f))), weights.base, **SAME)


def test_the_ambient_metric_is_the_packages(example, f, centre):
    law = AmbientFactor(torch.tensor(centre)[None], torch.tensor([RADIUS], dtype=torch.float64), STRENGTH)
    m = example.ambient_metric(f[:, :3], centre, RADIUS, STRENGTH)
    np.testing.assert_allclose(m, law(torch.tensor(f[:, :3])).numpy(), **SAME)
    assert m.max() > 100.0


@pytest.mark.parametrize("strength", [0.0, STRENGTH])
def test_the_shortest_path_costs_the_same(example, product, f, ends, centre, strength):
    graph, weights = product
    source, target = ends
    m = example.ambient_metric(f[:, :3], centre, RADIUS, strength)
    reweighted = example.edge_weights(graph.edges, f, m)
    path, cost = example.shortest_path(graph.edges, reweighted, source, target)
    search = LiteralSearch(graph.adjacency, weights, strength)
    search.aim(target, search.field(target))
    search.begin(source, centre[None], np.array([RADIUS]))
    search.go_on()
    assert search.finished
    assert cost == pytest.approx(search.cost, rel=1e-9)
    assert search.path_cost(path) == pytest.approx(cost, rel=1e-9)


def test_every_reweighted_edge_costs_the_same(example, product, f, centre):
    graph, weights = product
    reweighted = example.edge_weights(graph.edges, f, example.ambient_metric(f[:, :3], centre, RADIUS, STRENGTH))
    search = LiteralSearch(graph.adjacency, weights, STRENGTH)
    search.aim(0, search.field(0))
    search.begin(0, centre[None], np.array([RADIUS]))
    costs = [search.path_cost(edge) for edge in graph.edges]
    np.testing.assert_allclose(reweighted, costs, **SAME)
    assert np.max(reweighted / weights.base) > 10.0


def test_the_spline_is_the_packages(example, product, f, ends):
    graph, _ = product
    path, _ = example.shortest_path(graph.edges, example.edge_weights(graph.edges, f, np.ones(len(f))), *ends)
    at = np.linspace(0.0, 1.0, 200)
    latent = graph.latent[path]
    assert len(latent) > 10
    np.testing.assert_allclose(example.fit_spline(latent)(at), fitted_spline(latent)(at), **SAME)
