"""Reach to grasp with the whole arm in several families: which ways are left when some of them are blocked?

Two sets of simulated demonstrations (`joint_teacher.reach_to_grasp`), one skill of each for every seed:

- *separated*: three families, each with the elbow elsewhere from start to goal; the hand does the same in all;
- *meeting*: two families that begin alike, open to either side, meet half way, open again, and end alike.

Of each skill, on the whole latent box, walls and all: energies of the shortest paths from the start of one family to
the goal of each, within and across. Then spheres are put in the way and the planner is asked:

- *free*: from the start of each family to whichever family's goal configuration is the cheapest;
- *one way*: a sphere in the arm of one family, late on its way. From its start there is none; the others are left;
- *goal*: a sphere at the common goal of the hand. There is no way at all;
- *hybrid*: in the meeting set a sphere on the first opening of one family, and one on the second of the other. What is
  left is a way that nobody showed: the one family's first half, the other's second;
- *both*: a sphere on the first opening of both. There is no way at all.

- *one way*: a sphere in the arm of one family, late on its way. From its start there is none; the others are left;
Clearances are those of the arm's meshes, every 5 ms, by PyBullet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.arm_queries import body_spheres, distances
from geodesic_motion_ros.experiments.blocked_arm import CHECK_PERIOD, arm_clearance, every
from geodesic_motion_ros.experiments.learned_paths import LearnedPaths, whole_box
from geodesic_motion_ros.experiments.posture_strip import posture_strips
from geodesic_motion_ros.experiments.trained import BRIEFLY, check_seeds, trained_once
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.joint_query import GoalChoice
from geodesic_motion_ros.joint_reference import JointReference
from geodesic_motion_ros.joint_sheet import JointSheet
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.plots import BLUE, VERMILION, Sphere, Way, legend_below, write_figure
from geodesic_motion_ros.simulation.collision_geometry import CollisionGeometry
from geodesic_motion_ros.simulation.joint_teacher import reach_to_grasp
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import Cell, text_table

if TYPE_CHECKING:
    from geodesic_motion_ros.manifold.joint_training import JointTrainingSettings

SETS = ("separated", "meeting")
#: Radius of the spheres [m].
RADIUS = 0.04
#: Parts of a way, as shares of the body's arc: begin and end, and the two openings.
BEGIN, END, FIRST, SECOND = (0.0, 0.3), (0.6, 1.0), (0.15, 0.35), (0.65, 0.85)
#: Every so many samples of ways are looked at for a place.
_EVERY = 6
#: A way that is in a family for less than this share of it has only brushed against it, where families meet.
PASSED = 0.15
#: Nodes along each side of the box for energies.
_BOX = (40, 40, 40)
_PICTURE_PERIOD = 0.02
#: Name and colour of a way without spheres, and among them.
_MARKED = ("geodesic", BLUE), ("geodesic among spheres", VERMILION)


@dataclass(frozen=True)
class GraspJointSettings:
    """How many demonstrations of each family are shown; `seeds` are of the trainings, one skill of each set for each.

    The demonstrations are the same for all seeds.
    """

    shown: int = 3
    seeds: tuple[int, ...] = (0, 1, 2)
    planner: JointPlannerSettings = field(default_factory=JointPlannerSettings)

    def __post_init__(self) -> None:
        if self.shown < 2:
            raise ParameterError(f"shown is {self.shown}; a family needs at least 2 demonstrations")
        check_seeds(self.seeds)


@dataclass(frozen=True)
class Energies:
    """Energies (F, F) of the shortest paths from the start of each family (row) to the goal of each (column), and the
    largest squared length of one edge of each (`LearnedPath`); `edge_limit` is what the planner allows an edge.
    """

    energy: np.ndarray
    dearest: np.ndarray
    edge_limit: float

    @property
    def within(self) -> np.ndarray:
        """(F,) from the start of a family to its own goal."""
        return np.diag(self.energy)

    @property
    def across(self) -> np.ndarray:
        """(F (F - 1),) from the start of a family to the goal of another."""
        return self.energy[~np.eye(len(self.energy), dtype=bool)]


@dataclass(frozen=True, eq=False)
class Scene:
    """Spheres, and what the planner makes of them.

    Attributes
    ----------
    name : as above; family : whose start the arm begins at, -1 where all begin alike.
    centres, radii : (o, 3), (o,) of the spheres [m].
    wanted : the families that the way is to pass one after the other, each of the tuples would do; empty: there should
        be no way.
    passed : those that it passes; empty where the planner refused. reason : why it did.
    clearance, certified : least distance of the arm from the spheres [m], as measured and as promised; NaN refused.
    duration : of the way [s]. reference : of the planner, None where it refused.
    """

    name: str
    family: int
    centres: np.ndarray
    radii: np.ndarray
    wanted: tuple[tuple[int, ...], ...]
    passed: tuple[int, ...]
    reason: str
    clearance: float = math.nan
    certified: float = math.nan
    duration: float = math.nan
    reference: JointReference | None = None

    @property
    def as_expected(self) -> bool:
        """Whether the way is one of those wanted and clear, or refused where there is none."""
        if not self.wanted:
            return self.reference is None
        return self.passed in self.wanted and not self.clearance <= 0.0

    def told(self) -> dict[str, Any]:
        """What `--json` writes."""
        left_out = {"reference"}
        told = {name: value for name, value in vars(self).items() if name not in left_out}
        return told | {"as_expected": self.as_expected}


@dataclass(frozen=True)
class SkillReport:
    """What one skill does."""

    kind: str
    seed: int
    families: int
    energies: Energies
    scenes: tuple[Scene, ...]


@dataclass(frozen=True)
class GraspJointReport:
    """What all skills do, and one of each set to be drawn."""

    settings: GraspJointSettings
    skills: tuple[SkillReport, ...]
    drawn: dict[str, JointSpacePlanner] = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            "settings": asdict(self.settings),
            "skills": [
                {
                    "set": report.kind, "seed": report.seed, "families": report.families,
                    "energies": asdict(report.energies), "scenes": [scene.told() for scene in report.scenes],
                }
                for report in self.skills
            ],
        }  # fmt: skip

    def table(self) -> str:
        """The tables as plain text."""
        return "\n\n".join([self._energies(), self._scenes()])

    def _energies(self) -> str:
        head = [
            "energies", "seed", "families", "within, least", "within, most", "across, least", "across, most",
            "least ratio", "edge within", "edge across", "edge allowed",
        ]  # fmt: skip
        rows: list[list[Cell]] = []
        for report in self.skills:
            if report.kind != "separated":
                continue
            found = report.energies
            others = ~np.eye(report.families, dtype=bool)
            rows.append([
                report.kind, report.seed, report.families, float(found.within.min()), float(found.within.max()),
                float(found.across.min()), float(found.across.max()),
                float(found.across.min() / found.within.max()), float(np.diag(found.dearest).max()),
                float(found.dearest[others].min()), found.edge_limit,
            ])  # fmt: skip
        return text_table(head, rows, 4)

    def _scenes(self) -> str:
        head = [
            "scene", "seed", "from family", "families passed", "clearance mm", "promised mm", "seconds", "as expected",
        ]  # fmt: skip
        rows: list[list[Cell]] = []
        notes: list[str] = []
        for report in self.skills:
            for scene in report.scenes:
                passed = " then ".join(map(str, scene.passed)) if scene.reference is not None else "refused"
                family = "any" if scene.family < 0 else str(scene.family)
                rows.append([
                    f"{report.kind}: {scene.name}", report.seed, family, passed, 1e3 * scene.clearance,
                    1e3 * scene.certified, scene.duration, "yes" if scene.as_expected else "NO",
                ])  # fmt: skip
                notes += [scene.reason] if scene.reason else []
        said = [f"{notes.count(reason)} x refused: {reason}" for reason in sorted(set(notes))]
        return "\n".join([text_table(head, rows, 1), *said])


def measure_grasp_joint(
    settings: GraspJointSettings = GraspJointSettings(),
    skills: Path = Path("out/experiments/skills"),
    training: JointTrainingSettings | None = None,
    show_progress: bool = True,
) -> GraspJointReport:
    """Show, train and ask.

    Parameters
    ----------
    skills : cache of trained skills, see `trained_once`. training : its seed is replaced; None: `BRIEFLY`.
    """
    from geodesic_motion_ros.manifold.joint_training import JointTrainingSettings

    base = training or JointTrainingSettings(**BRIEFLY)
    shown = {
        "separated": reach_to_grasp(settings.shown, 0, families=3, connected=False),
        "meeting": reach_to_grasp(settings.shown, 0, families=2, connected=True, openings=2),
    }
    reports, drawn = [], {}
    count = len(SETS) * len(settings.seeds)
    with tqdm(total=count, desc="grasp-joint", unit="skill", disable=not show_progress) as bar:
        for seed in settings.seeds:
            for kind in SETS:
                skill = trained_once(f"reach_{kind}", shown[kind], replace(base, seed=seed), skills)
                planner = JointSpacePlanner(skill, settings.planner)
                scenes = separated_scenes(planner) if kind == "separated" else meeting_scenes(planner)
                families = len(mean_ways(skill))
                reports.append(SkillReport(kind, seed, families, family_energies(skill), scenes))
                drawn.setdefault(kind, planner)
                bar.update()
    return GraspJointReport(settings, tuple(reports), drawn)


def mean_ways(skill: Skill) -> np.ndarray:
    """Mean canonical motions (F, S, eta) [rad] of a skill's families.

    Raises
    ------
    ParameterError : the skill is not of joint space, or on the raw sheet, which knows no families.
    """
    sheet = skill.canonical
    if not isinstance(sheet, JointSheet):
        raise ParameterError(f"'{skill.name}' is not a joint-space skill on a canonical sheet: it knows no families")
    return np.array([
        sheet.configurations[sheet.modes == mode].mean(axis=0) for mode in range(int(sheet.modes.max()) + 1)
    ])  # fmt: skip


def family_energies(skill: Skill, shape: tuple[int, ...] | None = _BOX) -> Energies:
    """Shortest paths between all starts and goals of a skill's families, on its whole latent box; shape : its nodes."""
    paths, modes = LearnedPaths(whole_box(skill, shape)), skill.canonical.modes
    ends = np.array([skill.codes[modes == mode][:, [0, -1]].mean(axis=0) for mode in range(int(modes.max()) + 1)])
    found = [[paths.shortest(start, goal) for goal in ends[:, 1]] for start in ends[:, 0]]
    energy, dearest = (np.array([[getattr(path, of) for path in row] for row in found]) for of in ("energy", "dearest"))
    return Energies(energy, dearest, skill.graph(shape).energy_limit)


def separated_scenes(planner: JointSpacePlanner) -> tuple[Scene, ...]:
    """The scenes of families that never meet."""
    ways = mean_ways(planner.skill)
    stage, families = _Stage(planner), range(len(ways))
    goals = GoalChoice(ways[:, -1], "the hand's goal, in whichever family")
    hand = planner.robot.forward(ways[0, -1])[0]
    scenes = [stage.scene("free", f, ways[f, 0], goals, [], [(f,)]) for f in families]
    for blocked in families:
        # Where the arm starts it is not to stand in the sphere.
        free = [*np.delete(ways, blocked, axis=0), _part(ways[blocked], *BEGIN)]
        sphere = sphere_on(planner, _part(ways[blocked], *END), np.concatenate(free))
        scenes += [
            stage.scene(f"way {blocked} blocked", f, ways[f, 0], goals, [sphere], [] if f == blocked else [(f,)])
            for f in families
        ]
    return (*scenes, *(stage.scene("goal blocked", f, ways[f, 0], goals, [hand], []) for f in families))


def meeting_scenes(planner: JointSpacePlanner) -> tuple[Scene, ...]:
    """The scenes of two families that meet at both ends and half way."""
    ways = mean_ways(planner.skill)
    if len(ways) != 2:
        raise ParameterError(f"the skill has {len(ways)} families; these scenes are of two")
    stage = _Stage(planner)
    start, goal = ways[:, 0].mean(axis=0), GoalChoice(ways[:, -1].mean(axis=0)[None], "that of all demonstrations")
    ends = ways[:, [0, -1]].reshape(-1, ways.shape[-1])

    def spheres(first: int, second: int) -> list[np.ndarray]:
        """On the other family's openings than those of a way."""
        way = np.concatenate([_part(ways[first], 0.0, 0.5), _part(ways[second], 0.5, 1.0)])
        return [sphere_on(planner, _part(ways[1 - family], *part), way)
                for family, part in ((first, FIRST), (second, SECOND))]  # fmt: skip

    asked: list[tuple[str, list[np.ndarray], list[tuple[int, ...]]]] = [
        ("free", [], [(0,), (1,), (0, 1), (1, 0)]),
        ("first of 0 blocked", spheres(1, 1)[:1], [(1,), (1, 0)]),
        ("hybrid, 1 then 0", spheres(1, 0), [(1, 0)]),
        ("hybrid, 0 then 1", spheres(0, 1), [(0, 1)]),
        ("both blocked", [sphere_on(planner, _part(way, *FIRST), ends) for way in ways], []),
    ]
    return tuple(stage.scene(name, -1, start, goal, centres, wanted) for name, centres, wanted in asked)


def sphere_on(planner: JointSpacePlanner, blocked: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Centre (3,) [m] of a sphere in the arm somewhere on a motion (n, eta), as far as may be from it on another."""
    places = body_spheres(planner, blocked[::_EVERY]).reshape(-1, 3)
    bodies = body_spheres(planner, free[::_EVERY])
    return max(places, key=lambda place: float(distances(planner, bodies, place, RADIUS).min()))


class _Stage:
    """Asks one planner, and judges what it answers."""

    def __init__(self, planner: JointSpacePlanner) -> None:
        self._planner, self._geometry = planner, CollisionGeometry.panda()

    def scene(
        self,
        name: str,
        family: int,
        start: np.ndarray,
        goal: GoalChoice,
        spheres: Sequence[np.ndarray],
        wanted: Sequence[tuple[int, ...]],
    ) -> Scene:
        """From a start (eta,) to a goal among spheres, given by their centres."""
        centres, radii = np.array(spheres).reshape(-1, 3), np.full(len(spheres), RADIUS)
        self._planner.set_obstacles(centres, radii)
        plan = self._planner.plan_configurations(start, goal)
        asked = name, family, centres, radii, tuple(wanted)
        if plan.reference is None:
            return Scene(*asked, (), plan.verdict.reason)
        way = every(CHECK_PERIOD, plan.reference)
        clearance = arm_clearance(self._geometry, way, centres, radii)
        return Scene(
            *asked, self._passed(plan.reference.latent), "", clearance, plan.verdict.clearance,
            plan.reference.duration, plan.reference,
        )  # fmt: skip

    def _passed(self, latent: np.ndarray) -> tuple[int, ...]:
        """The families that latent points (n, d) pass, one after the other."""
        return passed_in_turn(np.argmax(self._planner.graph.progress_map(latent)[1], axis=1))


def _part(way: np.ndarray, first: float, last: float) -> np.ndarray:
    """A motion (n, eta) between two shares of it."""
    return way[round(first * (len(way) - 1)) : round(last * (len(way) - 1)) + 1]


def passed_in_turn(families: np.ndarray) -> tuple[int, ...]:
    """Of families (n,) that a way is in, those that it stays in for more than PASSED of it, in turn."""
    bounds = np.flatnonzero(np.diff(families, prepend=-1, append=-1))
    stays = [
        int(families[begin]) for begin, end in pairwise(bounds)
        if end - begin > PASSED * len(families)
    ]  # fmt: skip
    return tuple(family for i, family in enumerate(stays) if i == 0 or family != stays[i - 1])


def draw_grasp_joint(report: GraspJointReport, path: Path) -> None:
    """The first seed: above latent spaces with ways; below the arm on ways that are left, row by row."""
    from matplotlib.figure import Figure

    from geodesic_motion_ros.joint_plots import draw_latent_tubes

    seed = report.settings.seeds[0]
    of = {item.kind: item.scenes for item in report.skills if item.seed == seed}
    free = [scene for scene in of["separated"] if scene.name == "free"]
    blocked = [scene for scene in of["separated"] if scene.name == "way 0 blocked"]
    hybrid = [scene for scene in of["meeting"] if scene.name.startswith("hybrid") and scene.as_expected]
    strips = [scene for scene in (*blocked, *hybrid[:1]) if scene.reference is not None]
    figure = Figure(figsize=(13.0, 5.2 + 2.05 * len(strips)), layout="constrained")
    grid = figure.add_gridspec(1 + len(strips), 3, height_ratios=(4.8, *(2.0 for _ in strips)))
    panels = [
        ("separated", free, "a  Separated families, nothing in the way"),
        ("separated", blocked, "b  Family 0 blocked: the others are left"),
        ("meeting", hybrid[:1] or of["meeting"][:1], "c  Families that meet: the hybrid is left"),
    ]
    named: dict[str, Any] = {}
    for column, (kind, scenes, title) in enumerate(panels):
        ways = [
            Way(scene.reference.latent, np.empty((0, 3)), *_MARKED[bool(len(scene.radii))])
            for scene in scenes if scene.reference is not None
        ]  # fmt: skip
        spheres = [Sphere(centre, RADIUS, centre[None]) for centre in scenes[0].centres]
        handles = draw_latent_tubes(figure, grid[0, column], report.drawn[kind], ways, spheres, title, zoom=0.85)
        named |= {str(handle.get_label()): handle for handle in handles}
    for row, scene in enumerate(strips, start=1):
        axes = figure.add_subplot(grid[row, :])
        axes.imshow(_strip(scene))
        axes.set_axis_off()
        axes.set_title(f"{'def'[row - 1]}  {_caption(scene)}", loc="left", fontsize=11)
    legend_below(figure, list(named.values()))
    write_figure(figure, path)


def _caption(scene: Scene) -> str:
    passed, clear = " then ".join(map(str, scene.passed)), f"{1e3 * scene.clearance:.0f} mm clear of the spheres"
    if scene.family >= 0:
        return f"Separated, family 0 blocked: family {passed} is left, {clear}"
    return f"Meeting, each family blocked on one half: family {passed}, {clear}"


def _strip(scene: Scene) -> np.ndarray:
    assert scene.reference is not None
    spheres = {
        str(i): (centre, float(radius))
        for i, (centre, radius) in enumerate(zip(scene.centres, scene.radii, strict=True))
    }
    return posture_strips([every(_PICTURE_PERIOD, scene.reference)], [spheres], width=400, height=270)
