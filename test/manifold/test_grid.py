"""The lattice and its neighbourhood."""

import numpy as np
import pytest

from geodesic_motion_ros.manifold import grid as grid_module
from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid, stencil
from geodesic_motion_ros.queries.path_smoothing import resample_latent, smooth_latent
from geodesic_motion_ros.utils.errors import PlanningError


@pytest.mark.parametrize(("dimension", "neighbours"), [(2, 8), (2, 16), (2, 32), (3, 26), (3, 98), (4, 80)])
def test_stencil_holds_each_direction_once(dimension, neighbours):
    half = stencil(dimension, neighbours)
    both = np.concatenate([half, -half])
    assert len(np.unique(both, axis=0)) == neighbours
    directions = both / np.linalg.norm(both, axis=1, keepdims=True)
    assert len(np.unique(directions.round(9), axis=0)) == neighbours


def test_stencil_names_the_possible_numbers():
    with pytest.raises(PlanningError, match="8, 16, 32"):
        stencil(2, 12)


def test_edges_of_a_full_grid_join_every_pair_in_reach_once():
    grid = LatentGrid(np.zeros(2), np.ones(2), (5, 4))
    edges = grid.edges(grid.numbering(np.ones(20, dtype=bool)), 8)
    nodes = grid.nodes() / grid.spacing
    steps = np.abs(nodes[edges[:, 0]] - nodes[edges[:, 1]]).round(9)
    assert np.all(steps.max(axis=1) == 1.0)
    assert len(np.unique(np.sort(edges, axis=1), axis=0)) == len(edges) == 4 * 4 + 5 * 3 + 2 * 4 * 3


def test_pruned_nodes_have_no_edges_and_the_rest_is_renumbered():
    grid = LatentGrid(np.zeros(2), np.ones(2), (4, 4))
    kept = np.ones(16, dtype=bool)
    kept[[5, 10]] = False
    nodes = grid.nodes()[kept]
    edges = grid.edges(grid.numbering(kept), 8)
    assert edges.max() == 13
    steps = np.abs(nodes[edges[:, 0]] - nodes[edges[:, 1]]) / grid.spacing
    assert np.all(steps.max(axis=1) < 1.0 + 1e-9)


def test_coordinates_invert_nodes():
    grid = LatentGrid(np.array([-1.0, 2.0, 0.0]), np.array([1.0, 5.0, 0.5]), (3, 4, 5))
    expected = np.stack(np.unravel_index(np.arange(60), grid.shape), axis=1)
    np.testing.assert_allclose(grid.coordinates(grid.nodes()), expected, atol=1e-12)


def test_adjacency_lists_both_ends_of_every_edge():
    edges = np.array([[0, 1], [2, 0], [1, 2]])
    adjacency = Adjacency.from_edges(edges, 4)
    for node in range(4):
        slots = slice(adjacency.first[node], adjacency.first[node + 1])
        for neighbour, edge in zip(adjacency.node[slots], adjacency.edge[slots], strict=True):
            assert {node, neighbour} == set(edges[edge])
    assert np.diff(adjacency.first).tolist() == [2, 2, 2, 0]


@pytest.mark.parametrize(
    ("lower", "upper", "shape", "named"),
    [
        ([0.0, 0.0], [1.0, 0.0], (5, 5), "upper must exceed lower"),
        ([0.0, 0.0], [1.0, 1.0], (5, 1), "at least 2 nodes"),
        ([0.0, 0.0], [1.0, 1.0], (5, 5, 5), "same number"),
    ],
)
def test_an_impossible_box_is_refused(lower, upper, shape, named):
    with pytest.raises(PlanningError, match=named):
        LatentGrid(np.array(lower), np.array(upper), shape)


@pytest.mark.parametrize("shape", [(20_000, 20_000, 20_000), (3_000_000, 4_000_000)])
def test_a_grid_that_memory_does_not_hold_is_refused_before_it_is_made_and_a_smaller_one_proposed(shape):
    dimension = len(shape)
    with pytest.raises(PlanningError, match=r"nodes takes about [\d,.]+ GB, and [\d.]+ GB are free: ") as refused:
        LatentGrid(np.zeros(dimension), np.ones(dimension), shape)
    proposed = tuple(int(side) for side in str(refused.value).split(": ")[-1].removesuffix(" would fit").split(" x "))
    assert all(side < asked for side, asked in zip(proposed, shape, strict=True))
    LatentGrid(np.zeros(dimension), np.ones(dimension), tuple(int(0.9 * side) for side in proposed))


def test_where_the_system_does_not_tell_its_memory_nothing_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(grid_module, "_MEMORY", tmp_path / "none")
    LatentGrid(np.zeros(2), np.ones(2), (10**9, 10**9))


@pytest.mark.parametrize("thickness", [1e-6, 0.02, 0.2])
def test_an_axis_that_the_network_does_not_use_leaves_the_smoothing_of_paths_as_it_is_without_it(thickness):
    """Steps as small as its spacing would leave corners of the grid in the path, which no arm can pass."""
    flat = LatentGrid(np.zeros(2), np.array([6.0, 4.0]), (50, 50))
    grid = LatentGrid(np.zeros(3), np.array([6.0, thickness, 4.0]), (50, 50, 50))
    assert grid.step == flat.step == pytest.approx(4.0 / 49.0, rel=1e-15)
    along = np.repeat(np.arange(30), 2)
    stairs = flat.spacing * np.stack([along[1:], along[:-1]], axis=1)
    raised = np.insert(stairs, 1, 0.5 * thickness, axis=1)
    in_plane, in_space = (smooth_latent(resample_latent(path, flat.step), 2.0) for path in (stairs, raised))
    np.testing.assert_allclose(np.delete(in_space, 1, axis=1), in_plane, rtol=0.0, atol=1e-12)
    chords = np.diff(in_plane, axis=0)
    chords /= np.linalg.norm(chords, axis=1, keepdims=True)
    assert np.min(np.sum(chords[1:] * chords[:-1], axis=1)) > np.cos(np.radians(45.0))


def test_axes_of_much_the_same_spacing_count_alike():
    assert LatentGrid(np.zeros(2), np.array([4.0, 2.0]), (5, 5)).step == 0.5
