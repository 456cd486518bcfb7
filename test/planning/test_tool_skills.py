"""Skills of tool poses, for the whole arm: nodes, paths, goals, frames, and the planner's promises on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.pose_query import PoseQueryBuilder
from geodesic_motion_ros.queries.query import Query
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

SKILL = Skill.load("panda_pouring")
START, GOAL = (Pose(pose[:3], pose[3:]) for pose in (SKILL.start_pose, SKILL.goal_pose))
HOME = TaskFrame.identity()
TICK = 0.01


@pytest.fixture(scope="module")
def planner() -> ReactivePlanner:
    return ReactivePlanner(SKILL)


@pytest.fixture(scope="module")
def builder(planner: ReactivePlanner) -> PoseQueryBuilder:
    return PoseQueryBuilder(SKILL, planner.graph, PlannerSettings(), planner.robot, planner.collision)


@pytest.fixture(scope="module")
def query(builder: PoseQueryBuilder) -> Query:
    return built(builder)


def built(builder: PoseQueryBuilder, frame: TaskFrame = HOME) -> Query:
    """Between the skill's own ends, which move with a frame."""
    start, goal = (Pose(*frame.to_base(end.position, end.quaternion)) for end in (START, GOAL))
    found = builder.build(builder.start_by_pose(start), builder.goal_by_pose(goal, frame))
    assert isinstance(found, Query)
    return found


def tool(robot: Robot, configurations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return end_effector_poses(np.ascontiguousarray(configurations), robot.chain)


def test_a_node_s_spheres_are_those_of_an_arm_that_holds_its_pose(builder, query, planner) -> None:
    """The hand's spheres tell its pose; the arm can follow the base path, and only then may edges be used."""
    hand = np.array(planner.collision.points.names)[planner.collision.moving] == "panda_hand"
    usable = np.unique(query.decoded.edges[np.isfinite(query.graph.base)])
    assert len(usable) > 0.95 * len(query.graph.positions)
    start = planner.collision.positions(planner.robot, query.start[None])[0][planner.collision.moving][hand]
    apart = np.linalg.norm(start - planner.robot.forward(query.start)[0], axis=1)
    for node in usable[::97]:
        there = np.linalg.norm(query.body.spheres[node, hand] - query.graph.positions[node], axis=1)
        np.testing.assert_allclose(there, apart, atol=1e-4)


def test_the_goal_is_the_requested_pose(query, planner) -> None:
    position, quaternion = planner.robot.forward(query.goal)
    np.testing.assert_allclose(position, GOAL.position, atol=1e-6)
    assert angle_between(quaternion, GOAL.quaternion) < 1e-6


def test_paths_are_followed_near_the_start_they_go_on_from(query, planner) -> None:
    latent = np.linspace(query.start_latent, query.decoded.latent[query.goal_node], 80)
    path = query.configurations_along(latent, query.start)
    assert not isinstance(path, Refusal)
    assert np.max(np.abs(np.diff(path, axis=0))) < 0.2
    np.testing.assert_allclose(path[0], query.start, atol=0.02)


def test_a_frame_moves_all_configurations_tools_with_it(builder, planner) -> None:
    frame = TaskFrame(np.array([0.02, -0.01, 0.03]), np.array([0.999, 0.0, 0.0, 0.0447101778]))
    here, there = built(builder), built(builder, frame)
    latent = here.decoded.latent[:: len(here.decoded.latent) // 20]
    for query, place in ((here, HOME), (there, frame)):
        nodes = query.graph.body_points[:, 0]
        np.testing.assert_allclose(query.body.points[:, 0], place.points_to_base(nodes), atol=1e-12)
    assert len(latent) > 10


def test_another_posture_holds_the_same_poses_and_there_are_not_more_than_five(builder, query, planner) -> None:
    seen, other = [query], builder.other_posture(query)
    while other is not None:
        seen.append(other)
        np.testing.assert_allclose(planner.robot.forward(other.goal)[0], GOAL.position, atol=1e-6)
        other = builder.other_posture(other)
    assert 2 <= len(seen) <= 5
    assert np.max(np.abs(seen[1].goal - seen[0].goal)) > 0.1
    assert builder.first_posture(seen[-1]).lift.swivel == 0


def test_a_query_in_the_first_posture_that_serves_is_that_of_its_first_posture(builder, monkeypatch) -> None:
    """Where the first swivel cannot be held too: what has been tried on a query is known of that object alone."""
    query = built(builder)
    assert builder.first_posture(query) is query
    other = builder.other_posture(query)
    assert other.lift.swivel > 0
    assert builder.first_posture(other).lift.swivel == 0
    monkeypatch.setattr("geodesic_motion_ros.contract.settings.SWIVELS", (9.0, 0.0))
    second = built(builder)
    assert second.lift.swivel == 1
    assert builder.first_posture(second) is second


def test_a_start_from_which_the_path_cannot_be_followed_is_refused_with_place_and_reason(builder, planner) -> None:
    """The hand is turned as far as its joint goes; the demonstrated path turns it farther."""
    goal, robot = builder.goal_by_pose(GOAL, HOME), planner.robot
    free = builder.start_by_pose(START)
    found = [builder.build(robot.checked(np.where(np.arange(7) == 6, limit, free)), goal) for limit in (2.85, -2.85)]
    assert all(isinstance(one, Refusal) for one in found)
    assert {one.code for one in found} <= {VerdictCode.START_OUT_OF_SUPPORT, VerdictCode.NO_FEASIBLE_PATH}


def stand_at_the_start(planner: ReactivePlanner) -> None:
    """At rest there, with the goal given and no obstacle."""
    planner.take_obstacles(Obstacles.none())
    planner.clear_goal()
    start = planner.plan(START.position, START.quaternion, GOAL.position, GOAL.quaternion).reference.positions[0]
    planner.stand_at(start, 0.0)
    assert planner.set_goal(GOAL.position, GOAL.quaternion).ok


def played(planner: ReactivePlanner, obstacles: Obstacles, seconds: float = 12.0) -> np.ndarray:
    """Commanded configurations (n, 7), from the skill's start to its goal."""
    stand_at_the_start(planner)
    assert planner.take_obstacles(obstacles).ok
    commanded = []
    for number in range(int(seconds / TICK)):
        planner.tick(number * TICK)
        commanded.append(planner.commanded_state((number + 1) * TICK)[0])
    return np.array(commanded)


def nearest(planner: ReactivePlanner, spheres: CollisionModel, path: np.ndarray, obstacles: Obstacles) -> float:
    return min(obstacle_clearance(spheres, planner.robot, q, obstacles)[0] for q in path[::4])


def test_the_stream_ends_exactly_at_the_goal_and_twice_alike(planner) -> None:
    first, again = (played(planner, Obstacles.none(), 8.0) for _ in range(2))
    position, quaternion = planner.robot.forward(first[-1])
    np.testing.assert_allclose(position, GOAL.position, atol=1e-6)
    assert angle_between(quaternion, GOAL.quaternion) < 1e-6
    np.testing.assert_array_equal(first, again)


def test_a_sphere_on_the_elbow_s_path_is_not_touched_and_the_tool_alone_would_let_it_be(planner) -> None:
    undisturbed, model = played(planner, Obstacles.none(), 8.0), CollisionModel.named("panda")
    middle = undisturbed[len(undisturbed) // 3]
    sphere = Obstacles.of_spheres(elbow_position(planner.robot, middle)[None], np.array([0.04]))
    assert nearest(planner, model.of_link("panda_hand"), undisturbed, sphere) > 0.05
    blind = ReactivePlanner(SKILL, replace(planner.settings, avoid="tool"))
    assert nearest(planner, model, played(blind, sphere), sphere) < 0.0
    arm = played(planner, sphere)
    if nearest(planner, model, arm[:1], sphere) > 0.0:
        assert nearest(planner, model, arm, sphere) > 0.0
    else:
        np.testing.assert_array_equal(arm[0], arm[-1])


@pytest.mark.parametrize(
    ("start", "end", "speed", "leaves"),
    [
        ([0.471, -0.561, 0.391], [0.430, -0.220, 0.337], 0.093, -1.45),
        ([0.616, -0.479, 0.334], [0.424, -0.179, 0.340], 0.126, -0.28),
    ],
)
def test_an_arm_that_was_stopped_goes_on_where_its_goal_would_be_reached_if_sent_again(
    planner, start, end, speed, leaves
) -> None:
    """A sphere crosses and comes to rest beside the arm: the paths of the query that it began with are blocked there,
    those of one from where it stands are not.
    """
    obstacle = LineObstacle(start, end, speed, 0.035, leaves)
    line = np.subtract(end, start)
    velocity, halts = speed * line / np.linalg.norm(line), leaves + np.linalg.norm(line) / speed
    stand_at_the_start(planner)
    codes = []
    for number in range(1000):
        now = number * TICK
        moving = float(leaves <= now < halts) * velocity
        planner.set_obstacles(obstacle.position(now)[None], np.array([obstacle.radius]), moving[None], now)
        codes.append(planner.tick(now).verdict.code)
    assert VerdictCode.NO_FEASIBLE_PATH in codes
    if codes[-1] is not VerdictCode.OK:
        planner.stand_at(planner.commanded_state(now)[0], now)
        assert planner.set_goal(GOAL.position, GOAL.quaternion).ok
        assert planner.tick(now).verdict.code is VerdictCode.NO_FEASIBLE_PATH


@pytest.mark.parametrize("deadline", [NEVER, Deadline(-np.inf)], ids=["enough time", "no time"])
def test_an_arm_at_rest_tries_its_other_postures_however_little_time_a_tick_has(planner, deadline) -> None:
    """In the first posture a sphere above the upper arm blocks every path; a tick may be too short for one search."""
    stand_at_the_start(planner)
    planner.take_obstacles(Obstacles.of_spheres(np.array([[-0.09, -0.065, 0.65]]), np.array([0.038])))
    ticks = (planner.tick(number * TICK, deadline) for number in range(60))
    codes = [plan.verdict.code for plan in ticks]
    assert codes[0] is not VerdictCode.OK
    assert VerdictCode.OK in codes


def test_the_tool_s_spheres_stay_clear_where_only_they_avoid(planner) -> None:
    undisturbed = played(planner, Obstacles.none(), 8.0)
    blind = ReactivePlanner(SKILL, replace(planner.settings, avoid="tool"))
    place = planner.robot.forward(undisturbed[len(undisturbed) // 2])[0] + [0.0, 0.0, -0.05]
    sphere = Obstacles.of_spheres(place[None], np.array([0.02]))
    tool_spheres = blind.collision
    assert nearest(planner, tool_spheres, undisturbed, sphere) < 0.0
    assert nearest(planner, tool_spheres, played(blind, sphere), sphere) > 0.0


@pytest.mark.parametrize(
    ("position", "quaternion", "code"),
    [
        ([np.nan, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], VerdictCode.BAD_INPUT),
        ([0.4, 0.0, 0.4], [0.0, 0.0, 0.0, 0.0], VerdictCode.BAD_INPUT),
        ([3.0, 0.0, 0.4], [1.0, 0.0, 0.0, 0.0], VerdictCode.GOAL_OUT_OF_SUPPORT),
        ([0.3, 0.5, 0.4], [1.0, 0.0, 0.0, 0.0], VerdictCode.GOAL_OUT_OF_SUPPORT),
    ],
)
def test_goals_that_are_none_are_refused(planner, position, quaternion, code) -> None:
    assert planner.set_goal(np.array(position), np.array(quaternion)).code is code


def test_a_plan_has_the_poses_of_the_tool() -> None:
    planner = ReactivePlanner(SKILL)
    plan = planner.plan(START.position, START.quaternion, GOAL.position, GOAL.quaternion)
    positions, quaternions = plan.tool_poses
    assert positions.shape == (len(plan.reference.times), 3)
    for i in (0, len(positions) // 2, -1):
        pose = Pose(*planner.robot.forward(plan.reference.positions[i]))
        np.testing.assert_allclose(positions[i], pose.position, atol=1e-12)
        assert abs(quaternions[i] @ pose.quaternion) == pytest.approx(1.0)
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.0)
    assert planner.tick(0.0).tool_poses is None
