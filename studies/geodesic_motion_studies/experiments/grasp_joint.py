"""Reach to grasp with the whole arm in several families: which paths are left when some of them are blocked?

Two sets of simulated demonstrations (`joint_teacher.reach_to_grasp`):

- *separated*: three families, each with the elbow elsewhere from start to goal; the hand does the same in all;
- *meeting*: two families that begin alike, open to either side, meet in the middle, open again, and end alike.

Two rows: *ours*, one skill of each set for every seed, and the paper's to the letter (*literal*), one skill of each set
with `JointTrainingSettings.paper` and the first seed, planned with `PaperPlanner`.

Spheres are drawn at random in the arm on the families' mean motions (`grasp_joint_scenes`), the same for every skill.
From every start both planners plan to whichever goal is the cheapest. Scenes in which a sphere touches the
arm at its start or at its own family's goal are counted and left out; where that is so from all starts the scene is
counted and drawn again. The others are distinguished by what the spheres leave of what was demonstrated: something, or
nothing at all; in the meeting set it may be a hybrid alone that nobody demonstrated, the first half of one family and
the second of the other.

Energies: of ours on the whole latent box, walls and all, from the start of one family to the goal of each; of the
literal planner's paths, length squared, with no sphere, with one that is put so that it blocks one family, with all
families blocked, and from one family to the goal of another. Of its paths among the drawn spheres the table has which a
limit to the energy over the free path's would refuse (`energy_limit` has more of it).

Clearances are those of the arm's meshes, every 5 ms, by PyBullet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.paper.paper_planner import PaperPlanner, PaperSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.simulation.joint_teacher import reach_to_grasp
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.joint_plots import draw_latent_tubes
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION, DrawnPath, Sphere, legend_below, write_figure
from geodesic_motion_studies.experiments.arm_players import Families, LiteralArm, OurArm, Player, settings_table
from geodesic_motion_studies.experiments.grasp_joint_scenes import (
    RADIUS,
    Scene,
    SceneAnswer,
    Stage,
    blocking_spheres,
)
from geodesic_motion_studies.experiments.learned_paths import LearnedPaths, whole_box
from geodesic_motion_studies.experiments.posture_strip import draw_strip, numbered, posture_strips
from geodesic_motion_studies.experiments.study import Report, Study, option, seeds, setting
from geodesic_motion_studies.experiments.trained import BRIEFLY, trained_once
from geodesic_motion_studies.tools.cost_limit import CostLimit, limit_columns

#: Families of each set.
SETS = {"separated": 3, "meeting": 2}
#: Why a planner got no query.
COVERED = "not planned: a sphere touches the arm at the start or at the goal"
#: Limits to the energy of a path over the free path's.
LIMITS = (1.25, 1.5, 2.0, 3.0)
#: Nodes along each side of the box for energies.
_BOX = (40, 40, 40)
#: Name and colour of a path that is clear of all spheres, and of one that is not.
_MARKED = {"clear": ("geodesic", BLUE), "hits": ("geodesic through a sphere", VERMILION)}
#: Every so many configurations of an answer are drawn from.
_THINNED = 4


def shown_sets(each: int) -> dict[str, JointDemonstrations]:
    """The demonstrations of both sets, so many of each family."""
    return {
        "separated": reach_to_grasp(each, 0, families=3, connected=False),
        "meeting": reach_to_grasp(each, 0, families=2, connected=True, openings=2),
    }


@dataclass(frozen=True)
class GraspJoint(Study):
    """Show, train and ask; one skill of each set for each of the `seeds`, the literal row's with the first.

    The demonstrations are the same for all seeds. `places` scenes are drawn of one sphere, for the meeting set as many
    of two.
    """

    shown: int = option(3, "demonstrations of each family", least=2)
    seeds: tuple[int, ...] = seeds()
    places: int = setting(24, least=1)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    literal: PaperSettings = field(default_factory=PaperSettings)

    def measure(self, out: Path) -> GraspJointReport:
        ours, literally = JointTrainingSettings(**BRIEFLY), JointTrainingSettings.paper()
        shown = shown_sets(self.shown)
        reports, drawn, made, again, first = [], {}, [], {}, self.seeds[0]

        def trained(kind: str, training: JointTrainingSettings, seed: int) -> Skill:
            return trained_once(f"reach_{kind}", shown[kind], replace(training, seed=seed), out / "skills")

        for kind, count in SETS.items():
            families = Families.of(shown[kind], count)
            stage = Stage(families, connected=kind == "meeting", seed=first)
            scenes, again[kind] = all_scenes(stage, self.places), stage.again
            for seed in tqdm(self.seeds, desc=f"grasp-joint, {kind}", unit="skill"):
                skill = trained(kind, ours, seed)
                planner = ReactivePlanner(skill, self.planner)
                drawn.setdefault(("ours", kind), planner)
                player = OurArm(planner, families)
                made += [(f"ours, {kind}", player, ours)] if seed == first else []
                answers = answered(player, stage, scenes)
                reports.append(SkillReport("ours", kind, seed, answers, family_energies(skill)))
            skill = trained(kind, literally, first)
            paper = LiteralArm(PaperPlanner(skill, self.literal), families)
            made.append((f"literal, {kind}", paper, literally))
            blocked = among_blocking(paper, stage, drawn["ours", kind])
            reports.append(SkillReport("literal", kind, first, answered(paper, stage, scenes), blocked=blocked))
            drawn["literal", kind] = ReactivePlanner(skill, self.planner)
        return GraspJointReport(self, tuple(reports), settings_table(made), again, drawn)


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
    """What one skill does.

    Attributes
    ----------
    row : who plans, ours or literal; kind : of `SETS`; seed : of the training.
    answers : to scenes without a sphere, with one, and with two.
    energies : of the families on our skill, None of the literal row.
    blocked : paths of the literal planner among spheres that are put to block, by what they block; empty of ours.
    """

    row: str
    kind: str
    seed: int
    answers: tuple[SceneAnswer, ...]
    energies: Energies | None = None
    blocked: tuple[tuple[str, SceneAnswer], ...] = ()


@dataclass(frozen=True)
class GraspJointReport(Report):
    """What all skills do, and one of each row and set to be drawn.

    made : how they came about. again : of each set, scenes that were drawn again.
    """

    settings: GraspJoint
    skills: tuple[SkillReport, ...]
    made: str
    again: dict[str, int]
    drawn: dict[tuple[str, str], ReactivePlanner] = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        return {
            "settings": asdict(self.settings),
            "scenes_drawn_again": self.again,
            "skills": [
                {
                    "row": report.row, "set": report.kind, "seed": report.seed,
                    "energies": None if report.energies is None else asdict(report.energies),
                    "scenes": [answer.as_dict() for answer in report.answers],
                    "blocked": [
                        answer.as_dict() | {"spheres": name, "energy": energy_of(answer)}
                        for name, answer in report.blocked
                    ],
                }
                for report in self.skills
            ],
        }  # fmt: skip

    def table(self) -> str:
        """The tables as plain text."""
        return "\n\n".join([self.made, self._scenes(), self._energies(), self._blocked(), self._limits()])

    def _scenes(self) -> str:
        head = [
            "row", "set", "seed", "spheres", "scenes", "covered", "something left", "clear", "as shown", "refused",
            "hits", "least mm", "hybrids alone left", "taken", "nothing left", "refused", "clear", "hits",
        ]  # fmt: skip
        rows: list[list[Cell]] = []
        for report in self.skills:
            counts = sorted({len(answer.scene.radii) for answer in report.answers})
            for count in counts:
                counted = [answer for answer in report.answers if len(answer.scene.radii) == count]
                rows.append([report.row, report.kind, report.seed, count, *_counted(counted)])
        again = ", ".join(f"{kind} {count}" for kind, count in self.again.items())
        note = f"scenes drawn again because a sphere touches the arm at every start or its goal: {again}"
        return "\n".join([text_table(head, rows, 0, left=(0, 1)), note])

    def _energies(self) -> str:
        head = [
            "our energies", "seed", "families", "within, least", "within, most", "across, least", "across, most",
            "least ratio", "edge within", "edge across", "edge allowed",
        ]  # fmt: skip
        rows: list[list[Cell]] = []
        for report in self.skills:
            found = report.energies
            # Families that meet change from one to the other for nothing.
            if found is None or report.kind != "separated":
                continue
            others = ~np.eye(len(found.energy), dtype=bool)
            rows.append([
                report.kind, report.seed, len(found.energy), float(found.within.min()), float(found.within.max()),
                float(found.across.min()), float(found.across.max()),
                float(found.across.min() / found.within.max()), float(np.diag(found.dearest).max()),
                float(found.dearest[others].min()), found.edge_limit,
            ])  # fmt: skip
        return text_table(head, rows, 4)

    def _blocked(self) -> str:
        head = ["literal planner", "set", "from family", "energy", "over free", "families passed", "clearance mm"]
        rows: list[list[Cell]] = []
        for report in self.skills:
            free = {answer.scene.start: energy_of(answer) for name, answer in report.blocked if name == "free"}
            for name, answer in report.blocked:
                start = answer.scene.start
                spheres = len(answer.scene.radii)
                rows.append([
                    name, report.kind, "any" if len(start) > 1 else str(start[0]), energy_of(answer),
                    energy_of(answer) / free[start], " then ".join(map(str, answer.passed)),
                    1e3 * answer.clearance if spheres else None,
                ])  # fmt: skip
        return text_table(head, rows, 2, left=(0, 1))

    def _limits(self) -> str:
        rows: list[list[Cell]] = [
            [report.kind, *energy_ratios(report.answers).cells(LIMITS)]
            for report in self.skills if report.row == "literal"
        ]  # fmt: skip
        return text_table(["literal, energy over free", *limit_columns(LIMITS)], rows, 2)

    def draw(self, path: Path) -> None:
        """The first seed: above latent spaces with paths; below the arm on some of them, row by row."""
        first = {(item.row, item.kind): item.answers for item in self.skills if item.seed == self.settings.seeds[0]}
        ours, literal = _telling(first["ours", "separated"], first["literal", "separated"])
        hybrid = _hybrid(first["ours", "meeting"])
        panels = [
            (("ours", "separated"), ours, "a  Ours: what is blocked is refused"),
            (("literal", "separated"), literal, "b  Literal, the same scene"),
            (("ours", "meeting"), [hybrid], "c  Ours, families that meet"),
        ]
        rows = [("Ours", _nearest(ours)), ("Literal", _nearest(literal)), ("Ours", hybrid)]
        strips = [(name, answer) for name, answer in rows if answer.played is not None]
        figure = Figure(figsize=(13.0, 5.2 + 2.05 * len(strips)), layout="constrained")
        grid = figure.add_gridspec(1 + len(strips), 3, height_ratios=(4.8, *(2.0 for _ in strips)))
        named: dict[str, Any] = {}
        for column, (drawn, answers, title) in enumerate(panels):
            paths = [
                DrawnPath(answer.played.latent, np.empty((0, 3)), *_MARKED[answer.kind])
                for answer in answers if answer.played is not None
            ]  # fmt: skip
            spheres = [Sphere(centre, RADIUS, centre[None]) for centre in answers[0].scene.centres]
            handles = draw_latent_tubes(figure, grid[0, column], self.drawn[drawn], paths, spheres, title, zoom=0.75)
            named |= {str(handle.get_label()): handle for handle in handles}
        for row, (name, answer) in enumerate(strips, start=1):
            title = f"{'def'[row - 1]}  {name}, {_caption(answer)}"
            draw_strip(figure.add_subplot(grid[row, :]), _strip(answer), title)
        legend_below(figure, list(named.values()))
        write_figure(figure, path)


def energy_of(answer: SceneAnswer) -> float:
    """Of the literal planner's path, as a curve of constant speed in its metric."""
    assert answer.played is not None
    return answer.played.cost**2


def energy_ratios(answers: Sequence[SceneAnswer]) -> CostLimit:
    """Energies of the literal planner's paths among spheres, over that of the free path from the same start."""
    free = {answer.scene.start: energy_of(answer) for answer in answers if not len(answer.scene.radii)}
    among = [answer for answer in answers if len(answer.scene.radii) and answer.played is not None]
    hits, clear = (
        np.array([energy_of(answer) / free[answer.scene.start] for answer in among if answer.kind == kind])
        for kind in ("hits", "clear")
    )
    return CostLimit(hits, clear)


def _counted(answers: list[SceneAnswer]) -> list[Cell]:
    """Scenes, those left out, and what is made of the others: the columns of the table from there on."""
    open_ends = [answer for answer in answers if not answer.scene.covered]
    some = [answer for answer in open_ends if answer.scene.left]
    none = [answer for answer in open_ends if not answer.scene.left]
    clear = [answer for answer in some if answer.kind == "clear"]
    shown = [answer for answer in clear if answer.passed in answer.scene.left]
    least = min((answer.clearance for answer in clear), default=math.nan)
    return [
        len(answers), len(answers) - len(open_ends), len(some), len(clear), len(shown), _of(some, "refused"),
        _of(some, "hits"), 1e3 * least if math.isfinite(least) else None,
        sum(answer.scene.hybrids_alone for answer in some), sum(answer.scene.hybrids_alone for answer in shown),
        len(none), *(_of(none, kind) for kind in ("refused", "clear", "hits")),
    ]  # fmt: skip


def _of(answers: list[SceneAnswer], kind: str) -> int:
    return sum(answer.kind == kind for answer in answers)


def all_scenes(stage: Stage, places: int) -> list[Scene]:
    """Without a sphere, with one in so many places, and of families that meet with two."""
    scenes = [stage.scene(*ends, np.empty((0, 3))) for ends in stage.ends()]
    return scenes + [scene for count in ((1, 2) if stage.connected else (1,)) for scene in stage.drawn(places, count)]


def answered(player: Player, stage: Stage, scenes: Sequence[Scene]) -> tuple[SceneAnswer, ...]:
    """What a planner makes of scenes; of those that are covered it plans none."""
    return tuple(SceneAnswer(scene, COVERED) if scene.covered else stage.answer(player, scene) for scene in scenes)


def among_blocking(player: LiteralArm, stage: Stage, planner: ReactivePlanner) -> tuple[tuple[str, SceneAnswer], ...]:
    """Paths of the literal planner among `blocking_spheres`, and of families that are apart from one to another's goal.

    planner : whose arm the spheres are put on.
    """
    queries = [
        (name, stage.scene(*ends, np.array(spheres)))
        for name, spheres in blocking_spheres(planner, stage).items() for ends in stage.ends()
    ]  # fmt: skip
    queries += [("free, to another family's goal", scene) for scene in to_other_families(stage)]
    return tuple((name, stage.answer(player, scene)) for name, scene in queries)


def to_other_families(stage: Stage) -> list[Scene]:
    """From the start of each family to the goals of the others, without a sphere; none where families meet."""
    if stage.connected:
        return []
    return [stage.scene(start, tuple(set(goals) - {start}), np.empty((0, 3))) for start, goals in stage.ends()]


def family_energies(skill: Skill, shape: tuple[int, ...] | None = _BOX) -> Energies:
    """Shortest paths between all starts and goals of a skill's families, on its whole latent box; shape : its nodes."""
    paths, modes = LearnedPaths(whole_box(skill, shape)), skill.canonical.modes
    ends = np.array([skill.codes[modes == mode][:, [0, -1]].mean(axis=0) for mode in range(int(modes.max()) + 1)])
    found = [[paths.shortest(start, goal) for goal in ends[:, 1]] for start in ends[:, 0]]
    energy, dearest = (np.array([[getattr(path, of) for path in row] for row in found]) for of in ("energy", "dearest"))
    return Energies(energy, dearest, skill.graph(shape).energy_limit)


def _telling(
    ours: Sequence[SceneAnswer], literal: Sequence[SceneAnswer]
) -> tuple[list[SceneAnswer], list[SceneAnswer]]:
    """Both rows' answers, from all starts, to that place of a sphere which tells them apart best."""
    families = len([answer for answer in ours if not len(answer.scene.radii)])

    def difference(begin: int) -> int:
        pairs = zip(ours[begin : begin + families], literal[begin : begin + families], strict=True)
        apart = [(mine.kind, other.kind) for mine, other in pairs if not mine.scene.covered]
        kinds = {kind for kind, _ in apart}
        return apart.count(("refused", "hits")) + len(kinds)

    begin = max(range(families, len(ours), families), key=difference)
    return list(ours[begin : begin + families]), list(literal[begin : begin + families])


def _hybrid(answers: Sequence[SceneAnswer]) -> SceneAnswer:
    """One that takes a hybrid where nothing else is left; the last where none does."""
    found = [answer for answer in answers if answer.scene.hybrids_alone and answer.passed in answer.scene.left]
    return max(found, key=lambda answer: answer.clearance, default=answers[-1])


def _nearest(answers: Sequence[SceneAnswer]) -> SceneAnswer:
    """The one that comes nearest to the spheres."""
    return min(answers, key=lambda answer: math.inf if answer.played is None else answer.clearance)


def _caption(answer: SceneAnswer) -> str:
    passed = " then ".join(map(str, answer.passed))
    away = f"{1e3 * abs(answer.clearance):.0f} mm {'clear of' if answer.kind == 'clear' else 'deep in'} the spheres"
    return f"family {passed}: {away}"


def _strip(answer: SceneAnswer) -> np.ndarray:
    assert answer.played is not None
    spheres = numbered(answer.scene.centres, answer.scene.radii)
    return posture_strips([answer.played.configurations[::_THINNED]], [spheres], width=400, height=270)
