"""Queries on a canonical sheet: exact ends for any start and goal that was shown, refusals with numbers, ridges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.canonical import canonical_form
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.planner import Plan, PlannerSettings, ReactivePlanner
from geodesic_motion_ros.quaternions import angle_between, rotate_by
from geodesic_motion_ros.query import Pose
from geodesic_motion_ros.reference import ReferenceFollower
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.verdict import VerdictCode

PERIOD = 0.01
NOTHING = (np.empty((0, 3)), np.empty(0))


@pytest.fixture(scope="module")
def shared_planner(canonical_fan_skill) -> ReactivePlanner:
    return ReactivePlanner(canonical_fan_skill)


@pytest.fixture
def planner(shared_planner) -> ReactivePlanner:
    shared_planner.set_obstacles(*NOTHING)
    shared_planner.clear_goal()
    return shared_planner


def displaced(pose: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and quaternion of a pose (7,) carried by an offset (6,)."""
    return pose[:3] + offset[:3], rotate_by(offset[3:], pose[3:])


def shown_ends(skill: Skill, seed: int) -> tuple[tuple, tuple]:
    """A start and a goal drawn from the convex hulls of the demonstrated ones."""
    random, sheet = np.random.default_rng(seed), skill.canonical
    weights = random.dirichlet(np.ones(len(sheet.modes)), 2)
    start = displaced(skill.start_pose, weights[0] @ sheet.start_offsets)
    return start, displaced(skill.goal_pose, weights[1] @ sheet.goal_offsets)


def mean_plan(planner: ReactivePlanner) -> Plan:
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    return planner.plan(start[:3], start[3:], goal[:3], goal[3:])


def gap_to(curve: np.ndarray, points: np.ndarray) -> float:
    """Largest distance [m] of points (n, 3) from the samples of a curve (m, 3)."""
    return float(np.linalg.norm(points[:, None] - curve, axis=-1).min(axis=1).max())


def test_a_motion_may_start_where_a_plan_is_not_refused_for_its_start(planner):
    random, skill = np.random.default_rng(0), planner.skill
    answers = []
    for _ in range(30):
        reference = mean_plan(planner).reference
        position, quaternion = reference.sample(random.uniform(0.0, reference.duration))
        pose = Pose(position + random.normal(scale=0.04, size=3), quaternion)
        refused = planner.plan(pose.position, quaternion, *np.split(skill.goal_pose, [3])).verdict.code
        answers.append(planner._queries.may_start(pose))
        assert answers[-1] == (refused is not VerdictCode.START_OUT_OF_SUPPORT)
    assert 5 < sum(answers) < 25


@pytest.mark.parametrize("seed", range(20))
def test_shown_starts_and_goals_are_met_exactly_with_hardly_a_correction(planner, seed):
    start, goal = shown_ends(planner.skill, seed)
    plan = planner.plan(*start, *goal)
    verdict, reference = plan.verdict, plan.reference
    assert verdict.ok, verdict
    assert verdict.end_correction < 0.002
    assert verdict.in_support
    assert max(verdict.start_beyond, verdict.goal_beyond) < 1e-6
    np.testing.assert_allclose(reference.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)
    assert angle_between(reference.quaternions[[0, -1]], np.stack([start[1], goal[1]])).max() < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_the_graph_itself_is_carried_to_the_ends_before_anything_is_planned(planner, seed):
    start, goal = shown_ends(planner.skill, seed)
    query = planner.query(*start, *goal)
    np.testing.assert_allclose(query.graph.positions[query.goal_node], goal[0], atol=0.002)
    assert angle_between(query.graph.quaternions[query.goal_node], goal[1]) < 0.02
    source = int(np.argmin(np.linalg.norm(planner.graph.latent - query.start_latent, axis=1)))
    assert np.linalg.norm(query.graph.positions[source] - start[0]) < 0.02


def test_the_conformal_factor_leaves_the_field_a_lower_bound(planner):
    start, goal = shown_ends(planner.skill, 0)
    query = planner.query(*start, *goal)
    assert query.graph.conformal.min() >= 1.0
    first, second = planner.graph.edges.T
    reached = np.isfinite(query.to_goal[first]) & np.isfinite(query.to_goal[second])
    jump = np.abs(query.to_goal[first] - query.to_goal[second])[reached]
    assert np.all(jump <= query.graph.base[reached] * (1.0 + 1e-9))


@pytest.mark.parametrize("seed", range(15))
def test_a_sphere_on_the_way_of_a_carried_query_is_passed(planner, seed):
    random = np.random.default_rng(seed)
    start, goal = shown_ends(planner.skill, seed)
    direct = planner.plan(*start, *goal).reference
    centre = direct.positions[random.integers(len(direct.positions) // 3, 2 * len(direct.positions) // 3)]
    planner.set_obstacles([centre + random.normal(scale=0.005, size=3)], [0.015])
    plan = planner.plan(*start, *goal)
    assert plan.verdict.ok, plan.verdict
    assert plan.verdict.clearance > 0.0
    np.testing.assert_allclose(plan.reference.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)
    planner.set_obstacles(*NOTHING)
    np.testing.assert_array_equal(planner.plan(*start, *goal).reference.positions, direct.positions)


def test_the_goal_verdict_tells_the_offset_and_what_of_it_is_beyond_the_shown(planner):
    sheet, goal = planner.skill.canonical, planner.skill.goal_pose
    inside = planner.set_goal(*displaced(goal, 0.9 * sheet.goal_offsets[0]))
    assert inside.ok
    assert inside.goal_beyond < 1e-6
    assert inside.goal_offset > 0.005
    upward = np.array([0.0, 0.0, 0.06, 0.0, 0.0, 0.0])
    outside = planner.set_goal(*displaced(goal, upward))
    assert outside.ok
    assert 0.06 - sheet.goal_offsets[:, 2].max() - 1e-6 <= outside.goal_beyond < 0.05


def test_a_goal_beyond_the_limit_is_refused_with_the_numbers(planner):
    goal = planner.skill.goal_pose
    assert planner.set_goal(goal[:3], goal[3:]).ok
    refused = planner.set_goal(*displaced(goal, np.array([0.0, 0.05, 0.25, 0.0, 0.0, 0.0])))
    assert refused.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert refused.goal_beyond > 0.1
    for said in (f"{1000 * refused.goal_beyond:.0f} mm", "50 mm", "maximum_offset", "demonstrated"):
        assert said in refused.reason
    start = planner.skill.start_pose
    np.testing.assert_allclose(planner.tick(start[:3], start[3:]).reference.positions[-1], goal[:3], atol=1e-9)
    turned = planner.set_goal(*displaced(goal, np.array([0.0, 0.0, 0.0, 1.2, 0.0, 0.0])))
    assert turned.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert turned.goal_beyond_angle > 0.5


def test_a_start_in_the_middle_of_the_task_is_met_too(planner):
    direct, goal = mean_plan(planner).reference, planner.skill.goal_pose
    half = len(direct.positions) // 2
    plan = planner.plan(direct.positions[half], direct.quaternions[half], goal[:3], goal[3:])
    assert plan.verdict.ok, plan.verdict
    np.testing.assert_allclose(plan.reference.positions[0], direct.positions[half], atol=1e-9)
    assert plan.reference.duration < 0.8 * direct.duration


def test_a_new_goal_in_motion_bends_the_way_without_a_jump(planner):
    sheet, goal = planner.skill.canonical, planner.skill.goal_pose
    start = planner.skill.start_pose
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(start[:3], start[3:])
    goals = [displaced(goal, sign * 0.8 * sheet.goal_offsets[row]) for row, sign in ((0, 1), (2, 1), (4, 1), (5, 1))]
    limit = planner.settings.acceleration * PERIOD
    positions, quaternions, speeds = [follower.position.copy()], [follower.quaternion.copy()], [0.0]
    for step in range(700):
        if step % 40 == 0 and step // 40 < len(goals):
            assert planner.set_goal(*goals[step // 40]).ok
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert plan.verdict.ok, plan.verdict
        follower.accept(plan.reference)
        follower.advance(PERIOD)
        positions.append(follower.position.copy())
        quaternions.append(follower.quaternion.copy())
        speeds.append(follower.speed)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    assert steps.max() <= planner.settings.speed * PERIOD * 1.05
    assert angle_between(np.array(quaternions[1:]), np.array(quaternions[:-1])).max() < 0.02
    assert np.abs(np.diff(speeds)).max() <= 2.0 * limit
    assert min(speeds[60:200]) > 0.5 * planner.settings.speed
    np.testing.assert_allclose(follower.position, goals[-1][0], atol=1e-5)


def test_a_new_goal_without_a_way_brings_the_moving_arm_to_rest(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(start[:3], start[3:])
    assert planner.set_goal(goal[:3], goal[3:]).ok
    for _ in range(100):
        follower.accept(planner.tick(follower.position, follower.quaternion, follower.speed).reference)
        follower.advance(PERIOD)
    assert follower.speed > 0.8 * planner.settings.speed
    assert planner.set_goal(start[:3], start[3:]).ok
    planner.set_obstacles(start[None, :3], [0.03])
    braking = int(2.0 * planner.settings.speed / planner.settings.acceleration / PERIOD)
    for _ in range(braking):
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        if follower.speed == 0.0:
            break
        assert plan.reference is not None, f"no ramp at {follower.speed} m/s"
        follower.accept(plan.reference)
        follower.advance(PERIOD)
    assert follower.speed == 0.0


@pytest.fixture(scope="module")
def bent(stored) -> tuple[Skill, np.ndarray]:
    """A skill of arcs around a corner, whose inside is shorter, and the mean of what was shown (m, 3)."""
    from geodesic_motion_ros.demonstrations.demonstrations import Demonstration
    from geodesic_motion_ros.manifold.training import TrainingSettings, train_task_space_skill

    s = np.linspace(0.0, 0.5 * np.pi, 120)
    items = []
    for number, radius in enumerate(np.linspace(0.18, 0.32, 7)):
        # Arcs between common ends that bulge out differently far.
        arc = np.stack([0.25 * np.cos(s), 0.25 * np.sin(s), 0.0 * s], axis=1)
        out = (radius - 0.25) * np.sin(2.0 * s)[:, None] * np.stack([np.cos(s), np.sin(s), 0.0 * s], axis=1)
        down = np.tile([0.0, 1.0, 0.0, 0.0], (len(s), 1))
        items.append(Demonstration(arc + out + [0.25, -0.1, 0.35], down, 0.03 * np.arange(120), f"arc {number}"))
    shown = Demonstrations(tuple(items))
    settings = TrainingSettings(
        steps=800, hidden=(64, 32), samples=100, kernels=100, precision_samples=2, precision_iterations=60
    )
    skill = stored("arcs", lambda: train_task_space_skill(shown, settings, name="arcs"))
    return skill, canonical_form(shown, 200, 0.1).positions.mean(axis=0)


def test_the_ridge_keeps_the_geodesic_at_the_mean_where_the_plain_metric_cuts_the_corner(bent):
    skill, mean = bent
    along = gap_to(mean, mean_plan(ReactivePlanner(skill)).reference.positions)
    plain = gap_to(mean, mean_plan(ReactivePlanner(skill, PlannerSettings(ridge_strength=0.0))).reference.positions)
    assert along < 0.01
    assert plain > 2.0 * along


def test_without_an_obstacle_the_geodesic_follows_the_mean_of_the_fan(planner):
    sheet = planner.skill.canonical
    mean = sheet.positions.mean(axis=0)
    # The fan's rims are 120 mm away.
    assert gap_to(mean, mean_plan(planner).reference.positions) < 0.02


def test_conditioning_changes_the_way_only_where_the_skill_regresses(canonical_fan_skill, planner):
    start, goal = shown_ends(planner.skill, 3)
    free = planner.plan(*start, *goal).reference.positions
    without = ReactivePlanner(canonical_fan_skill, PlannerSettings(query_conditioning=False))
    assert not canonical_fan_skill.canonical.regresses
    np.testing.assert_array_equal(without.plan(*start, *goal).reference.positions, free)
    regressing = replace(canonical_fan_skill, canonical=replace(canonical_fan_skill.canonical, penalty=0.3))
    conditioned = ReactivePlanner(regressing).plan(*start, *goal)
    assert conditioned.verdict.ok, conditioned.verdict
    assert conditioned.verdict.end_correction < 0.002
    assert not np.array_equal(conditioned.reference.positions, free)
    np.testing.assert_allclose(conditioned.reference.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)


def test_a_single_demonstration_is_a_skill_that_can_be_carried(stored, varying_fan):
    from geodesic_motion_ros.manifold.training import TrainingSettings, train_task_space_skill

    settings = TrainingSettings(
        steps=800, hidden=(64, 32), samples=100, kernels=60, precision_samples=2, precision_iterations=40
    )
    one = Demonstrations((varying_fan[3],))
    skill = stored("single", lambda: train_task_space_skill(one, settings, name="single"))
    assert skill.ridges is None
    assert not skill.canonical.regresses
    planner = ReactivePlanner(skill)
    offset = np.array([0.02, -0.01, 0.02, 0.05, 0.0, -0.1])
    start, goal = displaced(skill.start_pose, offset), displaced(skill.goal_pose, -offset)
    plan = planner.plan(*start, *goal)
    assert plan.verdict.ok, plan.verdict
    assert plan.verdict.end_correction < 0.002
    assert plan.verdict.goal_beyond == pytest.approx(np.linalg.norm(offset[:3]), abs=1e-6)
    np.testing.assert_allclose(plan.reference.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)
    assert gap_to(varying_fan[3].positions, mean_plan(planner).reference.positions) < 0.02
