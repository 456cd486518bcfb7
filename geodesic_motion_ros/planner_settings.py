"""What a user may choose about planning."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Literal, get_args

import numpy as np

from geodesic_motion_ros.errors import PlanningError
from geodesic_motion_ros.graph.ambient_law import LAWS, AmbientLaw
from geodesic_motion_ros.trajectory.tool_limits import ToolLimits

#: Ways among obstacles that move are certified with this multiple of the obstacle margin: nothing moves exactly as
#: expected.
MOVING_MULTIPLE = 2.0
#: What sets out or goes on among them is to be able to stop so long later [s]: by then it has been looked at again.
LOOKED_AT_AGAIN = 0.03
#: Where they may come to a stand meanwhile is told by so many places each, the first where they were last seen.
STOPPING_PLACES = 12


#: Limits of the tool with skills of tool poses, where no others are set.
TOOL_LIMITS = ToolLimits(speed=0.2, angular_speed=0.8, acceleration=1.5)
#: Which spheres of the arm are kept away from obstacles: all, or the tool's alone.
Avoid = Literal["arm", "tool"]


@dataclass(frozen=True)
class PlannerSettings:
    """Settings of planning, for every kind of skill. Lengths in metres, angles in radians.

    Attributes
    ----------
    obstacle_margin : clearance the search keeps from obstacles; the certificate asks for more than 0.
    obstacle_position_error : how far obstacles may be from where their source says that they are: so much larger they
        are taken to be, and by how far the arm was off its path (`planning/tracking.py`).
    ambient_strength, ambient_width_ratio : zeta, and Gaussian width over (obstacle + body radius), of the soft metric.
    ambient_law : how it grows towards obstacles: gaussian, completed, or hard: not at all (`graph/ambient.py`).
    ridge_strength : a of the ridges' conformal factor exp(a u^2); 0 leaves the plain pull-back metric.
    cost_cap : paths that cost more than so many times what a demonstration costs without obstacles count as blocked.
    query_conditioning : let start and goal choose between the demonstrations, where the skill found that it helps.
    prediction : obstacles are expected to move on linearly for so long [s], and to stand then; where that leaves
        no path, what moves is not counted after it. It must be longer than a stop takes, latency included,
        which is 0.5 s: what comes into sight later cannot be stopped for.
    avoidance : False ignores obstacles altogether; for control experiments only.
    avoid : "arm", or "tool": of the arm the tool's spheres alone are kept away from obstacles.
    grid_shape, neighbours : of the latent graph; None: the skill's own.
    refine : make the graph's shortest paths continuous ones, which know no directions of a grid.
    tool_points, tool_radii : spheres (K, 3), (K,) fixed in the tool frame. The metric of a skill of tool poses sees
        them, and they are what is kept away from obstacles where only the tool is.
    maximum_offset, maximum_offset_angle : how far start and goal of a skill of tool poses may lie from the manifold, or
        beyond the starts and goals that were demonstrated.
    maximum_joint_offset : the same of a skill of configurations, over all joints [rad].
    body_radius : radius of the body around its points, as the soft metric of a skill of configurations sees it. What is
        hard, the removal of nodes and the certificate, knows the arm's collision spheres.
    speed_scale, acceleration_scale : share of the joints' velocity limits, and of their acceleration and jerk limits.
    speed, angular_speed : limits of the tool [m/s], [rad/s]. 0: none; None: 0.2 and 0.8 with skills of tool poses, none
        with those of configurations.
    acceleration : limit of the tool's acceleration [m/s^2], tangential and centripetal together; None: 1.5, or none.
        That of the angular acceleration follows: full angular speed is reached in the time that full speed takes.
    latency : a new reference takes over so long after its planning began [s].
    """

    obstacle_margin: float = 0.005
    obstacle_position_error: float = 0.0
    ambient_strength: float = 1000.0
    ambient_width_ratio: float = 0.5
    ambient_law: AmbientLaw = "gaussian"
    ridge_strength: float = 1.0
    cost_cap: float = 20.0
    query_conditioning: bool = True
    prediction: float = 1.6
    avoidance: bool = True
    avoid: Avoid = "arm"
    grid_shape: tuple[int, ...] | None = None
    neighbours: int | None = None
    refine: bool = True
    tool_points: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    tool_radii: tuple[float, ...] = (0.04,)
    maximum_offset: float = 0.05
    maximum_offset_angle: float = 0.5
    maximum_joint_offset: float = 0.5
    body_radius: float = 0.08
    speed_scale: float = 0.3
    acceleration_scale: float = 0.2
    speed: float | None = None
    angular_speed: float | None = None
    acceleration: float | None = None
    latency: float = 0.03

    #: Settings that may be 0.
    may_be_zero: ClassVar[tuple[str, ...]] = (
        "obstacle_margin", "obstacle_position_error", "ambient_strength", "ridge_strength", "prediction", "speed",
        "angular_speed", "acceleration",
    )  # fmt: skip

    def tool_limits(self, of_tool_poses: bool) -> ToolLimits:
        """Limits of the tool with a skill of tool poses, or with one of configurations."""
        default = TOOL_LIMITS if of_tool_poses else ToolLimits()
        chosen = {field.name: getattr(self, field.name) for field in fields(ToolLimits)}
        return replace(default, **{name: value for name, value in chosen.items() if value is not None})

    def __post_init__(self) -> None:
        for name, choices in (("ambient_law", LAWS), ("avoid", get_args(Avoid))):
            if getattr(self, name) not in choices:
                raise PlanningError(f"setting {name} is '{getattr(self, name)}', must be one of {', '.join(choices)}")
        if len(self.tool_points) != len(self.tool_radii) or not self.tool_points:
            raise PlanningError(
                f"{len(self.tool_points)} tool points and {len(self.tool_radii)} tool radii: "
                "give one radius per point, and at least one"
            )
        if np.shape(self.tool_points)[1:] != (3,) or not np.all(np.isfinite(self.tool_points)):
            raise PlanningError("tool_points must be finite (x, y, z) triples in the tool frame [m]")
        if not all(math.isfinite(radius) and radius >= 0.0 for radius in self.tool_radii):
            raise PlanningError(f"tool radii {self.tool_radii} must be finite and not negative [m]")
        for setting in fields(self):
            value = getattr(self, setting.name)
            # A whole number is a number too; the grid judges its own settings.
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            allowed = value >= 0.0 if setting.name in self.may_be_zero else value > 0.0
            if not (allowed and math.isfinite(value)):
                wanted = "0 or positive" if setting.name in self.may_be_zero else "positive"
                raise PlanningError(f"setting {setting.name} is {value}, must be finite and {wanted}")
