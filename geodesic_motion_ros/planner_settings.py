"""PlannerSettings: what a user may choose about planning."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from geodesic_motion_ros.errors import PlanningError
from geodesic_motion_ros.motion_curve import MotionLimits


@dataclass(frozen=True)
class PlannerSettings:
    """What a user may choose. Lengths in metres, angles in radians.

    Attributes
    ----------
    tool_points, tool_radii : spheres (K, 3), (K,) fixed in the tool frame that obstacles are kept away from.
    obstacle_margin : clearance the search keeps from obstacles; the certificate asks for more than 0.
    ambient_strength, ambient_width_ratio : zeta, and Gaussian width over (obstacle + tool radius), of the soft metric.
    ridge_strength : a of the ridges' conformal factor exp(a u^2); 0 leaves the plain pull-back metric.
    query_conditioning : let start and goal choose between the demonstrations, where the skill found that it helps.
    maximum_offset, maximum_offset_angle : how far start and goal may lie from the manifold, or beyond the starts and
        goals that were demonstrated.
    reanchor_distance, reanchor_angle : a start further than this from the current reference begins a new query.
    speed, angular_speed : limits of the tool [m/s], [rad/s].
    acceleration : limit of the tool's acceleration [m/s^2], tangential and centripetal together. That of the angular
        acceleration follows: full angular speed is reached in the time that full speed takes.
    avoidance : False ignores obstacles altogether; for control experiments only.
    grid_shape, neighbours : of the latent graph.
    """

    tool_points: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    tool_radii: tuple[float, ...] = (0.04,)
    obstacle_margin: float = 0.005
    ambient_strength: float = 1000.0
    ambient_width_ratio: float = 0.5
    ridge_strength: float = 1.0
    query_conditioning: bool = True
    maximum_offset: float = 0.05
    maximum_offset_angle: float = 0.5
    reanchor_distance: float = 0.02
    reanchor_angle: float = 0.1
    speed: float = 0.2
    angular_speed: float = 0.8
    acceleration: float = 0.5
    avoidance: bool = True
    grid_shape: tuple[int, ...] = (100, 100)
    neighbours: int = 16

    @property
    def limits(self) -> MotionLimits:
        """Limits of speed and acceleration that references keep."""
        angular_acceleration = self.acceleration * self.angular_speed / self.speed
        return MotionLimits(self.speed, self.angular_speed, self.acceleration, angular_acceleration)

    def __post_init__(self) -> None:
        if len(self.tool_points) != len(self.tool_radii) or not self.tool_points:
            raise PlanningError(
                f"{len(self.tool_points)} tool points and {len(self.tool_radii)} tool radii: "
                "give one radius per point, and at least one"
            )
        if np.shape(self.tool_points)[1:] != (3,) or not np.all(np.isfinite(self.tool_points)):
            raise PlanningError("tool_points must be finite (x, y, z) triples in the tool frame [m]")
        if not all(math.isfinite(radius) and radius >= 0.0 for radius in self.tool_radii):
            raise PlanningError(f"tool radii {self.tool_radii} must be finite and not negative [m]")
        may_be_zero = ("obstacle_margin", "ambient_strength", "ridge_strength", "reanchor_distance", "reanchor_angle")
        for setting in fields(self):
            value = getattr(self, setting.name)
            # A whole number is a number too; the grid judges its own settings.
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            allowed = value >= 0.0 if setting.name in may_be_zero else value > 0.0
            if not (allowed and math.isfinite(value)):
                wanted = "0 or positive" if setting.name in may_be_zero else "positive"
                raise PlanningError(f"setting {setting.name} is {value}, must be finite and {wanted}")
