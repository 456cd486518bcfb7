"""ToolLimits: how fast the tool of an arm may move and turn, and how hard it may accelerate."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from geodesic_motion_ros.utils.errors import PlanningError


@dataclass(frozen=True)
class ToolLimits:
    """Limits of the norms of the tool's velocities and accelerations in the base frame; 0 where there is no limit.

    Attributes
    ----------
    speed, angular_speed : [m/s], [rad/s]. acceleration : tangential and centripetal together [m/s^2].

    Raises
    ------
    PlanningError : a limit is negative or not finite.
    """

    speed: float = 0.0
    angular_speed: float = 0.0
    acceleration: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise PlanningError(f"setting {field.name} is {value}, must be finite and 0 or positive")

    @property
    def angular_acceleration(self) -> float:
        """[rad/s^2], so that full angular speed is reached in the time of full speed; 0 where one has no limit."""
        return self.acceleration * self.angular_speed / self.speed if self.speed else 0.0

    @property
    def limited(self) -> bool:
        """Whether there is any limit."""
        return any(getattr(self, field.name) > 0.0 for field in fields(self))
