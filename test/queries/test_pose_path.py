"""Paths of tool poses: ends, obstacles, refusals; scenes come with a control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.curves import arc_length
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.geometry.shapes import solid_distances, solid_rows
from geodesic_motion_ros.manifold.ambient_metric import obstacle_clearances
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.queries.query import Query
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import PlanningError

NOTHING = (np.empty((0, 3)), np.empty(0))
TOOL_RADIUS = 0.04


def test_a_path_meets_both_ends_and_the_skill(planner):
    path, start, goal = planner.nominal(), planner.skill.start_pose, planner.skill.goal_pose
    np.testing.assert_allclose(path.positions[[0, -1]], [start[:3], goal[:3]], atol=1e-9)
    assert angle_between(path.quaternions[[0, -1]], np.stack([start[3:], goal[3:]])).max() < 1e-6
    assert len(path.positions) == len(path.quaternions) == len(path.latent)
    # The middle of the fan is a straight line, its rims bulge out by 120 mm.
    line = start[:3] + np.linspace(0, 1, 50)[:, None] * (goal[:3] - start[:3])
    gaps = np.linalg.norm(path.positions[:, None] - line, axis=-1).min(axis=1)
    assert gaps.max() < 0.04


def test_unseen_ends_are_met_exactly_in_one_hemisphere(planner):
    start, goal = planner.skill.start_pose.copy(), planner.skill.goal_pose.copy()
    start[:3] += [0.02, -0.01, 0.015]
    goal[:3] += [-0.02, 0.02, 0.01]
    path = planner.plan(start[:3], start[3:], goal[:3], -goal[3:])
    np.testing.assert_allclose(path.positions[[0, -1]], [start[:3], goal[:3]], atol=1e-9)
    assert np.all(np.sum(path.quaternions[1:] * path.quaternions[:-1], axis=1) > 0.9)


def test_a_start_at_the_goal_is_a_path_that_stays_there(planner):
    goal = planner.skill.goal_pose
    path = planner.plan(goal[:3], goal[3:], goal[:3], goal[3:])
    assert isinstance(path, PosePath), path
    np.testing.assert_allclose(path.resample(50).positions, np.tile(goal[:3], (50, 1)), atol=1e-9)


def test_two_planners_answer_with_the_same_bytes(another, planner):
    sphere = [planner.middle()], [0.03]
    paths = []
    for each in (planner, another()):
        each.set_obstacles(*sphere)
        paths.append(each.nominal())
    for name in ("positions", "quaternions", "latent"):
        assert getattr(paths[0], name).tobytes() == getattr(paths[1], name).tobytes()
    assert paths[0].figures == paths[1].figures


@pytest.mark.parametrize("seed", range(10))
def test_a_sphere_on_the_path_is_hit_without_avoidance_and_not_with_it(another, planner, seed):
    random = np.random.default_rng(seed)
    direct = planner.nominal().positions
    centre = direct[random.integers(len(direct) // 4, 3 * len(direct) // 4)] + random.normal(scale=0.01, size=3)
    radius = random.uniform(0.01, 0.03)
    if seed == 0:
        blind = another(PlannerSettings(avoidance=False))
        blind.set_obstacles([centre], [radius])
        assert blind.nominal().figures.clearance < 0.0
    assert np.linalg.norm(direct - centre, axis=1).min() < radius + TOOL_RADIUS
    planner.set_obstacles([centre], [radius])
    path = planner.nominal()
    assert path.figures.clearance > 0.0
    dense = path.resample(3000).positions
    assert np.linalg.norm(dense - centre, axis=1).min() - radius - TOOL_RADIUS >= path.figures.clearance - 1e-9


@pytest.mark.parametrize("kind", ["box", "capsule", "cloud"])
def test_obstacles_of_every_kind_are_hit_without_avoidance_and_passed_with_it(another, planner, kind):
    centre = planner.middle() + [0.0, 0.0, 0.01]
    turn = Rotation.from_rotvec([0.3, 0.2, 0.8]).as_matrix()
    extents, radius = {"box": ([0.03, 0.02, 0.01], 0.0), "capsule": ([0.0, 0.0, 0.03], 0.015)}.get(kind, (None, None))
    if kind == "cloud":
        seen = centre + np.random.default_rng(0).uniform(-0.015, 0.015, (200, 3))
        obstacles = replace(Obstacles.none(), cloud=DistanceField.of(seen, 0.005, 0.005, 0.02))
    else:
        row = solid_rows(centre[None], turn[None], np.array([extents]), np.array([radius]))
        obstacles = replace(Obstacles.none(), solids=row, solid_velocities=np.zeros((1, 3)))
    blind = another(PlannerSettings(avoidance=False))
    assert blind.take_obstacles(obstacles).ok
    assert blind.nominal().figures.clearance < 0.0
    assert planner.take_obstacles(obstacles).ok
    path = planner.nominal()
    assert path.figures.clearance > 0.0
    dense = path.resample(3000).positions
    if kind == "cloud":
        gaps = cKDTree(seen).query(dense)[0] - 0.005 - TOOL_RADIUS
    else:
        gaps = solid_distances(dense, obstacles.solids) - TOOL_RADIUS
    assert gaps.min() >= path.figures.clearance - 1e-9


def test_every_sphere_of_the_tool_keeps_the_clearance(another, planner):
    """The sphere lies under the flange, where a tool with one sphere at its origin does not meet it."""
    far = another(PlannerSettings(tool_points=((0.0, 0.0, 0.0), (0.0, 0.0, 0.12)), tool_radii=(0.03, 0.02)))
    points, radii = np.array(far.settings.tool_points), np.array(far.settings.tool_radii)
    direct = planner.nominal()
    half = len(direct.positions) // 2
    below = tool_points(direct.positions[half, None], direct.quaternions[half, None], points)[0, 1]
    sphere = Obstacles.of_spheres(below[None], np.array([0.02]))

    def gap(path: PosePath) -> float:
        even = path.resample(2000)
        body = tool_points(even.positions, even.quaternions, points)
        return float(obstacle_clearances(body, radii, sphere, np.inf).min())

    assert gap(direct) < 0.0
    far.take_obstacles(sphere)
    path = far.nominal()
    assert 0.0 < path.figures.clearance <= gap(path) + 1e-9


def test_an_obstacle_that_moves_counts_where_it_is(planner):
    centre = planner.middle()
    planner.set_obstacles([centre], [0.03])
    standing = planner.nominal()
    moving = Obstacles.of_spheres(centre[None], np.array([0.03]), np.array([[0.0, 0.0, 1.0]]), 7.0)
    planner.take_obstacles(moving)
    np.testing.assert_array_equal(planner.nominal().positions, standing.positions)


def test_a_path_around_an_obstacle_is_longer(planner):
    direct = planner.nominal()
    planner.set_obstacles([planner.middle()], [0.03])
    assert arc_length(planner.nominal().positions)[-1] > arc_length(direct.positions)[-1]


def test_a_far_obstacle_changes_nothing_and_one_that_left_leaves_no_trace(planner):
    before = planner.nominal().positions
    planner.set_obstacles([[0.5, 0.0, 2.0]], [0.1])
    np.testing.assert_array_equal(planner.nominal().positions, before)
    planner.set_obstacles([before[len(before) // 2]], [0.03])
    assert not np.array_equal(planner.nominal().positions, before)
    planner.set_obstacles(*NOTHING)
    np.testing.assert_array_equal(planner.nominal().positions, before)
    assert planner.nominal().figures.clearance == np.inf


def test_a_wall_leaves_no_path_and_says_so(planner):
    planner.set_obstacles([planner.middle()], [0.17])
    verdict = planner.refusal()
    assert verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "block" in verdict.reason


@pytest.mark.parametrize(
    ("end", "code", "words"),
    [("start_pose", VerdictCode.IN_COLLISION, "overlaps"), ("goal_pose", VerdictCode.NO_FEASIBLE_PATH, "goal")],
)
def test_an_obstacle_on_an_end_is_named(another, planner, end, code, words):
    sphere = [getattr(planner.skill, end)[:3]], [0.03]
    planner.set_obstacles(*sphere)
    verdict = planner.refusal()
    assert verdict.code is code
    assert words in verdict.reason
    assert verdict.figures.goal_offset < 0.05
    blind = another(PlannerSettings(avoidance=False))
    blind.set_obstacles(*sphere)
    assert blind.nominal().figures.clearance < 0.0


@pytest.mark.parametrize(
    ("position", "quaternion", "words"),
    [
        ([np.nan, 0, 0], [1, 0, 0, 0], "finite"),
        ([0.4, 0, np.inf], [1, 0, 0, 0], "finite"),
        ([0.4, 0, 1e200], [1, 0, 0, 0], "at most 1000"),
        ([0.4, 0, 0.3], [1e160, 0, 0, 0], "at most 1000"),
        ([0.4, 0, 0.3], [0, 0, 0, 0], "zero"),
        ([0.4, 0], [1, 0, 0, 0], "expected"),
    ],
)
def test_bad_poses_are_refused_with_the_reason(planner, position, quaternion, words):
    start, goal = np.split(planner.skill.start_pose, [3]), np.split(planner.skill.goal_pose, [3])
    for end, ends in (("start", (position, quaternion, *goal)), ("goal", (*start, position, quaternion))):
        for verdict in (planner.plan(*ends), planner.query(*ends)):
            assert isinstance(verdict, Refusal)
            assert verdict.code is VerdictCode.BAD_INPUT
            assert verdict.reason.startswith(end)
            assert words in verdict.reason


def test_a_goal_far_from_the_demonstrations_is_refused_with_its_distance(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    verdict = planner.plan(start[:3], start[3:], goal[:3] + [0.0, 0.3, 0.0], goal[3:])
    assert verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert verdict.figures.goal_offset > 0.2
    assert "maximum_offset" in verdict.reason


def test_a_start_far_from_the_demonstrations_is_refused_with_its_distance(planner):
    goal = planner.skill.goal_pose
    verdict = planner.plan(goal[:3] + [0.0, 0.0, 0.5], goal[3:], goal[:3], goal[3:])
    assert verdict.code is VerdictCode.START_OUT_OF_SUPPORT
    assert verdict.figures.start_offset > 0.2


def test_no_robot_has_to_reach_the_poses(canonical_fan_skill):
    planner = PosePathPlanner(canonical_fan_skill, PlannerSettings(maximum_offset=10.0))
    start, goal = canonical_fan_skill.start_pose, canonical_fan_skill.goal_pose
    away = np.array([3.0, 0.0, 0.0])
    path = planner.plan(start[:3] + away, start[3:], goal[:3] + away, goal[3:])
    assert isinstance(path, PosePath), path
    robot = Robot.named(canonical_fan_skill.robot)
    assert np.all(np.linalg.norm(path.positions - robot.shoulder, axis=1) > robot.reach)


def test_a_query_is_the_graph_carried_to_both_ends(planner):
    start, goal = planner.skill.start_pose.copy(), planner.skill.goal_pose
    start[:3] += [0.02, -0.01, 0.015]
    query = planner.query(start[:3], start[3:], goal[:3], goal[3:])
    assert isinstance(query, Query)
    np.testing.assert_allclose(query.graph.positions[query.goal_node], goal[:3], atol=1e-9)
    np.testing.assert_array_equal(query.start.position, start[:3])


@pytest.mark.parametrize(
    ("centres", "radii", "words"),
    [
        ([[0, 0, 0], [np.nan, 0, 0]], [0.1, 0.1], "obstacle 1"),
        ([[0, 0, 0]], [0.0], "positive"),
        ([[0, 0, 0]], [-0.1], "positive"),
        ([[0, 0, 0]], [np.inf], "obstacle 0"),
        ([[0, 0, 0]], [0.1, 0.1], "expected (o, 3)"),
        ([[0, 0], [0, 0], [0, 0]], [0.1, 0.1], "expected (o, 3)"),
        ([0, 0, 0], [0.1], "expected (o, 3)"),
    ],
)
def test_bad_obstacles_are_refused_as_a_whole_and_named(planner, centres, radii, words):
    planner.set_obstacles([planner.middle()], [0.17])
    verdict = planner.set_obstacles(centres, radii)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert words in verdict.reason
    assert planner.refusal().code is VerdictCode.NO_FEASIBLE_PATH


def test_a_bad_solid_is_refused_and_the_old_obstacles_stay(planner):
    planner.set_obstacles([planner.middle()], [0.17])
    flat = solid_rows(np.zeros((1, 3)), np.eye(3)[None], np.array([[0.1, 0.1, 0.0]]), np.zeros(1))
    verdict = planner.take_obstacles(replace(Obstacles.none(), solids=flat, solid_velocities=np.zeros((1, 3))))
    assert verdict.code is VerdictCode.BAD_INPUT
    assert "solid 0" in verdict.reason
    assert planner.refusal().code is VerdictCode.NO_FEASIBLE_PATH


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"tool_radii": (0.1, 0.1)}, "one radius per point"),
        ({"tool_radii": (-0.1,)}, "tool radius .m. is -0.1: it must lie between 0 and 1000"),
        ({"tool_radii": (np.nan,)}, "tool radius .m. is nan: it must lie between 0 and 1000"),
        ({"latency": 0.0}, "latency"),
        ({"speed": -1}, "speed"),
        ({"obstacle_margin": -1}, "finite and 0 or positive"),
        ({"ambient_strength": np.nan}, "ambient_strength"),
        ({"ambient_law": "soft"}, "one of gaussian, completed, hard"),
        ({"tool_points": ((0.0, 0.0),)}, r"tool_points has shape \(1, 2\): expected \(K, 3\)"),
    ],
)
def test_impossible_settings_are_named(settings, words):
    with pytest.raises(PlanningError, match=words):
        PlannerSettings(**settings)
