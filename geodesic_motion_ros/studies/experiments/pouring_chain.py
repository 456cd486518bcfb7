"""One bottle over all cups: three geodesics in a chain, played by the arm among the stands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from geodesic_motion_ros.geometry.curves import interpolate, pose_arc_length
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.planning.status import Verdict
from geodesic_motion_ros.simulation.gestures import RATE_HZ, STEPS_PER_SAMPLE, smooth_step
from geodesic_motion_ros.simulation.joint_teacher import CUP_PLACES
from geodesic_motion_ros.simulation.tabletop import Cylinder, TabletopWorld
from geodesic_motion_ros.simulation.teacher import CUP_REGION, Motion, bottle_in_hand, perform
from geodesic_motion_ros.studies.experiments.held_bottle import bottle_mouth
from geodesic_motion_ros.studies.experiments.pouring_places import PLACES, at_bottle, at_cup, standing_there

#: The arm waits so long over each cup [s].
_PAUSE = 0.5
#: Largest speed of the tool [m/s]; a rotation of one radian counts as so much of its path [m].
_SPEED, _ROTATION_LENGTH = 0.2, 0.25
#: Largest over mean speed of `smooth_step`.
_PEAK = 1.875


@dataclass(frozen=True, eq=False)
class Chain:
    """One bottle over all cups.

    Attributes
    ----------
    parts : the geodesics; fewer than cups where the planner refused one, for a reason.
    mouth_off : of each part, horizontal distance of the bottle's mouth from the cup's axis when it is poured [m].
    behind : largest distance of the tool from where it was to be at the time [m].
    clearance : least distance of the arm from what stands there [m].
    joints : (k, 7) what the arm did [rad].
    """

    seed: int
    parts: tuple[PosePath, ...]
    reason: str = ""
    mouth_off: tuple[float, ...] = ()
    behind: float = math.nan
    clearance: float = math.nan
    joints: np.ndarray = field(default_factory=lambda: np.empty((0, 7)))


def pour_all_cups(planner: PosePathPlanner, seed: int, bottle: int = 0) -> Chain:
    """Plan and play the chain of one bottle."""
    planner.take_obstacles(Obstacles.none())
    stops = [at_bottle(bottle), *(at_cup(cup) for cup in PLACES)]
    parts: list[PosePath] = []
    for begin, end in pairwise(stops):
        path = planner.plan(*begin, *end)
        if isinstance(path, Verdict):
            return Chain(seed, tuple(parts), f"part {len(parts)}: {path.reason}")
        parts.append(path)
    motion, poured = _played(parts, standing_there(bottle))
    with TabletopWorld(rate_hz=RATE_HZ * STEPS_PER_SAMPLE) as world:
        done = perform(world, motion)
    tool = done.demonstration
    mouth = [bottle_mouth(tool.positions[at], tool.quaternions[at]) for at in poured]
    cups = [CUP_REGION.at(np.array(CUP_PLACES[cup])) for cup in PLACES]
    off = tuple(float(np.linalg.norm(place[:2] - cup)) for place, cup in zip(mouth, cups, strict=True))
    behind = float(np.linalg.norm(tool.positions - motion.positions, axis=1).max())
    return Chain(seed, tuple(parts), "", off, behind, done.clearance, done.joint_positions)


def _played(parts: Sequence[PosePath], solid: Sequence[Cylinder]) -> tuple[Motion, list[int]]:
    """Paths one after the other, each from rest to rest with a pause after it, and the last samples of the pauses."""
    poses, poured, count = [], [], 0
    for part in parts:
        length = pose_arc_length(part.positions, part.quaternions, _ROTATION_LENGTH)
        seconds = _PEAK * length[-1] / _SPEED
        # `smooth_step` stays at 1 in the pause.
        phase = smooth_step(np.arange(0.0, seconds + _PAUSE, 1.0 / RATE_HZ) / seconds)
        poses.append(interpolate(length, part.positions, part.quaternions, length[-1] * phase))
        count += len(phase)
        poured.append(count - 1)
    positions, quaternions = (np.concatenate(arrays) for arrays in zip(*poses, strict=True))
    times = np.arange(count) / RATE_HZ
    return Motion("chain", times, positions, continuous_signs(quaternions), tuple(solid), bottle_in_hand()), poured
