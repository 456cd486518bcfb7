"""Shortest paths on graphs under metrics whose geodesics are known."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_studies.experiments.metric_graph import (
    MetricGraph,
    evenly,
    latent_length,
    magnification,
    metric_tensors,
)


def stretched(latent: torch.Tensor) -> torch.Tensor:
    """Nine times as dear across a wall at z_1 = 0 as anywhere else, outside of a gate at z_2 > 0.8."""
    wall = (latent[:, 0].abs() < 0.15) & (latent[:, 1] < 0.8)
    return torch.eye(2).double() * torch.where(wall, 81.0, 1.0)[:, None, None]


def length(curve: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


def test_a_path_goes_round_a_wall() -> None:
    grid = LatentGrid(np.array([-1.0, -1.0]), np.array([1.0, 1.0]), (41, 41))
    start, goal = np.array([-0.9, 0.0]), np.array([0.9, 0.0])
    path = MetricGraph.on_grid(stretched, grid, np.ones(41**2, dtype=bool), 16).path(start, goal)
    assert path is not None
    np.testing.assert_array_equal(path[[0, -1]], [start, goal])
    crossing = path[np.abs(path[:, 0]) < 0.1]
    assert np.all(crossing[:, 1] > 0.7)
    assert 2.4 < length(path) < 2.8


def test_what_is_not_joined_has_no_path() -> None:
    grid = LatentGrid(np.array([-1.0, -1.0]), np.array([1.0, 1.0]), (21, 21))
    graph = MetricGraph.on_grid(stretched, grid, np.abs(grid.nodes()[:, 0]) > 0.2, 8)
    assert graph.path(np.array([-0.9, 0.0]), np.array([0.9, 0.0])) is None
    empty = MetricGraph.on_grid(stretched, grid, np.zeros(21**2, dtype=bool), 8)
    assert empty.path(np.array([-0.9, 0.0]), np.array([0.9, 0.0])) is None


def test_magnification_is_the_log_of_the_volume() -> None:
    tensors = metric_tensors(stretched, np.array([[0.0, 0.0], [0.5, 0.0]]))
    assert magnification(tensors) == pytest.approx([np.log(81.0), 0.0])


def test_a_length_counts_the_metric_between_the_corners_too() -> None:
    through = np.array([[-1.0, 0.0], [1.0, 0.0]])
    # 0.3 of 2 are in the wall.
    assert latent_length(stretched, through) == pytest.approx(1.7 + 9.0 * 0.3, rel=0.02)
    assert latent_length(stretched, through + [0.0, 0.9]) == pytest.approx(2.0)
    steps = np.linalg.norm(np.diff(evenly(np.array([[0.0, 0.0], [0.1, 0.0], [1.0, 0.0]]), 11), axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.1, atol=1e-12)
