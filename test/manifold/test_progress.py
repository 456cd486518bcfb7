"""Progress is tabulated on the grid: exact at its nodes, linear between, constant outside."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.progress import ProgressMap

GRID = LatentGrid(np.array([-4.0, -2.0]), np.array([4.0, 2.0]), (60, 40))


def strip(count: int = 5) -> np.ndarray:
    s = np.linspace(0.0, 1.0, 50)
    height = np.linspace(-0.5, 0.5, count)[:, None] * np.sin(np.pi * s)
    return np.stack([np.tile(6.0 * s - 3.0, (count, 1)), height], axis=-1)


def test_at_the_nodes_it_is_the_mean_paths_own():
    mean_paths = MeanPaths.of_codes(strip(), np.zeros(5, dtype=int))
    progress, shares = ProgressMap.from_mean_paths(mean_paths, GRID)(GRID.nodes())
    expected = mean_paths.coordinates(GRID.nodes())
    np.testing.assert_allclose(progress, expected[0], atol=1e-9)
    np.testing.assert_allclose(shares, expected[1], atol=1e-9)


def test_it_is_linear_between_the_nodes_and_held_outside():
    table = np.arange(2400.0) / 2399.0
    progress = ProgressMap(table, np.stack([table, 1.0 - table], axis=1), GRID)
    nodes = GRID.nodes()
    middle, shares = progress(0.5 * (nodes[:1] + nodes[1:2]))
    np.testing.assert_allclose(middle, 0.5 * (table[:1] + table[1:2]), rtol=1e-9)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    far, _ = progress(np.array([[-100.0, -100.0], [100.0, 100.0]]))
    np.testing.assert_allclose(far, [0.0, 1.0])


def test_along_codes_it_runs_from_start_to_goal_and_knows_no_mean_paths():
    codes = strip()
    progress = ProgressMap.from_codes(codes, GRID)
    for own in codes:
        found, shares = progress(own)
        assert np.abs(found - np.linspace(0.0, 1.0, 50)).max() < 0.1
        assert shares.shape == (50, 0)


def test_a_single_demonstration_is_enough():
    codes = strip(1)
    assert np.abs(ProgressMap.from_codes(codes, GRID)(codes[0])[0] - np.linspace(0.0, 1.0, 50)).max() < 0.1


def test_what_is_worked_out_near_kept_nodes_is_what_is_worked_out_everywhere() -> None:
    codes = np.stack([np.stack([np.linspace(-2.0, 2.0, 30), np.full(30, y)], axis=1) for y in (-0.5, 0.0, 0.4)])
    mean_paths = MeanPaths.of_codes(codes, np.array([0, 0, 1]))
    grid = LatentGrid(np.array([-2.5, -1.0]), np.array([2.5, 1.0]), (60, 40))
    kept = np.abs(grid.nodes()[:, 1]) < 0.5
    near, everywhere = (ProgressMap.from_mean_paths(mean_paths, grid, *mask) for mask in ((kept,), ()))
    points = np.random.default_rng(0).uniform([-2.4, -0.5], [2.4, 0.5], (200, 2))
    for found, expected in zip(near(points), everywhere(points), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)
    # Elsewhere it stays what it is at the nearest of them.
    far, rim = np.array([[0.3, 0.99]]), np.array([[0.3, 0.5]])
    np.testing.assert_allclose(near(far)[0], near(rim)[0], atol=0.05)
