"""Pouring in task space, three bottles to three cups of which three pairs were shown: all nine, an obstacle, a chain.

The simulated teacher carries each of three bottles to a cup of its own, and the three ways cross (`joint_teacher.
pouring`); what is learned are the poses of the tool. For every seed of the training:

- *pairs*: from each bottle to each cup, on the raw sheet, the paper's, and on the canonical one. What counts is how far
  a path is from any position that was demonstrated;
- *clearance*: half way along each path a sphere beside the bottle or under it, 1 cm deep in its way. The planner that
  takes the tool for a sphere of 4 cm does not know of the bottle in the hand; the other one has spheres along it that
  hold all of it. Measured is the exact distance of the bottle's two cylinders from the sphere, along the dense path;
- *chain*: with one bottle to the first cup, on to the second and to the third: three geodesics on the raw sheet, which
  alone takes an end that was shown for a start. It is played by the arm in PyBullet among the stands.

For the first seed a sphere *moves* through the way while the tool follows it on the raw sheet, and the geodesic is
drawn at two times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import brentq
from scipy.spatial import cKDTree
from tqdm import tqdm

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.posture_strip import evenly
from geodesic_motion_ros.experiments.pouring_joint import standing_there
from geodesic_motion_ros.experiments.trained import BRIEFLY, trained_once
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.plots import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    Way,
    draw_latent_ways,
    latent_background,
    write_figure,
)
from geodesic_motion_ros.quaternions import continuous_signs, to_rotation
from geodesic_motion_ros.reference import ReferenceFollower, TaskSpaceReference
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.gestures import RATE_HZ, STEPS_PER_SAMPLE
from geodesic_motion_ros.simulation.joint_teacher import BOTTLE_PLACES, CUP_PLACES, pouring
from geodesic_motion_ros.simulation.scenes import LineObstacle, crossing
from geodesic_motion_ros.simulation.tabletop import Cylinder, TabletopWorld, fixed_to
from geodesic_motion_ros.simulation.teacher import (
    BOTTLE_REGION,
    BOTTLE_YAW,
    CUP_REGION,
    CUP_YAW,
    Motion,
    Pose,
    bottle_in_hand,
    grasp_pose,
    perform,
    pouring_pose,
)
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import Cell, text_table

if TYPE_CHECKING:
    from geodesic_motion_ros.manifold.training import TrainingSettings

TASK = "pouring_places"
SHEETS = ("raw", "canonical")
PLACES = range(len(BOTTLE_PLACES))
#: Distance of the spheres along the bottle [m].
_SPACING = 0.03
#: Radius of the spheres [m], how deep they are in the bottle's way [m], and the speed of the one that moves [m/s].
_RADIUS, _DEPTH, _SPEED = 0.04, 0.01, 0.08
#: Where spheres are, seen from the bottle: under it, and beside it.
_SIDES = ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
#: Time between ticks of the stream, and longest stream [s].
_TICK, _LONGEST = 0.02, 20.0
#: The goal is reached within this [m].
_ARRIVED = 1e-3
#: The arm waits so long over each cup [s].
_PAUSE = 0.5


@dataclass(frozen=True)
class PouringTaskSettings:
    """How many demonstrations of each pair are shown; `seeds` are of the trainings."""

    shown: int = 3
    seeds: tuple[int, ...] = (0, 1, 2)

    def __post_init__(self) -> None:
        if self.shown < 1:
            raise ParameterError(f"shown is {self.shown}; at least 1 is needed")
        if not self.seeds or min(self.seeds) < 0:
            raise ParameterError(f"seeds {self.seeds}: give at least one, none negative")


@dataclass(frozen=True, eq=False)
class Pair:
    """From one bottle to one cup on one sheet.

    Attributes
    ----------
    reference : None where the planner refused, for a reason.
    off : largest distance of the path from any demonstrated position [m].
    """

    sheet: str
    seed: int
    bottle: int
    cup: int
    reference: TaskSpaceReference | None
    reason: str = ""
    off: float = math.nan


@dataclass(frozen=True)
class Blocked:
    """A sphere in the bottle's way: the exact clearance of the bottle [m] on the path planned with the bottle, and with
    the hand alone; NaN where that was refused. `side` is one of those where spheres are.
    """

    sheet: str
    seed: int
    side: int
    bottle: int
    cup: int
    with_bottle: float
    hand_alone: float


@dataclass(frozen=True, eq=False)
class Chain:
    """One bottle over all cups.

    Attributes
    ----------
    parts : the geodesics; fewer than cups where the planner refused one, for a reason.
    mouth_off : of each part, horizontal distance of the bottle's mouth from the cup's axis when it is poured [m].
    behind : largest distance of the tool from where it was to be at the time [m].
    clearance : least distance of the arm from what stands there [m].
    joints : (k, 7) what the arm did [rad].
    """

    seed: int
    parts: tuple[TaskSpaceReference, ...]
    reason: str = ""
    mouth_off: tuple[float, ...] = ()
    behind: float = math.nan
    clearance: float = math.nan
    joints: np.ndarray = field(default_factory=lambda: np.empty((0, 7)))


@dataclass(frozen=True, eq=False)
class Moment:
    """The stream at a time [s]: the sphere's centre (3,), how the tool is turned (4,), its way so far, and the geodesic
    from there (n, 3).
    """

    time: float
    centre: np.ndarray
    quaternion: np.ndarray
    gone: np.ndarray
    ahead: np.ndarray


@dataclass(frozen=True, eq=False)
class Stream:
    """A sphere moves through the way of a tool that follows its geodesic.

    Attributes
    ----------
    moments : two, before the sphere matters and when it is nearest. nominal : (n, 3) the geodesic without it.
    clearance : least exact distance of the bottle from the sphere [m]; unaware : had the tool followed the nominal one.
    """

    moments: tuple[Moment, Moment]
    nominal: np.ndarray
    reached: bool
    clearance: float
    unaware: float


@dataclass(frozen=True)
class PouringTaskReport:
    """All of it."""

    settings: PouringTaskSettings
    pairs: tuple[Pair, ...]
    blocked: tuple[Blocked, ...]
    chains: tuple[Chain, ...]
    stream: Stream
    shown: Demonstrations = field(repr=False)
    raw: Skill = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            "settings": asdict(self.settings),
            "pairs": [
                {"sheet": item.sheet, "seed": item.seed, "bottle": item.bottle, "cup": item.cup,
                 "reached": item.reference is not None, "reason": item.reason, "off": item.off}
                for item in self.pairs
            ],
            "blocked": [asdict(item) for item in self.blocked],
            "chains": [
                {"seed": item.seed, "parts": len(item.parts), "reason": item.reason, "mouth_off": item.mouth_off,
                 "behind": item.behind, "clearance": item.clearance,
                 "seconds": sum(part.duration for part in item.parts)}
                for item in self.chains
            ],
            "moving": {"reached": self.stream.reached, "clearance": self.stream.clearance,
                       "unaware": self.stream.unaware},
        }  # fmt: skip

    def table(self) -> str:
        """The tables as plain text, with what was refused."""
        pairs: list[list[Cell]] = []
        for sheet in SHEETS:
            for seed in self.settings.seeds:
                of = [item for item in self.pairs if (item.sheet, item.seed) == (sheet, seed)]
                reached = [item for item in of if item.reference is not None]
                off = {
                    shown: max((1e3 * item.off for item in reached if (item.bottle == item.cup) == shown), default=None)
                    for shown in (True, False)
                }
                pairs.append([f"{sheet} sheet", seed, f"{len(reached)} of {len(of)}", off[True], off[False]])
        blocked: list[list[Cell]] = []
        for sheet in SHEETS:
            for seed in self.settings.seeds:
                spheres = [item for item in self.blocked if (item.sheet, item.seed) == (sheet, seed)]
                known = [1e3 * item.with_bottle for item in spheres if not math.isnan(item.with_bottle)]
                hand = [1e3 * item.hand_alone for item in spheres if not math.isnan(item.hand_alone)]
                blocked.append([
                    f"{sheet} sheet", seed, len(spheres), len(known), sum(value <= 0.0 for value in known),
                    min(known, default=None), len(hand), sum(value <= 0.0 for value in hand), min(hand, default=None),
                ])  # fmt: skip
        chains: list[list[Cell]] = [
            [item.seed, f"{len(item.parts)} of {len(PLACES)}", 1e3 * max(item.mouth_off, default=math.nan),
             1e3 * item.behind, 1e3 * item.clearance]
            for item in self.chains
        ]  # fmt: skip
        stream = self.stream
        refused = [
            f"{item.sheet} sheet, seed {item.seed}, {item.bottle} to {item.cup}: {item.reason}"
            for item in self.pairs if item.reason
        ] + [f"chain, seed {item.seed}: {item.reason}" for item in self.chains if item.reason]  # fmt: skip
        return "\n".join([
            text_table(["pairs", "seed", "reached", "off, shown pairs mm", "off, others mm"], pairs, 1), "",
            text_table(
                ["sphere in the bottle's way", "seed", "scenes", "answered", "hits", "least mm",
                 "hand alone: answered", "hits", "least mm"], blocked, 1,
            ), "",
            text_table(
                ["chain, seed", "geodesics", "mouth off the cup mm", "tool behind mm", "arm clear mm"], chains, 1
            ), "",
            f"moving sphere: {'reached' if stream.reached else 'NOT reached'}, bottle {1e3 * stream.clearance:.1f} mm "
            f"clear; {1e3 * stream.unaware:.1f} mm on the way without the sphere", *refused,
        ])  # fmt: skip


def measure_pouring_task(
    settings: PouringTaskSettings = PouringTaskSettings(),
    skills: Path = Path("out/experiments/skills"),
    training: TrainingSettings | None = None,
    show_progress: bool = True,
) -> PouringTaskReport:
    """Show, train, plan and play.

    Parameters
    ----------
    skills : cache of trained skills, see `trained_once`. training : seed and sheet are replaced; None: `BRIEFLY`.
    """
    from geodesic_motion_ros.manifold.training import TrainingSettings

    base = training or TrainingSettings(**BRIEFLY)
    shown = pouring(settings.shown, 0).tool_demonstrations(Robot.panda())
    pairs: list[Pair] = []
    blocked: list[Blocked] = []
    chains: list[Chain] = []
    streams, raw_skills = [], []
    for seed in tqdm(settings.seeds, desc="pouring-task", unit="seed", disable=not show_progress):
        raw, canonical = (
            trained_once(TASK, shown, replace(base, seed=seed, sheet=sheet, orientation_model=None), skills)
            for sheet in SHEETS
        )
        planners = {
            sheet: ReactivePlanner(skill, bottle_settings())
            for sheet, skill in zip(SHEETS, (raw, canonical), strict=True)
        }
        for sheet, planner in planners.items():
            pairs += all_pairs(planner, shown, sheet, seed)
            blocked += blocked_pairs(planner, ReactivePlanner(planner.skill), sheet, seed)
        chains.append(pour_all_cups(planners["raw"], seed))
        if not streams:
            streams.append(past_a_moving_sphere(planners["raw"]))
            raw_skills.append(raw)
    return PouringTaskReport(
        settings, tuple(pairs), tuple(blocked), tuple(chains), streams[0], shown, raw_skills[0]
    )  # fmt: skip


def bottle_settings() -> PlannerSettings:
    """Tool spheres that hold the bottle in the hand, besides the one at the tool's origin."""
    points, radii = [(0.0, 0.0, 0.0)], [PlannerSettings().tool_radii[0]]
    for part in bottle_in_hand():
        along = to_rotation(np.array(part.quaternion)).apply([0.0, 0.0, 1.0])
        count = math.ceil(part.height / _SPACING) + 1
        for place in np.linspace(-0.5, 0.5, count) * part.height:
            points.append(tuple((np.array(part.centre) + place * along).tolist()))
            # Half way between two spheres the cylinder's surface is held just so.
            radii.append(math.hypot(part.radius, 0.5 * part.height / (count - 1)))
    return PlannerSettings(tool_points=tuple(points), tool_radii=tuple(radii))


def bottle_distance(positions: np.ndarray, quaternions: np.ndarray, centres: np.ndarray, radius: float) -> float:
    """Least signed distance [m] of the bottle from a sphere, the tool at poses (n, 3), (n, 4), the sphere at (n, 3)."""
    least = math.inf
    local = to_rotation(quaternions).inv().apply(centres - positions)
    for part in bottle_in_hand():
        seen = to_rotation(np.array(part.quaternion)).inv().apply(local - part.centre)
        beside = np.hypot(seen[:, 0], seen[:, 1]) - part.radius
        beyond = np.abs(seen[:, 2]) - 0.5 * part.height
        outside = np.hypot(np.maximum(beside, 0.0), np.maximum(beyond, 0.0))
        least = min(least, float(np.min(outside + np.minimum(np.maximum(beside, beyond), 0.0))))
    return least - radius


def at_bottle(bottle: int) -> Pose:
    """Tool pose that grasps a bottle in the middle of where it was shown."""
    return grasp_pose(BOTTLE_REGION.at(np.array(BOTTLE_PLACES[bottle])), float(np.mean(BOTTLE_YAW)))


def at_cup(cup: int) -> Pose:
    """Tool pose that pours into a cup in the middle of where it was shown."""
    return pouring_pose(CUP_REGION.at(np.array(CUP_PLACES[cup])), float(np.mean(CUP_YAW)))


def all_pairs(planner: ReactivePlanner, shown: Demonstrations, sheet: str, seed: int) -> list[Pair]:
    """Every bottle to every cup, nothing in the way."""
    planner.take_obstacles(Obstacles.none())
    tree = cKDTree(np.concatenate([item.positions for item in shown]))
    found = []
    for bottle in PLACES:
        for cup in PLACES:
            plan = planner.plan(*at_bottle(bottle), *at_cup(cup))
            if plan.reference is None:
                found.append(Pair(sheet, seed, bottle, cup, None, plan.verdict.reason))
                continue
            off = float(tree.query(plan.reference.positions)[0].max())
            found.append(Pair(sheet, seed, bottle, cup, plan.reference, "", off))
    return found


def blocked_pairs(
    planner: ReactivePlanner, unaware: ReactivePlanner, sheet: str, seed: int, sides: Sequence[int] = range(len(_SIDES))
) -> list[Blocked]:
    """Spheres in the bottle's way half way of every pair; `unaware` knows nothing of the bottle."""
    found = []
    for bottle in PLACES:
        for cup in PLACES:
            ends = *at_bottle(bottle), *at_cup(cup)
            planner.take_obstacles(Obstacles.none())
            free = planner.plan(*ends).reference
            if free is None:
                continue
            for side in sides:
                centre = sphere_beside(*free.sample(0.5 * free.duration), np.array(_SIDES[side]))
                clearances = []
                for asked in (planner, unaware):
                    asked.set_obstacles(centre[None], np.array([_RADIUS]))
                    way = asked.plan(*ends).reference
                    clearances.append(math.nan if way is None else _clearance(way, centre))
                found.append(Blocked(sheet, seed, side, bottle, cup, *clearances))
    return found


def sphere_beside(position: np.ndarray, quaternion: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Centre (3,) of a sphere, `_DEPTH` deep in the bottle from a direction (3,), the tool at a pose (3,), (4,)."""
    middle = np.array(fixed_to(position, quaternion, bottle_in_hand()[0]).centre)

    def depth(away: float) -> float:
        return -bottle_distance(position[None], quaternion[None], (middle + away * direction)[None], _RADIUS) - _DEPTH

    return middle + brentq(depth, 0.0, 0.5) * direction


def _clearance(way: TaskSpaceReference, centre: np.ndarray) -> float:
    """Exact distance [m] of the bottle from a standing sphere along a reference, every 5 ms."""
    poses = [way.sample(time) for time in np.arange(0.0, way.duration + 0.005, 0.005)]
    positions, quaternions = map(np.array, zip(*poses, strict=True))
    return bottle_distance(positions, quaternions, np.broadcast_to(centre, positions.shape), _RADIUS)


def pour_all_cups(planner: ReactivePlanner, seed: int, bottle: int = 0) -> Chain:
    """Plan and play the chain of one bottle."""
    planner.take_obstacles(Obstacles.none())
    stops = [at_bottle(bottle), *(at_cup(cup) for cup in PLACES)]
    parts: list[TaskSpaceReference] = []
    for begin, end in pairwise(stops):
        plan = planner.plan(*begin, *end)
        if plan.reference is None:
            return Chain(seed, tuple(parts), f"part {len(parts)}: {plan.verdict.reason}")
        parts.append(plan.reference)
    motion, poured = _played(parts, standing_there(bottle))
    with TabletopWorld(rate_hz=RATE_HZ * STEPS_PER_SAMPLE) as world:
        done = perform(world, motion)
    tool = done.demonstration
    mouth = [_mouth(tool.positions[at], tool.quaternions[at]) for at in poured]
    cups = [CUP_REGION.at(np.array(CUP_PLACES[cup])) for cup in PLACES]
    off = tuple(float(np.linalg.norm(place[:2] - cup)) for place, cup in zip(mouth, cups, strict=True))
    behind = float(np.linalg.norm(tool.positions - motion.positions, axis=1).max())
    return Chain(seed, tuple(parts), "", off, behind, done.clearance, done.joint_positions)


def _played(parts: Sequence[TaskSpaceReference], solid: Sequence[Cylinder]) -> tuple[Motion, list[int]]:
    """References one after the other with a pause after each, and the last samples of the pauses."""
    poses: list[tuple[np.ndarray, np.ndarray]] = []
    poured = []
    for part in parts:
        poses += [part.sample(time) for time in np.arange(0.0, part.duration + _PAUSE, 1.0 / RATE_HZ)]
        poured.append(len(poses) - 1)
    positions, quaternions = map(np.array, zip(*poses, strict=True))
    times = np.arange(len(poses)) / RATE_HZ
    return Motion("chain", times, positions, continuous_signs(quaternions), tuple(solid), bottle_in_hand()), poured


def _mouth(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Where the bottle's mouth is (3,)."""
    neck = fixed_to(position, quaternion, bottle_in_hand()[1])
    return np.array(neck.centre) + 0.5 * neck.height * to_rotation(np.array(neck.quaternion)).apply([0.0, 0.0, 1.0])


def past_a_moving_sphere(planner: ReactivePlanner, bottle: int = 0, cup: int = 2) -> Stream:
    """Follow the stream while a sphere crosses under the bottle where it would be half way, just then."""
    start, goal = at_bottle(bottle), at_cup(cup)
    planner.take_obstacles(Obstacles.none())
    nominal = planner.plan(*start, *goal).reference
    if nominal is None:
        raise ParameterError(f"there is no way from bottle {bottle} to cup {cup} even without the sphere")
    half = 0.5 * nominal.duration
    point = sphere_beside(*nominal.sample(half), np.array(_SIDES[0]))
    sphere = crossing(point, np.array([-1.0, 0.0, 0.0]), half, _SPEED, _RADIUS)
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(*start)
    planner.clear_goal()
    planner.set_goal(*goal)
    gone, centres, ahead = [follower.position], [sphere.position(0.0)], [nominal.positions]
    turned = [follower.quaternion]
    while len(gone) * _TICK < _LONGEST and np.linalg.norm(gone[-1] - goal[0]) > _ARRIVED:
        now = (len(gone) - 1) * _TICK
        centre, velocity = sphere.position(now), _velocity(sphere, now)
        planner.take_obstacles(Obstacles.of_spheres(centre[None], np.array([_RADIUS]), velocity[None], now))
        plan = planner.tick(follower.position, follower.quaternion, follower.speed, now=now)
        if plan.reference is None:
            follower.hold()
        else:
            follower.accept(plan.reference)
            ahead[-1] = plan.reference.positions
        follower.advance(_TICK)
        gone.append(follower.position)
        turned.append(follower.quaternion)
        centres.append(sphere.position(now + _TICK))
        ahead.append(ahead[-1])
    gone_by, times = np.array(gone), _TICK * np.arange(len(gone))
    unaware = [nominal.sample(time) for time in times]
    positions, quaternions = map(np.array, zip(*unaware, strict=True))
    nearest = int(np.argmin(np.linalg.norm(gone_by - centres, axis=1)))
    moments = tuple(
        Moment(float(times[at]), centres[at], turned[at], gone_by[: at + 1], ahead[at])
        for at in (nearest // 3, nearest)
    )
    reached = bool(np.linalg.norm(gone_by[-1] - goal[0]) <= _ARRIVED)
    return Stream(
        (moments[0], moments[1]), nominal.positions, reached,
        bottle_distance(gone_by, np.array(turned), np.array(centres), _RADIUS),
        bottle_distance(positions, quaternions, np.array(centres), _RADIUS),
    )  # fmt: skip


def _velocity(sphere: LineObstacle, now: float) -> np.ndarray:
    return (sphere.position(now + _TICK) - sphere.position(now)) / _TICK


def draw_pouring_task(report: PouringTaskReport, path: Path) -> None:
    """The first seed: all pairs in the latent space and from above, the moving sphere at two times, and the chain."""
    from matplotlib.figure import Figure

    seed = report.settings.seeds[0]
    figure = Figure(figsize=(13.0, 9.6), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(5.2, 2.4, 2.2), width_ratios=(1.0, 1.0))
    pairs = [item for item in report.pairs if (item.sheet, item.seed) == ("raw", seed) and item.reference is not None]
    names = {True: ("geodesic of a pair that was shown", BLUE), False: ("geodesic of another pair", VERMILION)}
    ways = [Way(item.reference.latent, item.reference.positions, *names[item.bottle == item.cup]) for item in pairs]
    ways.sort(key=lambda way: way.colour == BLUE)
    axes = figure.add_subplot(grid[0, 0])
    handles = latent_background(figure, axes, report.raw)
    handles += draw_latent_ways(axes, ways)
    axes.set_title(f"a  Raw sheet: {len(pairs)} of {len(PLACES) ** 2} pairs, 3 shown", loc="left", fontsize=11)
    _from_above(figure.add_subplot(grid[0, 1]), report.shown, ways)
    for column, (letter, moment) in enumerate(zip("cd", report.stream.moments, strict=True)):
        panel = figure.add_subplot(grid[1, column])
        handles += _draw_moment(panel, report, moment)
        title = f"{letter}  Raw sheet, a sphere crosses under the bottle: after {moment.time:.1f} s"
        panel.set_title(title, loc="left", fontsize=11)
    chain = next((item for item in report.chains if len(item.joints)), None)
    if chain is not None:
        axes = figure.add_subplot(grid[2, :])
        axes.imshow(_strip(chain.joints))
        axes.set_axis_off()
        axes.set_title("e  Raw sheet, three geodesics in a chain: one bottle over all cups", loc="left", fontsize=11)
    named = {str(handle.get_label()): handle for handle in handles}
    figure.legend(handles=list(named.values()), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    write_figure(figure, path)


def _from_above(axes: Any, shown: Demonstrations, ways: Sequence[Way]) -> None:
    """The tool's ways among the demonstrations; the y axis, from bottles to cups, to the right."""
    for item in shown:
        axes.plot(*(100.0 * item.positions[:, 1::-1].T), color=GREY, linewidth=0.7, alpha=0.7)
    for way in ways:
        axes.plot(*(100.0 * way.positions[:, 1::-1].T), color=way.colour, linewidth=1.6)
    for region, places, name in ((BOTTLE_REGION, BOTTLE_PLACES, "bottle"), (CUP_REGION, CUP_PLACES, "cup")):
        for number, place in enumerate(100.0 * region.at(np.array(places))):
            axes.plot(*place[::-1], "o", color="black", markersize=5)
            axes.annotate(f"{name} {number}", place[::-1], xytext=(0, 7), textcoords="offset points", ha="center")
    axes.set(xlabel="y [cm]", ylabel="x [cm]", aspect="equal")
    axes.margins(0.12)
    axes.set_title("b  The same from above", loc="left", fontsize=11)


def _draw_moment(axes: Any, report: PouringTaskReport, moment: Moment) -> list[Any]:
    """The stream at a time, seen along x: the tool's ways, and the outline of what it holds."""
    from matplotlib.patches import Circle, Polygon

    for item in report.shown:
        axes.plot(*(100.0 * item.positions[:, 1:].T), color=GREY, linewidth=0.6, alpha=0.5)
    axes.add_patch(Circle(100.0 * moment.centre[1:], 100.0 * _RADIUS, color=ORANGE, alpha=0.85, label="moving sphere"))
    for part in bottle_in_hand():
        held = fixed_to(moment.gone[-1], moment.quaternion, part)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [part.radius, 0.5 * part.height]
        along = to_rotation(np.array(held.quaternion)).apply([0.0, 0.0, 1.0])[1:]
        across = np.array([along[1], -along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
        outline = np.array(held.centre)[1:] + corners[:, :1] * across + corners[:, 1:] * along
        axes.add_patch(Polygon(100.0 * outline, facecolor=GREEN, alpha=0.5, label="bottle"))
    axes.plot(*(100.0 * report.stream.nominal[:, 1:].T), "--", color=BLUE, linewidth=1.6, label="geodesic without it")
    axes.plot(*(100.0 * moment.ahead[:, 1:].T), color=VERMILION, linewidth=2.2, label="geodesic at the time")
    axes.plot(*(100.0 * moment.gone[:, 1:].T), color="black", linewidth=2.4, label="way gone by now")
    axes.plot(*(100.0 * moment.gone[-1, 1:]), "o", color="black", markersize=6)
    axes.set(xlabel="y [cm]", ylabel="z [cm]", aspect="equal")
    return axes.get_legend_handles_labels()[0]


def _strip(joints: np.ndarray, width: int = 400, height: int = 270, postures: int = 5) -> np.ndarray:
    """The arm with the bottle at even shares of the chain's time, side by side."""
    pictures = []
    with TabletopWorld() as world:
        for configuration in joints[evenly(len(joints), postures)]:
            world.reset(configuration)
            held = (fixed_to(*world.tool_pose(), part) for part in bottle_in_hand())
            world.furnish((), [*standing_there(0), *held])
            pictures.append(world.render(width, height, "front", oversampling=2))
    return np.concatenate(pictures, axis=1)
