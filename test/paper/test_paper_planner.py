"""The paper's planner: goals at nodes, paths of fitted splines, spheres only, and searches that go on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.geometry.fitted_spline import fitted_spline
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.paper.literal_search import LiteralSearch
from geodesic_motion_ros.paper.paper_planner import CAUTION, COEFFICIENTS, SAMPLES, PaperPlanner
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.utils.deadline import Deadline


@pytest.fixture
def planner(shared: PaperPlanner) -> PaperPlanner:
    """At the skill's start, among nothing, with a path to the skill's goal."""
    start, goal = (np.split(pose, [3]) for pose in (shared.skill.start_pose, shared.skill.goal_pose))
    shared.set_obstacles(Obstacles.none())
    shared.clear_goal()
    shared.stand_at(np.zeros(7), *start)
    shared.take_goal(shared.prepare_goal(*goal))
    return shared


def sphere_on(planner: PaperPlanner, radius: float = 0.06) -> Obstacles:
    """A sphere around the middle of the path."""
    assert planner.path is not None
    positions, _ = planner.tool_poses(planner.path)
    return Obstacles.of_spheres(positions[len(positions) // 2][None], np.array([radius]))


def test_the_path_is_the_decoded_spline_through_the_cheapest_nodes(planner) -> None:
    verdict = planner.tick()
    assert (verdict.code, verdict.reason, verdict.figures.cost_gap) == (VerdictCode.OK, CAUTION, 0.0)
    assert planner.is_exact
    nodes = planner.graph.latent[planner.search.nodes]
    spline = fitted_spline(nodes, COEFFICIENTS)(np.linspace(0.0, 1.0, SAMPLES))
    np.testing.assert_allclose(planner.path.latent, spline, atol=1e-9 * np.ptp(nodes, axis=0).max())
    if planner.skill.space == "joint":
        positions, _ = end_effector_poses(planner.path.places, planner.robot.chain)
    else:
        positions = planner.path.places[:, :3]
    np.testing.assert_allclose(planner.tool_poses(planner.path)[0], positions, atol=1e-9)
    np.testing.assert_allclose(positions[-1], planner.skill.goal_pose[:3], atol=0.05)


def test_full_speed_is_kept_everywhere_along_the_path(planner) -> None:
    planner.tick()
    path, settings = planner.path, planner.settings
    seconds = np.diff(path.times)
    if planner.skill.space == "joint":
        rates = np.abs(np.diff(path.places, axis=0)) / seconds[:, None] / planner.robot.velocity_limits
        np.testing.assert_allclose(rates.max(axis=1), settings.speed_scale, rtol=1e-6)
    else:
        assert np.all(np.linalg.norm(np.diff(path.places[:, :3], axis=0), axis=1) <= settings.speed * seconds + 1e-9)


def test_an_obstacle_makes_another_path_and_leaves_none_of_it_behind(planner) -> None:
    planner.tick()
    free, cost = planner.search.nodes, planner.search.cost
    planner.set_obstacles(sphere_on(planner))
    assert not planner.is_exact
    verdict = planner.tick()
    assert planner.search.cost > cost
    assert f"energy is {(planner.search.cost / cost) ** 2:.2g} times that of the free path" in verdict.reason
    planner.set_obstacles(Obstacles.none())
    planner.tick()
    assert planner.search.cost == cost
    np.testing.assert_array_equal(planner.search.nodes, free)


def test_a_search_without_time_is_followed_as_far_as_it_knows_and_goes_on(planner) -> None:
    planner.tick()
    planner.set_obstacles(sphere_on(planner))
    verdict = planner.tick(Deadline(0.5, itertools.count(1).__next__))
    assert verdict.ok
    assert verdict.figures.cost_gap > 0.0
    assert not planner.is_exact
    assert planner.path is not None
    for _ in range(10_000):
        verdict = planner.tick(Deadline(0.5, itertools.count().__next__))
        if planner.is_exact:
            break
    assert verdict.figures.cost_gap == 0.0


def test_newer_obstacles_wait_for_the_search_that_runs(planner) -> None:
    planner.tick()
    free = planner.search.cost
    planner.set_obstacles(sphere_on(planner))
    planner.tick(Deadline(0.5, itertools.count(1).__next__))
    planner.set_obstacles(Obstacles.none())
    # Without time for the search that runs, which knows of the sphere still.
    assert planner.tick(Deadline(0.5, itertools.count(1).__next__)).figures.cost_gap > 0.0
    assert planner.search.cost > free
    assert not planner.is_exact
    assert planner.tick().figures.cost_gap == 0.0
    assert planner.is_exact
    assert planner.search.cost == free


def test_a_goal_that_the_skill_does_not_know_is_refused_with_the_distances(planner) -> None:
    position, quaternion = np.split(planner.skill.goal_pose, [3])
    verdict = planner.prepare_goal(position + [0.0, 0.0, 0.6], quaternion, 0.05, 0.5)
    assert verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert verdict.figures.goal_offset > 0.05
    assert "allowed are 50 mm" in verdict.reason


def test_the_paper_knows_spheres_only(planner) -> None:
    refused = planner.set_obstacles(Obstacles.one_of_each(np.zeros(3), np.zeros(3), 0.0))
    assert refused.code is VerdictCode.BAD_INPUT
    assert "spheres only" in refused.reason
    nowhere = Obstacles.of_spheres(np.full((1, 3), np.nan), np.ones(1))
    assert planner.set_obstacles(nowhere).code is VerdictCode.BAD_INPUT
    assert planner.tick().ok


def test_halted_it_stays_and_then_goes_on_from_there(planner) -> None:
    planner.tick()
    planner.advance(0.5 * planner.path.duration)
    here = planner.path.latent_at(planner.lead)
    planner.halt()
    assert planner.path.stands
    np.testing.assert_allclose(planner.path.latent_at(planner.lead), here)
    assert planner.tick().ok
    np.testing.assert_allclose(planner.path.latent[0], here)
    assert not planner.path.stands
    planner.clear_goal()
    assert planner.tick().code is VerdictCode.NO_GOAL


def test_a_plan_on_request_leaves_the_path_alone(planner) -> None:
    planner.tick()
    path = planner.path
    start, goal = (np.split(pose, [3]) for pose in (planner.skill.goal_pose, planner.skill.start_pose))
    backwards = planner.plan(start, goal)
    assert planner.path is path
    np.testing.assert_allclose(planner.tool_poses(backwards)[0][-1], planner.skill.start_pose[:3], atol=0.05)


def test_no_query_raises_and_every_path_is_finite(shared) -> None:
    random = np.random.default_rng(0)

    def pose() -> tuple[np.ndarray, np.ndarray]:
        quaternion = random.normal(size=4)
        return random.uniform(-1.5, 1.5, size=3), quaternion / np.linalg.norm(quaternion)

    shared.clear_goal()
    for query in range(60):
        count = query % 5
        radii = 10.0 ** random.uniform(-3.0, 3.0, size=count)
        shared.set_obstacles(Obstacles.of_spheres(random.uniform(-1.0, 1.0, size=(count, 3)), radii))
        if query % 3 == 0:
            shared.take_goal(shared.prepare_goal(*pose()))
        if query % 7 == 0:
            shared.stand_at(np.zeros(7), *pose())
        assert shared.tick().ok
        assert np.isfinite(shared.search.cost)
        assert np.all(np.isfinite(shared.path.places))
        assert np.all(np.diff(shared.path.times) > 0.0)
        shared.advance(random.uniform(0.0, 2.0))


def test_a_held_object_is_what_obstacles_are_kept_from_and_adds_its_radius(planners) -> None:
    planner, bottle = planners["task"], HeldObject("bottle", "cylinder", (0.03, 0.2), (0.0, 0.0, 0.2))
    start, goal = (np.split(pose, [3]) for pose in (planner.skill.start_pose, planner.skill.goal_pose))
    planner.set_obstacles(Obstacles.none())
    planner.stand_at(np.zeros(7), *start)
    planner.take_goal(planner.prepare_goal(*goal))
    planner.tick()
    nodes, free = planner.search.nodes, planner.search.cost
    positions, quaternions = planner.tool_poses(planner.path)
    middle = len(positions) // 2
    hanging = positions[middle] + to_rotation(quaternions[middle]).apply([0.0, 0.0, 0.2])
    sphere = Obstacles.of_spheres(hanging[None], np.array([0.02]))
    try:
        assert planner.hold([bottle, HeldObject("cup", "sphere", (0.03,))]).code is VerdictCode.BAD_INPUT
        assert planner.hold([bottle]).ok
        planner.set_obstacles(sphere)
        planner.tick()
        held = planner.search.cost
        # The metric is of the bottle's position, and the sphere is as wide as both radii together.
        points = planner.graph.transported(Offsets.none(), np.array([[0.0, 0.0, 0.2]]))
        search = LiteralSearch(planner.graph.adjacency, points, planner.settings.strength)
        search.aim(int(planner.search.nodes[-1]), search.field(int(planner.search.nodes[-1])))
        search.begin(int(planner.search.nodes[0]), sphere.centres, np.array([0.05]))
        search.go_on()
        assert held == search.cost
    finally:
        planner.hold([])
    planner.set_obstacles(Obstacles.none())
    planner.tick()
    assert planner.search.cost == free
    np.testing.assert_array_equal(planner.search.nodes, nodes)
