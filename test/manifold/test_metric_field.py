"""The metric between the nodes: what of it is exact, and that obstacles and mean paths stretch it as the nodes'."""

import math

import numpy as np
import pytest

from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.metric_field import (
    MetricField,
    conformal_exponent,
    curve_length,
    evenly,
    nearest_samples,
    packed_tensors,
    piecewise,
)
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.obstacles.obstacles import Obstacles

SHAPES = [(12, 10), (7, 8, 6)]


class Scene:
    """One body point at every node of a grid, which moves linearly with the latent point: a flat metric."""

    def __init__(
        self, shape: tuple[int, ...], seed: int = 0, kept: float = 1.0, mean_paths: MeanPaths | None = None
    ) -> None:
        self.random = np.random.default_rng(seed)
        d = len(shape)
        self.grid = LatentGrid(-np.ones(d), np.ones(d), shape)
        mask = self.random.random(math.prod(shape)) < kept
        self.nodes = self.grid.nodes()[mask]
        self.place = 0.5 * self.random.normal(size=(3, d))
        self.points = (self.nodes @ self.place.T)[:, None]
        root = 0.3 * self.random.normal(size=(d, d))
        self.rest = root.T @ root
        unit = self.grid.spacing[:, None] * self.grid.spacing
        every = np.ones((len(self.nodes), 1, 1))
        tensors = packed_tensors((every * (self.place.T @ self.place * unit))[:, None], every * (self.rest * unit))
        self.field = MetricField.of(self.grid, self.grid.numbering(mask), tensors, mean_paths)

    def among(self, obstacles: Obstacles) -> NodeEvaluation:
        return NodeEvaluation.of(NodeBody.of_tool(self.points, np.array([0.05])), obstacles, 1e3, 0.5, 0.02)


def _spheres(centres: np.ndarray, radius: float) -> Obstacles:
    return Obstacles.of_spheres(centres, np.full(len(centres), radius))


@pytest.mark.parametrize("kept", [1.0, 0.8])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_flat_metric_is_flat_between_the_nodes_and_beside_missing_ones(shape, kept):
    scene = Scene(shape, kept=kept)
    curve = scene.random.uniform(-0.9, 0.9, size=(2, len(shape)))
    step = curve[1] - curve[0]
    expected = math.sqrt(np.sum((scene.place @ step) ** 2) + step @ scene.rest @ step)
    assert curve_length(scene.field, scene.among(Obstacles.none()), curve) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_an_obstacle_stretches_the_share_of_the_body_point(shape):
    scene = Scene(shape)
    node = len(scene.nodes) // 2
    evaluation = scene.among(_spheres(scene.points[node] + [0.0, 0.0, 0.13], 0.1))
    evaluate_nodes(np.array([node]), evaluation)
    factor = evaluation.factors[node, 0]
    assert factor > 1.0
    step = 1e-6 * scene.random.normal(size=len(shape))
    at = scene.field.coordinates(scene.nodes[node] + np.stack([-step, step]))
    energies, support, _ = piecewise(scene.field, evaluation, at)
    expected = factor * np.sum((scene.place @ (2.0 * step)) ** 2) + 4.0 * step @ scene.rest @ step
    assert energies[0] == pytest.approx(expected, rel=1e-3)
    assert support[0] == pytest.approx(1.0)


def test_clearance_lies_between_that_of_the_nodes_around():
    scene = Scene((12, 10))
    evaluation = scene.among(_spheres(scene.points[40], 0.05))
    points = scene.field.coordinates(scene.random.uniform(-1.0, 1.0, size=(200, 2)))
    _, _, clearance = piecewise(scene.field, evaluation, np.repeat(points, 2, axis=0))
    evaluate_nodes(np.arange(len(scene.nodes)), evaluation)
    known = np.minimum(evaluation.clearance, evaluation.within)
    assert known.min() < 0.0
    for point, found in zip(points, clearance[::2], strict=True):
        around = np.all(np.abs(scene.field.coordinates(scene.nodes) - point) < 1.0, axis=1)
        assert known[around].min() - 1e-12 <= found <= known[around].max() + 1e-12


def test_where_no_node_is_near_there_is_no_length():
    scene = Scene((12, 10), kept=0.3)
    evaluation = scene.among(Obstacles.none())
    assert curve_length(scene.field, evaluation, np.array([[-1.0, -1.0], [1.0, 1.0]])) == math.inf


def _mean_paths(d: int, seed: int) -> MeanPaths:
    random = np.random.default_rng(seed)
    along = np.linspace(-0.8, 0.8, 60)[None, :, None]
    centres = along * np.ones(d) + 0.2 * np.sin(3.0 * along + random.uniform(0.0, 6.0, size=(2, 1, d)))
    roots = np.repeat(np.eye(d) + 0.3 * random.normal(size=(2, 1, d, d)), 60, axis=1)
    return MeanPaths(centres, 9.0 * roots.swapaxes(-1, -2) @ roots, np.array([0.0, 0.7]))


@pytest.mark.parametrize("d", [2, 3, 4])
def test_the_exponent_is_that_of_the_mean_paths_conformal_factor(d):
    mean_paths = _mean_paths(d, seed=d)
    field = Scene((6,) * d, mean_paths=mean_paths).field
    random = np.random.default_rng(1)
    latent = mean_paths.centres[random.integers(2, size=50), random.integers(60, size=50)]
    latent = latent + 0.15 * random.normal(size=latent.shape)
    expected = np.log(mean_paths.conformal_factors(latent, 1.0))
    gradient, curvature, nearest = np.empty(d), np.empty((d, d)), np.empty(2, dtype=np.int64)
    arrays = field.centres, field.precisions, field.penalties, field.strength, field.cap

    def exponent(point: np.ndarray) -> float:
        nearest_samples(point, field.centres, field.precisions, nearest)
        return conformal_exponent(point, *arrays, nearest, gradient, curvature)

    found = np.array([exponent(point) for point in field.coordinates(latent)])
    # The nearest sample is looked for from a few: it may be another valley's of a winding path, never a nearer one.
    assert np.all(found >= expected - 1e-9)
    assert np.mean(np.abs(found - expected) < 1e-9) > 0.9
    for point in field.coordinates(latent[expected < 5.0]):
        exponent(point)
        slope, bowl = gradient.copy(), curvature.copy()
        assert np.all(np.linalg.eigvalsh(bowl) > 0.0)
        for a in range(d):
            step = 1e-6 * np.eye(d)[a]
            change = (exponent(point + step) - exponent(point - step)) / 2e-6
            assert change == pytest.approx(slope[a], rel=1e-4, abs=1e-4)


def test_a_polyline_is_cut_into_pieces_of_the_same_length():
    path = np.random.default_rng(0).normal(size=(9, 3))
    even = evenly(path, 4000)
    steps = np.linalg.norm(np.diff(even, axis=0), axis=1)
    np.testing.assert_allclose(even[[0, -1]], path[[0, -1]], rtol=0.0, atol=1e-12)
    # All but those around a corner.
    assert np.quantile(steps, 0.01) == pytest.approx(steps.max(), rel=1e-6)
    assert steps.sum() == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=1).sum(), rel=1e-3)
