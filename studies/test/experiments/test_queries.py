"""Queries that are drawn: where they lie, and that what is raised, missed or refused is counted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import self_clearance
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.drawn_queries import (
    CYCLE,
    DEMONSTRATED,
    INSIDE,
    OBSTACLES,
    ODD_STARTS,
    OUTSIDE,
    QuerySource,
    Spread,
)
from geodesic_motion_studies.experiments.queries import PLAN, TAKEOVER, Queries, QueriesReport, answers_to
from geodesic_motion_studies.tools.limit_shares import limit_shares

TOOL, ARM, WITH_STOPS = "panda_bottle2shelf", "ur5_reach", "fr3_reach_to_grasp"


@pytest.fixture(scope="module")
def found() -> QueriesReport:
    return Queries((TOOL,), 2 * CYCLE, 3).measure(Path())


@pytest.fixture(scope="module")
def planner() -> ReactivePlanner:
    return ReactivePlanner(Skill.load(TOOL))


@pytest.fixture(scope="module")
def source() -> QuerySource:
    return QuerySource.of(Skill.load(TOOL))


def test_what_is_drawn_lies_within_the_farthest_sample_or_up_to_twice_as_far_out() -> None:
    """In a space of three numbers whose samples span a plane."""
    random = np.random.default_rng(0)
    samples = random.normal(size=(12, 2)) @ [[1.0, 0.0, 1.0], [0.0, 5.0, 0.0]] + [3.0, 0.0, 0.0]
    spread = Spread.of(samples)
    inverse = np.linalg.pinv(np.cov(samples.T))
    radii = {
        outside: [
            np.sqrt((drawn - spread.mean) @ inverse @ (drawn - spread.mean))
            for drawn in (spread.draw(random, outside) for _ in range(200))
        ]
        for outside in (False, True)
    }
    farthest = max(np.sqrt((each - spread.mean) @ inverse @ (each - spread.mean)) for each in samples)
    assert spread.farthest == pytest.approx(farthest)
    assert 0.9 * farthest < max(radii[False]) <= farthest <= min(radii[True])
    assert 1.9 * farthest < max(radii[True]) <= 2.0 * farthest


@pytest.mark.parametrize("samples", [np.ones((1, 3)), np.ones((5, 3))], ids=["one", "equal"])
def test_without_a_spread_the_mean_is_drawn(samples: np.ndarray) -> None:
    spread = Spread.of(samples)
    np.testing.assert_array_equal(spread.draw(np.random.default_rng(0), outside=True), np.ones(3))


def test_every_part_is_drawn_and_seed_and_number_repeat_a_query() -> None:
    source = QuerySource.of(Skill.load(ARM))
    drawn = [source.drawn(number, 7) for number in range(2 * CYCLE)]
    assert {each.part for each in drawn} == {INSIDE, OUTSIDE, OBSTACLES, ODD_STARTS}
    again, other = source.drawn(5, 7), source.drawn(5, 8)
    np.testing.assert_array_equal(again.start, drawn[5].start)
    assert not np.array_equal(other.start, again.start)
    assert all((len(each.radii) > 0) == (each.part == OBSTACLES) for each in drawn)


def test_odd_starts_are_at_a_limit_or_beyond_it_or_touch_the_arm_itself() -> None:
    source = QuerySource.of(Skill.load(ARM))
    robot = source.robot
    kinds = set()
    for number in range(20 * CYCLE):
        query = source.drawn(number, 0)
        if query.part == ODD_STARTS:
            beyond = np.max(np.maximum(robot.lower - query.start, query.start - robot.upper))
            touches = self_clearance(source.collision, robot, query.start)[0] < 0.0
            assert beyond >= 0.0 or touches
            kinds.add("beyond" if beyond > 0.0 else "at" if beyond == 0.0 else "touching")
    assert kinds == {"at", "beyond", "touching"}


def test_every_demonstration_is_answered_by_both_requests_and_nothing_is_raised(found: QueriesReport) -> None:
    own = [each for each in found.answers if each.query.part == DEMONSTRATED]
    assert len(own) == 2 * len(Skill.load(TOOL).codes)
    assert all(each.code is not None and each.code.name == "OK" for each in own)
    assert not [each for each in found.answers if each.code is None or each.violations]


def test_what_is_handed_over_is_complete(found: QueriesReport, tmp_path: Path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", found.as_dict()).read_text())
    requested = sum(part[1] for row in content["answered"].values() for part in row.values())
    answered = sum(part[0] for row in content["answered"].values() for part in row.values())
    assert requested == len(found.answers) == answered + sum(each["count"] for each in content["refusals"])
    assert all(each["reason"] and each["first"]["goal_pose"] for each in content["refusals"])
    assert f"{TOOL}  {PLAN}" in found.table()
    found.draw(tmp_path / "queries.png")
    assert (tmp_path / "queries.png").read_bytes().startswith(b"\x89PNG")


class Wrong:
    """A planner whose plans lead to a goal that is moved, or that raises."""

    def __init__(self, planner: ReactivePlanner, moved: float) -> None:
        self._planner, self._moved = planner, moved

    def __getattr__(self, name: str) -> Any:
        return getattr(self._planner, name)

    def plan(self, *poses: np.ndarray) -> Any:
        if np.isnan(self._moved):
            raise ValueError("a broken planner")
        return self._planner.plan(poses[0], poses[1], poses[2] + [0.0, 0.0, self._moved], poses[3])


@pytest.mark.parametrize(("moved", "expected"), [(0.0, ()), (0.02, ("ends elsewhere",))])
def test_a_motion_that_misses_its_goal_is_counted(
    planner: ReactivePlanner, source: QuerySource, moved: float, expected: tuple[str, ...]
) -> None:
    """The control: the same planner as it is."""
    answers = answers_to(Wrong(planner, moved), source.demonstrated()[0])
    assert next(each for each in answers if each.request == PLAN).violations == expected


def test_what_is_raised_is_reported_with_its_query(planner: ReactivePlanner, source: QuerySource) -> None:
    answers = answers_to(Wrong(planner, np.nan), source.demonstrated()[0])
    report = QueriesReport(0, 0, tuple(answers))
    (raised,) = report.as_dict()["exceptions"]
    assert raised["reason"] == "ValueError: a broken planner"
    assert raised["number"] == 0
    assert f"{TOOL}, {PLAN}, {DEMONSTRATED} 0: raised ValueError" in report.table()


def fastest_share(robot: Robot) -> float:
    """The largest share of an FR3's speed limits in some of the skill's motions at full scale, by a planner's robot."""
    settings = PlannerSettings(speed_scale=1.0, acceleration_scale=1.0)
    planner = ReactivePlanner(Skill.load(WITH_STOPS), settings, robot=robot)
    source, limits, shares = QuerySource.of(planner.skill), JointLimits.of(Robot.named("fr3")), []
    for number in range(60):
        query = source.drawn(number, 0)
        if query.part in (INSIDE, OUTSIDE):
            start, goal = query.start_pose, query.goal_pose
            plan = planner.plan(start.position, start.quaternion, goal.position, goal.quaternion)
            if plan.reference is not None:
                shares.append(limit_shares(plan.reference, limits)[0])
    assert len(shares) > 30
    return max(shares)


def test_at_full_scale_an_arm_keeps_its_limits_towards_stops_and_without_knowing_them_it_does_not() -> None:
    """Were commands allowed all of an FR3's speed, which they are not."""
    robot = Robot.named("fr3")
    robot.largest_speed_scale = 1.0
    assert fastest_share(robot) <= 1.0
    robot.position_based_velocity = None
    assert fastest_share(robot) > 1.0


def test_motions_that_are_taken_over_keep_the_makers_limits() -> None:
    report = Queries((WITH_STOPS,), 8, 1, takeovers=3, speed_scale=0.8, acceleration_scale=1.0).measure(Path())
    own = [each for each in report.answers if each.request == TAKEOVER]
    assert sum(each.motions for each in own) > 50
    assert 0.7 < max(each.share for each in own) <= 1.00001
    assert not [each for each in report.answers if each.code is None or each.violations]
    assert report.as_dict()["motions"][f"{WITH_STOPS} {TAKEOVER}"][0] == sum(each.motions for each in own)


def test_a_takeover_that_breaks_a_limit_is_counted() -> None:
    """The planner does not know the limits of the arm by which it is judged."""
    planner = ReactivePlanner(Skill.load(WITH_STOPS), PlannerSettings(speed_scale=0.8, acceleration_scale=1.0))
    queries = QuerySource.of(planner.skill).demonstrated()[:2]
    planner.robot.acceleration_limits = 0.1 * planner.robot.acceleration_limits
    answers = answers_to(planner, queries[0], queries[1:])
    assert {each.violations for each in answers} == {("breaks a limit",)}
