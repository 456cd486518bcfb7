"""Joints that are reported in [-pi, pi), or with turns counted: the motion that was made, and only where it may be."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.takes import Action, Take
from geodesic_motion_ros.demonstrations.turns import TURN, align_turns, unwrap_turns

NAMES = ("endless", "short", "wide")
ROBOT = SimpleNamespace(lower=np.array([-np.inf, -2.0, -TURN]), upper=np.array([np.inf, 2.0, TURN]))


def take(*columns: np.ndarray, name: str = "take") -> Take:
    return Take(name, 0.01 * np.arange(len(columns[0])), np.stack(columns, axis=1), NAMES)


def wrapped(angles: np.ndarray, lowest: float = -np.pi) -> np.ndarray:
    return (angles - lowest) % TURN + lowest


TURNING, STILL = np.linspace(2.8, 3.9, 200), np.zeros(200)


@pytest.mark.parametrize("lowest", [-np.pi, 0.0])
@pytest.mark.parametrize("first", [2.8, 6.0, -3.3, -6.5, 0.0])
def test_a_joint_that_wraps_turns_on(first: float, lowest: float) -> None:
    angles = first + 0.9 * np.sin(np.linspace(0.0, 6.0, 200))
    motion, flaws = unwrap_turns(take(wrapped(angles, lowest), STILL, STILL), ROBOT)
    np.testing.assert_allclose(np.diff(motion.values[:, 0]), np.diff(angles), atol=1e-12)
    assert motion.values[0, 0] == wrapped(angles, lowest)[0]
    assert [flaw.action for flaw in flaws] == ([Action.READ] if np.ptp(wrapped(angles, lowest)) > 2.0 else [])


def test_joints_that_pass_are_named_with_the_time() -> None:
    (flaw,) = unwrap_turns(take(wrapped(TURNING), STILL, wrapped(TURNING)), ROBOT)[1]
    assert flaw.what == "steps by whole turns in endless, wide"
    assert flaw.time == pytest.approx(0.01 * np.argmax(np.pi <= TURNING))


def test_a_joint_turns_on_only_within_its_limits() -> None:
    """Elsewhere the step is a jump, for other rules. So is a step that is no whole turn."""
    beyond = np.where(np.arange(200) < 100, 6.0, 6.5 - TURN)
    step = np.where(np.arange(200) < 100, 0.0, 4.0)
    for columns in ((STILL, STILL, beyond), (step, STILL, STILL)):
        motion = take(*columns)
        assert unwrap_turns(motion, ROBOT) == (motion, [])


def test_motions_whole_turns_apart_are_brought_together_where_the_joint_has_no_end() -> None:
    motions = [take(TURNING, STILL, STILL + 3.0, name="one"), take(TURNING - TURN, STILL, STILL - 3.0, name="two"),
               take(TURNING + 2.0, STILL, STILL, name="three")]
    moved, (flaw,) = align_turns(motions, ROBOT)
    np.testing.assert_allclose(moved[1].values[:, 0], TURNING, atol=1e-12)
    np.testing.assert_array_equal(moved[1].values[:, 1:], motions[1].values[:, 1:])
    assert (moved[0], moved[2]) == (motions[0], motions[2])
    assert flaw.what == "is whole turns from 'one' in endless"
