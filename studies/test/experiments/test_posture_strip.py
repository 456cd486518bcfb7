"""Strips of the arm: a row for each motion, its own spheres in it."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.experiments.posture_strip import evenly, posture_strips


def test_the_second_row_alone_shows_its_sphere() -> None:
    ready = Robot.named("panda").ready
    motion = ready + np.linspace(0.0, 0.3, 30)[:, None]
    sphere = {"0": (np.array([0.5, -0.3, 0.4]), 0.08)}
    picture = posture_strips([motion, motion], [{}, sphere], width=64, height=48, postures=3).astype(int)
    assert picture.shape == (2 * 48, 3 * 64, 3)
    red = (picture[..., 0] > 150) & (picture[..., 1] < 100) & (picture[..., 2] < 100)
    assert not np.any(red[:48])
    assert np.any(red[48:])


def test_first_and_last_are_among_what_is_chosen() -> None:
    assert evenly(100, 5).tolist() == [0, 24, 49, 74, 99]
    assert evenly(3, 5).tolist() == [0, 1, 2]
