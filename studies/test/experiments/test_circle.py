"""Circles in several postures: what is shown, what counts as a switch, and a small run from data to picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import swivel_angle
from geodesic_motion_ros.skill.skill import NEIGHBOURS
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments import circle
from geodesic_motion_studies.experiments.circle import (
    LITERAL,
    SWIVELS,
    TRAINING,
    Circle,
    CirclePath,
    Circles,
    circle_paths,
    shown_circles,
)
from geodesic_motion_studies.experiments.latent_pictures import grid_around
from geodesic_motion_studies.experiments.metric_graph import MetricGraph


@pytest.fixture(scope="module")
def shown() -> Circles:
    return shown_circles(per_family=2, samples=40)


def test_families_draw_the_same_circles_with_their_elbows_elsewhere(shown) -> None:
    robot = Robot.named("panda")
    for number, configurations in enumerate(shown.configurations):
        tool = np.array([robot.forward(configuration)[0] for configuration in configurations])
        same = np.array([robot.forward(configuration)[0] for configuration in shown.configurations[number % 2]])
        np.testing.assert_allclose(tool, same, atol=1e-8)
        assert np.linalg.norm(tool[-1] - tool[0]) < 0.03
        swivels = [swivel_angle(robot, configuration) for configuration in configurations]
        assert np.abs(np.array(swivels) - SWIVELS[number // 2]).max() < np.radians(12.0)


def test_a_switch_is_a_change_of_the_nearest_family() -> None:
    path = CirclePath(np.zeros((6, 2)), np.zeros((6, 7)), 1, np.array([1, 1, 0, 0, 2, 1]), 0.0)
    assert path.switches == 3
    assert CirclePath(np.zeros((3, 2)), np.zeros((3, 7)), 2, np.array([2, 2, 2]), 0.0).switches == 0


@pytest.mark.parametrize("dimension", [2, 3])
def test_geodesics_switch_between_rings_that_cross_and_not_where_space_keeps_them_apart(dimension) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    codes = np.stack([ring, ring + [0.5, 0.0]])
    if dimension == 3:
        heights = np.broadcast_to([[[0.0]], [[1.0]]], (2, 60, 1))
        codes = np.concatenate([codes, heights], axis=2)
    data = torch.tensor(codes.reshape(-1, dimension))

    def dear_off_the_data(latent: torch.Tensor) -> torch.Tensor:
        distance = torch.cdist(latent, data).amin(dim=1)
        return (1.0 + (10.0 * distance) ** 2)[:, None, None] * torch.eye(dimension, dtype=latent.dtype)

    grid = grid_around(codes, {2: 60, 3: 26}[dimension], 0.1)
    everywhere = np.ones(len(grid.nodes()), dtype=bool)
    graph = MetricGraph.on_grid(dear_off_the_data, grid, everywhere, NEIGHBOURS[dimension])
    paths, apart = circle_paths(graph, codes, Circles(codes, 2), lambda latent: latent)
    assert (len(paths), apart) == (2 * len(circle.BEGINS), 0)
    if dimension == 2:
        assert any(path.switches for path in paths)
    else:
        assert not any(path.switches for path in paths)
        assert all(np.all(path.nearest == path.family) for path in paths)


def test_a_small_run_leaves_table_and_picture(shown, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(circle, "SIDES", {2: 40, 3: 15})
    small = {"hidden": (32, 16), "steps": 30, "batch": 64, "kernels": 40, "precision_iterations": 5}
    study = Circle((0,), ours=replace(TRAINING, **small), literal=replace(LITERAL, **small), shown=shown)
    report, again = study.measure(tmp_path), study.measure(tmp_path)
    assert again.table() == report.table()
    assert len(list(tmp_path.rglob("*.safetensors"))) == 4
    for row in report.rows:
        assert len(row.paths) + row.apart == len(shown.configurations) * len(circle.BEGINS)
        # In the whole box every pair of ends is joined.
        assert row.model == "ours" or row.apart == 0
    assert report.table().count("\n") == 1 + 4
    rows = [(row["model"], row["dimension"]) for row in report.as_dict()["rows"]]
    assert rows == [("ours", 2), ("ours", 3), ("literal", 2), ("literal", 3)]
    report.draw(tmp_path / "circle.png")
    assert (tmp_path / "circle.png").read_bytes().startswith(b"\x89PNG")


def test_nothing_to_learn_is_refused(shown) -> None:
    with pytest.raises(ParameterError, match="at least one"):
        Circle(())
