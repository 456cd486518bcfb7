"""The meaning of the parameters of a node that plans."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rclpy.node import Node

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.parameters import NodeParameters, Value
from geodesic_motion_ros.robot.collision_model import tool_spheres
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError, RobotError, SkillError

_SETTINGS = (
    "avoidance", "avoid", "obstacle_margin", "obstacle_position_error", "ambient_strength", "ambient_width_ratio",
    "ambient_law", "cost_cap", "ridge_strength", "query_conditioning", "prediction", "maximum_offset",
    "maximum_offset_angle", "maximum_joint_offset", "speed_scale", "acceleration_scale", "latency", "body_radius",
    "refine", "timing", "periodic", "rounds", "detour", "unseen", "patience", "approach_covered_goal",
)  # fmt: skip
#: The arm rests where `speed_override` leaves less than this share of the joints' velocity limits: motions of minutes
#: take too long to be planned in a tick.
_LEAST_SHARE = 0.01
#: Negative: what belongs to the kind of skill.
_TOOL_LIMITS = ("speed", "angular_speed", "acceleration")


def load_skill(node: Node, options: NodeParameters) -> Skill:
    """Load the skill that a node's parameters name, and let what belongs to its robot stand in for their defaults.

    Raises
    ------
    SkillError : the skill is missing, damaged or of another robot.
    """
    node.get_logger().info(f"loading the skill {options['skill']}")
    skill = Skill.load(options["skill"])
    try:
        options.stand_in(defaults_of_robot(skill, options.values))
        robot = Robot.named(skill.robot)
    except RobotError as error:
        raise SkillError(f"{options['skill']}: {error}") from error
    if skill.tool_frame != robot.tool_link:
        raise SkillError(
            f"skill {skill.name} moves the frame {skill.tool_frame!r}, this node drives {robot.tool_link!r}"
        )
    if options["base_frame"] != options["joint_prefix"] + skill.base_frame:
        node.get_logger().warning(
            f"base_frame {options['base_frame']!r} is taken for the skill's {skill.base_frame!r}"
        )
    return skill


def defaults_of_robot(skill: Skill, values: Mapping[str, Value]) -> dict[str, Value]:
    """Return values of the skill's own robot for the parameters that are still those of the default one; RobotError:
    none.
    """
    of_default = {parameter.name: parameter.default for parameter in PLANNER}
    spheres = tool_spheres(skill.robot).ravel().tolist()
    own = {"base_frame": values["joint_prefix"] + skill.base_frame, "tool_spheres": spheres}
    return {name: value for name, value in own.items() if name in values and values[name] == of_default[name]}


def planner_settings(values: Mapping[str, Value]) -> PlannerSettings:
    """Return the settings of a planner, or of a filter; PlanningError where parameters do not go together."""
    chosen = {name: values[name] for name in _SETTINGS if name in values}
    chosen |= {name: None if values[name] < 0.0 else values[name] for name in _TOOL_LIMITS}
    if "tool_spheres" in values:
        spheres = np.array(values["tool_spheres"]).reshape(-1, 4)
        points, radii = map(tuple, spheres[:, :3].tolist()), spheres[:, 3].tolist()
        chosen |= {"tool_points": tuple(points), "tool_radii": tuple(radii)}
    # An arm that rests is not slow besides.
    return PlannerSettings(speed_override=1.0 if why_paused(values) else values["speed_override"], **chosen)


def why_paused(values: Mapping[str, Value]) -> str:
    """Return why `speed_override` has the arm rest on its path; "" where it may move."""
    override, scale = values["speed_override"], values["speed_scale"]
    if override * scale >= _LEAST_SHARE - 1e-9:
        return ""
    return (
        f"speed_override is {override:g}: the arm rests on its path until it is {_LEAST_SHARE / scale:.2g} or more, "
        f"with speed_scale {scale:g}"
    )


def tool_tolerance(values: Mapping[str, Value]) -> tuple[float, float]:
    """Return the largest distance [m] and angle [rad] of the tool from where it was sent."""
    return values["tracking_tolerance"], values["tracking_tolerance_angle"]


def refuse_no_rotation(values: Mapping[str, Value]) -> None:
    """Refuse a task frame that is none: ParameterError."""
    if np.linalg.norm(values["task_frame"][3:]) < 1e-6:
        raise ParameterError(
            "parameter task_frame ends with a zero quaternion: end it with 1.0, 0.0, 0.0, 0.0 where nothing is turned"
        )
