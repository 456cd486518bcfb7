"""JointLimits: what the joints of an arm may do."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.position_based_velocity import PositionBasedVelocity
from geodesic_motion_ros.utils.errors import RobotError

#: Kept from the ends of a joint's range [rad]: arms refuse references that touch them.
POSITION_MARGIN = 0.01


@dataclass(frozen=True)
class JointLimits:
    """Limits of eta joints, (eta,) each.

    Attributes
    ----------
    lower, upper : positions [rad], infinite for continuous joints.
    velocity : [rad/s]. acceleration : [rad/s^2]. jerk : [rad/s^3], infinite where it is not limited.
    position_based_velocity : limits of the speeds towards stops besides; None: there are none.

    Raises
    ------
    RobotError : not all of one length, no room between lower and upper, or a limit that is not positive.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    position_based_velocity: PositionBasedVelocity | None = None

    def __post_init__(self) -> None:
        names = [field.name for field in fields(self) if field.name != "position_based_velocity"]
        for name in names:
            values = np.array(getattr(self, name), dtype=float)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        shapes = {name: getattr(self, name).shape for name in names}
        if len(set(shapes.values())) != 1 or self.lower.ndim != 1:
            raise RobotError(f"joint limits must all be (eta,): they are {shapes}")
        if not np.all(self.lower < self.upper):
            raise RobotError(f"lower limits must be below upper ones: {self.lower} and {self.upper}")
        for name in ("velocity", "acceleration"):
            if not np.all((getattr(self, name) > 0.0) & np.isfinite(getattr(self, name))):
                raise RobotError(f"limits of {name} must be positive and finite: they are {getattr(self, name)}")
        if not np.all(self.jerk > 0.0):
            raise RobotError(f"limits of jerk must be positive: they are {self.jerk}")
        approach = self.position_based_velocity
        if approach is not None and len(approach.lower) != len(self.lower):
            raise RobotError(f"{len(approach.lower)} joints have limits towards stops: there are {len(self.lower)}")

    def covering(self, other: JointLimits) -> JointLimits:
        """The wider of these limits of velocity, acceleration and jerk and of others."""
        names = "velocity", "acceleration", "jerk"
        return replace(self, **{name: np.maximum(getattr(self, name), getattr(other, name)) for name in names})

    def largest_speeds(self, positions: np.ndarray) -> np.ndarray:
        """Largest speeds [rad/s] (2, n, eta) towards lower and towards higher positions at positions (n, eta)."""
        if self.position_based_velocity is None:
            return np.broadcast_to(self.velocity, (2, *positions.shape))
        return np.minimum(self.velocity, self.position_based_velocity.largest_speeds(positions))

    @classmethod
    def of(
        cls,
        robot: Robot,
        speed_scale: float | None = None,
        acceleration_scale: float = 1.0,
        position_margin: float = POSITION_MARGIN,
    ) -> JointLimits:
        """Scale a robot's own limits: velocities by one share, accelerations and jerks by another one in (0, 1].

        Limits of the speeds towards stops are not scaled: the smaller of theirs and the scaled one is the limit.

        Parameters
        ----------
        speed_scale : in (0, `Robot.largest_speed_scale`]; None: the limits as they are, to judge by.

        Raises
        ------
        RobotError : a scale is outside of its range, or the robot has no acceleration limits.
        """
        largest = robot.largest_speed_scale
        if speed_scale is not None and not 0.0 < speed_scale <= largest:
            servo = ": above that a servo that overshoots breaks limits at which the arm stops itself (max_speed_scale)"
            reason = servo if largest < 1.0 else ""
            raise RobotError(f"speed_scale is {speed_scale}: it must be in (0, {largest:g}]{reason}")
        if not 0.0 < acceleration_scale <= 1.0:
            raise RobotError(f"acceleration_scale is {acceleration_scale}: it must be in (0, 1]")
        if not np.all(np.isfinite(robot.acceleration_limits)):
            raise RobotError("the robot has no acceleration limits: give its description a joint_limits.yaml")
        return cls(
            robot.lower + position_margin,
            robot.upper - position_margin,
            (1.0 if speed_scale is None else speed_scale) * robot.velocity_limits,
            acceleration_scale * robot.acceleration_limits,
            acceleration_scale * robot.jerk_limits,
            robot.position_based_velocity,
        )
