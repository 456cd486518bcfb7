"""The meaning of the twin's parameters: where the arm begins, what stands around it, spheres by script."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import yaml

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.nodes.parameter_tables import TWIN
from geodesic_motion_ros.nodes.parameters import Value
from geodesic_motion_ros.nodes.scene_parameter import declared_scene
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT, RobotDescription
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.depth_camera import DepthCameraSettings
from geodesic_motion_ros.simulation.scripted_spheres import NAMED, ScriptedSpheres, spheres_named
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.errors import ParameterError, RobotError, SkillError

# What these hold where nothing else is given, a parameter file with all defaults included.
_DEFAULTS = {parameter.name: parameter.default for parameter in TWIN}
_RATES = ("state_rate", "obstacle_rate", "image_rate", "cloud_rate")


def robot_of(values: Mapping[str, Value]) -> str:
    """Return which robot the twin is: the one that is named, else the skill's; name or folder."""
    if values["robot"]:
        return values["robot"]
    return Skill.load(values["skill"]).robot if values["skill"] else DEFAULT_ROBOT


def base_frame(values: Mapping[str, Value]) -> str:
    """Return the frame of all poses: the one that is given, else the robot's base link, with `joint_prefix`."""
    given = values["base_frame"]
    if given != _DEFAULTS["base_frame"]:
        return given
    return values["joint_prefix"] + RobotDescription.named(robot_of(values)).base_link


def initial_joints(values: Mapping[str, Value], robot: Robot) -> np.ndarray:
    """Return joint positions (eta,) [rad] that a robot starts from: those given, or where the skill begins, or else at
    ready.

    Raises
    ------
    SkillError : there is no such skill, or it is of another robot. RobotError : the robot does not reach its start.
    """
    given = values["initial_joint_positions"]
    if given != _DEFAULTS["initial_joint_positions"]:
        return np.array(given)
    if not values["skill"]:
        return np.round(robot.ready, 4)  # as the default says it of the default robot
    skill = Skill.load(values["skill"])
    own = Robot.named(skill.robot)
    if (own.joint_names, skill.tool_frame) != (robot.joint_names, robot.tool_link):
        raise SkillError(
            f"skill {skill.name} moves the frame {skill.tool_frame!r} of a {skill.robot!r}, the twin is an arm to "
            f"{robot.tool_link!r}: start it with skill:='' to use initial_joint_positions"
        )
    return start_joints(values["skill"])


@cache
def start_joints(name: str) -> np.ndarray:
    """Return joint positions (eta,) [rad] of its robot at the start of a skill, a folder or a shipped name.

    Raises
    ------
    SkillError : there is no such skill. RobotError : there is no such robot, or it does not reach its start.
    """
    skill = Skill.load(name)
    robot = Robot.named(skill.robot)
    if skill.space == "joint":
        joints = skill.mean_configuration("start")
    else:
        joints = solve(robot, skill.start_pose[:3], skill.start_pose[3:])
    joints.setflags(write=False)
    return joints


def steps_per_message(values: Mapping[str, Value]) -> dict[str, int]:
    """Return physics steps from one message to the next, by the parameter of its rate; 0 for never.

    Rounded down, so that the rates are reached.
    """
    rates = {name: values[name] for name in _RATES}
    return {name: 0 if rate == 0.0 else max(1, int(values["physics_rate"] / rate)) for name, rate in rates.items()}


def scene_around(text: str, skill: str) -> DeclaredScene:
    """Return what stands around the arm, by the parameters `scene` and `skill`; where nothing is declared nothing does.
    """
    if text in NAMED or _is_mapping(text):
        raise ParameterError(
            f"parameter scene = {brief(text)}: spheres by script are the parameter `spheres` now; scene is what always "
            "stands around the arm: a file, as in config/scenes, or the name of one of those"
        )
    return declared_scene(text, Skill.load(skill) if skill and not text else None) or DeclaredScene.empty()


def _is_mapping(text: str) -> bool:
    try:
        return isinstance(yaml.safe_load(text), dict)
    except (yaml.YAMLError, ValueError):
        return False


def scripted_spheres(text: str) -> ScriptedSpheres:
    """Return spheres by name, or from a YAML mapping; an empty text is none."""
    try:
        described = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a date that is none
        raise ParameterError(f"spheres is neither a name nor YAML: {' '.join(str(error).split())}") from error
    if described is None:
        return ScriptedSpheres({})
    return spheres_named(described) if isinstance(described, str) else ScriptedSpheres.from_dict(described)


def camera_settings(values: Mapping[str, Value]) -> DepthCameraSettings:
    """Return the camera of the clouds; ParameterError where it cannot stand so."""
    place, target = (tuple(values[name]) for name in ("camera_place", "camera_target"))
    return DepthCameraSettings(place, target, noise=values["cloud_noise"])


def check_twin(values: Mapping[str, Value]) -> None:
    """Refuse values that do not go together: ParameterError."""
    scripted_spheres(values["spheres"])
    camera_settings(values)
    try:
        if values["initial_joint_positions"] != _DEFAULTS["initial_joint_positions"]:
            Robot.named(robot_of(values)).checked(np.array(values["initial_joint_positions"]))
    except (RobotError, SkillError) as error:
        raise ParameterError(f"parameter initial_joint_positions: {error}") from error
    slow = [name for name in _RATES if values[name] > values["physics_rate"]]
    if slow:
        raise ParameterError(
            f"parameter {slow[0]} = {values[slow[0]]:g} Hz: "
            f"expected at most physics_rate, {values['physics_rate']:g} Hz"
        )
