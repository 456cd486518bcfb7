"""Transport in joint space: ends are met, the tool goes with them, and nothing else happens."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.robot.inverse_kinematics import pose_error
from geodesic_motion_ros.robot.kinematics import Robot

ROBOT = Robot.named("panda")
NO_MEAN_PATHS = np.zeros((60, 0))
S = np.linspace(0.0, 1.0, 60)
#: Offsets of start and goal [rad], over all joints of length one.
OFFSETS = np.random.default_rng(4).normal(size=(2, 7))
OFFSETS /= np.linalg.norm(OFFSETS, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def curve(reach_demonstrations) -> np.ndarray:
    """A reach (60, 7) [rad], whose elbow swings out in between."""
    return reach_demonstrations.resample(60)[0].configurations


def tool_moves(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Translations [m] and rotation vectors [rad] of the tool, (n, 6)."""
    return np.stack([pose_error(*ROBOT.forward(a), *ROBOT.forward(b)) for a, b in zip(before, after, strict=True)])


@pytest.mark.parametrize("size", [0.01, 0.3, 0.8])
def test_both_ends_are_met_exactly(curve, size):
    asked = curve[[0, -1]] + size * OFFSETS
    offsets = JointOffsets.between(ROBOT, curve[[0, -1]], asked)
    carried = offsets.carried(curve, S, NO_MEAN_PATHS)
    np.testing.assert_allclose(carried[[0, -1]], asked, atol=1e-12)


def test_the_tools_offset_fades_with_its_exponent(curve):
    asked = curve[[0, -1]] + 0.05 * OFFSETS
    for fade in (1.0, 4.0):
        offsets = JointOffsets.between(ROBOT, curve[[0, -1]], asked, fade=fade)
        carried = offsets.carried(curve, S, NO_MEAN_PATHS)
        np.testing.assert_allclose(carried[[0, -1]], asked, atol=1e-12)
        wanted = (1.0 - S[:, None]) ** fade * (offsets.tool[0] - offsets.tool[1]) + offsets.tool[1]
        assert np.abs(tool_moves(curve, carried) - wanted)[:, :3].max() < 0.1 * np.abs(offsets.tool[:, :3]).max()


def test_ends_at_other_progress_are_met_there(curve):
    asked = curve[[10, 50]] + 0.2 * OFFSETS
    offsets = JointOffsets.between(ROBOT, curve[[10, 50]], asked, (float(S[10]), float(S[50])))
    carried = offsets.carried(curve, S, NO_MEAN_PATHS)
    np.testing.assert_allclose(carried[[10, 50]], asked, atol=1e-12)


def test_none_leaves_everything_where_it_is(curve):
    shares = np.full((60, 2), 0.5)
    np.testing.assert_array_equal(JointOffsets.none(ROBOT, 2).carried(curve, S, shares), curve)
    np.testing.assert_array_equal(JointOffsets.none(ROBOT).carried(curve, S, NO_MEAN_PATHS), curve)


def tool_error(curve: np.ndarray, size: float, plainly: bool) -> float:
    """How far [m] the tool is at most from where the blended tool offsets want it."""
    asked = curve[[0, -1]] + size * OFFSETS
    offsets = JointOffsets.between(ROBOT, curve[[0, -1]], asked)
    share = S[:, None]
    carried = offsets.carried(curve, S, NO_MEAN_PATHS)
    if plainly:
        carried = curve + (1.0 - share) * size * OFFSETS[0] + share * size * OFFSETS[1]
    wanted = (1.0 - share) * offsets.tool[0] + share * offsets.tool[1]
    return float(np.linalg.norm((tool_moves(curve, carried) - wanted)[:, :3], axis=1).max())


def test_the_tool_moves_as_asked_but_for_the_second_order(curve):
    errors = [tool_error(curve, size, plainly=False) for size in (0.02, 0.04)]
    assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.15)
    # The control: joint offsets that are blended alone are off in the first order.
    plain = [tool_error(curve, size, plainly=True) for size in (0.02, 0.04)]
    assert plain[1] / plain[0] == pytest.approx(2.0, rel=0.15)
    assert plain[0] > 10.0 * errors[0]


def test_corrections_of_the_mean_paths_come_first(curve):
    corrections = np.zeros((1, 2, 7))
    corrections[0, :, 3] = 0.1, 0.2
    shown = curve[[0, -1]] + corrections[0]
    offsets = JointOffsets.between(ROBOT, shown, shown, corrections=corrections)
    carried = offsets.carried(curve, S, np.ones((60, 1)))
    expected = curve + (0.1 + 0.1 * S)[:, None] * np.eye(7)[3]
    np.testing.assert_allclose(carried, expected, atol=1e-12)
    np.testing.assert_allclose(offsets.carried(curve, S, np.zeros((60, 1))), curve, atol=1e-12)
