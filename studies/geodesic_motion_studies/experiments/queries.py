"""Queries that are drawn, of every shipped skill: what is answered, what is refused and why, what raises.

A query is requested as a user can: one half by `plan` from pose to pose, the other by `stand_at`, `set_goal` (with a
skill of configurations `set_goal_configuration`) and `tick`. One planner serves all queries of a skill; an empty scene
is declared to it: `plan` makes detours, the first tick none. How queries are drawn is for
`drawn_queries`: a start and a goal inside the demonstrated spread, as many up to twice outside; a quarter of all among
one or two standing spheres; and starts at or beyond a limit of a joint, or in contact of the arm with itself. Besides,
every demonstration's own start and goal are requested, by both. With --takeovers each motion of a tick is taken over
in motion, by the goal and among the spheres of another query, and again: the row `takeover`. Columns count answers of
queries:

demonstrated, inside, outside, obstacles, odd starts  answered with a motion to the goal, of so many requests
exceptions  what was raised: each is a bug; the query is named under the table, and in `figures.json`
violations  answers whose motion does not begin where it was requested (1e-6 rad; `plan`: 5 mm and 0.02 rad, as near as
            the posture in which the arm stands may be), ends off the goal (10 mm, 0.1 rad), breaks a limit of a joint,
            or touches; and refusals without a reason. Limits count at 1 kHz, too: the robot's own, of speeds towards
            stops among them. Takeovers: a motion that breaks a limit, or begins where the one before is not
motions, of limits  motions that were judged, stops and what a takeover leads to among them; the largest share of a
            robot's own limit of velocity, acceleration or jerk that one of them uses

Under the table: the reasons of all refusals, numbers folded to #, most frequent first.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import SAME_START, PlannerSettings
from geodesic_motion_ros.contract.status import Verdict, VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import self_clearances
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREY, VERMILION, write_figure
from geodesic_motion_studies.experiments.drawn_queries import CYCLE, DEMONSTRATED, PARTS, Query, QuerySource
from geodesic_motion_studies.experiments.study import Report, Study, option
from geodesic_motion_studies.tools.limit_shares import limit_shares

SKILLS = (
    "panda_reach_to_grasp", "panda_pouring", "panda_bottle2shelf", "panda_wide_reach", "panda_insertion",
    "fr3_reach_to_grasp", "ur5_reach", "iiwa14_reach_to_grasp",
)  # fmt: skip
TICK, PLAN, TAKEOVER = "tick", "plan", "takeover"
#: How far a motion may end from the requested goal [m], [rad].
AT_GOAL = 0.01, 0.1
#: How far a motion may begin from the requested start [rad].
AT_START = 1e-6
#: A motion is looked at this often for contacts [s].
LOOK_PERIOD = 0.01
#: Shares of a motion after which it is taken over, the period of ticks meanwhile [s], and how many of them may pass.
TAKEN_OVER, TICK_PERIOD, PATIENCE = (0.1, 0.9), 0.01, 30
#: How far a motion may begin from where the one before is [rad].
SAME_PLACE = 1e-6
#: Rounding of what is exactly at a limit.
_ROUNDING = 1e-5
_COUNTED = ("exceptions", "violations", "motions", "of limits")
_NUMBER = re.compile(r"(?<![\w.])[-+]?(\d+(\.\d+)?|\.\d+|inf|nan)(e[-+]?\d+)?(?![\w])")
_NAME = re.compile(r"'[^']*'")


@dataclass(frozen=True, eq=False)
class Answer:
    """What one request came to.

    code : of the verdict; None where something was raised. reason : the verdict's, or what was raised.
    violations : what an answer does not keep; none where it was refused.
    motions : how many were judged. share : the largest of a limit of the robot that they use.
    """

    skill: str
    request: str
    query: Query
    code: VerdictCode | None
    reason: str
    violations: tuple[str, ...] = ()
    motions: int = 0
    share: float = 0.0

    @property
    def folded(self) -> str:
        """The reason without its numbers and names."""
        return _NAME.sub("'*'", _NUMBER.sub("#", self.reason))

    def as_dict(self) -> dict[str, Any]:
        """All that repeats it."""
        query = self.query
        return {
            "skill": self.skill, "request": self.request, "part": query.part, "number": query.number,
            "code": None if self.code is None else self.code.name, "reason": self.reason,
            "violations": self.violations, "start": query.start,
            "start_pose": np.concatenate([query.start_pose.position, query.start_pose.quaternion]),
            "goal": query.goal, "goal_pose": np.concatenate([query.goal_pose.position, query.goal_pose.quaternion]),
            "centres": query.centres, "radii": query.radii,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class QueriesReport(Report):
    """All answers. queries : that were drawn of each skill."""

    seed: int
    queries: int
    answers: tuple[Answer, ...]

    def as_dict(self) -> dict[str, Any]:
        return {
            "seed": self.seed, "queries_of_each_skill": self.queries,
            "answered": {
                f"{skill} {request}": {part: self._answered(skill, request, part) for part in PARTS}
                for skill, request in self._rows()
            },
            "motions": {f"{skill} {request}": self._motions(skill, request) for skill, request in self._rows()},
            "refusals": [
                {"code": code, "reason": reason, "count": count, "first": self._first(code, reason).as_dict()}
                for (code, reason), count in self._refusals()
            ],
            "exceptions": [each.as_dict() for each in self.answers if each.code is None],
            "violations": [each.as_dict() for each in self.answers if each.violations],
        }  # fmt: skip

    def table(self) -> str:
        rows: list[list[Cell]] = []
        for skill, request in self._rows():
            own = [each for each in self.answers if (each.skill, each.request) == (skill, request)]
            parts = ["{} of {}".format(*self._answered(skill, request, part)) for part in PARTS]
            raised, broken = sum(each.code is None for each in own), sum(bool(each.violations) for each in own)
            rows.append([skill, request, *parts, raised, broken, *self._motions(skill, request)])
        lines = [
            f"{self.queries} queries of each skill, seed {self.seed}",
            text_table(["skill", "request", *PARTS, *_COUNTED], rows, left=(0, 1)),
            *(f"{count:6d}  {code}: {reason}" for (code, reason), count in self._refusals()),
        ]
        for each in self.answers:
            if each.code is None or each.violations:
                found = f"raised {each.reason}" if each.code is None else ", ".join(each.violations)
                lines.append(f"{each.skill}, {each.request}, {each.query.part} {each.query.number}: {found}")
        return "\n".join(lines)

    def draw(self, path: Path) -> None:
        """Shares of the drawn queries that are answered, a bar for each part of a skill."""
        skills = list(dict.fromkeys(each.skill for each in self.answers))
        figure = Figure(figsize=(11.0, 0.7 + 0.55 * len(skills)), layout="constrained")
        axes = figure.subplots()
        for row, (part, colour) in enumerate(zip(PARTS[1:], (BLUE, GREY, VERMILION, "black"), strict=True)):
            counts = [[self._answered(skill, request, part) for request in (TICK, PLAN)] for skill in skills]
            shares = [sum(own[0] for own in two) / max(1, sum(own[1] for own in two)) for two in counts]
            axes.barh(np.arange(len(skills)) + 0.2 * row, shares, 0.18, color=colour, label=part)
        axes.set_yticks(np.arange(len(skills)) + 0.3, skills)
        axes.invert_yaxis()
        axes.set(xlim=(0.0, 1.0), xlabel="answered with a motion to the goal")
        axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        write_figure(figure, path)

    def _rows(self) -> list[tuple[str, str]]:
        return list(dict.fromkeys((each.skill, each.request) for each in self.answers))

    def _answered(self, skill: str, request: str, part: str) -> tuple[int, int]:
        """How many requests were answered, of how many."""
        own = [each for each in self.answers if (each.skill, each.request, each.query.part) == (skill, request, part)]
        return sum(each.code is VerdictCode.OK for each in own), len(own)

    def _motions(self, skill: str, request: str) -> tuple[int, float]:
        """How many motions were judged, and the largest share of a limit that one of them uses."""
        own = [each for each in self.answers if (each.skill, each.request) == (skill, request)]
        return sum(each.motions for each in own), max((each.share for each in own), default=0.0)

    def _refusals(self) -> list[tuple[tuple[str, str], int]]:
        """(code, folded reason), and how often it was given."""
        refused = (each for each in self.answers if each.code not in (None, VerdictCode.OK))
        return Counter((each.code.name, each.folded) for each in refused if each.code is not None).most_common()

    def _first(self, code: str, reason: str) -> Answer:
        return next(
            each for each in self.answers if each.code is not None and (each.code.name, each.folded) == (code, reason)
        )


@dataclass(frozen=True)
class Queries(Study):
    """So many drawn queries of each of several skills."""

    skills: tuple[str, ...] = option(
        SKILLS, "folders, or shipped names", type=lambda text: tuple(text.split(",")), metavar="SKILL,SKILL"
    )  # fmt: skip
    queries: int = option(40, "drawn of each skill", least=1)
    seed: int = option(0, "of what is drawn", least=0)
    takeovers: int = option(0, "of each motion that a tick has begun, one after the other", least=0)
    speed_scale: float = option(PlannerSettings.speed_scale, "of the planners")
    acceleration_scale: float = option(PlannerSettings.acceleration_scale, "of the planners")

    def measure(self, out: Path) -> QueriesReport:
        answers: list[Answer] = []
        settings = PlannerSettings(speed_scale=self.speed_scale, acceleration_scale=self.acceleration_scale)
        for name in self.skills:
            skill = Skill.load(name)
            planner = ReactivePlanner(skill, settings, scene=DeclaredScene.empty())
            source = QuerySource.of(skill)
            queries = [*source.demonstrated(), *(source.drawn(number, self.seed) for number in range(self.queries))]
            for place, query in enumerate(tqdm(queries, desc=skill.name, unit="query")):
                others = [queries[(place + ahead) % len(queries)] for ahead in range(1, self.takeovers + 1)]
                answers += answers_to(planner, query, others)
        return QueriesReport(self.seed, self.queries, tuple(answers))


def answers_to(planner: ReactivePlanner, query: Query, others: Sequence[Query] = ()) -> list[Answer]:
    """A demonstrated query is requested by both, a drawn one by each in turn; without a start posture by `plan`.

    others : queries that take over the motion of a tick, one after the other.
    """
    by_tick = (query.number // 2 + query.number // (2 * CYCLE)) % 2 == 0
    found = []
    if query.start is not None and (by_tick or query.part == DEMONSTRATED):
        found.append(_answer(planner, query, TICK, lambda: _judged(planner, query, TICK, _ticked(planner, query))))
        if others:
            found.append(_answer(planner, query, TAKEOVER, lambda: _taken_over(planner, query, others)))
    if not found or query.part == DEMONSTRATED:
        found.append(_answer(planner, query, PLAN, lambda: _judged(planner, query, PLAN, _planned(planner, query))))
    return found


def _ticked(planner: ReactivePlanner, query: Query) -> Plan:
    """The answer of the first tick, or the refusal of the start or of the goal before it."""
    assert query.start is not None
    planner.clear_goal()
    planner.set_obstacles(query.centres, query.radii)
    standing, taken = planner.stand_at(query.start, 0.0), _request_goal(planner, query)
    ticked = planner.tick(0.0)
    refused = next((verdict for verdict in (standing.verdict, taken) if not verdict.ok), None)
    return ticked if refused is None else Plan(None, 0.0, refused)


def _request_goal(planner: ReactivePlanner, query: Query) -> Verdict:
    if query.goal is None:
        return planner.set_goal(query.goal_pose.position, query.goal_pose.quaternion)
    return planner.set_goal_configuration(query.goal)


def _planned(planner: ReactivePlanner, query: Query) -> Plan:
    planner.set_obstacles(query.centres, query.radii)
    start, goal = query.start_pose, query.goal_pose
    return planner.plan(start.position, start.quaternion, goal.position, goal.quaternion)


def _taken_over(planner: ReactivePlanner, query: Query, others: Sequence[Query]) -> Answer:
    """The motion of a tick, taken over in motion for the goals and among the spheres of other queries."""
    limits, random = JointLimits.of(planner.robot), np.random.default_rng(query.number)
    plan, now = _ticked(planner, query), 0.0
    verdict, begin, motions, violations = plan.verdict, plan.begin, [], []
    if plan.reference is not None:
        motions.append(plan.reference)
    for other in others if motions else ():
        now = max(now, begin + random.uniform(*TAKEN_OVER) * motions[-1].duration)
        _request_goal(planner, other)
        planner.set_obstacles(other.centres, other.radii, time=now)
        for _ in range(PATIENCE):
            plan, now = planner.tick(now), now + TICK_PERIOD
            if plan.reference is not None:
                before = motions[-1].sample(plan.begin - begin)[0]
                if np.max(np.abs(plan.reference.positions[0] - before)) > SAME_PLACE:
                    violations.append("begins elsewhere")
                begin = plan.begin
                motions.append(plan.reference)
                if plan.verdict.ok:
                    break
    # The first one is that of the tick.
    taken = motions[1:]
    share = max((_largest_share(motion, limits) for motion in taken), default=0.0)
    if share > 1.0 + _ROUNDING or not all(motion.keeps(planner.limits) for motion in taken):
        violations.append("breaks a limit")
    name = planner.skill.name
    return Answer(name, TAKEOVER, query, verdict.code, verdict.reason, tuple(violations), len(taken), share)


def _largest_share(motion: JointReference, limits: JointLimits) -> float:
    return float(np.max(limit_shares(motion, limits)))


def _answer(planner: ReactivePlanner, query: Query, request: str, method: Callable[[], Answer]) -> Answer:
    """What a request came to; what it raised where it did."""
    try:
        return method()
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return Answer(planner.skill.name, request, query, None, reason)


def _judged(planner: ReactivePlanner, query: Query, request: str, plan: Plan) -> Answer:
    name, verdict = planner.skill.name, plan.verdict
    if not verdict.ok or plan.reference is None:
        objection = "no motion" if verdict.ok else "" if verdict.reason else "no reason"
        violations = (objection,) if objection else ()
        return Answer(name, request, query, verdict.code, verdict.reason, violations)
    share = _largest_share(plan.reference, JointLimits.of(planner.robot))
    violations = _violations(planner, query, request, plan.reference, share)
    return Answer(name, request, query, verdict.code, verdict.reason, violations, 1, share)


def _violations(
    planner: ReactivePlanner, query: Query, request: str, reference: JointReference, share: float
) -> tuple[str, ...]:
    """What an answer does not keep; share : the largest of a limit of the robot that it uses."""
    robot, collision, first, last = planner.robot, planner.collision, reference.positions[0], reference.positions[-1]
    found = []
    if request == TICK:
        if np.max(np.abs(first - query.start)) > AT_START:
            found.append("begins elsewhere")
    elif not _near(Pose(*robot.forward(first)), query.start_pose, SAME_START):
        found.append("begins elsewhere")
    if not _near(Pose(*robot.forward(last)), query.goal_pose, AT_GOAL):
        found.append("ends elsewhere")
    if not reference.keeps(planner.limits) or share > 1.0 + _ROUNDING:
        found.append("breaks a limit")
    postures = reference.samples(np.arange(0.0, reference.duration + LOOK_PERIOD, LOOK_PERIOD))[0]
    placed = collision.positions(robot, postures)
    if len(collision.self_pairs) and np.min(self_clearances(placed, collision.radii, collision.self_pairs)[0]) < 0.0:
        found.append("touches itself")
    bodies, radii = placed[:, collision.moving], collision.radii[collision.moving]
    for centre, radius in zip(query.centres, query.radii, strict=True):
        if np.min(np.linalg.norm(bodies - centre, axis=2) - radii) < radius:
            found.append("touches a sphere")
    return tuple(found)


def _near(one: Pose, other: Pose, limits: tuple[float, float]) -> bool:
    apart = np.linalg.norm(one.position - other.position), angle_between(one.quaternion, other.quaternion)
    return bool(apart[0] <= limits[0] and apart[1] <= limits[1])
