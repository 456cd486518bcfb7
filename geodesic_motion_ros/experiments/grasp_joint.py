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

Clearances are those of the arm's meshes, every 5 ms, by PyBullet.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.blocked_arm import every
from geodesic_motion_ros.experiments.grasp_joint_scenes import (
    RADIUS,
    Scene,
    mean_ways,
    meeting_scenes,
    separated_scenes,
)
from geodesic_motion_ros.experiments.learned_paths import LearnedPaths, whole_box
from geodesic_motion_ros.experiments.posture_strip import posture_strips
from geodesic_motion_ros.experiments.trained import BRIEFLY, check_seeds, trained_once
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.plots import BLUE, VERMILION, Sphere, Way, legend_below, write_figure
from geodesic_motion_ros.simulation.joint_teacher import reach_to_grasp
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import Cell, text_table

if TYPE_CHECKING:
    from geodesic_motion_ros.manifold.joint_training import JointTrainingSettings

SETS = ("separated", "meeting")
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


def family_energies(skill: Skill, shape: tuple[int, ...] | None = _BOX) -> Energies:
    """Shortest paths between all starts and goals of a skill's families, on its whole latent box; shape : its nodes."""
    paths, modes = LearnedPaths(whole_box(skill, shape)), skill.canonical.modes
    ends = np.array([skill.codes[modes == mode][:, [0, -1]].mean(axis=0) for mode in range(int(modes.max()) + 1)])
    found = [[paths.shortest(start, goal) for goal in ends[:, 1]] for start in ends[:, 0]]
    energy, dearest = (np.array([[getattr(path, of) for path in row] for row in found]) for of in ("energy", "dearest"))
    return Energies(energy, dearest, skill.graph(shape).energy_limit)


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
