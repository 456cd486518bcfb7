"""No query raises: whatever is asked of a planner, it answers with a verdict, and with a reference where that is OK.

GEODESIC_QUERIES queries are drawn for each skill: those shipped, and those in the folders of GEODESIC_SKILLS. Of their
verdicts, and of the time that they took, a line is printed (`pytest -rP`).
"""

from __future__ import annotations

import os
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Verdict, VerdictCode
from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

QUERIES = int(os.environ.get("GEODESIC_QUERIES", "100"))
SKILLS = ("panda_pouring", "panda_bottle2shelf", "panda_reach_to_grasp", "paper_pouring", "paper_reach")
SKILLS += ("panda_wide_reach", "panda_insertion", "fr3_reach_to_grasp", "ur5_reach", "iiwa14_reach_to_grasp")
SKILLS += tuple(filter(None, os.environ.get("GEODESIC_SKILLS", "").split(os.pathsep)))
#: Of graphs that take long to stand, and to carry to a goal, on the default grid.
GRIDS = {"paper_reach": (25, 25, 25)}
#: Obstacles stay for a few queries, and a goal for a few ticks.
QUERIES_PER_SCENE, QUERIES_PER_GOAL = 5, 3
IDENTITY = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
#: Numbers that have broken programs before.
NUMBERS = (0.0, -0.0, 1e-320, 1e-160, 1e160, -1e300, np.nan, np.inf, -np.inf)


class Draw:
    """Draws what a planner of a skill is asked: near what was demonstrated, within reach, beyond it, and nonsense."""

    def __init__(self, skill: Skill) -> None:
        self.robot = Robot.named(skill.robot)
        codes = skill.codes[:, ::9].reshape(-1, skill.codes.shape[-1])
        if skill.space == "joint":
            self.configurations = np.clip(skill.decoder.configurations(codes), self.robot.lower, self.robot.upper)
            poses = [np.concatenate(self.robot.forward(shown)) for shown in self.configurations]
        else:
            decoded = skill.decoder.decode(codes)
            poses = [*np.concatenate([decoded.positions, decoded.quaternions], axis=1)]
            self.configurations = np.array([solve(self.robot, pose[:3], pose[3:]) for pose in poses[::3]])
        self.poses = np.array([skill.start_pose, skill.goal_pose, *poses])

    def configuration(self, random: np.random.Generator) -> np.ndarray:
        """(eta,) [rad]."""
        lower, upper = self.robot.lower, self.robot.upper
        shown, anywhere = random.choice(self.configurations), self.robot.sample(1, random)[0]
        at_limits, count = np.where(random.uniform(size=len(lower)) < 0.5, lower, upper), len(lower)
        in_line = np.eye(count)[[0, 1, -1]].sum(axis=0)
        return self._one(
            random,
            lambda: shown,
            lambda: np.clip(shown + random.normal(size=count) * 10.0 ** random.uniform(-9.0, 0.0), lower, upper),
            lambda: anywhere,
            lambda: at_limits,
            lambda: np.where(random.uniform(size=count) < 0.7, at_limits, anywhere),
            # Stretched, with the axes of the wrist in line.
            lambda: np.clip(anywhere * in_line, lower, upper),
            lambda: at_limits * (1.0 + 10.0 ** random.uniform(-16.0, 3.0)),
            lambda: self._spoilt(anywhere, random),
            lambda: anywhere[:-1],
        )

    def pose(self, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """(3,) [m] and (4,)."""
        shown, turned = random.choice(self.poses), normalise(random.normal(size=4))
        pose = self._one(
            random,
            lambda: self.poses[random.integers(2)],
            lambda: shown,
            lambda: shown + random.normal(size=7) * 10.0 ** random.uniform(-9.0, -0.5),
            lambda: np.concatenate([shown[:3], turned]),
            lambda: np.concatenate(self.robot.forward(self.robot.sample(1, random)[0])),
            lambda: np.concatenate([random.normal(size=3) * 10.0 ** random.uniform(-1.0, 3.0), turned]),
            lambda: shown * np.repeat([1.0, -(10.0 ** random.uniform(-7.0, 3.0))], [3, 4]),
            lambda: self._spoilt(shown, random),
            lambda: shown[:6],
        )
        return pose[:3], pose[3:]

    def obstacles(self, random: np.random.Generator) -> Obstacles:
        """That stand or move, near what was demonstrated or anywhere."""
        centres = random.choice(self.poses, size=random.integers(1, 9))[:, :3] + 0.1 * random.normal(size=3)
        radii, velocities = 10.0 ** random.uniform(-3.0, 0.0, len(centres)), 0.2 * random.normal(size=centres.shape)
        return self._one(
            random,
            Obstacles.none,
            lambda: Obstacles.of_spheres(centres, 0.1 * radii),
            lambda: Obstacles.of_spheres(centres, radii),
            lambda: Obstacles.of_spheres(centres, 0.1 * radii, velocities, time=0.0),
            lambda: Obstacles.one_of_each(centres[0], velocities[0], 0.0),
            lambda: Obstacles.of_spheres(centres * 10.0 ** random.uniform(0.0, 3.0), radii),
            lambda: Obstacles.of_spheres(centres, radii * 10.0 ** random.uniform(0.0, 3.0)),
            lambda: Obstacles.of_spheres(self._spoilt(centres, random), self._spoilt(radii, random)),
        )

    @staticmethod
    def _one(random: np.random.Generator, *choices: Callable) -> object:
        return choices[random.integers(len(choices))]()

    @staticmethod
    def _spoilt(array: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """With one number replaced."""
        spoilt = np.array(array)
        spoilt.flat[random.integers(spoilt.size)] = random.choice(NUMBERS)
        return spoilt


class Asked:
    """A planner, and the queries of each kind that are drawn for it: calls that return a verdict or a plan."""

    def __init__(self, skill: Skill) -> None:
        self.planner = ReactivePlanner(skill, PlannerSettings(grid_shape=GRIDS.get(skill.name)))
        self._draw = Draw(skill)
        self._now = 0.0

    def change_scene(self, random: np.random.Generator, stands: bool) -> None:
        """Other obstacles, another task frame, and another place where the arm stands."""
        self.planner.take_obstacles(self._draw.obstacles(random))
        self.planner.set_task_frame(*(self._draw.pose(random) if random.uniform() < 0.2 else IDENTITY))
        if stands:
            self.planner.stand_at(random.choice(self._draw.configurations), self._now)

    def goal(self, random: np.random.Generator) -> Callable[[], Verdict]:
        """A goal pose, or a goal configuration where there are such."""
        if random.uniform() < 0.5:
            return partial(self.planner.set_goal_configuration, self._draw.configuration(random))
        return partial(self.planner.set_goal, *self._draw.pose(random))

    def plan(self, random: np.random.Generator) -> Callable[[], Plan]:
        """A plan between two poses."""
        return partial(self.planner.plan, *self._draw.pose(random), *self._draw.pose(random))

    def tick(self, random: np.random.Generator) -> Callable[[], Plan]:
        """A tick of the stream, to the goal asked for last, in motion or from wherever the arm is then."""
        self._now += 10.0 ** random.uniform(-3.0, 0.0)
        if random.uniform() < 0.2:
            self.planner.stand_at(self._draw.configuration(random), self._now)
        return partial(self.planner.tick, self._now)


@pytest.fixture(scope="module", params=SKILLS)
def asked(request: pytest.FixtureRequest) -> Asked:
    return Asked(Skill.load(request.param))


@pytest.mark.parametrize(
    ("kind", "count", "expected"),
    [
        ("goal", QUERIES, {"OK", "GOAL_OUT_OF_SUPPORT", "BAD_INPUT"}),
        ("plan", 3 * QUERIES // 10, {"OK", "GOAL_OUT_OF_SUPPORT", "START_OUT_OF_SUPPORT"}),
        ("tick", 3 * QUERIES // 10, {"OK", "START_OUT_OF_SUPPORT", "IN_COLLISION"}),
    ],
    ids=["goals", "plans", "ticks"],
)
def test_no_query_raises(asked: Asked, kind: str, count: int, expected: set[str]) -> None:
    verdicts: Counter[str] = Counter()
    raised, seconds = [], 0.0
    for number in range(count):
        random = np.random.default_rng([0, number])
        if number % QUERIES_PER_SCENE == 0:
            # Once it is known where the arm stands the graph is carried to every goal, which takes long.
            asked.change_scene(random, stands=kind != "goal" or number >= 0.9 * count)
        if kind == "tick" and number % QUERIES_PER_GOAL == 0:
            asked.goal(random)()
        query = getattr(asked, kind)(random)
        began = time.perf_counter()
        try:
            answer = query()
        except Exception:
            raised.append(f"query {number}, {query}:\n{traceback.format_exc()}")
            continue
        seconds += time.perf_counter() - began
        check(answer)
        verdicts[verdict_of(answer).code.name] += 1
    print(f"{asked.planner.skill.name}, {count} {kind}s: {dict(verdicts)}, {1e3 * seconds / count:.2f} ms each")
    assert not raised, f"{len(raised)} of {count} raised, first {raised[0]}"
    assert expected <= set(verdicts), verdicts


def verdict_of(answer: Verdict | Plan) -> Verdict:
    return answer if isinstance(answer, Verdict) else answer.verdict


def check(answer: Verdict | Plan) -> None:
    """A refusal has a reason, and what is commanded is a motion that is known to be clear."""
    verdict, reference = verdict_of(answer), getattr(answer, "reference", None)
    assert verdict.ok or verdict.reason, answer
    if reference is not None:
        assert np.all(np.isfinite(reference.positions)), answer
        assert not (verdict.ok and np.isnan(verdict.figures.clearance)), answer


def test_demonstrations_that_end_at_a_joint_limit_are_no_exception() -> None:
    """The mean of equal numbers may be larger than each of them, by rounding."""
    skill, limit = Skill.load("panda_reach_to_grasp"), Robot.named("panda").upper[6]
    poles = skill.canonical.goal_poles.copy()
    poles[:, 6] = np.nextafter(limit, np.inf)
    planner = ReactivePlanner(replace(skill, canonical=replace(skill.canonical, goal_poles=poles)))
    poles[:, 6] = limit
    verdict = planner.set_goal(*planner.robot.forward(poles[0]))
    assert verdict.ok, verdict


def test_an_arm_that_touches_itself_where_it_stands_is_named_so() -> None:
    """With spheres that are larger than the arm's. The control: with its own it sets out."""
    skill = Skill.load("ur5_reach")
    robot, own, sheet = Robot.named("ur5"), CollisionModel.named("ur5"), skill.canonical
    starts, goals = (getattr(sheet, f"{end}_poles")[getattr(sheet, f"{end}_groups")] for end in ("start", "goal"))
    starts, goal = starts + sheet.start_offsets, goals[0] + sheet.goal_offsets[0]
    clearances = [self_clearance(own, robot, start)[0] for start in starts]
    start, least = starts[np.argmin(clearances)], min(clearances)
    assert least > 0.0
    verdicts = []
    for model in (own, replace(own, radii=own.radii + 0.5 * least + 0.001)):
        planner = ReactivePlanner(skill, collision=model)
        planner.stand_at(start, 0.0)
        planner.set_goal_configuration(goal)
        verdicts.append(planner.tick(0.0).verdict)
    assert verdicts[0].ok, verdicts[0]
    assert verdicts[1].code is VerdictCode.IN_COLLISION
    assert "overlap by 2.0 mm where the arm stands" in verdicts[1].reason


def test_a_pose_that_no_configuration_holds_is_refused_with_its_end() -> None:
    skill = Skill.load("panda_reach_to_grasp")
    planner = ReactivePlanner(skill)
    start, goal = np.split(skill.start_pose, [3]), np.split(skill.goal_pose, [3])
    far = start[0] + [0.0, 0.0, 2.0], start[1]
    refused = {"start": planner.plan(*far, *goal), "goal": planner.plan(*start, *far)}
    for end, plan in refused.items():
        assert plan.verdict.code.name == f"{end.upper()}_OUT_OF_SUPPORT"
        assert f"holds the tool at the {end}: " in plan.verdict.reason
