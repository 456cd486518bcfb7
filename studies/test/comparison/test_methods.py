"""The peers, without physics: each does what it is known for, and a control does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import configuration_clearance
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.catalogue import ROWS
from geodesic_motion_studies.comparison.execution import Stage
from geodesic_motion_studies.comparison.method import TICK, Answer, Method
from geodesic_motion_studies.comparison.scene import Scene, draw_scene

#: Our detours from other base paths.
DETOURED = ("mean demonstration + detour", "ProMP + detour", "nearest demonstration + detour")


@pytest.fixture(scope="module")
def arena(reach_skill: Skill) -> Arena:
    return Arena.of(reach_skill)


@pytest.fixture(scope="module")
def scene(arena: Arena, blocked_elbow) -> Scene:
    return blocked_elbow(arena)


@pytest.fixture(scope="module")
def blocked(arena: Arena) -> Scene:
    """Spheres that stand and block every demonstration."""
    scenes = (draw_scene(arena, "static", number, 0) for number in range(1, 40, 2))
    return next(scene for scene in scenes if not np.any(scene.free))


def made(row: str, arena: Arena) -> Method:
    for library in ROWS[row].needs:
        pytest.importorskip(library)
    return ROWS[row].make(arena)


def standing(scene: Scene) -> Obstacles:
    return Obstacles.of_spheres(
        np.array([sphere.begin for sphere in scene.spheres]), np.array([sphere.radius for sphere in scene.spheres])
    )


def least_clearance(arena: Arena, scene: Scene, configurations: np.ndarray) -> float:
    seen = standing(scene)
    return min(
        configuration_clearance(arena.collision, arena.robot, one, seen.centres, seen.radii)[0]
        for one in configurations
    )


def stepped(method: Method, scene: Scene, obstacles: Obstacles, until: float) -> np.ndarray:
    """Configurations (n, eta) of an arm that is where it is sent, for a method that sends one after the other."""
    method.reset(scene)
    sent = []
    for tick in range(int(until / TICK)):
        waypoints = method.tick(tick * TICK, obstacles).waypoints
        assert waypoints is not None
        sent.append(waypoints.positions[0])
    return np.array(sent)


def first_answer(method: Method, scene: Scene, obstacles: Obstacles) -> Answer:
    method.reset(scene)
    return method.tick(0.0, obstacles)


@pytest.mark.parametrize("row", ["free demonstration", *DETOURED, "ProMP", "RRT-Connect"])
def test_a_path_is_planned_that_is_free_and_keeps_its_ends(arena, scene, row) -> None:
    waypoints = first_answer(made(row, arena), scene, standing(scene)).waypoints
    assert waypoints is not None
    np.testing.assert_allclose(waypoints.positions[[0, -1]], [scene.start, scene.goal], atol=1e-9)
    assert least_clearance(arena, scene, waypoints.positions) > 0.0
    # The control: the nearest demonstration is not.
    blocked = scene.demonstrations[arena.nearest(scene.start, scene.goal)]
    assert least_clearance(arena, scene, blocked.positions) < 0.0


@pytest.mark.parametrize("row", ["free demonstration", *DETOURED, "ProMP", "RRT-Connect"])
def test_what_comes_into_the_path_is_stopped_for_and_said(arena, scene, row) -> None:
    method = made(row, arena)
    free = first_answer(method, scene, Obstacles.none()).waypoints
    assert free is not None
    assert method.tick(TICK, Obstacles.none()).waypoints is None
    # On the goal: there is no other path.
    covering = Obstacles.of_spheres(arena.robot.forward(scene.goal)[0][None], np.array([0.05]))
    answer = method.tick(0.5, covering)
    assert answer.refusal
    assert answer.waypoints is not None
    assert np.linalg.norm(answer.waypoints.positions[-1] - scene.goal) > 0.1
    assert method.tick(0.51, covering).waypoints is None


@pytest.mark.parametrize("row", ["free demonstration", *DETOURED, "ProMP", "RRT-Connect"])
@pytest.mark.parametrize("apart", [0.015, 0.003])
def test_a_goal_beside_a_sphere_is_planned_to(arena, scene, row, apart) -> None:
    """Scenes have goals 15 mm from standing spheres."""
    at_goal, radius = arena.body(scene.goal[None])[0], 0.04
    # Outwards of the hand, away from the arm.
    last = int(np.argmax(np.linalg.norm(at_goal[:, :2], axis=1)))
    outwards = at_goal[last] * [1.0, 1.0, 0.0] / np.linalg.norm(at_goal[last, :2])
    beside = at_goal[last] + (arena.body_radii[last] + radius + apart) * outwards
    left = configuration_clearance(arena.collision, arena.robot, scene.goal, beside[None], np.array([radius]))[0]
    assert 0.5 * apart < left <= apart + 1e-9
    waypoints = first_answer(made(row, arena), scene, Obstacles.of_spheres(beside[None], np.array([radius]))).waypoints
    assert waypoints is not None
    np.testing.assert_allclose(waypoints.positions[-1], scene.goal, atol=1e-9)


def test_the_nearest_free_demonstration_is_played_and_another_one_joined_where_it_is_blocked(arena, scene) -> None:
    method = made("free demonstration", arena)

    def off(positions: np.ndarray, number: int) -> float:
        shown = scene.demonstrations[number].positions
        return max(float(np.min(np.linalg.norm(shown - one, axis=1))) for one in positions)

    nearest = arena.nearest(scene.start, scene.goal)
    first = first_answer(method, scene, Obstacles.none()).waypoints
    assert off(first.positions, nearest) < 0.02
    # Then something comes that only others are free of.
    answer = method.tick(0.2, standing(scene))
    assert answer.planned
    assert not answer.refusal
    ahead = answer.waypoints.positions[len(answer.waypoints.positions) // 2 :]
    assert least_clearance(arena, scene, answer.waypoints.positions) > 0.0
    assert off(ahead, nearest) > 0.05
    # From the beginning one that is free is played as it is.
    around = first_answer(method, scene, standing(scene)).waypoints
    chosen = [number for number in range(len(arena.shown)) if off(around.positions, number) < 0.02]
    assert chosen
    assert np.all(scene.free[chosen])


@pytest.mark.parametrize("row", DETOURED)
def test_without_obstacles_the_base_path_itself_is_played(arena, scene, row) -> None:
    def played(row: str) -> np.ndarray:
        waypoints = first_answer(made(row, arena), scene, Obstacles.none()).waypoints
        return waypoints.positions[np.linspace(0, len(waypoints.positions) - 1, 200).astype(int)]

    if row == "mean demonstration + detour":
        own = arena.modes == arena.modes[arena.nearest(scene.start, scene.goal)]
        base = arena.moved(scene.start, scene.goal)[own].mean(axis=0)
    else:
        base = played({"ProMP + detour": "ProMP", "nearest demonstration + detour": "free demonstration"}[row])
    at = np.linspace(0, len(base) - 1, 2000)
    dense = np.stack([np.interp(at, np.arange(len(base)), joint) for joint in base.T], axis=1)
    off = [np.min(np.linalg.norm(dense - one, axis=1)) for one in played(row)]
    assert max(off) < 0.005


@pytest.mark.parametrize("row", DETOURED)
def test_a_detour_leads_round_what_blocks_all_that_was_demonstrated(arena, blocked, stage: Stage, row) -> None:
    assert stage.play(blocked, made(row, arena))[0].success
    # The control: what has no detour waits.
    assert stage.play(blocked, made("free demonstration", arena))[0].refused


def test_a_primitive_has_samples_and_no_detour(arena, blocked, stage: Stage) -> None:
    assert stage.play(blocked, made("ProMP", arena))[0].refused


def test_in_motion_the_arm_stops_before_it_leaves_the_base_path(arena, blocked) -> None:
    method, seen = made("nearest demonstration + detour", arena), standing(blocked)
    first_answer(method, blocked, Obstacles.none())
    stop = method.tick(0.2, seen)
    assert stop.refusal
    at_rest = 0.2 + len(stop.waypoints.positions) * TICK
    answers = [method.tick(now, seen) for now in np.arange(0.2, at_rest + 1.0, TICK)[1:]]
    detour = next(answer for answer in answers if answer.waypoints is not None)
    assert not detour.refusal
    ends = stop.waypoints.positions[-1], blocked.goal
    np.testing.assert_allclose(detour.waypoints.positions[[0, -1]], ends, atol=1e-9)
    assert least_clearance(arena, blocked, detour.waypoints.positions) > 0.0


def test_the_same_scene_makes_the_same_tree(arena, scene) -> None:
    method = made("RRT-Connect", arena)
    one, other = (first_answer(method, scene, standing(scene)).waypoints for _ in range(2))
    np.testing.assert_array_equal(one.positions, other.positions)


@pytest.mark.parametrize("row", ["DMP", "barriers"])
def test_without_obstacles_the_demonstration_is_followed(arena, scene, row) -> None:
    nearest = scene.demonstrations[arena.nearest(scene.start, scene.goal)]
    motion = stepped(made(row, arena), scene, Obstacles.none(), nearest.duration + 0.5)
    tools = np.array([arena.robot.forward(one)[0] for one in motion[::20]])
    shown = arena.tool_curve(nearest.positions).positions
    assert max(np.min(np.linalg.norm(shown - tool, axis=1)) for tool in tools) < 0.02
    np.testing.assert_allclose(tools[-1], scene.goal_pose[0], atol=0.01)


def test_a_primitive_stays_at_the_goal(arena) -> None:
    """After the time that it was learned over, too, where the arm comes to rest."""
    scene = draw_scene(arena, "none", 1, 0)
    duration = scene.demonstrations[arena.nearest(scene.start, scene.goal)].duration
    motion = stepped(made("DMP", arena), scene, Obstacles.none(), duration + 2.5)
    tools = np.array([arena.robot.forward(one)[0] for one in motion[int(duration / TICK) :: 10]])
    assert np.max(np.linalg.norm(tools - scene.goal_pose[0], axis=1)) < 0.005


def test_a_primitive_is_bent_around_what_blocks_the_tool(arena, scene) -> None:
    method = made("DMP", arena)
    nearest = scene.demonstrations[arena.nearest(scene.start, scene.goal)]
    ahead = arena.tool_curve(nearest.samples(np.array([0.5, 0.55]) * nearest.duration)[0]).positions
    seen = Obstacles.of_spheres(ahead[:1] + [0.0, 0.0, 0.02], np.array([0.05]))

    def nearest_of(motion: np.ndarray) -> float:
        return min(float(np.linalg.norm(arena.robot.forward(one)[0] - seen.centres[0])) for one in motion[::5])

    until = 0.6 * nearest.duration
    bent = nearest_of(stepped(method, scene, seen, until))
    assert bent > nearest_of(stepped(method, scene, Obstacles.none(), until))


def test_barriers_are_not_crossed(arena, scene) -> None:
    method = made("barriers", arena)
    nearest = scene.demonstrations[arena.nearest(scene.start, scene.goal)]
    until = 0.8 * nearest.duration
    assert least_clearance(arena, scene, stepped(method, scene, standing(scene), until)[::5]) > 0.0
    assert least_clearance(arena, scene, stepped(method, scene, Obstacles.none(), until)[::5]) < 0.0


def test_barriers_evade_what_comes(arena, scene) -> None:
    """The sphere is still too far off for its place alone to move the arm."""
    method = made("barriers", arena)
    still = replace(scene, demonstrations=tuple(arena.timed(np.stack([scene.start] * 4)) for _ in arena.shown))
    beside = arena.robot.forward(scene.start)[0] + [0.0, 0.25, 0.0]
    apart = configuration_clearance(arena.collision, arena.robot, scene.start, beside[None], np.array([0.05]))[0]

    def moved(speed: float) -> float:
        seen = Obstacles.of_spheres(beside[None], np.array([0.05]), np.array([[0.0, -speed, 0.0]]), time=0.0)
        answer = first_answer(method, still, seen)
        assert not answer.refusal
        return float(np.max(np.abs(answer.waypoints.positions[0] - scene.start)))

    # What the barrier allows, and a little more.
    assert moved(method.settings["gain"] * (apart - method.settings["kept_off"]) + 0.15) > 1e-4
    assert moved(0.0) < 1e-6


def test_the_paper_s_planner_goes_to_the_goal_and_takes_no_skill_without_its_model(arena) -> None:
    with pytest.raises(ParameterError, match="paper's model"):
        made("paper", arena)
    pouring = Arena.of(Skill.load("panda_pouring"))
    scene, method = draw_scene(pouring, "none", 0, 0), made("paper", pouring)
    method.reset(scene)
    poses = [method.tick(TICK * tick, Obstacles.none()).pose for tick in range(1500)]
    np.testing.assert_allclose(poses[-1][0], scene.goal_pose[0], atol=1e-3)
    assert angle_between(poses[-1][1], scene.goal_pose[1]) < 0.01
    # The mass that is commanded makes no jump, and is no faster than what it follows, but for where its goal was moved.
    steps = np.linalg.norm(np.diff([position for position, _ in poses], axis=0), axis=1)
    assert 0.0 < steps.max() < 0.01
