"""How the planner keeps its rate: planner and twin as two processes, at one rate after the other.

Four stretches in each: the goal stays; the goal jumps on a small circle many times a second, each time a new query,
for which the graph is transported anew and its obstacle-free field found again; a sphere moves to and fro through the
path; ten times a second comes a point cloud of all that is under the arm.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from geodesic_motion_ros.nodes.stolen_time import StolenTime
from geodesic_motion_ros.paper.paper_planner import STRENGTH_OF_POSES, PaperPlanner, PaperSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.rates.planner_stream import Cloud, PlannerStream, Spheres, no_spheres

#: The skills of the paper's planner, with zeta, and grids on which it is seen where they lead.
PAPER = {"paper_pouring": STRENGTH_OF_POSES, "paper_reach": 1e3}
_COARSE = {2: (60, 60), 3: (20, 20, 20)}
#: Radius of the circle on which the goal jumps, and of the obstacles; how far from the tool's undisturbed path these
#: stand, and how much room they leave [m].
CIRCLE, OBSTACLE, BESIDE, ROOM = 0.010, 0.03, 0.20, 0.05
#: A ball around the tool's origin that stands for the hand [m].
HAND = 0.10
#: Of the sphere that moves: its radius, how far it goes to either side of the path's middle [m], and its period [s].
MOVING_RADIUS, REACH, ROUND = 0.05, 0.25, 4.0
#: Of the cloud: its points, the side of the table top that they lie on and what it leaves to the arm above [m], and by
#: how much it moves from one to the next.
POINTS, TABLE, UNDER, SHIFT = 10_000, 0.8, 0.08, 0.003


@dataclass(frozen=True)
class RateRow:
    """What one stretch of the stream has shown: rates in Hz, durations in ms; stolen_percent as of `StolenTime`.

    exact_percent : share of the ticks on a path to the goal that ended with the proof that none is cheaper.
    verdicts : how many ticks had which, the most frequent first.
    """

    asked: float
    name: str
    rate: float
    tick_p50: float
    tick_p99: float
    misses: int
    goals: int
    exact_percent: float
    stolen_percent: float
    verdicts: dict[str, int]


@dataclass(frozen=True)
class _ToolPath:
    """The undisturbed path: places of the tool (n, 3), and balls (m, 3), (m,) that cover what moves along it [m]."""

    tool: np.ndarray
    balls: np.ndarray
    radii: np.ndarray

    @classmethod
    def of(cls, skill: Skill) -> _ToolPath:
        """Between the skill's own ends."""
        ends = *np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3])
        arm = ReactivePlanner(skill)
        motion = arm.plan(*ends).reference
        assert motion is not None
        moving = arm.collision.moving
        balls = arm.collision.positions(arm.robot, motion.positions)[:, moving]
        radii = np.tile(arm.collision.radii[moving], len(balls))
        return cls(end_effector_poses(motion.positions, arm.robot.chain)[0], balls.reshape(-1, 3), radii)


def measure_rates(
    skill: str,
    folder: Path,
    rates: Sequence[float] = (100.0,),
    seconds: float = 8.0,
    goals_hz: float = 10.0,
    obstacles: int = 10,
    domain: int = 83,
) -> list[RateRow]:
    """Let a planner move a twin, and read its rate off its own status.

    Parameters
    ----------
    rates : of the planner [Hz], one after the other. seconds : length of each stretch.
    goals_hz : new goals a second in the second stretch. obstacles : how many stand beside the path in the first two.
    folder : parameter files and logs of the nodes go there.

    Raises
    ------
    ParameterError : a number that is not positive. DemoError : a node ends or does not answer.
    """
    if not (seconds > 0.0 and goals_hz > 0.0 and obstacles >= 0 and rates and min(rates) > 0.0):
        raise ParameterError(
            f"seconds {seconds}, goals_hz {goals_hz}, obstacles {obstacles}, rates {list(rates)}: must be positive"
        )
    path = _ToolPath.of(Skill.load(skill))
    beside = _beside(path, obstacles)
    stretches: list[tuple[str, float, Spheres, Cloud | None]] = [
        ("goal stays", 0.0, beside, None),
        (f"goal moves {goals_hz:g} times a second", goals_hz, beside, None),
        ("a sphere moves through the path", 0.0, _through(path.tool), None),
        (f"clouds of {POINTS} points", 0.0, no_spheres, _table_top(path)),
    ]
    rows = []
    for rate in rates:
        for name, hertz, spheres, cloud in stretches:
            with PlannerStream(skill, folder / f"{rate:g}_hz" / name.replace(" ", "_"), rate, domain) as stream:
                stream.spheres, stream.cloud = spheres, cloud
                rows.append(_stretch(stream, rate, name, seconds, hertz))
    return rows


def measure_paper(folder: Path, rate: float = 100.0, seconds: float = 8.0, domain: int = 83) -> list[RateRow]:
    """The same of the paper's planner on its two shipped skills: among nothing, and among one sphere that moves.

    Raises
    ------
    ParameterError, DemoError : as of `measure_rates`.
    """
    if not (seconds > 0.0 and rate > 0.0):
        raise ParameterError(f"seconds {seconds}, rate {rate}: must be positive")
    rows = []
    for name, strength in PAPER.items():
        skill = Skill.load(name)
        planner = PaperPlanner(skill, PaperSettings(strength), _COARSE[len(skill.latent_lower)])
        ends = (tuple(np.split(pose, [3])) for pose in (skill.start_pose, skill.goal_pose))
        path, _ = planner.tool_poses(planner.plan(*ends))
        paper = {"module": "paper.paper_node", "simulation_only": True, "ambient_strength": strength}
        for scene, spheres in {"no obstacle": no_spheres, "a sphere moves through the path": _through(path)}.items():
            with PlannerStream(name, folder / name / scene.replace(" ", "_"), rate, domain, **paper) as stream:
                stream.spheres = spheres
                rows.append(_stretch(stream, rate, f"{name}: {scene}", seconds, 0.0))
    return rows


def table(rows: list[RateRow]) -> str:
    """The rows as plain text."""
    head = ["asked Hz", "", "rate Hz", "tick p50 ms", "p99 ms", "misses", "goals", "exact %", "stolen %", "verdicts %"]
    cells = [[*astuple(row)[:-1], _percent(row.verdicts)] for row in rows]
    return text_table(head, cells, digits=1)


def _percent(verdicts: dict[str, int]) -> str:
    """For example OK 98.4, STALE_STATE 1.6."""
    total = sum(verdicts.values())
    return ", ".join(f"{name} {100.0 * count / total:.1f}" for name, count in verdicts.items())


def _stretch(stream: PlannerStream, asked: float, name: str, seconds: float, goals_hz: float) -> RateRow:
    """Send the goal, or a stream of goals, and sum the ticks up from the first on that has one."""
    pose, goals = stream.skill.goal_pose, 0

    def send() -> None:
        nonlocal goals
        angle = 2.4 * goals
        shift = CIRCLE * np.array([math.cos(angle), math.sin(angle), 0.0]) if goals else np.zeros(3)
        stream.send_goal(pose[:3] + shift, pose[3:])
        goals += 1

    send()
    stream.wait(lambda: stream.code != "NO_GOAL", seconds)
    stream.ticks.clear()
    stolen = StolenTime()
    if goals_hz > 0.0:
        stream.node.create_timer(1.0 / goals_hz, send)
    stream.spend(seconds)
    taken = stolen.percent()
    first, last = stream.ticks[0], stream.ticks[-1]
    p50, p99 = np.percentile([tick.duration for tick in stream.ticks], [50.0, 99.0])
    rate = (last.number - first.number) / (last.time - first.time)
    verdicts = dict(Counter(tick.code for tick in stream.ticks).most_common())
    misses, gaps = last.misses - first.misses, [tick.cost_gap for tick in stream.ticks if tick.code == "OK"]
    exact = 100.0 * float(np.mean(np.array(gaps) == 0.0)) if gaps else math.nan
    return RateRow(asked, name, rate, float(p50), float(p99), misses, goals, exact, taken, verdicts)


def _beside(path: _ToolPath, count: int) -> Spheres:
    """Obstacles that are felt along the path and do not block it."""
    random = np.random.default_rng(0)
    centres: list[np.ndarray] = []
    while len(centres) < count:
        offset = random.normal(size=3)
        centre = path.tool[random.integers(len(path.tool))] + BESIDE * offset / np.linalg.norm(offset)
        if np.min(np.linalg.norm(path.balls - centre, axis=1) - path.radii) > OBSTACLE + ROOM:
            centres.append(centre)
    standing = np.array(centres).reshape(-1, 3), np.full(count, OBSTACLE)
    return lambda _: standing


def _table_top(path: _ToolPath) -> Cloud:
    """A level surface under all that moves, seen a little differently each time."""
    random = np.random.default_rng(0)
    middle, height = path.tool[:, :2].mean(axis=0), np.min(path.balls[:, 2] - path.radii) - UNDER
    points = np.column_stack([middle + TABLE * random.uniform(-0.5, 0.5, size=(POINTS, 2)), np.full(POINTS, height)])
    return lambda time: points + SHIFT * np.array([math.sin(7.0 * time), math.cos(7.0 * time), 0.0])


def _through(path: np.ndarray) -> Spheres:
    """One sphere that goes to and fro across the middle of the path, level and at right angles to it."""
    middle = len(path) // 2
    along = path[min(middle + 1, len(path) - 1)] - path[middle - 1]
    across = np.array([-along[1], along[0], 0.0]) / np.hypot(along[0], along[1])
    radius = np.array([MOVING_RADIUS])
    return lambda time: (path[middle] + REACH * math.cos(2.0 * math.pi * time / ROUND) * across[None], radius)
