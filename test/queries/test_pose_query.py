"""Queries on a canonical sheet: exact ends for any start and goal that was shown, refusals with numbers, mean paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Figures, VerdictCode
from geodesic_motion_ros.demonstrations.canonical import PoseForm
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.geometry.curves import arc_length
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.quaternions import angle_between, rotate_by
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.queries.pose_query import PoseQueryBuilder
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

NOTHING = (np.empty((0, 3)), np.empty(0))


@pytest.fixture(scope="module")
def shared_planner(canonical_fan_skill) -> PosePathPlanner:
    return PosePathPlanner(canonical_fan_skill)


@pytest.fixture
def planner(shared_planner) -> PosePathPlanner:
    shared_planner.set_obstacles(*NOTHING)
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


def planned(planner: PosePathPlanner, start: tuple, goal: tuple) -> PosePath:
    """The path between two poses, which there must be."""
    path = planner.plan(*start, *goal)
    assert isinstance(path, PosePath), path
    return path


def mean_path(planner: PosePathPlanner) -> PosePath:
    """That between the mean start and the mean goal."""
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    return planned(planner, (start[:3], start[3:]), (goal[:3], goal[3:]))


@pytest.fixture
def queries(planner) -> PoseQueryBuilder:
    arm = Robot.named(planner.skill.robot), CollisionModel.named(planner.skill.robot)
    return PoseQueryBuilder(planner.skill, planner.graph, planner.settings, *arm)


def gap_to(curve: np.ndarray, points: np.ndarray) -> float:
    """Largest distance [m] of points (n, 3) from the samples of a curve (m, 3)."""
    return float(np.linalg.norm(points[:, None] - curve, axis=-1).min(axis=1).max())


@pytest.mark.parametrize("seed", range(20))
def test_shown_starts_and_goals_are_met_exactly_with_hardly_a_correction(planner, seed):
    start, goal = shown_ends(planner.skill, seed)
    path = planned(planner, start, goal)
    figures = path.figures
    assert figures.end_correction < 0.002
    assert figures.in_support
    assert max(figures.start_beyond, figures.goal_beyond) < 1e-6
    np.testing.assert_allclose(path.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)
    assert angle_between(path.quaternions[[0, -1]], np.stack([start[1], goal[1]])).max() < 1e-6


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
def test_a_sphere_on_the_path_of_a_carried_query_is_passed(planner, seed):
    random = np.random.default_rng(seed)
    start, goal = shown_ends(planner.skill, seed)
    direct = planned(planner, start, goal)
    centre = direct.positions[random.integers(len(direct.positions) // 3, 2 * len(direct.positions) // 3)]
    planner.set_obstacles([centre + random.normal(scale=0.005, size=3)], [0.015])
    path = planned(planner, start, goal)
    assert path.figures.clearance > 0.0
    np.testing.assert_allclose(path.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)
    planner.set_obstacles(*NOTHING)
    np.testing.assert_array_equal(planned(planner, start, goal).positions, direct.positions)


def test_the_misfits_have_the_offset_and_its_part_beyond_the_demonstrated(canonical_fan_skill, queries):
    skill, sheet = canonical_fan_skill, canonical_fan_skill.canonical

    def misfits(offset: np.ndarray) -> Figures:
        goal = Pose(*displaced(skill.goal_pose, offset))
        assert queries.goal_refusal([goal]) is None
        return queries.transport(Pose(*np.split(skill.start_pose, [3])), [goal]).misfits

    inside = misfits(0.9 * sheet.goal_offsets[0])
    assert inside.goal_beyond < 1e-6
    assert inside.goal_offset > 0.005
    outside = misfits(np.array([0.0, 0.0, 0.06, 0.0, 0.0, 0.0]))
    assert 0.06 - sheet.goal_offsets[:, 2].max() - 1e-6 <= outside.goal_beyond < 0.05


def test_a_goal_beyond_the_limit_is_refused_with_the_numbers(canonical_fan_skill, queries):
    goal = canonical_fan_skill.goal_pose
    assert queries.goal_refusal([Pose(goal[:3], goal[3:])]) is None
    refused = queries.goal_refusal([Pose(*displaced(goal, np.array([0.0, 0.05, 0.25, 0.0, 0.0, 0.0])))])
    assert refused.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert refused.figures.goal_beyond > 0.1
    for said in (f"{1000 * refused.figures.goal_beyond:.0f} mm", "50 mm", "maximum_offset", "demonstrated"):
        assert said in refused.reason
    turned = queries.goal_refusal([Pose(*displaced(goal, np.array([0.0, 0.0, 0.0, 1.2, 0.0, 0.0])))])
    assert turned.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert turned.figures.goal_beyond_angle > 0.5


def test_a_start_in_the_middle_of_the_task_is_met_too(planner):
    direct = mean_path(planner)
    half = len(direct.positions) // 2
    path = planned(planner, (direct.positions[half], direct.quaternions[half]), direct.goal)
    np.testing.assert_allclose(path.positions[0], direct.positions[half], atol=1e-9)
    assert arc_length(path.positions)[-1] < 0.8 * arc_length(direct.positions)[-1]


@pytest.fixture(scope="module")
def bent(stored) -> tuple[Skill, np.ndarray]:
    """A skill of arcs around a corner, whose inside is shorter, and the mean of what was shown (m, 3)."""
    from geodesic_motion_ros.demonstrations.demonstrations import Demonstration
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.learning.training import train_skill

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
    skill = stored("arcs", lambda: train_skill(shown, settings, name="arcs"))
    return skill, PoseForm(shown, 0.1).sheet(200).positions.mean(axis=0)


def test_the_mean_path_keeps_the_geodesic_at_the_mean_where_the_plain_metric_cuts_the_corner(bent):
    skill, mean = bent
    along = gap_to(mean, mean_path(PosePathPlanner(skill)).positions)
    plain = gap_to(mean, mean_path(PosePathPlanner(skill, PlannerSettings(ridge_strength=0.0))).positions)
    assert along < 0.01
    assert plain > 2.0 * along


def test_without_an_obstacle_the_geodesic_follows_the_mean_of_the_fan(planner):
    sheet = planner.skill.canonical
    mean = sheet.positions.mean(axis=0)
    # The fan's rims are 120 mm away.
    assert gap_to(mean, mean_path(planner).positions) < 0.02


def test_conditioning_changes_the_path_only_where_the_skill_regresses(canonical_fan_skill, planner):
    start, goal = shown_ends(planner.skill, 3)
    free = planned(planner, start, goal).positions
    without = PosePathPlanner(canonical_fan_skill, PlannerSettings(query_conditioning=False))
    assert not canonical_fan_skill.canonical.regresses
    np.testing.assert_array_equal(planned(without, start, goal).positions, free)
    regressing = replace(canonical_fan_skill, canonical=replace(canonical_fan_skill.canonical, penalty=0.3))
    conditioned = planned(PosePathPlanner(regressing), start, goal)
    assert conditioned.figures.end_correction < 0.002
    assert not np.array_equal(conditioned.positions, free)
    np.testing.assert_allclose(conditioned.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)


def test_a_single_demonstration_is_a_skill_that_can_be_carried(stored, varying_fan):
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.learning.training import train_skill

    settings = TrainingSettings(
        steps=800, hidden=(64, 32), samples=100, kernels=60, precision_samples=2, precision_iterations=40
    )
    one = Demonstrations((varying_fan[3],))
    skill = stored("single", lambda: train_skill(one, settings, name="single"))
    assert skill.mean_paths is None
    assert not skill.canonical.regresses
    planner = PosePathPlanner(skill)
    offset = np.array([0.02, -0.01, 0.02, 0.05, 0.0, -0.1])
    start, goal = displaced(skill.start_pose, offset), displaced(skill.goal_pose, -offset)
    path = planned(planner, start, goal)
    assert path.figures.end_correction < 0.002
    assert path.figures.goal_beyond == pytest.approx(np.linalg.norm(offset[:3]), abs=1e-6)
    np.testing.assert_allclose(path.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)
    assert gap_to(varying_fan[3].positions, mean_path(planner).positions) < 0.02
