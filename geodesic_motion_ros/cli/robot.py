"""`geodesic-motion robot`: a robot's folder out of its URDF."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from geodesic_motion_ros.cli.arguments import HelpFormatter
from geodesic_motion_ros.cli.progress_bar import progress_bar
from geodesic_motion_ros.utils.errors import ParameterError

if TYPE_CHECKING:
    from geodesic_motion_ros.robot.kinematics import Robot
    from geodesic_motion_ros.robot.making import MadeRobot
    from geodesic_motion_ros.robot.self_pairs import LinkPair

_DESCRIPTION = """\
Make the folder that a robot is to this package, out of a URDF or a xacro file: its collision bodies are cut into convex
parts and covered with spheres, pairs that can meet are drawn, a ready posture is proposed. Look at the picture, then
name the folder in the place of a robot's name: `train --robot DIR`.
"""
_EPILOG = """\
examples:
  geodesic-motion robot arm.urdf --base base_link --tip tool0 --out robots/arm \\
      --acceleration 10 --jerk 1000 --limits-source "data sheet of the maker, page 12"
  geodesic-motion robot arm.urdf --base base_link --tip tool0 --out robots/arm --acceleration 5,5,7,7,9,9 --jerk 500 \\
      --beside finger=0.02 --ready 0,-1.57,1.57,0,1.57,0 --limits-source "measured"
  geodesic-motion robot arm.urdf.xacro hand:=true --package arm_description=src/arm_description --base base_link \
      --tip tool0 --out robots/arm --acceleration 10 --jerk 1000 --limits-source "chosen"
"""


def numbers(text: str) -> tuple[float, ...]:
    """Numbers out of "5,5,7"."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a list of numbers like 5,5,7") from None


def position(text: str) -> tuple[str, float]:
    """A joint and its position out of "finger=0.02"."""
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a joint with its position, like finger=0.02") from None


def argument(text: str) -> tuple[str, str]:
    """A name and its value out of "hand:=true"."""
    name, separator, value = text.partition(":=")
    if not (name and separator):
        raise argparse.ArgumentTypeError(f"'{text}' is not an argument of a xacro file, like hand:=true")
    return name, value


def package(text: str) -> tuple[str, Path]:
    """A ROS package and its folder out of "arm_description=src/arm_description"."""
    name, _, folder = text.partition("=")
    if not (name and folder and Path(folder).is_dir()):
        raise argparse.ArgumentTypeError(f"'{text}' is not a package with a folder that exists, NAME=FOLDER")
    return name, Path(folder)


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "robot", help="a robot of your own, out of its URDF",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("file", type=Path, metavar="FILE", help="URDF or xacro, with meshes or shapes that collide")
    parser.add_argument(
        "arguments", type=argument, nargs="*", metavar="NAME:=VALUE",
        help="of a xacro file, right behind it, as xacro has them",
    )  # fmt: skip
    parser.add_argument(
        "--package", type=package, action="append", metavar="NAME=FOLDER",
        help="where a ROS package is that the file names, in $(find NAME) or package://NAME; not needed where it is in "
        "a folder around the file, or ROS is sourced",
    )  # fmt: skip
    parser.add_argument("--base", required=True, metavar="LINK", help="where the chain begins, and all poses' frame")
    parser.add_argument("--tip", required=True, metavar="LINK", help="the link that skills move")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the folder to make")
    parser.add_argument("--name", help="what the robot is called; as its folder without it")
    # Required, but not of argparse: `run` asks for them together with the joints' names, which stand in the URDF.
    each = "one number for all joints, or one for each joint"
    parser.add_argument("--acceleration", type=numbers, metavar="A", help=f"required: limits [rad/s^2, m/s^2], {each}")
    parser.add_argument("--jerk", type=numbers, metavar="J", help=f"required: limits [rad/s^3, m/s^3], {each}")
    parser.add_argument(
        "--velocity", type=numbers, metavar="V",
        help=f"limits [rad/s, m/s] where the URDF has none, or wrong ones, {each}",
    )  # fmt: skip
    parser.add_argument("--limits-source", metavar="TEXT", help="required: where these limits are from")
    parser.add_argument("--ready", type=numbers, metavar="Q", help="a comfortable posture [rad]; proposed without it")
    parser.add_argument(
        "--beside", type=position, action="append", metavar="JOINT=POSITION",
        help="where a joint beside the chain stands, as a finger [rad, m]; without it at 0, or as near as it can",
    )  # fmt: skip
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Make the folder, say how good it is, draw it."""
    from geodesic_motion_ros.robot.description import RobotDescription
    from geodesic_motion_ros.robot.kinematics import Robot
    from geodesic_motion_ros.robot.making import Limits, make_robot
    from geodesic_motion_ros.robot.robot_file import limit_velocities, plain_urdf
    from geodesic_motion_ros.robot.urdf import moving_joints
    from geodesic_motion_ros.visualization.robot_view import draw_spheres

    with TemporaryDirectory() as folder:
        urdf = plain_urdf(arguments.file, Path(folder), dict(arguments.arguments), dict(arguments.package or ()))
        joints = moving_joints(urdf, arguments.base, arguments.tip)
        if arguments.velocity is not None:
            limit_velocities(urdf, dict(zip(joints, _each("velocity", arguments.velocity, joints), strict=True)))
        Robot.from_urdf(urdf, arguments.base, arguments.tip)
        wanted = ("acceleration", "jerk", "limits_source")
        if missing := [f"--{name.replace('_', '-')}" for name in wanted if getattr(arguments, name) is None]:
            raise ParameterError(
                f"a URDF says nothing of accelerations and jerks: give {', '.join(missing)} for {', '.join(joints)}"
            )
        print(f"{len(joints)} joints: {', '.join(joints)}", flush=True)
        acceleration, jerk = (_each(name, getattr(arguments, name), joints) for name in ("acceleration", "jerk"))
        with progress_bar(arguments.file.stem) as progress:
            made = make_robot(
                urdf, arguments.base, arguments.tip, arguments.out,
                Limits(acceleration, jerk, arguments.limits_source), arguments.name, arguments.ready,
                dict(arguments.beside or ()), progress,
            )  # fmt: skip
    robot = Robot.named(made.folder)
    for link, rows in made.spheres.items():
        names = [body.name for body in made.bodies if body.link == link]
        print(f"{link:24} {len(rows):3} spheres of {', '.join(dict.fromkeys(names))}")
    if bare := [link for link in robot.link_names if link not in made.spheres and link not in made.drawn_alone]:
        print(f"without a body in the URDF, and so never kept clear: {', '.join(bare)}")
    _say_what_the_urdf_leaves_open(made, robot)
    print(f"farthest point outside all spheres: {1e3 * max(0.0, made.farthest_outside()):.1f} mm")
    for pair in made.pairs:
        if pair.spheres == ():
            print(f"not kept apart: {' and '.join(pair.links)}, whose bodies nearly touch in all postures drawn")
            continue
        touching, overlapping = 100.0 * pair.touching, 100.0 * pair.overlapping
        chosen = "" if pair.spheres is None else f", {len(pair.spheres)} pairs of spheres chosen"
        print(
            f"kept apart: {' and '.join(pair.links)}; in the postures drawn their bodies nearly touch in "
            f"{touching:.1f} %, their spheres overlap in {overlapping:.1f} %{chosen}"
        )
    advise_on_alarms(made.pairs)
    unit = "rad, m" if any(robot.chain[4]) else "rad"
    print(f"ready: {', '.join(f'{value:.3f}' for value in robot.ready)} {unit}")
    if RobotDescription.named(made.folder).hand is None:
        print(f"no body moves with {arguments.tip}: write tool_spheres into robot.yaml for skills of tool poses")
    if not robot.takes_poses:
        print(f"poses need six joints, this arm has {len(joints)}: teach it by joint angles, send it goal_joints")
    if len(joints) < 3:
        print("detours need three joints: where an obstacle blocks what was demonstrated, this arm stops")
    draw_spheres(robot, made.bodies, made.spheres, made.folder / "spheres.png")
    print(f"wrote the robot to {made.folder}, its picture to {made.folder / 'spheres.png'}")


def _say_what_the_urdf_leaves_open(made: MadeRobot, robot: Robot) -> None:
    """Name what was taken in its place: bodies, masses, strengths, and where joints beside the chain stand."""
    from geodesic_motion_ros.robot.inertials import DENSITY, holding_strengths, joints_without_effort
    from geodesic_motion_ros.robot.urdf import read_urdf

    if made.drawn_alone:
        print(f"drawn but without a collision body, so that nothing guards it: {', '.join(made.drawn_alone)}")
    if adrift := made.adrift():
        print(
            f"far from the rest of the arm: {', '.join(f'{link} by {gap:.2f} m' for link, gap in adrift.items())}; are "
            "their meshes in the frames of their links, are bodies missing between? Look at the picture"
        )
    if made.without_inertial:
        print(
            f"without <inertial> or a mass: {', '.join(made.without_inertial)}; the twin takes that of the collision "
            f"bodies at {DENSITY:.0f} kg/m^3"
        )
    root = read_urdf(robot.urdf)
    if weak := joints_without_effort(robot, root):
        strengths = dict(zip(robot.joint_names, holding_strengths(robot, root), strict=True))
        print(
            f"limit of effort 0 or absent: the twin takes what holds the arm, "
            f"{', '.join(f'{name} {strengths[name]:.3g}' for name in weak)} [N m, prismatic: N]"
        )
    if made.beside:
        standing = ", ".join(f"{name} at {position:g}" for name, position in made.beside.items())
        print(
            f"beside the chain, taken as standing: {standing} [rad, m]; --beside JOINT=POSITION puts them elsewhere. "
            "Where they move, as a second arm does, no certificate knows of it"
        )


def advise_on_alarms(pairs: Iterable[LinkPair]) -> None:
    """Say of pairs whose spheres overlap much more often than their bodies touch what that means, and what to do."""
    from geodesic_motion_ros.robot.making import FALSE_ALARMS

    alarmed = {" and ".join(pair.links): pair.overlapping - pair.touching for pair in pairs if pair.spheres != ()}
    if often := [f"{names} in {100.0 * share:.0f} %" for names, share in alarmed.items() if share > FALSE_ALARMS]:
        print(
            f"spheres overlap while bodies are apart: {', '.join(often)} of the postures drawn. The arm keeps out of "
            "these, goals there are IN_COLLISION: that is safe, but costs room. Where a real arm must fold up so, "
            "look at spheres.png and make these links' spheres smaller in spheres.yaml"
        )


def _each(name: str, values: tuple[float, ...], joints: tuple[str, ...]) -> tuple[float, ...]:
    """One limit for each joint."""
    if len(values) not in (1, len(joints)) or not all(0.0 < value < float("inf") for value in values):
        raise ParameterError(f"--{name}: expected a positive number, or {len(joints)} of them for {', '.join(joints)}")
    return values if len(values) > 1 else values * len(joints)
