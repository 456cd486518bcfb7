"""A scripted teacher who guides the whole arm: joint-space demonstrations made by a simulated arm.

A tool pose leaves the arm a circle of elbows. The teacher says both: the pose of the tool along the motion, made up as
in `simulation.teacher` (laws, a hidden style of two numbers, a slow unsteady hand), and the swivel angle of the elbow
(`robot.swivel`). Families of demonstrations differ by the swivel angle alone.

*Reach to grasp*: the hand, pointing down beside the robot, is brought before an object and turns by 90 degrees until it
points at it. *Separated* families keep swivel angles of their own throughout; *connected* ones begin and end with the
elbow up, and open in between as sin^2, once or several times: then they meet in between, too.

*Circle*: once around in an upright plane. *Pouring*: three bottles, three cups, the paths of whose pairs cross.

With u in [0, 1] how far a motion has come, the tool follows

    x(u) = start + h(u) (goal - start) + n(u) . (laws + style) + hand(u),    psi(u) = psi_family(u) + style + hand(u).

Each sample is solved on the branch of the sample before. What comes out is refused unless it keeps `LIMIT_MARGIN` from
the position limits and `SPEED_SHARE` of the velocity limits. It is then played by the arm in PyBullet, which must come
near neither the table, nor what stands on it, nor itself, and what is returned is what the arm did: joint positions at
100 Hz.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.geometry.quaternions import continuous_signs, from_rotation, rotate_by, slerp
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import check_swivel, elbow_position, solve_with_swivel
from geodesic_motion_ros.simulation.gestures import (
    DOWN,
    RATE_HZ,
    STEPS_PER_SAMPLE,
    about,
    as_mounted,
    check_count,
    hand,
    outwards,
    pacing,
    smooth_step,
    style,
)
from geodesic_motion_ros.simulation.tabletop import Colour, TabletopWorld, fixed_to
from geodesic_motion_ros.simulation.teacher import (
    BOTTLE_REGION,
    CUP_REGION,
    Motion,
    Pose,
    pouring_motion,
    pouring_stands,
)
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_ros.utils.errors import DemonstrationError, RobotError

LIMIT_MARGIN = 0.05
"""Demonstrations stay this far [rad] inside the position limits."""
SPEED_SHARE = 0.5
"""Demonstrations move with at most this share of the velocity limits: a leap to another branch is faster."""
FOLLOWING_ERROR = 0.02
"""The arm stays this near [rad] to what it is to do."""
OWN_CLEARANCE = 0.01
"""The arm stays this far [m] from the table and from itself."""
SAMPLES_PER_CLEARANCE = 5

REACHING = (0.0, 0.3, 0.0, -1.9, 0.0, 2.2, 0.8)
"""Joint positions (7,) [rad] of an arm that reaches out, elbow up, drawn to within its limits: all demonstrations are
on its branch. The joints of the Panda, the FR3 and the LBR iiwa bend to the same sides."""
LARGEST_SWIVEL = np.radians(75.0)
"""Swivel angles of families are spread evenly from minus this to this [rad]."""
SWIVEL_SPREAD = np.radians(2.5)
"""Standard deviation [rad] of the swivel angle inside a family."""

REACH_START, REACH_GOAL = np.array([0.55, -0.34, 0.18]), np.array([0.74, 0.15, 0.35])
"""Middles (3,) [m] of starts and goals of the tool in the reach to grasp."""
REACH_SPREAD = np.array([0.03, 0.03, 0.02]), np.array([0.01, 0.01, 0.005])
"""Starts and goals lie within these [m] of the middles."""
REACH_TURN_SPREAD = np.radians((3.0, 1.5))
"""Starts and goals are turned about each axis by these standard deviations [rad]."""
# Raised by 30 degrees, and turned about the vertical by as much as makes 90 degrees of rotation in all:
# cos(90/2) = cos(30/2) cos(yaw/2).
GRASP_RISE = np.radians(30.0)
GRASP_YAW = 2.0 * np.arccos(np.cos(np.radians(45.0)) / np.cos(0.5 * GRASP_RISE))


CIRCLE_CENTRE = np.array([0.62, 0.0, 0.38])
"""Middle (3,) [m] of the circles."""
CIRCLE_RADIUS = 0.12
CIRCLE_SPREAD = np.array([0.015, 0.015, 0.015])
"""Middles of the circles lie within this [m] of `CIRCLE_CENTRE`."""
CIRCLE_SWIVEL = np.radians(40.0)

BOTTLE_PLACES = ((0.1, 0.1), (0.5, 0.5), (0.9, 0.9))
"""Where the three bottles of the pouring stand, as shares of `teacher.BOTTLE_REGION`."""
CUP_PLACES = ((0.9, 0.1), (0.5, 0.5), (0.1, 0.9))
"""Where the cups of the bottles of `BOTTLE_PLACES` stand, as shares of `teacher.CUP_REGION`: the paths cross."""
PLACE_SPREAD = 0.08
"""Bottles, cups and yaws lie within this share of their ranges of their places."""
POURING_SWIVEL = np.radians(-45.0)
POURING_SLOWNESS = 2.8  # of a person who guides a whole arm, beside one who guides a tool

GROUP_COLOURS: tuple[Colour, ...] = ((0.16, 0.50, 0.73), (0.93, 0.58, 0.12), (0.15, 0.63, 0.45), (0.56, 0.27, 0.68))


@dataclass(frozen=True, eq=False)
class Guidance:
    """One demonstration that the simulated teacher plans to show.

    Attributes
    ----------
    motion : of the tool, and what stands on the table and is carried.
    swivels : (T,) wanted swivel angles [rad].
    """

    motion: Motion
    swivels: np.ndarray


def reach_to_grasp(
    count_per_family: int, seed: int, families: int = 3, connected: bool = True, openings: int = 1
) -> JointDemonstrations:
    """The hand is brought over 0.5 m to an object and turned by 90 degrees, the elbow each time elsewhere.

    `count_per_family` demonstrations of the first family are followed by as many of the next. The same seed gives the
    same arrays bit by bit.

    Parameters
    ----------
    families : how many; their swivel angles are spread evenly from -`LARGEST_SWIVEL` to `LARGEST_SWIVEL`, with the
        elbow to the left of the arm first; one alone has its elbow up.
    connected : whether all families begin and end alike, with the elbow up.
    openings : how often connected families open during a motion; they meet in between. Each takes as long as one alone.

    Raises
    ------
    ParameterError : count_per_family, families or openings is below one.
    DemonstrationError : a demonstration fails a check; which and why is said.
    """
    return performed(reach_guidances(count_per_family, seed, families, connected, openings))


def circle(count: int, seed: int) -> JointDemonstrations:
    """The tool goes once around a circle of 12 cm in an upright plane across the arm, and ends where it began.

    Raises
    ------
    ParameterError : count is below one.
    DemonstrationError : a demonstration fails a check; which and why is said.
    """
    return performed(circle_guidances(count, seed))


def pouring(count_per_pair: int, seed: int) -> JointDemonstrations:
    """Three bottles are carried to three cups and tilted over them; the paths of the three pairs cross.

    First `count_per_pair` times the first bottle to the first cup, then the others. All cups stand there, but of the
    bottles only the one that is poured: the hand would not fit between them.

    Raises
    ------
    ParameterError : count_per_pair is below one.
    DemonstrationError : a demonstration fails a check; which and why is said.
    """
    return performed(pouring_guidances(count_per_pair, seed))


def reach_guidances(
    count_per_family: int, seed: int, families: int, connected: bool, openings: int = 1
) -> tuple[Guidance, ...]:
    """The guidances of `reach_to_grasp`, before the arm makes them."""
    check_count("count_per_family", count_per_family)
    check_count("families", families)
    check_count("openings", openings)
    generator = np.random.default_rng(seed)
    swivels = np.linspace(-LARGEST_SWIVEL, LARGEST_SWIVEL, families) if families > 1 else np.zeros(1)
    return tuple(
        _reach(f"family_{group}_{index}", group, swivel, openings if connected else 0, generator)
        for group, swivel in enumerate(swivels)
        for index in range(count_per_family)
    )


def circle_guidances(count: int, seed: int) -> tuple[Guidance, ...]:
    """The guidances of `circle`, before the arm makes them."""
    check_count("count", count)
    generator = np.random.default_rng(seed)
    return tuple(_circle(f"circle_{index}", generator) for index in range(count))


def pouring_guidances(count_per_pair: int, seed: int) -> tuple[Guidance, ...]:
    """The guidances of `pouring`, before the arm makes them."""
    check_count("count_per_pair", count_per_pair)
    generator = np.random.default_rng(seed)
    return tuple(
        _pouring(f"pair_{pair}_{index}", pair, generator)
        for pair in range(len(BOTTLE_PLACES))
        for index in range(count_per_pair)
    )


def draw_reaching_query(generator: np.random.Generator) -> tuple[Pose, Pose]:
    """A start and a goal (position (3,) [m], quaternion (4,)) of a reach to grasp, drawn as demonstrations are."""
    start, goal = (
        middle + spread * generator.uniform(-1.0, 1.0, 3)
        for middle, spread in zip((REACH_START, REACH_GOAL), REACH_SPREAD, strict=True)
    )
    down, at_object = (
        rotate_by(spread * np.clip(generator.normal(size=3), -2.0, 2.0), from_rotation(rotation))
        for rotation, spread in zip(_reach_rotations(), REACH_TURN_SPREAD, strict=True)
    )
    return (start, down), (goal, at_object)


def configurations(robot: Robot, guidance: Guidance) -> np.ndarray:
    """Joint positions (T, 7) [rad] of a guidance, each on the branch of the one before.

    Raises
    ------
    DemonstrationError : a pose cannot be reached with its swivel angle on that branch inside the limits.
    """
    motion = guidance.motion
    quaternions = as_mounted(robot, motion.quaternions)
    position, quaternion = motion.positions[0], quaternions[0]
    q = np.clip(REACHING, robot.lower, robot.upper)
    q[0] += np.arctan2(position[1], position[0])
    try:
        # from the elbow above the arm to where it is to be
        for swivel in np.linspace(0.0, guidance.swivels[0], 20):
            q = solve_with_swivel(robot, position, quaternion, swivel, q)
        path = []
        for pose in zip(motion.positions, quaternions, guidance.swivels, strict=True):
            q = solve_with_swivel(robot, *pose, q)
            path.append(q)
    except RobotError as error:
        raise DemonstrationError(f"demonstration '{motion.name}' cannot be performed: {error}") from error
    return np.array(path)


def performed(
    guidances: Sequence[Guidance], progress: Callable[[Iterable], Iterable] = iter, robot: str | Path = DEFAULT_ROBOT
) -> JointDemonstrations:
    """What a robot's arm (a shipped one's, or that of a folder) does of each guidance, checked as the head of this file
    says.

    `progress` is handed the guidances and gives them back one by one.

    Raises
    ------
    DemonstrationError : a guidance fails a check; which and why is said.
    RobotError : the arm has no swivel angle.
    """
    check_swivel(Robot.named(robot))
    with TabletopWorld(rate_hz=RATE_HZ * STEPS_PER_SAMPLE, robot=robot) as world:
        items = tuple(perform(world, guidance) for guidance in progress(guidances))
        return JointDemonstrations(items, world.robot.joint_names, str(robot))


def perform(world: TabletopWorld, guidance: Guidance) -> JointDemonstration:
    """Let the arm do what a guidance says, in a world that takes `STEPS_PER_SAMPLE` steps a sample, and record it.

    Raises
    ------
    DemonstrationError : the guidance fails a check; which and why is said.
    """
    name = guidance.motion.name
    wanted = configurations(world.robot, guidance)
    _check_motion(world.robot, wanted, name)
    velocities = np.gradient(wanted, 1.0 / RATE_HZ, axis=0)
    velocities[-1] = 0.0
    world.furnish(guidance.motion.solid)
    world.reset(wanted[0])
    world.set_joint_trajectory(JointWaypoints(guidance.motion.times, wanted, velocities))
    done = []
    for sample in range(len(wanted)):
        done.append(world.joint_positions)
        if sample % SAMPLES_PER_CLEARANCE == 0:
            _check_clearance(world, sample, name)
        for _ in range(STEPS_PER_SAMPLE):
            world.step()
    measured = np.array(done)
    behind = np.max(np.abs(measured - wanted))
    if behind > FOLLOWING_ERROR:
        raise DemonstrationError(
            f"demonstration '{name}': the arm is up to {behind:.3f} rad behind; {FOLLOWING_ERROR} are allowed"
        )
    _check_motion(world.robot, measured, name)
    return JointDemonstration(measured, guidance.motion.times, name)


def picture(
    guidances: Sequence[Guidance],
    demonstrations: JointDemonstrations,
    width: int = 960,
    height: int = 720,
    view: str = "front",
    robot: str | Path = DEFAULT_ROBOT,
) -> np.ndarray:
    """Picture (height, width, 3), uint8, of all paths: thick of the tool, thin of the elbow, a colour a group.

    The arm is where the last demonstration ends, among the bodies of its guidance.
    """
    with TabletopWorld(robot=robot) as world:
        last, final = guidances[-1].motion, demonstrations[-1].configurations[-1]
        world.reset(final)
        pose = world.tool_pose()
        world.furnish((), [*last.solid, *(fixed_to(*pose, part) for part in last.carried)])
        tools = demonstrations.tool_demonstrations(world.robot)
        for guidance, demonstration, tool in zip(guidances, demonstrations, tools, strict=True):
            colour = GROUP_COLOURS[guidance.motion.group % len(GROUP_COLOURS)]
            elbows = [elbow_position(world.robot, configuration) for configuration in demonstration.configurations]
            world.add_curve(tool.positions, colour, radius=0.003)
            world.add_curve(np.array(elbows), colour, radius=0.0015)
        return world.render(width, height, view, oversampling=2)


def _check_motion(robot: Robot, path: np.ndarray, name: str) -> None:
    margins = np.minimum(path - robot.lower, robot.upper - path)
    sample, joint = np.unravel_index(np.argmin(margins), margins.shape)
    if margins[sample, joint] < LIMIT_MARGIN:
        raise DemonstrationError(
            f"demonstration '{name}', sample {sample}: '{robot.joint_names[joint]}' is "
            f"{margins[sample, joint]:.3f} rad from its limit; {LIMIT_MARGIN} are needed"
        )
    shares = np.abs(np.diff(path, axis=0)) * RATE_HZ / robot.velocity_limits
    sample, joint = np.unravel_index(np.argmax(shares), shares.shape)
    if shares[sample, joint] > SPEED_SHARE:
        raise DemonstrationError(
            f"demonstration '{name}', sample {sample}: '{robot.joint_names[joint]}' moves with "
            f"{shares[sample, joint]:.2f} of its velocity limit; {SPEED_SHARE} are allowed"
        )


def _check_clearance(world: TabletopWorld, sample: int, name: str) -> None:
    clearance, between = min(world.own_clearance(), (world.furniture_clearance(), "the arm and what stands there"))
    if clearance < OWN_CLEARANCE:
        raise DemonstrationError(
            f"demonstration '{name}', sample {sample}: {between} are {1e3 * clearance:.1f} mm apart; "
            f"{1e3 * OWN_CLEARANCE:g} mm are needed"
        )


def _reach(name: str, group: int, swivel: float, openings: int, generator: np.random.Generator) -> Guidance:
    """From beside the robot, the hand down, in a bow to before the object, the hand at it; 0 openings: always open."""
    (start, down), (goal, at_object) = draw_reaching_query(generator)
    bold, early = style(generator)
    times, phase = pacing(8.0 * max(1, openings), generator)
    arch = (0.05 + 0.006 * bold) * np.sin(np.pi * phase)
    bow = (0.04 + 0.005 * bold) * np.sin(np.pi * phase) + 0.005 * early * np.sin(2.0 * np.pi * phase)
    positions = start + smooth_step(phase, gentle=True)[:, None] * (goal - start) + hand(phase, 0.002, generator)
    positions += bow[:, None] * outwards(start, goal) + arch[:, None] * [0.0, 0.0, 1.0]
    turned = smooth_step((phase - 0.12 + 0.015 * early) / 0.8)
    quaternions = rotate_by(hand(phase, np.radians(0.6), generator), slerp(down, at_object, turned))
    # the elbow takes the whole time, so that it need not hurry
    opened = np.sin(openings * np.pi * times / times[-1]) ** 2 if openings else np.ones_like(times)
    swivels = opened * swivel + _swivel_of_the_day(phase, generator)
    return Guidance(Motion(name, times, positions, continuous_signs(quaternions), (), group=group), swivels)


def _circle(name: str, generator: np.random.Generator) -> Guidance:
    """Once around, from below, the hand half raised."""
    centre = CIRCLE_CENTRE + CIRCLE_SPREAD * generator.uniform(-1.0, 1.0, 3)
    bold, early = style(generator)
    times, phase = pacing(7.0, generator)
    begin, gap = np.radians((5.0, 2.0)) * np.clip(generator.normal(size=2), -2.0, 2.0)
    angle = begin + (2.0 * np.pi + gap) * phase + 0.05 * early * np.sin(2.0 * np.pi * phase)
    width, height = CIRCLE_RADIUS + 0.006 * bold, CIRCLE_RADIUS + 0.004 * early
    around = np.stack([np.zeros_like(angle), width * np.sin(angle), -height * np.cos(angle)], axis=1)
    positions = centre + around + hand(phase, 0.002, generator)
    raised = from_rotation(about("y", -GRASP_RISE) * DOWN)
    quaternions = rotate_by(hand(phase, np.radians(1.0), generator), np.tile(raised, (len(times), 1)))
    motion = Motion(name, times, positions, continuous_signs(quaternions), ())
    return Guidance(motion, CIRCLE_SWIVEL + _swivel_of_the_day(phase, generator))


def _pouring(name: str, pair: int, generator: np.random.Generator) -> Guidance:
    """A bottle to its cup, among the cups of the other pairs and the stands of their bottles."""
    middle = np.array([*BOTTLE_PLACES[pair], 0.5, *CUP_PLACES[pair], 0.5])
    place = middle + PLACE_SPREAD * generator.uniform(-1.0, 1.0, 6)
    motion = pouring_motion(name, place, generator, POURING_SLOWNESS)
    others = [
        (BOTTLE_REGION.at(BOTTLE_PLACES[other]), CUP_REGION.at(CUP_PLACES[other]))
        for other in range(len(BOTTLE_PLACES))
        if other != pair
    ]
    beside = [body for bottle, cup in others for body in pouring_stands(bottle, cup)]
    swivels = POURING_SWIVEL + _swivel_of_the_day(np.linspace(0.0, 1.0, len(motion.times)), generator)
    return Guidance(replace(motion, solid=(*motion.solid, *beside), group=pair), swivels)


def _swivel_of_the_day(phase: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """How far (T,) [rad] the elbow of this demonstration is from that of its family."""
    offset = SWIVEL_SPREAD * np.clip(generator.normal(), -2.0, 2.0)
    return offset + hand(phase, np.radians(1.0), generator, components=1)[:, 0]


def _reach_rotations() -> tuple[Rotation, Rotation]:
    """Rotations of the tool at start and goal, 90 degrees apart: down; raised to the object."""
    return (
        about("z", -0.5 * GRASP_YAW) * DOWN,
        about("z", 0.5 * GRASP_YAW) * about("y", -GRASP_RISE) * DOWN,
    )
