"""Circles in several postures: what is shown, what counts as a switch, and a small run from data to picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments import circle
from geodesic_motion_ros.experiments.circle import (
    SWIVELS,
    TRAINING,
    Circles,
    CircleWay,
    draw_circle,
    measure_circle,
    shown_circles,
)
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import swivel_angle


@pytest.fixture(scope="module")
def shown() -> Circles:
    return shown_circles(per_family=2, samples=40)


def test_families_draw_the_same_circles_with_their_elbows_elsewhere(shown) -> None:
    robot = Robot.panda()
    for number, configurations in enumerate(shown.configurations):
        tool = np.array([robot.forward(configuration)[0] for configuration in configurations])
        same = np.array([robot.forward(configuration)[0] for configuration in shown.configurations[number % 2]])
        np.testing.assert_allclose(tool, same, atol=1e-8)
        assert np.linalg.norm(tool[-1] - tool[0]) < 0.03
        swivels = [swivel_angle(robot, configuration) for configuration in configurations]
        assert np.abs(np.array(swivels) - SWIVELS[number // 2]).max() < np.radians(12.0)


def test_a_switch_is_a_change_of_the_nearest_family() -> None:
    way = CircleWay(np.zeros((6, 2)), 1, np.array([1, 1, 0, 0, 2, 1]), 0.0)
    assert way.switches == 3
    assert CircleWay(np.zeros((3, 2)), 2, np.array([2, 2, 2]), 0.0).switches == 0


def test_a_small_run_leaves_table_and_picture(shown, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(circle, "SIDES", {2: 40, 3: 15})
    settings = replace(TRAINING, hidden=(32, 16), steps=60, batch=64, kernels=60, precision_iterations=10)
    report = measure_circle((0,), settings, shown)
    for row in report.rows:
        assert len(row.ways) + row.apart == len(shown.configurations) * len(circle.BEGINS)
    assert report.table().count("\n") == 3
    assert [row["dimension"] for row in report.as_dict()["rows"]] == [2, 3]
    draw_circle(report, tmp_path / "circle.png")
    assert (tmp_path / "circle.png").read_bytes().startswith(b"\x89PNG")


def test_nothing_to_learn_is_refused(shown) -> None:
    with pytest.raises(ParameterError, match="at least one"):
        measure_circle((), shown=shown)
