"""Pouring in task space, three bottles to three cups of which three pairs were shown: all nine, an obstacle, a chain.

The simulated teacher carries each of three bottles to a cup of its own, and the three paths cross (`joint_teacher.
pouring`); what is learned are the poses of the tool. For every seed of the training:

- *pairs*: from each bottle to each cup, on the raw sheet, the paper's, on the canonical one, and by the paper to the
  letter (*literal*: `TrainingSettings.paper` and its planner). What counts is how far a path is from any position that
  was demonstrated;
- *clearance*: halfway along each path a sphere beside the bottle or under it, 1 cm deep in its path. The planner that
  takes the tool for a sphere of 4 cm does not know of the bottle in the hand; the other one has spheres along it that
  hold all of it, or, literal, plans for the position of the bottle's body, and adds its radius. Measured is the exact
  distance of the bottle's two cylinders from the sphere, along the dense path;
- *chain*: with one bottle to the first cup, on to the second and to the third: three geodesics on the raw sheet, which
  alone takes an end that was shown for a start. It is played by the arm in PyBullet among the stands.

For the first seed a sphere *moves* through the path while the tool follows it on the raw sheet, and the geodesic is
drawn at two times. Of the same skill a second picture shows how a sphere reshapes the metric, and many geodesics
between random points (`reshaped_metric`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree
from tqdm import tqdm

from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.geometry.curves import Pose, PoseCurve, interpolate
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.paper.paper_planner import STRENGTH_OF_POSES, PaperPlanner, PaperSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.joint_teacher import BOTTLE_PLACES, CUP_PLACES, pouring
from geodesic_motion_ros.simulation.teacher import BOTTLE_REGION, CUP_REGION, bottle_in_hand
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import (
    BLUE,
    GREY,
    VERMILION,
    DrawnPath,
    draw_latent_paths,
    latent_background,
    write_figure,
)
from geodesic_motion_studies.experiments.posture_strip import draw_strip
from geodesic_motion_studies.experiments.pouring_motions import (
    Chain,
    Stream,
    draw_moment,
    past_a_moving_sphere,
    pour_all_cups,
)
from geodesic_motion_studies.experiments.pouring_scene import (
    PLACES,
    SIDES,
    SPHERE_RADIUS,
    at_bottle,
    at_cup,
    bottle_distance,
    bottle_settings,
    pouring_strip,
    sphere_beside,
)
from geodesic_motion_studies.experiments.requested_ends import farthest_end
from geodesic_motion_studies.experiments.reshaped_metric import ReshapedMetric, draw_reshaped_metric, reshape_metric
from geodesic_motion_studies.experiments.study import Report, Study, bandwidth_factor, changed, far_sigma, option, seeds
from geodesic_motion_studies.experiments.trained import BRIEFLY, trained_once

TASK = "pouring_places"
SHEETS = {"raw sheet": "raw", "canonical sheet": "canonical"}
LITERAL = "literal"
ROWS = (*SHEETS, LITERAL)
#: A path from a start to a goal among spheres at (o, 3) [m], or why there is none.
Plan = Callable[[Pose, Pose, np.ndarray], PoseCurve | Refusal]
#: Poses between two samples of a path where the bottle's clearance is measured.
_CHECKS = 10


@dataclass(frozen=True)
class PouringTask(Study):
    """Show, train, plan and play."""

    shown: int = option(3, "demonstrations of each of three pairs", least=1)
    seeds: tuple[int, ...] = seeds()
    far_sigma: float | None = far_sigma("the literal training")
    bandwidth_factor: float | None = bandwidth_factor("the literal training")

    def measure(self, out: Path) -> PouringTaskReport:
        shown = pouring(self.shown, 0).tool_demonstrations(Robot.named("panda"))
        pairs: list[Pair] = []
        blocked: list[FailedAttempts] = []
        chains: list[Chain] = []
        streams, raw = [], []
        for seed in tqdm(self.seeds, desc="pouring-task", unit="seed"):
            planners = {}
            for row, sheet in SHEETS.items():
                training = TrainingSettings(**BRIEFLY, seed=seed, sheet=sheet)
                skill = trained_once(TASK, shown, training, out / "skills")
                planners[row] = planner = PosePathPlanner(skill, bottle_settings())
                pairs += all_pairs(ours(planner), shown, row, seed)
                blocked += blocked_pairs(ours(planner), ours(PosePathPlanner(skill)), row, seed)
            literally = changed(
                TrainingSettings.paper(seed=seed), far_sigma=self.far_sigma, bandwidth_factor=self.bandwidth_factor
            )
            skill = trained_once(TASK, shown, literally, out / "skills")
            with_bottle, hand_alone = literal(skill, True), literal(skill, False)
            pairs += all_pairs(hand_alone, shown, LITERAL, seed)
            blocked += blocked_pairs(with_bottle, hand_alone, LITERAL, seed)
            chains.append(pour_all_cups(planners["raw sheet"], seed))
            if not streams:
                raw.append(planners["raw sheet"].skill)
                tool = replace(bottle_settings(), avoid="tool")
                streams.append(past_a_moving_sphere(ReactivePlanner(raw[0], tool)))
        return PouringTaskReport(
            self, tuple(pairs), tuple(blocked), tuple(chains), streams[0], reshape_metric(raw[0]), shown, raw[0]
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Pair:
    """From one bottle to one cup, by one of ROWS.

    Attributes
    ----------
    path : None where the planner refused, for a reason.
    off : largest distance of the path from any demonstrated position [m].
    missed : how far the path's ends are from the requested ones [m], the farther of the two.
    """

    row: str
    seed: int
    bottle: int
    cup: int
    path: PoseCurve | None
    reason: str = ""
    off: float = math.nan
    missed: float = math.nan


@dataclass(frozen=True)
class FailedAttempts:
    """A sphere on the bottle's path: the exact clearance of the bottle [m] on the path planned with the bottle, and
    with the hand alone; NaN where that was refused. `side` is one of those where spheres are.
    """

    row: str
    seed: int
    side: int
    bottle: int
    cup: int
    with_bottle: float
    hand_alone: float


@dataclass(frozen=True)
class PouringTaskReport(Report):
    """All of it."""

    settings: PouringTask
    pairs: tuple[Pair, ...]
    blocked: tuple[FailedAttempts, ...]
    chains: tuple[Chain, ...]
    stream: Stream
    reshaped: ReshapedMetric = field(repr=False)
    shown: Demonstrations = field(repr=False)
    raw: Skill = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        return {
            "settings": asdict(self.settings),
            "pairs": [
                {"row": item.row, "seed": item.seed, "bottle": item.bottle, "cup": item.cup,
                 "reached": item.path is not None, "reason": item.reason, "off": item.off, "missed": item.missed}
                for item in self.pairs
            ],
            "blocked": [asdict(item) for item in self.blocked],
            "chains": [
                {"seed": item.seed, "parts": len(item.parts), "reason": item.reason, "mouth_off": item.mouth_off,
                 "behind": item.behind, "clearance": item.clearance}
                for item in self.chains
            ],
            "moving": {"reached": self.stream.reached, "clearance": self.stream.clearance,
                       "unaware": self.stream.unaware},
            "reshaped": self.reshaped.as_dict(),
        }  # fmt: skip

    def table(self) -> str:
        """The tables as plain text, with what was refused."""
        pairs: list[list[Cell]] = []
        for row in ROWS:
            for seed in self.settings.seeds:
                of = [item for item in self.pairs if (item.row, item.seed) == (row, seed)]
                reached = [item for item in of if item.path is not None]
                off = {
                    shown: max((1e3 * item.off for item in reached if (item.bottle == item.cup) == shown), default=None)
                    for shown in (True, False)
                }
                missed = max((1e3 * item.missed for item in reached), default=None)
                pairs.append([row, seed, f"{len(reached)} of {len(of)}", off[True], off[False], missed])
        blocked: list[list[Cell]] = []
        for row in ROWS:
            for seed in self.settings.seeds:
                spheres = [item for item in self.blocked if (item.row, item.seed) == (row, seed)]
                known = [1e3 * item.with_bottle for item in spheres if not math.isnan(item.with_bottle)]
                hand = [1e3 * item.hand_alone for item in spheres if not math.isnan(item.hand_alone)]
                blocked.append([
                    row, seed, len(spheres), len(known), sum(value <= 0.0 for value in known),
                    min(known, default=None), len(hand), sum(value <= 0.0 for value in hand), min(hand, default=None),
                ])  # fmt: skip
        chains: list[list[Cell]] = [
            [item.seed, f"{len(item.parts)} of {len(PLACES)}", 1e3 * max(item.mouth_off, default=math.nan),
             1e3 * item.behind, 1e3 * item.clearance]
            for item in self.chains
        ]  # fmt: skip
        stream = self.stream
        refused = [
            f"{item.row}, seed {item.seed}, {item.bottle} to {item.cup}: {item.reason}"
            for item in self.pairs if item.reason
        ] + [f"chain, seed {item.seed}: {item.reason}" for item in self.chains if item.reason]  # fmt: skip
        return "\n".join([
            text_table(
                ["pairs", "seed", "reached", "off, shown pairs mm", "off, others mm", "ends missed mm"], pairs, 1
            ), "",
            text_table(
                ["sphere on the bottle's path", "seed", "scenes", "answered", "hits", "least mm",
                 "hand alone: answered", "hits", "least mm"], blocked, 1,
            ), "",
            text_table(
                ["chain, seed", "geodesics", "mouth off the cup mm", "tool behind mm", "arm clear mm"], chains, 1
            ), "",
            f"moving sphere: {'reached' if stream.reached else 'NOT reached'}, bottle {1e3 * stream.clearance:.1f} mm "
            f"clear; {1e3 * stream.unaware:.1f} mm on the path without the sphere",
            *self.reshaped.lines(), *refused,
        ])  # fmt: skip

    def draw(self, path: Path) -> None:
        """The first seed: all pairs in the latent space and from above, the moving sphere at two times, and the chain;
        in a second picture beside the first, NAME_metric.png, the reshaped metric.
        """
        seed = self.settings.seeds[0]
        figure = Figure(figsize=(13.0, 9.6), layout="constrained")
        grid = figure.add_gridspec(3, 2, height_ratios=(5.2, 2.4, 2.2), width_ratios=(1.0, 1.0))
        pairs = [
            (item.path, item.bottle == item.cup) for item in self.pairs
            if (item.row, item.seed) == ("raw sheet", seed) and isinstance(item.path, PosePath)
        ]  # fmt: skip
        names = {True: ("geodesic of a pair that was shown", BLUE), False: ("geodesic of another pair", VERMILION)}
        paths = [DrawnPath(path.latent, path.positions, *names[shown]) for path, shown in pairs]
        paths.sort(key=lambda path: path.colour == BLUE)
        axes = figure.add_subplot(grid[0, 0])
        handles = latent_background(figure, axes, self.raw)
        handles += draw_latent_paths(axes, paths)
        axes.set_title(f"a  Raw sheet: {len(pairs)} of {len(PLACES) ** 2} pairs, 3 shown", loc="left", fontsize=11)
        _from_above(figure.add_subplot(grid[0, 1]), self.shown, paths)
        for column, (letter, moment) in enumerate(zip("cd", self.stream.moments, strict=True)):
            panel = figure.add_subplot(grid[1, column])
            handles += draw_moment(panel, self.shown, self.stream.nominal, moment)
            title = f"{letter}  Raw sheet, a sphere crosses under the bottle: after {moment.time:.1f} s"
            panel.set_title(title, loc="left", fontsize=11)
        chain = next((item for item in self.chains if len(item.joints)), None)
        if chain is not None:
            title = "e  Raw sheet, three geodesics in a chain: one bottle over all cups"
            draw_strip(figure.add_subplot(grid[2, :]), pouring_strip(chain.joints, 0), title)
        named = {str(handle.get_label()): handle for handle in handles}
        figure.legend(handles=list(named.values()), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
        write_figure(figure, path)
        draw_reshaped_metric(self.reshaped, path.with_stem(f"{path.stem}_metric"))


def ours(planner: PosePathPlanner) -> Plan:
    """The paths of our planner."""

    def plan(start: Pose, goal: Pose, centres: np.ndarray) -> PosePath | Refusal:
        planner.set_obstacles(centres, np.full(len(centres), SPHERE_RADIUS))
        return planner.plan(*start, *goal)

    return plan


def literal(skill: Skill, with_bottle: bool) -> Plan:
    """The paths of the paper's planner, for the position of the bottle's body or for that of the hand."""
    planner = PaperPlanner(skill, PaperSettings(strength=STRENGTH_OF_POSES))
    body = bottle_in_hand()[0]
    bottle = HeldObject("bottle", "cylinder", (body.radius, body.height), body.centre, body.quaternion)
    assert planner.hold((bottle,) if with_bottle else ()).ok

    def plan(start: Pose, goal: Pose, centres: np.ndarray) -> PoseCurve:
        planner.set_obstacles(Obstacles.of_spheres(centres, np.full(len(centres), SPHERE_RADIUS)))
        return planner.tool_curve(start, goal)

    return plan


def all_pairs(plan: Plan, shown: Demonstrations, row: str, seed: int) -> list[Pair]:
    """Every bottle to every cup, without obstacles."""
    tree = cKDTree(np.concatenate([item.positions for item in shown]))
    found = []
    for bottle in PLACES:
        for cup in PLACES:
            ends = at_bottle(bottle), at_cup(cup)
            path = plan(*ends, np.empty((0, 3)))
            if isinstance(path, Refusal):
                found.append(Pair(row, seed, bottle, cup, None, path.reason))
                continue
            off = float(tree.query(path.positions)[0].max())
            found.append(Pair(row, seed, bottle, cup, path, "", off, farthest_end(path, *ends)))
    return found


def blocked_pairs(
    with_bottle: Plan, hand_alone: Plan, row: str, seed: int, sides: Sequence[int] = range(len(SIDES))
) -> list[FailedAttempts]:
    """Spheres on the bottle's path, halfway, for every pair."""
    found = []
    for bottle in PLACES:
        for cup in PLACES:
            ends = at_bottle(bottle), at_cup(cup)
            free = with_bottle(*ends, np.empty((0, 3)))
            if isinstance(free, Refusal):
                continue
            middle = free.resample(3)
            for side in sides:
                centre = sphere_beside(middle.positions[1], middle.quaternions[1], np.array(SIDES[side]))
                clearances = []
                for plan in (with_bottle, hand_alone):
                    path = plan(*ends, centre[None])
                    clearances.append(math.nan if isinstance(path, Refusal) else _clearance(path, centre))
                found.append(FailedAttempts(row, seed, side, bottle, cup, *clearances))
    return found


def _clearance(path: PoseCurve, centre: np.ndarray) -> float:
    """Exact distance [m] of the bottle from a standing sphere along a path, at `_CHECKS` poses between two samples."""
    samples = np.arange(float(len(path.positions)))
    at = np.linspace(0.0, samples[-1], _CHECKS * (len(samples) - 1) + 1)
    positions, quaternions = interpolate(samples, path.positions, path.quaternions, at)
    return bottle_distance(positions, quaternions, np.broadcast_to(centre, positions.shape), SPHERE_RADIUS)


def _from_above(axes: Any, shown: Demonstrations, paths: Sequence[DrawnPath]) -> None:
    """The tool's paths among the demonstrations; the y axis, from bottles to cups, to the right."""
    for item in shown:
        axes.plot(*(100.0 * item.positions[:, 1::-1].T), color=GREY, linewidth=0.7, alpha=0.7)
    for path in paths:
        axes.plot(*(100.0 * path.positions[:, 1::-1].T), color=path.colour, linewidth=1.6)
    # Beside the points, on the sides that no path comes from.
    for region, places, name, side, aligned in (
        (BOTTLE_REGION, BOTTLE_PLACES, "bottle", -7, "right"), (CUP_REGION, CUP_PLACES, "cup", 7, "left"),
    ):  # fmt: skip
        for number, place in enumerate(100.0 * region.at(np.array(places))):
            axes.plot(*place[::-1], "o", color="black", markersize=5)
            axes.annotate(
                f"{name} {number}", place[::-1], xytext=(side, -3), textcoords="offset points", ha=aligned
            )
    axes.set(xlabel="y [cm]", ylabel="x [cm]", aspect="equal")
    axes.margins(x=0.2, y=0.12)
    axes.set_title("b  The hand from above: it pours from beside the cups", loc="left", fontsize=11)
