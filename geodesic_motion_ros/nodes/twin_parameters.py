"""What the twin's parameters stand for: where the arm begins, what stands around it, spheres by script."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import yaml

from geodesic_motion_ros.nodes.parameter_tables import TWIN
from geodesic_motion_ros.nodes.parameters import Value
from geodesic_motion_ros.nodes.scene_parameter import declared_scene
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.scripted_spheres import NAMED, ScriptedSpheres, spheres_named
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.errors import ParameterError, RobotError, SkillError

# What `initial_joint_positions` holds where nothing else is given, a parameter file with all defaults included.
_READY = next(parameter.default for parameter in TWIN if parameter.name == "initial_joint_positions")
_RATES = ("state_rate", "obstacle_rate", "image_rate")


def initial_joints(values: Mapping[str, Value]) -> np.ndarray:
    """Joint positions (7,) [rad] to start from: those given, or where the skill begins."""
    given = values["initial_joint_positions"]
    return start_joints(values["skill"]) if values["skill"] and given == _READY else np.array(given)


@cache
def start_joints(name: str) -> np.ndarray:
    """Joint positions (7,) [rad] of a Panda at the start of a skill, a folder or a shipped name.

    A skill of joint space begins where its first group of demonstrations does on average, on the raw sheet where the
    first demonstration does.

    Raises
    ------
    SkillError : there is no such skill, or it is of another robot.
    RobotError : the Panda does not reach its start.
    """
    skill, robot = Skill.load(name), Robot.panda()
    if (skill.robot, skill.tool_frame) != ("panda", robot.tool_link):
        raise SkillError(
            f"skill {skill.name} moves the frame {skill.tool_frame!r} of a {skill.robot!r}, the twin is a 'panda' with "
            f"{robot.tool_link!r}: start it with skill:='' to use initial_joint_positions"
        )
    if skill.canonical is None and skill.space == "joint":
        joints = skill.decoder.configurations(skill.codes[0, :1])[0]
    elif skill.space == "joint":
        joints = skill.canonical.start_poles[0].copy()
    else:
        joints = solve(robot, skill.start_pose[:3], skill.start_pose[3:])
    joints.setflags(write=False)
    return joints


def steps_per_message(values: Mapping[str, Value]) -> dict[str, int]:
    """Physics steps from one message to the next, by the parameter of its rate; 0 for never.

    Rounded down, so that the rates are reached.
    """
    rates = {name: values[name] for name in _RATES}
    return {name: 0 if rate == 0.0 else max(1, int(values["physics_rate"] / rate)) for name, rate in rates.items()}


def scene_around(text: str, skill: str) -> DeclaredScene:
    """What stands around the arm, by the parameters `scene` and `skill`; where nothing is declared nothing does."""
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
    """Spheres by name, or from a YAML mapping; an empty text is none."""
    try:
        described = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a date that is none
        raise ParameterError(f"spheres is neither a name nor YAML: {' '.join(str(error).split())}") from error
    if described is None:
        return ScriptedSpheres({})
    return spheres_named(described) if isinstance(described, str) else ScriptedSpheres.from_dict(described)


def check_twin(values: Mapping[str, Value]) -> None:
    """Refuse values that do not go together: ParameterError."""
    scripted_spheres(values["spheres"])
    try:
        Robot.panda().checked(np.array(values["initial_joint_positions"]))
    except RobotError as error:
        raise ParameterError(f"parameter initial_joint_positions: {error}") from error
    slow = [name for name in _RATES if values[name] > values["physics_rate"]]
    if slow:
        raise ParameterError(
            f"parameter {slow[0]} = {values[slow[0]]:g} Hz: "
            f"expected at most physics_rate, {values['physics_rate']:g} Hz"
        )
