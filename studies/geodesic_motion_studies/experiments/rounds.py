"""Closed skills: held-out rounds beside the mean round, the seam between two rounds, spheres on the path.

Wiping is a figure of eight that ten people draw a little differently, each with gaps and tilts of their own, as
`wiping` makes it; with --demos a recording of joints is added, of rounds one after the other or one by one.

error     distance [mm] of the tool from held-out rounds, of three folds, by dynamic time warping: of the planned round
          from the start of the held-out one back to it, and of the mean round, moved there (`round_prediction`)
seam      root mean square and largest jerk of the joints [rad/s^3], as commanded a thousand times a second in some
          rounds: within a quarter of a second of where a round is joined to the next, and elsewhere
spheres   scenes of two rounds, half of them with a sphere that stands on the path, half with one that crosses it at
          0.1 to 0.4 m/s, 0.3 m and more beside the axis of the base: in how many the arm touched it in motion or
          within half a second after it, as PyBullet measures the distances of its meshes where it was commanded to
          be; in how many both rounds were made, and in how many none
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.readers import read_joint_takes
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.learning.settings import CommonSettings, JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import write_figure
from geodesic_motion_studies.experiments.folds import default_folds
from geodesic_motion_studies.experiments.round_prediction import Rounds, evaluate_rounds
from geodesic_motion_studies.experiments.study import Report, Study, option
from geodesic_motion_studies.experiments.trained import trained_once
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

#: People, samples, and the time of a round [s].
PEOPLE, SAMPLES, SECONDS = 10, 300, 4.0
#: Of the stream [s], and of the samples of its jerk.
TICK, FINE = 0.01, 1e-3
#: A seam is so long on either side [s]; a touch counts until so long after a motion; no scene lasts longer [s].
SEAM, AFTER_MOTION, LONGEST = 0.25, 0.5, 40.0
ROUNDS = 2


def wiping(seed: int, people: int = PEOPLE) -> Demonstrations:
    """Make rounds over a table at 0.25 m, tool down: 32 cm wide and 11 cm deep, by 12 % of that more or less."""
    random, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, SAMPLES)
    items = []
    for person in range(people):
        angle = 2.0 * np.pi * (t - 0.06 * np.sin(2.0 * np.pi * t))
        wide = 1.0 + 0.12 * random.normal()
        deep = wide + 0.02 * random.normal()
        places = [0.5 + 0.054 * deep * np.sin(2.0 * angle), 0.16 * wide * np.sin(angle), 0.25 + 0.006 * np.cos(angle)]
        shift, gap = 0.01 * random.normal(size=3), 0.004 * random.normal(size=3)
        tilt = 0.5 * (0.15 * np.sin(angle) + 0.05 * random.normal())
        zeros = np.zeros(SAMPLES)
        quaternions = np.stack([zeros, np.cos(tilt), np.sin(tilt), zeros], axis=1)
        positions = np.stack(places, axis=1) + shift + (t[:, None] - 0.5) * gap
        items.append(Demonstration(positions, quaternions, SECONDS * t * (1.0 + 0.1 * random.normal()), f"{person}"))
    return Demonstrations(tuple(items), frame="panda_link0")


@dataclass(frozen=True)
class RoundsRow:
    """One recording."""

    recording: str
    rounds: int
    planned_mm: float
    mean_mm: float
    unanswered: int
    seam_rms: float
    elsewhere_rms: float
    seam_largest: float
    elsewhere_largest: float
    scenes: int
    touched: int
    both_rounds: int
    no_round: int


@dataclass(frozen=True)
class RoundsReport(Report):
    """All rows; paths : of the tool (n, 3) [m], one held-out round, planned and mean, by recording."""

    rows: tuple[RoundsRow, ...]
    paths: dict[str, tuple[np.ndarray, ...]]

    def as_dict(self) -> dict[str, Any]:
        return {"rows": [asdict(row) | {"over_mean": row.planned_mm / row.mean_mm} for row in self.rows]}

    def table(self) -> str:
        head = (
            "recording", "rounds", "planned mm", "mean mm", "over mean", "unanswered", "jerk at seams rms",
            "elsewhere", "largest", "elsewhere", "scenes", "touched", "both rounds", "none",
        )  # fmt: skip
        rows = []
        for row in self.rows:
            name, rounds, planned, mean, *rest = asdict(row).values()
            rows.append((name, rounds, planned, mean, planned / mean, *rest))
        return text_table(head, rows, left=(0,))

    def draw(self, path: Path) -> None:
        """Seen from above: a held-out round, the one that was planned, and the mean."""
        figure = Figure(figsize=(4.5 * len(self.paths), 3.4), layout="constrained")
        for number, (name, curves) in enumerate(self.paths.items()):
            if not curves:
                # Nothing was answered.
                continue
            axes = figure.add_subplot(1, len(self.paths), number + 1)
            labels = ("held out", "planned", "mean")
            for curve, label, colour in zip(curves, labels, ("0.6", "C0", "C1"), strict=True):
                axes.plot(curve[:, 1], curve[:, 0], color=colour, label=label)
            axes.set_aspect("equal")
            axes.set(title=name, xlabel="y [m]", ylabel="x [m]")
            axes.locator_params(nbins=6)
        handles = figure.axes[0].get_legend_handles_labels() if figure.axes else ([], [])
        figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False)
        write_figure(figure, path)


@dataclass(frozen=True)
class RoundsStudy(Study):
    """Learn from two thirds of the rounds and predict the rest; play some rounds; play scenes with spheres."""

    demos: str | None = option(None, "recording of joints with rounds", type=str, metavar="FILE")
    robot: str = option("iiwa14", "that was recorded")
    played: int = option(6, "rounds for the jerk at seams", least=2)
    scenes: int = option(100, "with a sphere, of wiping", least=0)
    seed: int = option(10000, "of the first scene, and of the people who wipe", least=0)
    steps: int | None = option(None, "of the trainings; without it as many as they have by default", type=int)

    def measure(self, out: Path) -> RoundsReport:
        given: dict[str, Rounds] = {"wiping": wiping(self.seed)}
        if self.demos is not None:
            file = Path(self.demos)
            takes = read_joint_takes(file, self.robot)
            given[file.stem] = Recording.of_files(takes, self.robot, closed=True).demonstrations()
        rows, paths = [], {}
        for name, rounds in given.items():
            def train(shown: Rounds, seed: int, name: str = name) -> Skill:
                return trained_once(name, shown, self._settings(shown), out / "skills")

            row, paths[name] = self.row(name, rounds, train, self.scenes if name == "wiping" else 0)
            rows.append(row)
        return RoundsReport(tuple(rows), paths)

    def row(
        self, name: str, rounds: Rounds, train: Callable[[Rounds, int], Skill], scenes: int
    ) -> tuple[RoundsRow, tuple[np.ndarray, ...]]:
        """Measure one recording, with skills that `train` makes of rounds and a seed; and return its paths."""
        predicted = evaluate_rounds(rounds, default_folds(len(rounds)), (0,), train, f"{name}: held out")
        planned, mean = (predicted.rows[row] for row in ("geodesic", "mean_demonstration"))
        skill = train(rounds, 0)
        jerks = _jerks(skill, self.played)
        seam_rms, elsewhere_rms = (float(np.sqrt(np.mean(jerk**2))) for jerk in jerks)
        seam_largest, elsewhere_largest = (float(jerk.max()) for jerk in jerks)
        outcomes = [_play(skill, self.seed + number) for number in tqdm(range(scenes), desc="scenes")]
        touched, done = np.array(outcomes, dtype=int).reshape(-1, 2).T
        row = RoundsRow(
            recording=name,
            rounds=len(rounds),
            planned_mm=math.nan if planned["dtw_mm"] is None else planned["dtw_mm"],
            mean_mm=mean["dtw_mm"],
            unanswered=planned["unanswered"],
            seam_rms=seam_rms,
            elsewhere_rms=elsewhere_rms,
            seam_largest=seam_largest,
            elsewhere_largest=elsewhere_largest,
            scenes=len(outcomes),
            touched=int(touched.sum()),
            both_rounds=int(np.sum(done >= ROUNDS)),
            no_round=int(np.sum(done < 1)),
        )
        return row, tuple(curve.positions for curve in predicted.paths[:3])

    def _settings(self, rounds: Rounds) -> CommonSettings:
        steps = {} if self.steps is None else {"steps": self.steps}
        kind = JointTrainingSettings if isinstance(rounds, JointDemonstrations) else TrainingSettings
        return kind(closed=True, **steps)


def _planner(skill: Skill, **settings: Any) -> ReactivePlanner:
    return ReactivePlanner(skill, PlannerSettings(**settings), scene=DeclaredScene.empty())


def _begun(skill: Skill, **settings: Any) -> ReactivePlanner:
    """A planner whose arm stands where rounds begin, and is to make them."""
    planner = _planner(skill, periodic=True, **settings)
    if skill.space == "joint":
        start = skill.mean_configuration("start")
    else:
        start = solve(planner.robot, skill.start_pose[:3], skill.start_pose[3:])
    planner.stand_at(start, 0.0)
    planner.set_goal_configuration(start)
    return planner


def _jerks(skill: Skill, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    """The largest jerk of a joint [rad/s^3] in each millisecond near seams, and elsewhere, of rounds in full motion."""
    planner, joined, samples, times = _begun(skill), [], [], []
    now, before = 0.0, 0
    while planner.round < rounds and now < 10.0 * rounds:
        planner.tick(now)
        if planner.round != before:
            joined.append(planner.takeover)
        before = planner.round
        fine = now + FINE * np.arange(round(TICK / FINE))
        samples += [planner.commanded_state(time)[2] for time in fine]
        times += fine.tolist()
        now += TICK
    jerks = np.abs(np.diff(samples, axis=0)).max(axis=1) / FINE
    at, seams = np.array(times[1:]), np.array(joined[1:])
    near = np.abs(at[:, None] - seams).min(axis=1) < SEAM
    running = at > 1.0
    return jerks[near & running], jerks[~near & running]


def _beside_the_base(random: np.random.Generator, place: np.ndarray) -> np.ndarray:
    """A direction (3,) in which what passes a place (3,) [m] does not come to the base, which cannot make room."""
    while True:
        direction = np.append(random.normal(size=2), 0.3 * random.normal())
        along = direction[:2] / np.linalg.norm(direction[:2])
        if np.linalg.norm(place[:2] - (place[:2] @ along) * along) > 0.3:
            return direction / np.linalg.norm(direction)


def _play(skill: Skill, seed: int) -> tuple[bool, int]:
    """Whether the arm touched the sphere of a scene, and how many rounds it made."""
    random = np.random.default_rng(seed)
    planner = _begun(skill, rounds=ROUNDS)
    mean = skill.canonical.positions.mean(axis=0)
    # Not where the arm stands and is to come back to.
    mean = mean[np.linalg.norm(mean - skill.start_pose[:3], axis=1) > 0.12]
    place = mean[random.integers(len(mean))] + random.uniform(-0.03, 0.03, 3)
    radius, velocity, met = random.uniform(0.03, 0.05), np.zeros(3), 0.0
    if seed % 2:
        velocity = random.uniform(0.1, 0.4) * _beside_the_base(random, place)
        met = random.uniform(3.0, 8.0)
    geometry = CollisionGeometry(skill.robot)
    moved, touched, now, rests = -np.inf, False, 0.0, False
    try:
        while now < LONGEST and not touched and not rests:
            centre = place + velocity * (now - met)
            planner.set_obstacles(centre[None], np.array([radius]), velocity[None], time=now)
            plan = planner.tick(now)
            configuration, speed, _ = planner.commanded_state(now)
            moved = now if np.any(speed) else moved
            geometry.place(configuration)
            touched = now - moved <= AFTER_MOTION and geometry.clearance(centre, radius, 0.01) <= 0.0
            now += TICK
            rests = planner.round >= ROUNDS and plan.verdict.ok and now - moved > 1.0
    finally:
        geometry.close()
    return touched, planner.round if rests else planner.round - 1

