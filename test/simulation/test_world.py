"""The twin follows, measures and repeats: physics behaviour of ArmWorld."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.demonstrations.readers import read_demonstrations
from geodesic_motion_ros.robot.description import shipped_robots
from geodesic_motion_ros.robot.inverse_kinematics import pose_error, solve
from geodesic_motion_ros.simulation.camera import VIEWS
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints, TrajectoryPlayer
from geodesic_motion_ros.utils.errors import ParameterError, RobotError
from geodesic_motion_ros.utils.shared_files import find_shared

Pose = tuple[np.ndarray, np.ndarray]
#: A quaternion that turns z to -y.
LYING = [0.5**0.5, 0.5**0.5, 0.0, 0.0]
#: The hand points down.
DOWN = np.array([0.0, 1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def shared_world() -> Iterator[ArmWorld]:
    with ArmWorld(scene=DeclaredScene.from_name("table")) as world:
        yield world


@pytest.fixture
def world(shared_world: ArmWorld) -> ArmWorld:
    shared_world.set_obstacles({})
    shared_world.clear_curves()
    shared_world.reset()
    return shared_world


def distance_to(world: ArmWorld, pose: Pose) -> tuple[float, float]:
    error = pose_error(*world.tool_pose(), *pose)
    return float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))


def play(
    world: ArmWorld, pose_at: Callable[[float], Pose], duration: float, rate_hz: float = 100.0
) -> np.ndarray:
    """Stream target poses at a rate; rows of position error [m], angle error and joint lag [rad]."""
    sent, rows = 0, []
    while world.time < duration:
        if world.time >= sent / rate_hz - 1e-9:
            world.set_target_pose(*pose_at(sent / rate_hz))
            sent += 1
        world.step()
        lag = np.max(np.abs(world.joint_positions - world.commanded_positions))
        rows.append((*distance_to(world, pose_at(world.time)), lag))
    return np.array(rows)


def ramped(time: float, speed: float, length: float, acceleration: float) -> float:
    """Distance travelled with constant acceleration to a speed, and back to rest after a length."""
    ramp = speed / acceleration
    total = length / speed + ramp
    time = min(time, total)
    if time < ramp:
        return 0.5 * acceleration * time**2
    if time < total - ramp:
        return 0.5 * speed * ramp + speed * (time - ramp)
    return length - 0.5 * acceleration * (total - time) ** 2


def test_a_straight_line_at_250_mm_per_second_is_tracked(world: ArmWorld) -> None:
    start, quaternion = world.tool_pose()

    def pose_at(time: float) -> Pose:
        return start + np.array([0.1, -1.0, -0.1]) * ramped(time, 0.25, 0.4, 1.0), quaternion

    rows = play(world, pose_at, 2.5)
    assert rows[:, 0].max() < 2e-3
    assert np.median(rows[:, 0]) < 1e-3
    assert rows[:, 1].max() < np.radians(0.5)
    assert rows[:, 2].max() < 1e-3
    assert rows[-1, 0] < 1e-4


def test_joint_limits_hold_while_a_far_target_is_approached(world: ArmWorld) -> None:
    start, quaternion = world.tool_pose()
    world.set_target_pose(start + [0.1, -0.5, -0.2], quaternion)
    for _ in range(480):
        world.step()
        assert np.all(np.abs(world.joint_velocities) <= world.robot.velocity_limits * 1.05)
    assert distance_to(world, (start + [0.1, -0.5, -0.2], quaternion))[0] < 1e-3


def swinging(start: np.ndarray, duration: float = 3.0) -> JointWaypoints:
    """From `start` (7,) by some tenths of a radian within the limits, a waypoint every 20 ms."""
    swing = np.array([0.4, 0.2, -0.3, 0.3, 0.5, -0.3, 0.6])
    rate = np.pi / duration
    times = np.linspace(0.0, duration, int(50 * duration) + 1)
    shares = 0.5 - 0.5 * np.cos(rate * times), 0.5 * rate * np.sin(rate * times), 0.5 * rate**2 * np.cos(rate * times)
    motion = [np.outer(share, swing) for share in shares]
    motion[1][-1] = 0.0
    return JointWaypoints(times, start + motion[0], *motion[1:])


def test_a_joint_trajectory_is_followed(world: ArmWorld) -> None:
    waypoints = swinging(world.joint_positions)
    expected = TrajectoryPlayer(world.joint_positions, np.zeros(7))
    expected.replace(waypoints, 0.0, 0.0)
    world.set_joint_trajectory(waypoints)
    commanded, measured = [], []
    while world.time < 3.1:
        world.step()
        desired = expected.sample(world.time)[0]
        commanded.append(np.max(np.abs(world.commanded_positions - desired)))
        measured.append(np.max(np.abs(world.joint_positions - desired)))
    assert max(commanded) < 1e-9
    assert max(measured) < 1e-3
    assert measured[-1] < 1e-4


def test_begins_of_trajectories_are_of_the_clock_that_is_set(world: ArmWorld) -> None:
    start = world.joint_positions
    waypoints = swinging(start)
    world.clock_offset = 1000.0
    for _ in range(24):
        world.step()
    with pytest.raises(RobotError, match="ends in the past"):
        world.set_joint_trajectory(waypoints, 997.0)
    world.set_joint_trajectory(waypoints, 1000.5)
    while world.time < 0.5:
        world.step()
        np.testing.assert_allclose(world.joint_positions, start, atol=1e-3)
    while world.time < 3.5:
        world.step()
    np.testing.assert_allclose(world.joint_positions, waypoints.positions[-1], atol=1e-3)


@pytest.mark.parametrize("begin", [0.0, -1.5], ids=["of what is far", "into the midst"])
def test_a_jump_is_followed_as_fast_as_the_limits_allow(world: ArmWorld, begin: float) -> None:
    waypoints = swinging(world.joint_positions + (0.3 if begin == 0.0 else 0.0))
    world.set_joint_trajectory(waypoints, begin)
    velocities = [np.zeros(7)]
    for _ in range(960):
        before = world.commanded_positions
        world.step()
        velocities.append((world.commanded_positions - before) / world.dt)
        assert np.all(np.abs(velocities[-1]) <= world.robot.velocity_limits * (1.0 + 1e-9))
    accelerations = np.diff(velocities, axis=0) / world.dt
    assert np.all(np.abs(accelerations) <= world.robot.acceleration_limits * (1.0 + 1e-6))
    np.testing.assert_allclose(world.joint_positions, waypoints.positions[-1], atol=1e-3)


def test_a_trajectory_that_follows_poses_begins_with_their_motion(world: ArmWorld) -> None:
    start, quaternion = world.tool_pose()
    world.set_target_pose(start + [0.0, -0.4, 0.0], quaternion)
    for _ in range(80):
        world.step()
    before = world.joint_velocities
    goal = JointWaypoints(np.array([1.0]), world.robot.ready[None] + 0.1, np.zeros((1, 7)))
    world.set_joint_trajectory(goal)
    world.step()
    assert np.max(np.abs(world.joint_velocities - before)) < 0.1
    for _ in range(300):
        world.step()
    np.testing.assert_allclose(world.joint_positions, world.robot.ready + 0.1, atol=1e-3)


def rest_at(positions: np.ndarray) -> JointWaypoints:
    return JointWaypoints(np.array([1.0]), positions[None])


def test_poses_and_joint_trajectories_take_turns(world: ArmWorld) -> None:
    pose = world.tool_pose()
    world.set_joint_trajectory(rest_at(world.robot.ready + 0.1))
    for _ in range(400):
        world.step()
    np.testing.assert_allclose(world.joint_positions, world.robot.ready + 0.1, atol=1e-3)
    world.set_target_pose(*pose)
    for _ in range(600):
        world.step()
    assert distance_to(world, pose)[0] < 1e-3


def test_position_limits_end_what_a_trajectory_asks_for(world: ArmWorld) -> None:
    world.set_joint_trajectory(rest_at(world.robot.ready + [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0]))
    for _ in range(960):
        world.step()
        assert np.all(world.commanded_positions <= world.robot.upper)
    assert world.joint_positions[6] == pytest.approx(world.robot.upper[6], abs=1e-3)


@pytest.mark.parametrize(
    ("waypoints", "begin", "message"),
    [
        (JointWaypoints(np.array([1.0]), np.zeros((1, 6))), None, "a trajectory of 6 joints: expected panda_joint1"),
        (rest_at(np.zeros(7)), -3.0, "ends in the past"),
    ],
)
def test_an_impossible_joint_trajectory_is_refused_and_the_old_one_kept(
    world: ArmWorld, waypoints: JointWaypoints, begin: float | None, message: str
) -> None:
    world.set_joint_trajectory(rest_at(world.robot.ready + 0.05))
    with pytest.raises(RobotError, match=message):
        world.set_joint_trajectory(waypoints, begin)
    for _ in range(400):
        world.step()
    np.testing.assert_allclose(world.joint_positions, world.robot.ready + 0.05, atol=1e-3)


def test_hold_stops_and_stays(world: ArmWorld) -> None:
    start, quaternion = world.tool_pose()
    world.set_target_pose(start + [0.0, -0.4, 0.0], quaternion)
    for _ in range(80):
        world.step()
    assert np.max(np.abs(world.joint_velocities)) > 0.1
    world.hold()
    for _ in range(120):
        world.step()
    stopped = world.joint_positions
    for _ in range(120):
        world.step()
    np.testing.assert_allclose(world.joint_positions, stopped, atol=1e-4)
    assert np.max(np.abs(world.joint_velocities)) < 1e-3


@pytest.mark.parametrize("timeout", [0.1, 10.0])
def test_an_arm_that_did_not_get_to_the_end_in_time_holds_where_it_is(world: ArmWorld, timeout: float) -> None:
    """With the control: before the timeout it goes on to the end, too."""
    start, world.clock_offset = world.joint_positions, 1000.0
    goal = start + 0.5
    world.set_joint_trajectory(JointWaypoints(np.array([0.05]), goal[None]))
    stopped = []
    while world.time < 3.0:
        before = world.joint_positions
        if world.hold_if_overdue(timeout):
            stopped.append((world.time, before))
        world.step()
    if timeout > 1.0:
        assert not stopped
        np.testing.assert_allclose(world.joint_positions, goal, atol=1e-3)
        return
    ((time, where),) = stopped
    assert 0.15 < time < 0.16
    np.testing.assert_allclose(world.joint_positions, where, atol=1e-3)
    assert np.max(np.abs(where - goal)) > 0.3


def test_gravity_does_not_sag_the_arm(world: ArmWorld) -> None:
    for _ in range(240):
        world.step()
    np.testing.assert_allclose(world.joint_positions, world.robot.ready, atol=1e-3)


@pytest.mark.parametrize("pose", [(np.nan, 0.0, 0.4), (np.inf, 0.0, 0.4), (0.4, 0.0), (3.0, 0.0, 0.4)])
def test_an_impossible_target_is_refused_and_the_old_one_kept(world: ArmWorld, pose: tuple) -> None:
    start, quaternion = world.tool_pose()
    world.set_target_pose(start + [0.0, 0.02, 0.0], quaternion)
    with pytest.raises(RobotError):
        world.set_target_pose(np.array(pose), quaternion)
    with pytest.raises(RobotError, match="quaternion"):
        world.set_target_pose(start, np.zeros(4))
    for _ in range(240):
        world.step()
    assert distance_to(world, (start + [0.0, 0.02, 0.0], quaternion))[0] < 1e-3


def test_reset_restores(world: ArmWorld) -> None:
    start, quaternion = world.tool_pose()
    world.set_target_pose(start + [0.0, 0.2, 0.0], quaternion)
    for _ in range(100):
        world.step()
    world.reset()
    assert world.time == 0.0
    np.testing.assert_allclose(world.joint_positions, world.robot.ready, atol=1e-12)
    world.step()
    np.testing.assert_allclose(world.joint_positions, world.robot.ready, atol=1e-4)


def test_reset_to_a_tool_pose(world: ArmWorld) -> None:
    pose = (np.array([0.38, 0.10, 0.33]), np.array([0.0, 1.0, 0.0, 0.0]))
    world.reset(tool_pose=pose)
    distance, angle = distance_to(world, pose)
    assert distance < 1e-4
    assert angle < 2e-4
    with pytest.raises(RobotError, match="shoulder"):
        world.reset(tool_pose=(np.array([0.0, 0.0, 3.0]), pose[1]))
    with pytest.raises(RobotError, match="panda_joint4"):
        world.reset(np.zeros(7))


def test_the_same_commands_give_the_same_motion() -> None:
    def run(world: ArmWorld) -> np.ndarray:
        world.reset()
        start, quaternion = world.tool_pose()
        track = []
        for step in range(240):
            if step % 3 == 0:
                world.set_target_pose(start + np.array([0.0, -1e-3, 5e-4]) * step, quaternion)
            world.step()
            track.append(world.joint_positions)
        return np.array(track)

    with ArmWorld() as first, ArmWorld() as second:
        np.testing.assert_array_equal(run(first), run(second))
        np.testing.assert_array_equal(run(first), run(first))


def test_two_worlds_do_not_touch_each_other() -> None:
    with ArmWorld() as moving, ArmWorld() as resting:
        start, quaternion = moving.tool_pose()
        moving.set_target_pose(start + [0.0, 0.2, 0.0], quaternion)
        moving.set_obstacles({"ball": (np.array([0.5, 0.0, 0.5]), 0.05)})
        for _ in range(120):
            moving.step()
            resting.step()
        assert np.max(np.abs(moving.joint_positions - resting.joint_positions)) > 0.05
        assert resting.clearance() == (np.inf, "")
        assert moving.clearance()[0] < 1.0


def test_clearance_is_the_distance_to_the_nearest_link(world: ArmWorld) -> None:
    """Below the finger tips the distance of a sphere shrinks as it rises, and is negative inside."""
    tool, _ = world.tool_pose()
    distances = []
    for drop in (0.20, 0.15, 0.10):
        world.set_obstacles({"ball": (tool - [0.0, 0.0, drop], 0.05)})
        distance, link = world.clearance()
        assert link in ("panda_leftfinger", "panda_rightfinger")
        distances.append(distance)
    np.testing.assert_allclose(np.diff(distances), -0.05, atol=2e-3)
    assert distances[0] == pytest.approx(0.20 - 0.05, abs=0.02)
    world.set_obstacles({"ball": (tool, 0.05)})
    assert world.clearance()[0] < -0.01


def test_clearance_names_the_elbow(world: ArmWorld) -> None:
    """A sphere beside the elbow, whose joint lies where forward kinematics says."""
    _, origins = world.robot.link_frames(world.robot.ready)
    elbow = origins[world.robot.link_names.index("panda_link4")]
    world.set_obstacles({"ball": (elbow + [0.0, 0.3, 0.0], 0.05), "far": (np.array([-1.0, -1.0, 1.0]), 0.05)})
    distance, link = world.clearance()
    assert link in ("panda_link3", "panda_link4")
    assert 0.3 - 0.05 - 0.12 < distance < 0.3 - 0.05


def pressed_down(scene: DeclaredScene) -> tuple[dict[str, str], float]:
    """What the arm touches when its finger tips are sent 3 cm below z = 0, and how high they get [m]."""
    place = np.array([0.5, 0.0, 0.1])
    with ArmWorld(scene=scene) as world:
        world.reset(tool_pose=(place, DOWN))
        assert world.contacts() == {}
        play(world, lambda time: (place - [0.0, 0.0, ramped(time, 0.1, 0.13, 0.5)], DOWN), 2.0)
        return world.contacts(), float(world.tool_pose()[0][2])


def test_an_arm_that_is_pressed_on_the_declared_table_touches_it() -> None:
    """With the control: without the scene the arm goes where it is sent."""
    table = DeclaredScene.load(find_shared("config/scenes/table.yaml"))
    contacts, height = pressed_down(table)
    assert contacts.keys() == {"table"}
    assert contacts["table"] in ("panda_leftfinger", "panda_rightfinger", "panda_hand")
    assert height > -0.01
    contacts, height = pressed_down(DeclaredScene.empty())
    assert contacts == {}
    assert height == pytest.approx(-0.03, abs=2e-3)


@pytest.mark.parametrize(
    ("kind", "entry"),
    [
        ("boxes", {"centre": [0.5, 0.0, -0.05], "size": [0.3, 0.3, 0.1]}),
        # its axis along y: upright it would be 0.8 m high
        ("cylinders", {"centre": [0.5, 0.0, -0.1], "radius": 0.1, "height": 0.8, "quaternion": LYING}),
        ("planes", {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}),
    ],
)
def test_a_body_is_where_its_scene_declares_it(kind: str, entry: dict) -> None:
    scene = DeclaredScene.of({kind: [{"name": "thing", **entry}]})
    with ArmWorld(scene=scene) as world:
        world.reset(tool_pose=(np.array([0.5, 0.0, 0.022]), DOWN))
        high, between = world.own_clearance()
        assert between.endswith("finger and 'thing'")
        world.reset(tool_pose=(np.array([0.5, 0.0, 0.012]), DOWN))
        low, _ = world.own_clearance()
    assert high - low == pytest.approx(0.01, abs=1e-3)
    assert 0.0 < low < 0.012


def test_a_cylinder_is_round() -> None:
    """With the control: a hand beside it touches the edge of the box around it."""
    turned = {"centre": [0.5, 0.0, 0.0], "quaternion": [np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8)]}
    apart = []
    for table in (
        {"cylinders": [{"name": "thing", **turned, "radius": 0.2, "height": 0.6}]},
        {"boxes": [{"name": "thing", **turned, "size": [0.4, 0.4, 0.6]}]},
    ):
        with ArmWorld(scene=DeclaredScene.of(table)) as world:
            world.reset(tool_pose=(np.array([0.5, 0.35, 0.2]), DOWN))
            apart.append(world.own_clearance()[0])
    assert apart[1] < 0.0 < apart[0]


def test_empty_space_is_no_body() -> None:
    space = {"centre": [0.5, 0.0, 0.1], "size": [0.4, 0.4, 0.4]}
    lower, upper = [-1.0, -1.0, 0.05], [1.0, 1.0, 1.5]
    scene = DeclaredScene.of({"keep_out": [{"name": "screen", **space}], "workspace": {"lower": lower, "upper": upper}})
    assert pressed_down(scene)[0] == {}


def test_the_base_may_stand_on_the_scene(world: ArmWorld) -> None:
    world.step()
    assert world.contacts() == {}


def test_the_arm_sees_the_table_and_itself(world: ArmWorld) -> None:
    assert world.own_clearance()[0] > 0.02
    heights = []
    for height in (0.012, 0.022):
        world.reset(tool_pose=(np.array([0.5, 0.0, height]), DOWN))
        clearance, between = world.own_clearance()
        assert between in ("panda_leftfinger and 'table'", "panda_rightfinger and 'table'")
        heights.append(clearance)
    assert heights[1] - heights[0] == pytest.approx(0.01, abs=1e-3)
    world.reset(np.array([0.0, -0.4, 0.0, -3.05, 0.0, 0.1, 0.8]))
    clearance, between = world.own_clearance()
    assert clearance < 0.0
    assert "table" not in between


def test_without_obstacles_clearance_is_infinite(world: ArmWorld) -> None:
    assert world.clearance() == (np.inf, "")
    world.set_obstacles({"far": (np.array([0.0, 0.0, 9.0]), 0.1)})
    assert world.clearance(cutoff=1.0) == (np.inf, "")


def test_a_sphere_that_runs_into_the_hand_is_felt(world: ArmWorld) -> None:
    """With the control: the same sphere passing 25 cm away touches nothing."""
    tool, _ = world.tool_pose()

    def sweep(offset: float) -> tuple[int, float]:
        world.reset()
        touched, nearest = 0, np.inf
        for y in np.linspace(-0.25, 0.1, 120):
            world.set_obstacles({"ball": (tool + [offset, y, 0.0], 0.05)})
            world.step()
            touched += "ball" in world.contacts()
            nearest = min(nearest, world.clearance()[0])
        return touched, nearest

    hits, depth = sweep(0.0)
    misses, distance = sweep(0.25)
    assert hits > 0
    assert depth < 0.0
    assert misses == 0
    assert distance > 0.0


def test_obstacles_appear_move_grow_and_vanish(world: ArmWorld) -> None:
    tool, _ = world.tool_pose()
    below = tool - [0.0, 0.0, 0.1]
    world.set_obstacles({"ball": (below, 0.03)})
    small = world.clearance()[0]
    world.set_obstacles({"ball": (below, 0.05)})
    assert world.clearance()[0] == pytest.approx(small - 0.02, abs=2e-3)
    world.set_obstacles({"other": (below - [0.0, 0.0, 0.05], 0.03)})
    assert world.clearance()[0] == pytest.approx(small + 0.05, abs=2e-3)
    world.set_obstacles({})
    assert world.clearance() == (np.inf, "")


@pytest.mark.parametrize(
    ("sphere", "message"),
    [
        ((np.array([np.nan, 0.0, 0.0]), 0.1), "centre of obstacle 'bad'"),
        ((np.zeros(2), 0.1), "centre of obstacle 'bad'"),
        ((np.zeros(3), -0.1), "radius of obstacle 'bad'"),
        ((np.zeros(3), np.inf), "radius of obstacle 'bad'"),
    ],
)
def test_a_bad_obstacle_is_named_and_changes_nothing(world: ArmWorld, sphere: tuple, message: str) -> None:
    world.set_obstacles({"ball": (np.array([0.5, 0.0, 0.2]), 0.05)})
    before = world.clearance()
    with pytest.raises(ParameterError, match=message):
        world.set_obstacles({"fine": (np.array([0.4, 0.0, 0.3]), 0.1), "bad": sphere})
    assert world.clearance() == before


@pytest.mark.parametrize("view", sorted(VIEWS))
def test_pictures_show_obstacles_and_curves(world: ArmWorld, view: str) -> None:
    plain = world.render(80, 60, view)
    assert plain.shape == (60, 80, 3)
    assert plain.dtype == np.uint8
    world.set_obstacles({"ball": (np.array([0.45, -0.3, 0.3]), 0.08)})
    world.add_curve(np.linspace([0.3, -0.4, 0.3], [0.6, 0.2, 0.2], 20), (0.0, 0.0, 1.0), radius=0.02)
    picture = world.render(80, 60, view).astype(int)
    red = (picture[..., 0] > 120) & (picture[..., 1] < 90) & (picture[..., 2] < 90)
    blue = (picture[..., 2] > 120) & (picture[..., 0] < 90) & (picture[..., 1] < 90)
    assert red.any()
    assert blue.any()
    world.set_obstacles({})
    world.clear_curves()
    np.testing.assert_array_equal(world.render(80, 60, view), plain)


@pytest.mark.parametrize("robot", shipped_robots())
def test_pictures_show_arms_in_the_light(robot: str) -> None:
    """With the control: where the arm is, the picture is another one without it, and not black."""
    with ArmWorld(robot=robot) as world:
        shown = world.render(80, 60).astype(int)
        world.reset(world.robot.ready + 0.3)
        arm = np.any(shown != world.render(80, 60), axis=2)
    assert arm.sum() > 20
    assert np.mean(shown[arm].max(axis=1) < 40) < 0.1


def test_a_view_faces_the_side_on_which_something_is() -> None:
    view = VIEWS["front"]
    assert view.facing(np.array([0.5, -0.2, 0.3])) == view
    behind = view.facing(np.array([-0.5, 0.1, 0.3]))
    np.testing.assert_allclose(behind.target, np.multiply(view.target, (-1.0, -1.0, 1.0)))
    assert abs(behind.yaw - view.yaw) == 180.0


def test_oversampling_keeps_the_size(world: ArmWorld) -> None:
    assert world.render(64, 48, oversampling=2).shape == (48, 64, 3)


def test_an_unknown_view_and_a_bad_curve_are_refused(world: ArmWorld) -> None:
    with pytest.raises(ParameterError, match=r"'below'.*front"):
        world.render(8, 8, "below")
    with pytest.raises(ParameterError, match="curve"):
        world.add_curve(np.zeros((1, 3)), (1.0, 0.0, 0.0))


def test_a_bad_rate_is_refused() -> None:
    with pytest.raises(ParameterError, match="rate_hz"):
        ArmWorld(rate_hz=10.0)


def test_close_twice() -> None:
    world = ArmWorld()
    world.close()
    world.close()


@pytest.mark.parametrize("task", ["pouring", "bottle2shelf"])
def test_real_demonstrations_are_followed(world: ArmWorld, recordings: Path, task: str) -> None:
    """The first hand-guided recording, played at 100 Hz: near all along, exact at the end."""
    demonstration = read_demonstrations(recordings / "robotasks" / f"{task}.npy", units="cm")[0]
    world.reset(solve(world.robot, demonstration.positions[0], demonstration.quaternions[0]))
    last = len(demonstration.positions) - 1

    def pose_at(time: float) -> Pose:
        index = min(round(100.0 * time), last)
        return demonstration.positions[index], demonstration.quaternions[index]

    rows = play(world, pose_at, 0.01 * last + 0.5)
    assert rows[:, 0].max() < 4e-3
    assert rows[:, 1].max() < np.radians(5.0)
    assert rows[-1, 0] < 1e-4
    assert rows[-1, 1] < np.radians(0.05)


def test_a_joint_without_an_end_begins_the_shorter_angle(endless_reach_skill):
    with ArmWorld(robot=endless_reach_skill.robot) as world:
        start = world.robot.ready
        world.reset(start)
        moved = start + np.array([0.0] * 6 + [0.1])
        turned = np.stack([start, moved]) + np.array([0.0] * 6 + [2.0 * np.pi])
        world.set_joint_trajectory(JointWaypoints(np.array([0.5, 1.0]), turned))
        for _ in range(480):
            world.step()
            assert abs(world.joint_positions[6] - start[6]) < 0.15
        np.testing.assert_allclose(world.joint_positions, moved, atol=2e-3)
