"""Does the planner get around an obstacle on its path, and does it say so when it cannot?

For every held-out demonstration the planner plans from its start to its goal, knowing the other demonstrations only.
A sphere is put dead-centre on that path, at a random fraction of its arc length between 0.25 and 0.75, and the planner
plans again. What it ought to do is judged by the demonstrations the skill was learned from:

half free   at least half of them pass the sphere: there is a path that people took, and it should be found
some free   fewer than half, but one at least
none free   all of them run into the sphere: nobody demonstrated a path, and the planner should say so

They are evaluated with their ends moved to the present start and goal, both offsets fading linearly in arc length,
which is what a canonical sheet carried to a query is made of. A path may change over from one demonstration to another:
`none free` does not always mean that there is no path.

Spheres that cover the start or the goal are left out: being refused there proves nothing.

Returned paths are not believed: clearance is measured anew on the path interpolated to CHECK_STEP, with
nothing of the planner's own certificate. `through` counts references that touch the obstacle, `off support` those with
a latent point whose rms sigma exceeds the skill's limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from geodesic_motion_ros.cli.arguments import metres
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.geometry.curves import Pose, PoseCurve, arc_length, arc_length_fractions, interpolate
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.queries.path_smoothing import correct_ends
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.experiments.imitation_judge import EVERY_END
from geodesic_motion_studies.experiments.study import Report, option
from geodesic_motion_studies.experiments.trained import OfTrainings, Trained

#: Largest distance between the poses at which a curve's clearance is measured [m].
CHECK_STEP = 0.0005
#: Where on the path spheres are put, in fractions of its arc length.
INTERIOR = (0.25, 0.75)

Freedom = Literal["half free", "some free", "none free"]
FREEDOMS: tuple[Freedom, ...] = ("half free", "some free", "none free")


@dataclass(frozen=True)
class Avoidance(OfTrainings):
    """Make the scenes of every held-out demonstration of every skill, and plan in them.

    Attributes
    ----------
    radii : of the spheres [m]: small beside the spread of demonstrations, about as large, and larger.
    tool_radius : of the sphere around the tool's origin [m] that must stay clear too.
    scenes : spheres of each radius on the path of each held-out demonstration.
    seed : of the places. planner : everything else, end offsets unlimited by default.
    """

    radii: tuple[float, ...] = option((0.02, 0.04, 0.08), "of spheres [m]", type=metres, metavar="M,M")
    tool_radius: float = option(
        0.0, "of a sphere around the tool's origin [m]; 0: the radii already stand for obstacle and tool together",
        metavar="M",
    )  # fmt: skip
    scenes: int = option(8, "places on the path of each held-out demonstration", least=1)
    sheet: str = option("canonical", "skills are learned on", choices=("canonical", "raw"))
    seed: int = 0
    planner: PlannerSettings = EVERY_END

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.radii or min(self.radii) <= 0.0 or not all(map(math.isfinite, self.radii)):
            raise ParameterError(f"radii {self.radii}: give at least one, all positive [m]")
        if not (math.isfinite(self.tool_radius) and self.tool_radius >= 0.0):
            raise ParameterError(f"tool_radius is {self.tool_radius}; it must be 0 or positive [m]")

    def measured(self, skills: Iterable[Trained]) -> AvoidanceReport:
        chosen = replace(self.planner, tool_points=((0.0, 0.0, 0.0),), tool_radii=(self.tool_radius,))
        scenes: list[Scene] = []
        refused = 0
        for trained in skills:
            planner = PosePathPlanner(trained.skill, chosen)
            for index, item in zip(trained.fold, trained.held_out, strict=True):
                query = Query(trained.task, index, trained.seed, item.curve.start, item.curve.goal)
                made = _scenes_of(query, planner, carried(trained.shown, query.start, query.goal), self)
                refused += made is None
                scenes += made or []
        return AvoidanceReport(self, tuple(scenes), refused)


@dataclass(frozen=True)
class Scene:
    """One sphere on one path, and what the planner did about it.

    Attributes
    ----------
    task, demonstration, seed : whose start and goal, and which training of the skill.
    radius, centre, fraction : of the sphere [m], and where on the path it was put.
    free_share : share of the training demonstrations that stay clear, carried to start and goal.
    code, reason : the verdict. answered : whether there was a reference.
    certified : clearance [m] the planner promises; measured : the same on the dense check; NaN without a reference.
    off_support : whether the reference leaves the skill's support.
    """

    task: str
    demonstration: int
    seed: int
    radius: float
    centre: tuple[float, float, float]
    fraction: float
    free_share: float
    code: str
    reason: str
    answered: bool
    certified: float
    measured: float
    off_support: bool

    @property
    def freedom(self) -> Freedom:
        """How many demonstrations stay clear, in words."""
        if self.free_share >= 0.5:
            return "half free"
        return "some free" if self.free_share > 0.0 else "none free"

    @property
    def through(self) -> bool:
        """Whether the returned reference touches the obstacle."""
        return self.answered and not self.measured > 0.0


Figures = dict[str, float | int | None]
"""scenes, answered, through, off_support, infeasible_percent, least_clearance_mm, median_clearance_mm; or None."""


@dataclass(frozen=True)
class AvoidanceReport(Report):
    """All scenes, and what they come to."""

    settings: Avoidance
    scenes: tuple[Scene, ...]
    queries_without_path: int

    def summary(self, scenes: Sequence[Scene] | None = None) -> dict[Freedom, Figures]:
        """The figures of all scenes, or of some, by how many demonstrations are free."""
        chosen = self.scenes if scenes is None else scenes
        return {kind: _figures([scene for scene in chosen if scene.freedom == kind]) for kind in FREEDOMS}

    def as_dict(self) -> dict[str, Any]:
        return {
            "tool_radius": self.settings.tool_radius,
            "radii": list(self.settings.radii),
            "queries_without_path": self.queries_without_path,
            "summary": self.summary(),
            "by_task_and_radius": {
                f"{task}, {1000 * radius:.0f} mm": self.summary(scenes) for (task, radius), scenes in self._groups()
            },
            "scenes": [asdict(scene) | {"through": scene.through} for scene in self.scenes],
        }

    def table(self) -> str:
        """The table as plain text."""
        head = [
            "spheres", "demonstrations", "scenes", "answered", "through", "off support", "infeasible %", "least mm",
            "median mm",
        ]  # fmt: skip
        parts = [(f"{task}, {1000 * radius:.0f} mm", scenes) for (task, radius), scenes in self._groups()]
        rows = [
            [name if kind == FREEDOMS[0] else "", kind, *figures.values()]
            for name, scenes in [*parts, ("all", list(self.scenes))]
            for kind, figures in self.summary(scenes).items()
        ]
        notes = [
            f"tool radius {1000 * self.settings.tool_radius:.0f} mm; clearance measured every {1e3 * CHECK_STEP} mm"
        ]
        if self.queries_without_path:
            notes.append(f"{self.queries_without_path} motion(s) without a path even without obstacles: no scenes")
        return "\n".join([text_table(head, rows, digits=1), *notes])

    def _groups(self) -> list[tuple[tuple[str, float], list[Scene]]]:
        keys = sorted({(scene.task, scene.radius) for scene in self.scenes})
        return [(key, [scene for scene in self.scenes if (scene.task, scene.radius) == key]) for key in keys]

    def draw(self, path: Path) -> None:
        """What became of the scenes, by radius and by what demonstrations leave free; clearances of the answers."""
        figure = Figure(figsize=(12, 5), layout="constrained")
        outcomes, clearances = figure.subplots(1, 2)
        for radius in self.settings.radii:
            scenes = [scene for scene in self.scenes if scene.radius == radius]
            names = [f"{1000 * radius:.0f} mm, {kind}" for kind in FREEDOMS]
            figures = list(self.summary(scenes).values())
            answered = np.array([values["answered"] for values in figures])
            refused = np.array([values["scenes"] for values in figures]) - answered
            outcomes.barh(names, answered, color="tab:green", label="answered, clear")
            outcomes.barh(names, refused, left=answered, color="tab:gray", label="declared infeasible")
            through = [-values["through"] for values in figures]
            outcomes.barh(names, through, color="tab:red", label="through the obstacle")
            measured = [1e3 * scene.measured for scene in scenes if scene.answered]
            clearances.hist(measured, bins=30, histtype="step", label=f"{1000 * radius:.0f} mm")
        handles, labels = outcomes.get_legend_handles_labels()
        figure.legend(handles[:3], labels[:3], loc="outside lower left", ncols=3)
        outcomes.invert_yaxis()
        outcomes.set(xlabel="scenes", title="spheres dead-centre on the path, demonstrations carried to its ends")
        clearances.axvline(0.0, color="tab:red")
        clearances.legend(title="radius")
        clearances.set(xlabel="measured clearance [mm]", ylabel="paths", title="clearance on the dense check")
        figure.savefig(path, dpi=110)


@dataclass(frozen=True)
class Query:
    """Start and goal pose of held-out demonstration number `demonstration`."""

    task: str
    demonstration: int
    seed: int
    start: Pose
    goal: Pose


def carried(shown: Demonstrations, start: Pose, goal: Pose) -> list[PoseCurve]:
    """The demonstrations with their ends moved to a start and a goal pose."""
    return [PoseCurve(*correct_ends(item.positions, item.quaternions, start, goal)) for item in shown]


def free_share(curves: Sequence[PoseCurve], centre: np.ndarray, radius: float, settings: PlannerSettings) -> float:
    """Share of curves along which the tool stays clear of a sphere."""
    return float(np.mean([measured_clearance(curve, centre, radius, settings) > 0.0 for curve in curves]))


def measured_clearance(curve: PoseCurve, centre: np.ndarray, radius: float, settings: PlannerSettings) -> float:
    """Smallest distance [m] from the tool's spheres to an obstacle along a curve, at poses CHECK_STEP apart.

    Between the curve's samples positions are interpolated linearly and orientations on great circles.
    """
    length = arc_length(curve.positions)
    if length[-1] == 0.0:
        positions, quaternions = curve.positions, curve.quaternions
    else:
        even = np.linspace(0.0, length[-1], math.ceil(length[-1] / CHECK_STEP) + 1)
        positions, quaternions = interpolate(length, curve.positions, curve.quaternions, np.union1d(even, length))
    rotation = to_rotation(quaternions)
    distances = [
        np.linalg.norm(positions + rotation.apply(point) - centre, axis=1) - tool_radius
        for point, tool_radius in zip(settings.tool_points, settings.tool_radii, strict=True)
    ]
    return float(np.min(distances)) - radius


def _scenes_of(
    query: Query, planner: PosePathPlanner, shown: list[PoseCurve], settings: Avoidance
) -> list[Scene] | None:
    """The scenes on the path of one query; None where there is no path even without obstacles."""
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    path = planner.plan(*query.start, *query.goal)
    if isinstance(path, Refusal):
        return None
    random = np.random.default_rng([settings.seed, query.seed, query.demonstration])
    fractions = random.uniform(*INTERIOR, settings.scenes)
    centres, _ = interpolate(arc_length_fractions(path.positions), path.positions, path.quaternions, fractions)
    return [
        _scene(query, planner, shown, float(fraction), centre, radius)
        for fraction, centre in zip(fractions, centres, strict=True)
        for radius in settings.radii
        if not _covers(centre, radius + settings.tool_radius, query)
    ]


def _covers(centre: np.ndarray, radius: float, query: Query) -> bool:
    """Whether a sphere holds the start or the goal."""
    return any(np.linalg.norm(pose[0] - centre) <= radius for pose in (query.start, query.goal))


def _scene(
    query: Query,
    planner: PosePathPlanner,
    shown: list[PoseCurve],
    fraction: float,
    centre: np.ndarray,
    radius: float,
) -> Scene:
    """Put the sphere there and plan."""
    planner.set_obstacles(centre[None], np.array([radius]))
    path = planner.plan(*query.start, *query.goal)
    free = free_share(shown, centre, radius, planner.settings)
    measured, off_support = math.nan, False
    if isinstance(path, PosePath):
        sigma, _ = planner.skill.decoder.uncertainty(path.latent)
        off_support = bool(np.max(rms_sigma(sigma)) > planner.skill.sigma_limit)
        measured = measured_clearance(path, centre, radius, planner.settings)
    verdict = Verdict(figures=path.figures) if isinstance(path, PosePath) else path
    return Scene(
        query.task, query.demonstration, query.seed, radius, tuple(centre.tolist()), fraction, free,
        verdict.code.name, verdict.reason, verdict.ok, verdict.figures.clearance, measured,
        off_support,
    )  # fmt: skip


def _figures(scenes: Sequence[Scene]) -> Figures:
    answered = [1e3 * scene.measured for scene in scenes if scene.answered]
    return {
        "scenes": len(scenes),
        "answered": len(answered),
        "through": sum(scene.through for scene in scenes),
        "off_support": sum(scene.off_support for scene in scenes),
        "infeasible_percent": 100.0 * (1.0 - len(answered) / len(scenes)) if scenes else None,
        "least_clearance_mm": min(answered, default=None),
        "median_clearance_mm": float(np.median(answered)) if answered else None,
    }
