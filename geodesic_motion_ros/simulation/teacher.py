"""A scripted teacher: demonstrations made by a simulated arm, for experiments that recordings do not allow.

Two tasks. *Pouring*: a bottle that may stand anywhere in one region is carried to a cup that may stand anywhere in
another, and tilted over it. *Passing*: something is taken from one area to another past a pillar, on its left or on
its right.

The teacher is a stand-in for a person, and what is made up is said here. With u in [0, 1] how far a motion has come,
a demonstration is

    x(u) = start + h(u) (goal - start) + n(u) . (laws of the distance + style) + hand(u),

h a smooth step. The laws are the same in every demonstration: a longer distance is covered in a higher and wider arch.
The *style* is two hidden numbers of standard normal distribution a demonstration (cut at two): how boldly (arch and
bulge) and how early (tilt, and where the path bends) it is done this time, worth 5 to 15 mm at one standard
deviation. The *hand* adds three slow waves that vanish at both ends. Neither can be inferred from start and goal. The
wanted curve is then followed by the arm in PyBullet and what is returned is what the arm did: positions and
orientations of the tool link at 100 Hz, in the base frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.quaternions import continuous_signs, from_rotation, rotate_by
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.robot.inverse_kinematics import solve
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
from geodesic_motion_ros.simulation.tabletop import (
    Colour,
    Cylinder,
    Region,
    TabletopWorld,
    fixed_to,
    standing,
)
from geodesic_motion_ros.utils.errors import ParameterError

Pose = tuple[np.ndarray, np.ndarray]

BOTTLE_REGION = Region((0.48, -0.42), (0.63, -0.17))
"""Where bottles stand in the pouring task (axis of the bottle, from above)."""
CUP_REGION = Region((0.48, 0.17), (0.63, 0.42))
"""Where cups stand in the pouring task (axis of the cup, from above)."""
BOTTLE_YAW = np.radians((-37.0, -13.0))
"""Smallest and largest yaw [rad] with which a bottle is grasped."""
CUP_YAW = np.radians((-20.0, 4.0))
"""Smallest and largest yaw [rad] with which the bottle is brought to a cup."""
GRASP_PITCH = np.radians(60.0)  # how far the hand points down
STAND_HEIGHT = 0.08  # of what bottles and cups stand on
GRASP_HEIGHT = STAND_HEIGHT + 0.20
MOUTH_ABOVE_GRASP = 0.08
POURING_HEIGHT = STAND_HEIGHT + 0.22  # of the hand
POURING_TILT = np.radians(100.0)
BOTTLE_RADIUS, NECK_RADIUS, SHOULDER_BELOW_GRASP = 0.030, 0.013, 0.05
CUP_RADIUS, CUP_HEIGHT = 0.04, 0.09

PASS_START, PASS_GOAL = np.array([0.53, -0.30, 0.12]), np.array([0.53, 0.30, 0.14])
"""Middles (3,) [m] of the areas that something is taken from and put down in."""
PASS_SPREAD = np.array([0.015, 0.015, 0.005])
"""Starts and goals lie within this [m] of the middles."""
PASS_WIDTH = 0.135  # how far beside the pillar the tool passes
PASS_TURN = np.radians((-30.0, 30.0))
PILLAR = standing(np.array([0.53, 0.0]), 0.03, 0.18, (0.45, 0.36, 0.30))
"""What stands between the two areas."""
SIDES = ("left", "right")
"""Sides of the pillar, seen along the motion: left is towards the robot."""

GLASS: Colour = (0.25, 0.55, 0.35)
STAND_COLOUR: Colour = (0.62, 0.48, 0.36)
CUP_COLOUR: Colour = (0.90, 0.88, 0.82)
PATH_COLOURS: tuple[Colour, ...] = ((0.16, 0.50, 0.73), (0.93, 0.58, 0.12))


@dataclass(frozen=True, eq=False)
class Motion:
    """One demonstration that the simulated teacher plans to show.

    Attributes
    ----------
    name : what the demonstration will be called.
    times : (T,) [s]; positions : (T, 3) [m]; quaternions : (T, 4), scalar first: the wanted tool poses, base frame.
    solid : bodies on the table that the arm must not touch.
    carried : parts of what the hand holds, in the frame of the tool.
    group : number of the mode that the motion belongs to.
    """

    name: str
    times: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray
    solid: tuple[Cylinder, ...]
    carried: tuple[Cylinder, ...] = ()
    group: int = 0


@dataclass(frozen=True, eq=False)
class Performance:
    """A demonstration as the arm played it, its joint positions (T, eta) [rad], and how near it came to a body [m]."""

    demonstration: Demonstration
    joint_positions: np.ndarray
    clearance: float


def multi_goal_demonstrations(count: int, seed: int) -> Demonstrations:
    """Bottles brought to cups and tilted, each from and to another place.

    Bottles stand in `BOTTLE_REGION`, cups in `CUP_REGION`; the yaws of grasp and pouring vary too. The `count` draws
    are spread evenly over those ranges (a Latin hypercube); the same seed gives the same arrays bit by bit.

    Raises
    ------
    ParameterError : count is below one.
    """
    return performed(multi_goal_motions(count, seed))


def two_mode_demonstrations(count_per_mode: int, seed: int) -> Demonstrations:
    """Something taken past `PILLAR`: first `count_per_mode` times on its left, then as often on its right.

    Starts and goals vary by `PASS_SPREAD`, the tool turns by 60 degrees about the vertical.

    Raises
    ------
    ParameterError : count_per_mode is below one.
    """
    return performed(two_mode_motions(count_per_mode, seed))


def grasp_pose(bottle: np.ndarray, yaw: float) -> Pose:
    """Tool pose that holds an upright bottle standing at (2,) [m], the hand coming from `yaw` [rad]."""
    return np.array([*bottle[:2], GRASP_HEIGHT]), from_rotation(_side_grasp(yaw, 0.0))


def pouring_pose(cup: np.ndarray, yaw: float, tilt: float = POURING_TILT) -> Pose:
    """Tool pose in which the bottle, tilted by `tilt` [rad], has its mouth above the cup at (2,) [m]."""
    lateral = about("z", yaw).apply([0.0, 1.0, 0.0])
    position = np.array([*cup[:2], POURING_HEIGHT]) - MOUTH_ABOVE_GRASP * np.sin(tilt) * lateral
    return position, from_rotation(_side_grasp(yaw, tilt))


def draw_passing_query(generator: np.random.Generator) -> tuple[Pose, Pose]:
    """A start and a goal (position (3,) [m], quaternion (4,)) past the pillar, drawn uniformly as demonstrated."""
    start, goal = _passing_ends(generator)
    turned = from_rotation(about("z", PASS_TURN) * DOWN)
    return (start, turned[0]), (goal, turned[1])


def multi_goal_motions(count: int, seed: int) -> tuple[Motion, ...]:
    """The motions of `multi_goal_demonstrations`, before the arm makes them."""
    check_count("count", count)
    generator = np.random.default_rng(seed)
    cells = generator.permuted(np.tile(np.arange(count), (6, 1)), axis=1).T
    places = (cells + generator.random((count, 6))) / count
    return tuple(pouring_motion(f"pouring_{index}", place, generator) for index, place in enumerate(places))


def two_mode_motions(count_per_mode: int, seed: int) -> tuple[Motion, ...]:
    """The motions of `two_mode_demonstrations`, before the arm makes them."""
    check_count("count_per_mode", count_per_mode)
    generator = np.random.default_rng(seed)
    return tuple(
        _passing(f"{side}_{index}", group, generator)
        for group, side in enumerate(SIDES)
        for index in range(count_per_mode)
    )


def pouring_motion(name: str, place: np.ndarray, generator: np.random.Generator, slowness: float = 1.0) -> Motion:
    """One of `multi_goal_motions`: lift, carry in an arch, tilt over the cup.

    `place` (6,) in [0, 1] says where in their ranges bottle and cup are: bottle x, y, yaw, cup x, y, yaw. `slowness`
    is a factor on the time that it takes.
    """
    bottle, yaw_at_bottle = BOTTLE_REGION.at(place[:2]), _between(BOTTLE_YAW, place[2])
    cup, yaw_at_cup = CUP_REGION.at(place[3:5]), _between(CUP_YAW, place[5])
    bold, early = style(generator)
    start, _ = grasp_pose(bottle, yaw_at_bottle)
    goal, _ = pouring_pose(cup, yaw_at_cup)
    distance = float(np.linalg.norm(goal - start))
    times, phase = pacing(slowness * (3.5 + 4.0 * distance), generator)
    # up before across; wide of the straight line first, then from a little inside
    across = smooth_step((phase - 0.08) / 0.87)
    arch = (0.04 + 0.18 * distance + 0.014 * bold) * np.sin(np.pi * phase ** (0.72 + 0.03 * early))
    bulge = (0.01 + 0.06 * distance + 0.010 * bold) * np.sin(np.pi * phase)
    bulge += (0.012 + 0.007 * early) * np.sin(2.0 * np.pi * phase)
    positions = start + across[:, None] * (goal - start) + hand(phase, 0.003, generator)
    positions += bulge[:, None] * outwards(start, goal) + arch[:, None] * [0.0, 0.0, 1.0]
    tilt = POURING_TILT * smooth_step((phase - 0.42 + 0.035 * early) / (0.55 + 0.035 * early))
    yaw = yaw_at_bottle + across * (yaw_at_cup - yaw_at_bottle)
    quaternions = rotate_by(hand(phase, np.radians(1.5), generator), from_rotation(_side_grasp(yaw, tilt)))
    return Motion(name, times, positions, continuous_signs(quaternions), pouring_stands(bottle, cup), bottle_in_hand())


def pouring_stands(bottle: np.ndarray, cup: np.ndarray) -> tuple[Cylinder, ...]:
    """What stands at the places (2,) [m] of a bottle and of a cup once the bottle is in the hand."""
    return (
        standing(bottle, BOTTLE_RADIUS + 0.01, STAND_HEIGHT, STAND_COLOUR),
        standing(cup, CUP_RADIUS + 0.005, STAND_HEIGHT, STAND_COLOUR),
        standing(cup, CUP_RADIUS, CUP_HEIGHT, CUP_COLOUR, on=STAND_HEIGHT),
    )


def performed(
    motions: Sequence[Motion], progress: Callable[[Iterable], Iterable] = iter, robot: str | Path = DEFAULT_ROBOT
) -> Demonstrations:
    """What a robot's arm (a shipped one's, or that of a folder) does of each motion.

    `progress` is handed the motions and gives them back one by one.
    """
    with TabletopWorld(rate_hz=RATE_HZ * STEPS_PER_SAMPLE, robot=robot) as world:
        return Demonstrations(tuple(perform(world, motion).demonstration for motion in progress(motions)))


def perform(world: TabletopWorld, motion: Motion) -> Performance:
    """Let the arm follow a motion in a world that takes `STEPS_PER_SAMPLE` steps a sample, and record it."""
    if not np.isclose(world.dt * RATE_HZ * STEPS_PER_SAMPLE, 1.0):
        raise ParameterError(
            f"the world takes {1.0 / world.dt:g} steps a second: recording at {RATE_HZ:g} Hz needs "
            f"{RATE_HZ * STEPS_PER_SAMPLE:g}"
        )
    world.furnish(motion.solid)
    world.reset(_first_posture(world, motion))
    poses, joints, clearance = [], [], np.inf
    for position, quaternion in zip(motion.positions, as_mounted(world.robot, motion.quaternions), strict=True):
        poses.append(world.tool_pose())
        joints.append(world.joint_positions)
        clearance = min(clearance, world.furniture_clearance())
        world.set_target_pose(position, quaternion)
        for _ in range(STEPS_PER_SAMPLE):
            world.step()
    positions, quaternions = map(np.array, zip(*poses, strict=True))
    demonstration = Demonstration(positions, continuous_signs(quaternions), motion.times, motion.name)
    return Performance(demonstration, np.array(joints), clearance)


def picture(
    motions: Sequence[Motion],
    demonstrations: Demonstrations,
    width: int = 960,
    height: int = 720,
    view: str = "front",
    robot: str | Path = DEFAULT_ROBOT,
) -> np.ndarray:
    """Picture (height, width, 3), uint8, of all bodies and tool paths; the arm is where the last motion ends."""
    with TabletopWorld(rate_hz=RATE_HZ * STEPS_PER_SAMPLE, robot=robot) as world:
        last, final = motions[-1], demonstrations[-1]
        world.reset(perform(world, last).joint_positions[-1])
        solid = {body for motion in motions for body in motion.solid}
        picked_up = [
            fixed_to(motion.positions[0], motion.quaternions[0], part)
            for motion in motions[:-1]
            for part in motion.carried
        ]
        held = [fixed_to(final.positions[-1], final.quaternions[-1], part) for part in last.carried]
        world.furnish((), [*sorted(solid, key=lambda body: body.centre), *picked_up, *held])
        for motion, demonstration in zip(motions, demonstrations, strict=True):
            world.add_curve(demonstration.positions, PATH_COLOURS[motion.group], radius=0.003)
        return world.render(width, height, view, oversampling=2)


def _first_posture(world: TabletopWorld, motion: Motion) -> np.ndarray:
    """Joint positions (eta,) at the first pose: arm turned towards it, elbow up, wrist straight."""
    towards = world.robot.ready.copy()
    towards[0] = np.arctan2(motion.positions[0, 1], motion.positions[0, 0])
    return solve(world.robot, motion.positions[0], as_mounted(world.robot, motion.quaternions)[0], start=towards)


def _between(limits: np.ndarray, fraction: float) -> float:
    return float(limits[0] + fraction * (limits[1] - limits[0]))


def _passing(name: str, group: int, generator: np.random.Generator) -> Motion:
    """From area to area in a bow around the pillar, group 0 on its left, group 1 on its right."""
    start, goal = _passing_ends(generator)
    bold, early = style(generator)
    distance = float(np.linalg.norm(goal - start))
    times, phase = pacing(2.0 + 3.5 * distance, generator)
    side = (-1.0, 1.0)[group]
    bow = np.clip(np.sin(np.pi * phase), 0.0, 1.0) ** 1.3 * (PASS_WIDTH + 0.006 * bold)
    bow += 0.006 * early * np.sin(2.0 * np.pi * phase)
    arch = (0.04 + 0.006 * bold) * np.sin(np.pi * phase)
    positions = start + smooth_step(phase, gentle=True)[:, None] * (goal - start) + hand(phase, 0.002, generator)
    positions += (side * bow)[:, None] * outwards(start, goal) + arch[:, None] * [0.0, 0.0, 1.0]
    turned = PASS_TURN[0] + smooth_step((phase - 0.1 + 0.03 * early) / 0.8) * np.ptp(PASS_TURN)
    upright = from_rotation(about("z", turned) * DOWN)
    quaternions = rotate_by(hand(phase, np.radians(1.5), generator), upright)
    return Motion(name, times, positions, continuous_signs(quaternions), (PILLAR,), group=group)


def _passing_ends(generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Start and goal (3,) [m] of a motion past the pillar."""
    start, goal = (middle + PASS_SPREAD * generator.uniform(-1.0, 1.0, 3) for middle in (PASS_START, PASS_GOAL))
    return start, goal


def _side_grasp(yaw: float | np.ndarray, tilt: float | np.ndarray) -> Rotation:
    """Rotation of a tool that holds a bottle from behind and above, the bottle tilted to its left by `tilt`."""
    return about("z", yaw) * about("x", np.negative(tilt)) * about("y", GRASP_PITCH - 0.5 * np.pi) * DOWN


def bottle_in_hand() -> tuple[Cylinder, ...]:
    """Body and neck of a bottle in the frame of the tool that grasps it."""
    grasp = _side_grasp(0.0, 0.0).inv()
    quaternion = tuple(from_rotation(grasp))
    parts = (
        (STAND_HEIGHT - GRASP_HEIGHT, -SHOULDER_BELOW_GRASP, BOTTLE_RADIUS),
        (-SHOULDER_BELOW_GRASP, MOUTH_ABOVE_GRASP, NECK_RADIUS),
    )
    return tuple(
        Cylinder(tuple(grasp.apply([0.0, 0.0, 0.5 * (low + high)])), radius, high - low, GLASS, quaternion)
        for low, high, radius in parts
    )
