"""JointLimits: what the joints of an arm may do."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from geodesic_motion_ros.robot.kinematics import Robot
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

    Raises
    ------
    RobotError : not all of one length, no room between lower and upper, or a limit that is not positive.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray

    def __post_init__(self) -> None:
        for field in fields(self):
            values = np.array(getattr(self, field.name), dtype=float)
            values.setflags(write=False)
            object.__setattr__(self, field.name, values)
        shapes = {field.name: getattr(self, field.name).shape for field in fields(self)}
        if len(set(shapes.values())) != 1 or self.lower.ndim != 1:
            raise RobotError(f"joint limits must all be (eta,): they are {shapes}")
        if not np.all(self.lower < self.upper):
            raise RobotError(f"lower limits must be below upper ones: {self.lower} and {self.upper}")
        for name in ("velocity", "acceleration"):
            if not np.all((getattr(self, name) > 0.0) & np.isfinite(getattr(self, name))):
                raise RobotError(f"limits of {name} must be positive and finite: they are {getattr(self, name)}")
        if not np.all(self.jerk > 0.0):
            raise RobotError(f"limits of jerk must be positive: they are {self.jerk}")

    def covering(self, other: JointLimits) -> JointLimits:
        """The wider of these limits of velocity, acceleration and jerk and of others."""
        names = "velocity", "acceleration", "jerk"
        return JointLimits(
            self.lower, self.upper, *(np.maximum(getattr(self, name), getattr(other, name)) for name in names)
        )

    @classmethod
    def of(
        cls,
        robot: Robot,
        speed_scale: float = 1.0,
        acceleration_scale: float = 1.0,
        position_margin: float = POSITION_MARGIN,
    ) -> JointLimits:
        """A robot's own limits: velocities times one scale in (0, 1], accelerations and jerks times the other.

        Raises
        ------
        RobotError : a scale outside (0, 1], or the robot has no acceleration limits.
        """
        for name, scale in (("speed_scale", speed_scale), ("acceleration_scale", acceleration_scale)):
            if not 0.0 < scale <= 1.0:
                raise RobotError(f"{name} is {scale}: it must be in (0, 1]")
        if not np.all(np.isfinite(robot.acceleration_limits)):
            raise RobotError("the robot has no acceleration limits: give its description a joint_limits.yaml")
        return cls(
            robot.lower + position_margin,
            robot.upper - position_margin,
            speed_scale * robot.velocity_limits,
            acceleration_scale * robot.acceleration_limits,
            acceleration_scale * robot.jerk_limits,
        )
