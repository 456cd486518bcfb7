"""The order of a quaternion's numbers: asked for where the tool points down in the other one, never where it does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.quaternion_order import is_scalar_last, mean_tilts, share_down
from geodesic_motion_ros.demonstrations.readers import read_demonstrations, read_joint_demonstrations
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.robot.kinematics import Robot


def scalar_last_read_as_first(demonstrations: Demonstrations) -> Demonstrations:
    """What comes out when a file in the order x, y, z, w is read as w, x, y, z."""
    items = tuple(replace(item, quaternions=np.roll(item.quaternions, -1, axis=1)) for item in demonstrations)
    return replace(demonstrations, items=items)


def real(recordings: Path, task: str) -> Demonstrations:
    if task in ("pouring", "bottle2shelf"):
        return read_demonstrations(recordings / "robotasks" / f"{task}.npy", "cm")
    joints = read_joint_demonstrations(recordings / "joints" / f"panda_{task}.csv", "panda")
    return joints.tool_demonstrations(Robot.named("panda"))


@pytest.mark.parametrize(
    ("task", "asked"), [("pouring", True), ("bottle2shelf", True), ("assembly", True), ("plum", False)]
)
def test_real_recordings_are_asked_about_in_the_wrong_order_alone(recordings, task, asked) -> None:
    # The tool of `plum` points straight down at a heading at which it does so in both orders.
    shown = real(recordings, task)
    assert not is_scalar_last(shown)
    assert is_scalar_last(scalar_last_read_as_first(shown)) == asked


def test_a_level_tool_is_not_asked_about_where_it_is_level_in_both_orders() -> None:
    half = np.sqrt(0.5)
    level = np.tile([half, 0.0, half, 0.0], (10, 1))  # the z axis along the base's x axis
    positions = np.linspace([0.3, 0.0, 0.3], [0.5, 0.1, 0.3], 10)
    shown = Demonstrations((Demonstration(positions, level, np.arange(10.0), "level"),))
    assert not is_scalar_last(shown)
    assert mean_tilts(shown) == pytest.approx((90.0, 90.0))


def test_the_share_is_that_of_the_rotated_axis() -> None:
    quaternions = np.random.default_rng(0).normal(size=(50, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    axes = to_rotation(quaternions).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(share_down(quaternions), -axes[:, 2], atol=1e-12)
