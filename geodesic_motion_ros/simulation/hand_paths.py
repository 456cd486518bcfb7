"""How a hand would pull the tool to demonstrate what a skill was learned from, each time a little differently.

With x_i the poses of a demonstration i as the skill decodes it, u in [0, 1] how far a motion has come and h a smooth
step, the hand wants the tool at

    x(u) = x_i(u) + (1 - h(u)) start + h(u) goal + hand(u),

start and goal drawn for each path, hand(u) slow waves that vanish at both ends (`gestures.hand`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.curves import interpolate
from geodesic_motion_ros.geometry.quaternions import continuous_signs, rotate_by
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.gestures import check_count, hand, pacing, smooth_step
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError

#: Starts and goals lie within this [m] of the demonstration's.
END_SPREAD = 0.015
#: Standard deviations of the hand in the middle of a path [m], [rad].
UNSTEADY = 0.004, np.radians(1.0)
#: How fast a hand leads the tool to where a path begins [m/s], and for how long at least [s].
LEADING_SPEED, SHORTEST_LEAD = 0.15, 1.0


@dataclass(frozen=True, eq=False)
class HandPath:
    """Poses of the tool over time: times (T,) [s] from 0, positions (T, 3) [m], quaternions (T, 4), base frame."""

    times: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray

    @classmethod
    def between(cls, start: tuple[np.ndarray, np.ndarray], goal: tuple[np.ndarray, np.ndarray]) -> HandPath:
        """From one pose to another in a straight line, from rest to rest."""
        duration = max(SHORTEST_LEAD, float(np.linalg.norm(goal[0] - start[0])) / LEADING_SPEED)
        times = np.linspace(0.0, duration, 100)
        ends = [np.stack(pair) for pair in zip(start, goal, strict=True)]
        poses = interpolate(np.array([0.0, 1.0]), ends[0], continuous_signs(ends[1]), smooth_step(times / duration))
        return cls(times, *poses)

    @property
    def start(self) -> tuple[np.ndarray, np.ndarray]:
        return self.positions[0], self.quaternions[0]

    def back(self) -> HandPath:
        """The same from its end to its start."""
        return HandPath(self.times[-1] - self.times[::-1], self.positions[::-1], self.quaternions[::-1])

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """The pose at a time [s]; that of an end outside of its times."""
        positions, quaternions = interpolate(
            self.times, self.positions, self.quaternions, np.clip([time], 0.0, self.times[-1])
        )
        return positions[0], quaternions[0]


def hand_paths(skill: Skill, count: int, seed: int, duration: float) -> list[HandPath]:
    """Paths along a skill's demonstrations, one after the other; the same seed gives the same paths.

    Parameters
    ----------
    duration : about how long each takes [s], from rest to rest.

    Raises
    ------
    ParameterError : the count is below one, the duration not positive.
    """
    check_count("count", count)
    if not (np.isfinite(duration) and duration > 0.0):
        raise ParameterError(f"duration is {duration:g} s: it must be positive")
    generator = np.random.default_rng(seed)
    return [_path(skill, number % len(skill.codes), duration, generator) for number in range(count)]


def _path(skill: Skill, demonstration: int, duration: float, generator: np.random.Generator) -> HandPath:
    positions, quaternions = _demonstrated(skill, demonstration)
    times, phase = pacing(duration, generator)
    positions, quaternions = interpolate(np.linspace(0.0, 1.0, len(positions)), positions, quaternions, phase)
    start, goal = END_SPREAD * generator.uniform(-1.0, 1.0, (2, 3))
    share = smooth_step(phase)[:, None]
    positions = positions + (1.0 - share) * start + share * goal + hand(phase, UNSTEADY[0], generator)
    return HandPath(times, positions, rotate_by(hand(phase, UNSTEADY[1], generator), quaternions))


def _demonstrated(skill: Skill, demonstration: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses of the tool along a demonstration, as the skill decodes it: (T, 3) [m] and (T, 4)."""
    codes = skill.codes[demonstration]
    if not isinstance(skill.decoder, JointSpaceDecoder):
        positions, quaternions = skill.decoder.poses(codes)
    else:
        robot = Robot.named(skill.robot)
        poses = [robot.forward(configuration) for configuration in skill.decoder.configurations(codes)]
        positions, quaternions = map(np.array, zip(*poses, strict=True))
    return positions, continuous_signs(quaternions)
