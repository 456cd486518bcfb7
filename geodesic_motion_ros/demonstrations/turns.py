"""Whole turns of joints: drivers report a joint without an end in [-pi, pi), or count its turns since they started."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take

if TYPE_CHECKING:
    from geodesic_motion_ros.robot.kinematics import Robot

TURN = 2.0 * np.pi
#: A step that is this close [rad] to whole turns is none of the arm: joints turn by less from sample to sample.
CLOSE = 1.0


def unwrap_turns(take: Take, robot: Robot) -> tuple[Take, list[Flaw]]:
    """Take steps of whole turns out of a take; with what was found.

    Only of joints that have room for it: the limits of the robot hold for the result.
    """
    steps = np.diff(take.values, axis=0, prepend=take.values[:1])
    turns = np.rint(steps / TURN)
    turns[np.abs(steps - TURN * turns) > CLOSE] = 0.0
    values = take.values - TURN * np.cumsum(turns, axis=0)
    inside = np.all((values >= robot.lower) & (values <= robot.upper), axis=0)
    passed = inside & np.any(turns != 0.0, axis=0)
    if not np.any(passed):
        return take, []
    first = int(np.argmax(np.any(turns[:, passed] != 0.0, axis=1)))
    what = f"steps by whole turns in {_listed(take, passed)}"
    flaw = Flaw(take.name, float(take.times[first]), what, Action.READ, "as a joint that turns on")
    return replace(take, values=np.where(passed, values, take.values)), [flaw]


def align_turns(motions: Sequence[Take], robot: Robot) -> tuple[list[Take], list[Flaw]]:
    """Move joints without an end to within half a turn of those of the first motion; with what was found."""
    moved, flaws = [], []
    endless = np.isinf(robot.lower) & np.isinf(robot.upper)
    for motion in motions:
        apart = np.mean(motion.values[[0, -1]] - motions[0].values[[0, -1]], axis=0)
        turns = np.where(endless, np.rint(apart / TURN), 0.0)
        if np.any(turns != 0.0):
            what = f"is whole turns from '{motions[0].name}' in {_listed(motion, turns != 0.0)}"
            flaws.append(Flaw(motion.name, float(motion.times[0]), what, Action.READ, "without them"))
            motion = replace(motion, values=motion.values - TURN * turns)
        moved.append(motion)
    return moved, flaws


def _listed(take: Take, chosen: np.ndarray) -> str:
    return ", ".join(name for name, each in zip(take.names, chosen, strict=True) if each)
