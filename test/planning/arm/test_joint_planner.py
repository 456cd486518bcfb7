"""ReactivePlanner: the arm takes another path, by what was requested, in the time that there is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.demonstrations.canonical import sample_body_arc
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.shapes import solid_distances, solid_rows
from geodesic_motion_ros.manifold.metric_field import curve_length
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation
from geodesic_motion_ros.motion.path_timer import PathTimer
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import Deadline

NOT_THIS = Refusal(VerdictCode.NO_FEASIBLE_PATH, "not this")


def test_the_goal_is_reached_at_rest_and_stays_reached(stream, nominal, goal) -> None:
    plans = stream.run(nominal.duration + 0.5)
    assert all(plan.verdict.ok for plan in plans)
    assert len(stream.handed) == 1
    assert stream.off(goal) < 1e-9
    assert nominal.keeps(stream.planner.limits)


def test_an_elbow_that_is_in_the_path_goes_on_the_other_side(stream, nominal, on_elbow, least_clearance) -> None:
    stream.planner.set_obstacles(*on_elbow)
    plan = stream.planner.tick(0.0)
    assert plan.verdict.ok
    assert least_clearance(stream.dense(nominal), on_elbow) < -0.03
    measured = least_clearance(stream.dense(plan.reference), on_elbow)
    assert 0.0 < plan.verdict.figures.clearance <= measured + 1e-4


@pytest.mark.parametrize("kind", ["box", "capsule", "cloud"])
def test_obstacles_of_every_kind_are_hit_on_the_old_path_and_passed_on_the_new(stream, nominal, on_elbow, kind) -> None:
    planner, (centre, _) = stream.planner, on_elbow
    turn = Rotation.from_rotvec([0.4, 0.3, 0.9]).as_matrix()[None]
    extents, radius = ([[0.03, 0.02, 0.04]], [0.0]) if kind == "box" else ([[0.0, 0.0, 0.03]], [0.025])
    solids, seen = solid_rows(centre, turn, np.array(extents), np.array(radius)), centre
    obstacles = replace(Obstacles.none(), solids=solids, solid_velocities=np.zeros((1, 3)))
    if kind == "cloud":
        seen = centre + np.random.default_rng(0).uniform(-0.02, 0.02, (2000, 3))
        obstacles = replace(Obstacles.none(), cloud=DistanceField.of(seen, 0.01, 0.005, 0.04))

    def least(reference: JointReference) -> float:
        model = planner.collision
        centres = model.positions(planner.robot, stream.dense(reference))[:, model.moving].reshape(-1, 3)
        gaps = cKDTree(seen).query(centres)[0] - 0.005 if kind == "cloud" else solid_distances(centres, solids)
        return float(np.min(gaps.reshape(-1, np.count_nonzero(model.moving)) - model.radii[model.moving]))

    assert planner.take_obstacles(obstacles).ok
    plan = planner.tick(0.0)
    assert plan.verdict.ok
    assert least(nominal) < -0.03
    assert 0.0 < plan.verdict.figures.clearance <= least(plan.reference)
    # A field tells no more than its reach.
    assert least(plan.reference) < plan.verdict.figures.clearance + 0.03 or kind == "cloud"


def test_a_start_beside_the_others_joins_their_path_by_the_fade_of_the_skill(reach_skill, planner, start, goal) -> None:
    """At half of the arc less of the tool's offset is left where it fades faster; both ends are met all the same."""
    beside = start + np.array([0.15, 0.05, 0.0, 0.05, 0.0, 0.0, 0.0])
    requested = ConfigurationGoal(goal[None], "the goal")

    def halfway(fade: float, first: np.ndarray) -> np.ndarray:
        skill = replace(reach_skill, canonical=replace(reach_skill.canonical, fade=fade))
        reference = ReactivePlanner(skill, planner.settings).plan_configurations(first, requested).reference
        path = sample_body_arc(reference.positions, planner.robot, skill.metric, 101)
        np.testing.assert_allclose(path[[0, -1]], [first, goal], atol=1e-6)
        return planner.robot.forward(path[50])[0]

    left = {fade: np.linalg.norm(halfway(fade, beside) - halfway(fade, start)) for fade in (1.0, 4.0)}
    assert left[4.0] < 0.5 * left[1.0]


def test_a_refined_path_is_shorter_than_the_graphs(reach_skill, planner, start, goal) -> None:
    planner.take_obstacles(Obstacles.none())
    planner.clear_goal()
    planner.stand_at(start, 0.0)
    prepared = planner.prepare_configuration(goal)
    choice, query = prepared.goal, prepared.query
    free = NodeEvaluation.of(query.body, Obstacles.none(), 0.0, 0.5, 0.02)

    def length(plan: Plan) -> float:
        assert plan.verdict.ok, plan.verdict.reason
        return curve_length(query.field, free, plan.reference.latent)

    plain = ReactivePlanner(reach_skill, replace(planner.settings, refine=False)).plan_configurations(start, choice)
    assert length(planner.plan_configurations(start, choice)) < length(plain)


def test_a_motion_that_would_be_no_gain_is_not_certified(planner, start, goal) -> None:
    planner.take_obstacles(Obstacles.none())
    planner.clear_goal()
    planner.stand_at(start, 0.0)
    query, still = planner.prepare_configuration(goal).query, np.zeros_like(start)
    single = Solver(
        planner.skill, planner.graph, planner.settings, planner.robot, planner.collision, planner.limits
    )
    state = MotionState(0.0, start, still, still, None)
    plan = single.solve(query, state, Obstacles.none(), single.attempts[:1])
    duration = plan.reference.duration
    longer = single.solve(query, state, Obstacles.none(), single.attempts[:1], longest=1.001 * duration)
    np.testing.assert_array_equal(longer.reference.positions, plan.reference.positions)
    refused = single.solve(query, state, Obstacles.none(), single.attempts[:1], longest=duration)
    assert refused.trajectory is None
    assert refused.verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "would be a gain" in refused.verdict.reason


def test_a_motion_is_as_fast_as_was_shown_but_where_what_moves_would_meet_it(reach_skill, planner, start, goal) -> None:
    """The demonstrations took twice as long as the limits would. A ball crosses their path halfway, when the arm
    would be there that slow; as fast as can be it is past before.
    """

    def solved(timing: str, obstacles: Obstacles) -> Plan:
        quick = replace(planner.settings, timing=timing, speed_scale=1.0, acceleration_scale=1.0, prediction=4.0)
        paced = ReactivePlanner(skill, quick)
        paced.take_obstacles(obstacles)
        paced.stand_at(start, 0.0)
        assert paced.set_goal_configuration(goal).ok
        return paced.tick(0.0)

    skill, free = reach_skill, Obstacles.none()
    fastest = solved("fastest", free)
    count, samples = skill.codes.shape[:2]
    times = np.tile(np.linspace(0.0, 2.0 * fastest.reference.duration, samples), (count, 1))
    skill = replace(reach_skill, canonical=replace(reach_skill.canonical, times=times))
    shown = solved("demonstrated", free)
    assert shown.reference.duration > 1.6 * fastest.reference.duration
    assert 0.5 * shown.reference.duration < 4.0
    # From below, halfway in the slow motion.
    when, velocity = 0.5 * shown.reference.duration, np.array([0.0, 0.0, 0.4])
    place, _ = planner.robot.forward(shown.reference.sample(when)[0])
    ball = Obstacles.of_spheres((place - when * velocity)[None], np.array([0.04]), velocity[None], time=0.0)
    passed = solved("demonstrated", ball)
    assert passed.verdict.ok
    assert passed.reference.duration < 1.3 * fastest.reference.duration


def test_a_path_that_is_found_again_is_not_judged_again(stream, nominal, on_elbow, monkeypatch) -> None:
    """An obstacle that comes from afar is felt by the search all along. The control: one that blocks the path."""
    judged, timed = [], PathTimer.time_curve

    def recorded(*arguments, **more):
        judged.append(stream.now)
        return timed(*arguments, **more)

    monkeypatch.setattr(PathTimer, "time_curve", recorded)
    (centre,), radius = on_elbow
    for number in range(80):
        away = np.array([0.0, 0.0, 1.2 - 0.012 * number])
        stream.planner.set_obstacles((centre + away)[None], radius)
        assert stream.run(stream.period)[0].verdict.ok
    assert len(judged) == 1
    hand, _ = stream.planner.robot.forward(nominal.positions[len(nominal.positions) // 2])
    stream.planner.set_obstacles(hand[None], radius)
    assert not stream.run(stream.period)[0].verdict.ok or len(judged) > 1


def test_out_of_time_the_arm_stays_and_the_next_ticks_go_on_trying(stream, start, goal, monkeypatch) -> None:
    """The first attempt is refused. The control: it is not."""
    planner, timed, judged = stream.planner, PathTimer.time_curve, []

    def picky(*arguments, **more):
        judged.append(timed(*arguments, **more))
        return NOT_THIS if len(judged) == 1 else judged[-1]

    monkeypatch.setattr(PathTimer, "time_curve", picky)
    missed, *later = (planner.tick(number * stream.period, Deadline(-np.inf)) for number in range(4))
    assert missed.verdict.code is VerdictCode.DEADLINE_MISSED
    assert "out of time after 1 of 2 attempts: not this" in missed.verdict.reason
    assert missed.reference is None
    assert VerdictCode.OK in [plan.verdict.code for plan in later]

    stream.stand_at(start)
    planner.set_goal_configuration(goal)
    assert planner.tick(0.0, Deadline(-np.inf)).verdict.ok


@pytest.mark.parametrize("other", [False, True], ids=["the same obstacle", "another one"])
def test_what_an_attempt_has_evaluated_serves_the_next_one_in_the_next_tick(stream, monkeypatch, other) -> None:
    """The time is over after the first attempt, which is refused. It does not serve where the obstacle is another."""
    planner, evaluated, counts = stream.planner, NodeEvaluation.of, []

    def recorded(*arguments, **more) -> NodeEvaluation:
        counts.append(arguments)
        return evaluated(*arguments, **more)

    def refused(*arguments, **more):
        return NOT_THIS

    monkeypatch.setattr(NodeEvaluation, "of", recorded)
    far = np.array([[3.0, 0.0, 0.0]])
    planner.set_obstacles(far, np.array([0.05]))
    with monkeypatch.context() as first:
        first.setattr(PathTimer, "time_curve", refused)
        missed = planner.tick(0.0, Deadline(-np.inf)).verdict
    assert "out of time after 1 of 2 attempts: not this" in missed.reason
    planner.set_obstacles(far + 0.1 * other, np.array([0.05]))
    assert planner.tick(stream.period).verdict.ok
    assert len(counts) == (2 if other else 1)


def test_a_search_that_was_out_of_time_goes_on_in_the_next_tick_as_long_as_obstacles_stand(
    stream, nominal, monkeypatch
) -> None:
    """It evaluates no node twice; the control: another obstacle."""
    planner, evaluated, begun = stream.planner, NodeEvaluation.of, []

    def recorded(*arguments, **more) -> NodeEvaluation:
        begun.append(arguments)
        return evaluated(*arguments, **more)

    monkeypatch.setattr(NodeEvaluation, "of", recorded)
    hand, _ = planner.robot.forward(nominal.positions[len(nominal.positions) // 2])
    for blocking in (hand, hand + [0.0, 0.0, 0.01]):
        planner.set_obstacles(blocking[None], np.array([0.06]))
        before = len(begun)
        plans = [planner.tick(number * stream.period, Deadline(-np.inf)) for number in range(4)]
        assert {plan.verdict.code for plan in plans} == {VerdictCode.DEADLINE_MISSED}
        assert len(begun) == before + 1
    last = planner.tick(4.0 * stream.period)
    assert last.verdict.code is not VerdictCode.DEADLINE_MISSED
    assert len(begun) == before + 1


def test_without_avoidance_or_with_the_hand_alone_the_elbow_hits(
    stream, reach_skill, planner, start, goal, on_elbow, least_clearance
) -> None:
    from geodesic_motion_studies.experiments.blocked_arm import hand_alone

    blind = ReactivePlanner(reach_skill, replace(planner.settings, avoidance=False))
    settings = replace(planner.settings, ambient_strength=0.0)
    for other in (blind, ReactivePlanner(reach_skill, settings, collision=hand_alone(planner.collision))):
        other.set_obstacles(*on_elbow)
        other.stand_at(start, 0.0)
        other.set_goal_configuration(goal)
        assert least_clearance(stream.dense(other.tick(0.0).reference), on_elbow) < -0.03


def test_a_goal_prepared_before_the_arm_was_found_elsewhere_is_planned_from_there(stream, nominal, goal) -> None:
    elsewhere = nominal.sample(0.4 * nominal.duration)[0]
    stream.stand_at(elsewhere)
    stream.planner.set_goal_configuration(goal)
    expected = stream.run(stream.period)[0].reference

    stream.stand_at(nominal.positions[0])
    prepared = stream.planner.prepare_configuration(goal)
    stream.stand_at(elsewhere)
    stream.planner.take_goal(prepared)
    reference = stream.run(stream.period)[0].reference
    np.testing.assert_array_equal(reference.positions, expected.positions)


def test_nothing_is_planned_before_there_is_a_state_and_a_goal(reach_skill, planner, start) -> None:
    fresh = ReactivePlanner(reach_skill, planner.settings)
    assert fresh.tick(0.0).verdict.code is VerdictCode.STALE_STATE
    assert fresh.commanded_state(0.0) is None
    fresh.stand_at(start, 0.0)
    assert fresh.tick(0.0).verdict.code is VerdictCode.NO_GOAL
    np.testing.assert_array_equal(fresh.commanded_state(0.0)[0], start)


@pytest.mark.parametrize(
    ("centres", "radii", "velocities", "said"),
    [
        ([[0.0, 0.0, np.nan]], [0.1], None, "finite"),
        ([[0.0, 0.0, 1.0]], [0.0], None, "positive"),
        ([[0.0, 0.0, 1.0]], [0.1], [[np.inf, 0.0, 0.0]], "finite"),
        ([[0.0, 0.0, 1.0]], [0.1, 0.2], None, "as many of each"),
    ],
)
def test_bad_obstacles_are_refused_and_the_old_ones_stay(stream, on_elbow, centres, radii, velocities, said) -> None:
    stream.planner.set_obstacles(*on_elbow)
    verdict = stream.planner.set_obstacles(np.array(centres), np.array(radii), velocities, time=0.0)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert said in verdict.reason
    assert np.isfinite(stream.planner.tick(0.0).verdict.figures.clearance)


def test_a_joint_that_turns_without_end_is_planned_for(endless_reach_skill, start, goal) -> None:
    planner = ReactivePlanner(endless_reach_skill)
    assert np.isinf(planner.robot.upper).tolist() == [False] * 6 + [True]
    planner.stand_at(start, 0.0)
    assert planner.set_goal_configuration(goal).ok
    assert planner.tick(0.0).verdict.ok
    # however a driver counts its turns
    reached = planner.motion_to_goal()[0].positions[-1]
    for turns in (-1, 2):
        turned = np.array([0.0] * 6 + [2.0 * np.pi * turns])
        planner.stand_at(start + turned, 0.0)
        np.testing.assert_allclose(planner.commanded_state(0.0)[0], start, atol=1e-12)
        assert planner.set_goal_configuration(goal - turned).ok
        assert planner.tick(0.0).verdict.ok
        np.testing.assert_allclose(planner.motion_to_goal()[0].positions[-1], reached, atol=1e-9)
