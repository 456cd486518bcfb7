"""What is planned: ends, obstacles, what is refused; scenes come with a control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.deadline import Deadline
from geodesic_motion_ros.distance_field import DistanceField
from geodesic_motion_ros.errors import PlanningError
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner import Plan, PlannerSettings
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.solids import solid_distances, solid_rows
from geodesic_motion_ros.verdict import Verdict, VerdictCode

NOTHING = (np.empty((0, 3)), np.empty(0))


def test_a_plan_meets_both_ends_and_the_skill(planner):
    plan = planner.nominal()
    assert plan.verdict.ok
    reference, start, goal = plan.reference, planner.skill.start_pose, planner.skill.goal_pose
    np.testing.assert_allclose(reference.positions[[0, -1]], [start[:3], goal[:3]], atol=1e-9)
    assert angle_between(reference.quaternions[[0, -1]], np.stack([start[3:], goal[3:]])).max() < 1e-6
    # The middle of the fan is a straight line, its rims bulge out by 120 mm.
    line = start[:3] + np.linspace(0, 1, 50)[:, None] * (goal[:3] - start[:3])
    gaps = np.linalg.norm(reference.positions[:, None] - line, axis=-1).min(axis=1)
    assert gaps.max() < 0.04


def test_unseen_ends_are_met_exactly(planner):
    start, goal = planner.skill.start_pose.copy(), planner.skill.goal_pose.copy()
    start[:3] += [0.02, -0.01, 0.015]
    goal[:3] += [-0.02, 0.02, 0.01]
    plan = planner.plan(start[:3], start[3:], goal[:3], -goal[3:])
    np.testing.assert_allclose(plan.reference.positions[[0, -1]], [start[:3], goal[:3]], atol=1e-9)
    assert np.all(np.sum(plan.reference.quaternions[1:] * plan.reference.quaternions[:-1], axis=1) > 0.9)


@pytest.mark.parametrize("seed", range(25))
def test_a_sphere_on_the_path_is_hit_without_avoidance_and_not_with_it(another, planner, seed):
    random = np.random.default_rng(seed)
    direct = planner.nominal().reference.positions
    centre = direct[random.integers(len(direct) // 4, 3 * len(direct) // 4)] + random.normal(scale=0.01, size=3)
    radius = random.uniform(0.01, 0.03)
    blind = another(PlannerSettings(avoidance=False)) if seed == 0 else None
    planner.set_obstacles([centre], [radius])
    if blind is not None:
        blind.set_obstacles([centre], [radius])
        assert blind.nominal().verdict.clearance < 0.0
    assert np.linalg.norm(direct - centre, axis=1).min() < radius + 0.04
    plan = planner.nominal()
    assert plan.verdict.ok
    assert plan.verdict.clearance > 0.0
    dense = np.array([plan.reference.sample(t)[0] for t in np.linspace(0, plan.reference.duration, 3000)])
    assert np.linalg.norm(dense - centre, axis=1).min() - radius - 0.04 >= plan.verdict.clearance - 1e-9


@pytest.mark.parametrize("kind", ["box", "capsule", "cloud"])
def test_obstacles_of_every_kind_are_hit_without_avoidance_and_passed_with_it(another, planner, kind):
    direct = planner.nominal().reference.positions
    centre = direct[len(direct) // 2] + [0.0, 0.0, 0.01]
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
    assert blind.nominal().verdict.clearance < 0.0
    assert planner.take_obstacles(obstacles).ok
    plan = planner.nominal()
    assert plan.verdict.ok
    assert plan.verdict.clearance > 0.0
    dense = np.array([plan.reference.sample(t)[0] for t in np.linspace(0, plan.reference.duration, 3000)])
    if kind == "cloud":
        gaps = cKDTree(seen).query(dense)[0] - 0.005 - 0.04
    else:
        gaps = solid_distances(dense, obstacles.solids) - 0.04
    assert gaps.min() >= plan.verdict.clearance - 1e-9


def test_a_bad_solid_is_refused_and_the_old_obstacles_stay(planner):
    planner.set_obstacles([planner.middle()], [0.17])
    flat = solid_rows(np.zeros((1, 3)), np.eye(3)[None], np.array([[0.1, 0.1, 0.0]]), np.zeros(1))
    verdict = planner.take_obstacles(replace(Obstacles.none(), solids=flat, solid_velocities=np.zeros((1, 3))))
    assert verdict.code is VerdictCode.BAD_INPUT
    assert "solid 0" in verdict.reason
    assert planner.nominal().reference is None


def test_the_plan_with_an_obstacle_is_never_cheaper_than_without(planner):
    direct = planner.nominal().reference
    planner.set_obstacles([direct.positions[len(direct.positions) // 2]], [0.03])
    detour = planner.nominal().reference
    assert detour.duration > direct.duration


def test_a_far_obstacle_changes_nothing_and_one_that_left_leaves_no_trace(planner):
    before = planner.nominal().reference
    planner.set_obstacles([[0.5, 0.0, 2.0]], [0.1])
    np.testing.assert_array_equal(planner.nominal().reference.positions, before.positions)
    planner.set_obstacles([before.positions[len(before.positions) // 2]], [0.03])
    assert not np.array_equal(planner.nominal().reference.positions, before.positions)
    planner.set_obstacles(*NOTHING)
    after = planner.nominal().reference
    np.testing.assert_array_equal(after.positions, before.positions)
    np.testing.assert_array_equal(after.times, before.times)


def test_a_wall_leaves_no_path_and_says_so(planner):
    centre = planner.middle()
    planner.set_obstacles([centre], [0.17])
    plan = planner.nominal()
    assert plan.reference is None
    assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "block" in plan.verdict.reason


@pytest.mark.parametrize(
    ("end", "code", "words"),
    [("start_pose", VerdictCode.IN_COLLISION, "overlaps"), ("goal_pose", VerdictCode.NO_FEASIBLE_PATH, "goal")],
)
def test_an_obstacle_on_an_end_is_named(planner, end, code, words):
    planner.set_obstacles([getattr(planner.skill, end)[:3]], [0.03])
    plan = planner.nominal()
    assert plan.reference is None
    assert plan.verdict.code is code
    assert words in plan.verdict.reason


def test_out_of_time_no_further_attempt_is_made(planner, monkeypatch):
    """A first attempt that fails is followed by another, but for the deadline."""
    certified, refused = planner._solver._certified, []

    def picky(*arguments):
        if not refused:
            refused.append(arguments)
            return Plan(None, Verdict(VerdictCode.NO_FEASIBLE_PATH, "not this one"))
        return certified(*arguments)

    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    monkeypatch.setattr(planner._solver, "_certified", picky)
    plan = planner.tick(start[:3], start[3:], 0.0, Deadline(-np.inf))
    assert plan.verdict.code is VerdictCode.DEADLINE_MISSED
    assert plan.verdict.reason == "out of time: not this one"
    assert plan.reference is None
    refused.clear()
    assert planner.tick(start[:3], start[3:], 0.0, Deadline(np.inf)).verdict.ok


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
def test_bad_poses_are_refused_with_the_reason_and_change_nothing(planner, position, quaternion, words):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    for verdict in (
        planner.set_goal(np.array(position), np.array(quaternion)),
        planner.tick(np.array(position), np.array(quaternion)).verdict,
        planner.plan(start[:3], start[3:], np.array(position), np.array(quaternion)).verdict,
    ):
        assert verdict.code is VerdictCode.BAD_INPUT
        assert words in verdict.reason
    assert planner.tick(start[:3], start[3:]).verdict.ok


def test_a_goal_far_from_the_demonstrations_is_refused_with_its_distance(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    verdict = planner.set_goal(goal[:3] + [0.0, 0.3, 0.0], goal[3:])
    assert verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert verdict.goal_offset > 0.2
    assert "maximum_offset" in verdict.reason
    np.testing.assert_allclose(planner.tick(start[:3], start[3:]).reference.positions[-1], goal[:3], atol=1e-9)


def test_a_start_far_from_the_demonstrations_is_refused(planner):
    goal = planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    plan = planner.tick(goal[:3] + [0.0, 0.0, 0.5], goal[3:])
    assert plan.verdict.code is VerdictCode.START_OUT_OF_SUPPORT


def test_without_a_goal_there_is_no_reference(planner):
    start = planner.skill.start_pose
    plan = planner.tick(start[:3], start[3:])
    assert plan.reference is None
    assert plan.verdict.code is VerdictCode.NO_GOAL


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
    centre = planner.middle()
    planner.set_obstacles([centre], [0.17])
    verdict = planner.set_obstacles(centres, radii)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert words in verdict.reason
    assert planner.nominal().reference is None


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"tool_radii": (0.1, 0.1)}, "one radius per point"),
        ({"tool_radii": (-0.1,)}, "negative"),
        ({"tool_radii": (np.nan,)}, "finite"),
        ({"speed": 0.0}, "speed"),
        ({"speed": -1}, "speed"),
        ({"obstacle_margin": -1}, "finite and 0 or positive"),
        ({"ambient_strength": np.nan}, "ambient_strength"),
        ({"ambient_law": "soft"}, "one of gaussian, completed, hard"),
        ({"tool_points": ((0.0, 0.0),)}, "triples"),
    ],
)
def test_impossible_settings_are_named(settings, words):
    with pytest.raises(PlanningError, match=words):
        PlannerSettings(**settings)
