"""MoveIt's planning scene: objects are added, moved, removed and attached; what is not taken is refused by name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bench import BASE, Bench
from geometry_msgs.msg import Pose
from shape_msgs.msg import Mesh, Plane, SolidPrimitive
from std_msgs.msg import Header

from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.messages import fill_pose
from geodesic_motion_ros.robot.kinematics import Robot

moveit = pytest.importorskip("moveit_msgs.msg", reason="make ros-extras builds it")
ADD, REMOVE, APPEND, MOVE = (
    getattr(moveit.CollisionObject, name) for name in ("ADD", "REMOVE", "APPEND", "MOVE")
)  # fmt: skip
TOOL = Robot.named("panda").tool_link
HERE = Pose()
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
BOX, SPHERE, CYLINDER = (
    SolidPrimitive(type=kind, dimensions=lengths)
    for kind, lengths in (
        (SolidPrimitive.BOX, [0.1, 0.2, 0.3]), (SolidPrimitive.SPHERE, [0.05]), (SolidPrimitive.CYLINDER, [0.4, 0.03]),
    )
)  # fmt: skip


def pose(*position: float) -> Pose:
    made = Pose()
    fill_pose(made, np.array(position), UPRIGHT)
    return made


def body(name: str, *shapes: SolidPrimitive, at: Pose, operation: bytes = ADD, frame: str = BASE, **more: Any) -> Any:
    return moveit.CollisionObject(
        header=Header(frame_id=frame), id=name, pose=at, primitives=list(shapes),
        primitive_poses=[pose(0.0, 0.0, 0.0) for _ in shapes], operation=operation, **more,
    )  # fmt: skip


def send(bench: Bench, *world: Any, attached: tuple[Any, ...] = (), is_diff: bool = True) -> None:
    scene = moveit.PlanningScene(is_diff=is_diff)
    scene.world.collision_objects = list(world)
    scene.robot_state.attached_collision_objects = list(attached)
    bench.publisher(moveit.PlanningScene, "planning_scene").publish(scene)


def obstacles(bench: Bench) -> Any:
    return bench.planner.inputs.snapshot().obstacles


def wait_for_obstacles(bench: Bench, spheres: int, solids: int) -> Any:
    found = lambda: (len(obstacles(bench).radii), len(obstacles(bench).solids)) == (spheres, solids)  # noqa: E731
    bench.wait(found, f"{spheres} spheres and {solids} solids")
    return obstacles(bench)


def test_objects_are_added_moved_appended_to_and_removed(ready):
    send(ready, body("ball", SPHERE, at=pose(0.5, 0.8, 0.3)), body("crate", BOX, CYLINDER, at=pose(0.0, -0.9, 0.2)))
    there = wait_for_obstacles(ready, 1, 2)
    np.testing.assert_allclose(there.centres, [[0.5, 0.8, 0.3]])
    np.testing.assert_allclose(there.radii, [0.05])
    np.testing.assert_allclose(there.solids[:, :3], [[0.0, -0.9, 0.2]] * 2)
    np.testing.assert_allclose(sorted(there.solids[0, 3:6]), [0.05, 0.1, 0.15])
    assert there.labels == ("planning_scene/ball/0", "planning_scene/crate/0", "planning_scene/crate/1")
    send(ready, body("ball", at=pose(0.5, 0.9, 0.3), operation=MOVE))
    ready.wait(lambda: obstacles(ready).centres[0, 1] == 0.9, "the ball elsewhere")
    send(ready, body("ball", SPHERE, at=pose(0.5, 0.9, 0.5), operation=APPEND))
    there = wait_for_obstacles(ready, 2, 2)
    np.testing.assert_allclose(there.centres, [[0.5, 0.9, 0.3], [0.5, 0.9, 0.5]])
    send(ready, body("crate", BOX, at=pose(0.0, -0.9, 0.2)))
    wait_for_obstacles(ready, 2, 1)
    send(ready, body("ball", at=Pose(), operation=REMOVE))
    wait_for_obstacles(ready, 0, 1)
    send(ready, body("other", SPHERE, at=pose(0.5, 0.8, 0.3)), is_diff=False)
    assert wait_for_obstacles(ready, 1, 0).labels == ("planning_scene/other/0",)
    send(ready, is_diff=False)
    wait_for_obstacles(ready, 0, 0)


def test_an_object_in_the_path_stops_the_arm_until_it_is_removed(ready, skill, wall):
    centre, radius = wall
    wide = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[radius])
    send(ready, body("wall", wide, at=pose(*centre)))
    wait_for_obstacles(ready, 1, 0)
    ready.send_goal(skill.goal_pose)
    ready.wait_for_code("NO_FEASIBLE_PATH")
    send(ready, body("wall", at=Pose(), operation=REMOVE))
    ready.wait_for_code("OK")


def test_what_is_not_taken_is_refused_by_name_and_hides_nothing(ready):
    cone = SolidPrimitive(type=SolidPrimitive.CONE, dimensions=[0.1, 0.1])
    inverted = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[-0.1])
    there = pose(0.5, 0.8, 0.3)
    for bad, reason in (
        (body("bad", at=there, meshes=[Mesh()], mesh_poses=[there]), "object 'bad': meshes are not taken"),
        (body("bad", at=there, planes=[Plane()], plane_poses=[there]), "object 'bad': planes are not taken"),
        (body("bad", cone, at=there), "object 'bad': a cone is not taken"),
        (body("bad", at=there), "object 'bad': it has no shapes"),
        (body("bad", at=there, operation=MOVE), "object 'bad': MOVE of what is not in the scene"),
        (body("bad", SPHERE, at=there, frame="nowhere"), "frame 'nowhere'"),
        (body("bad", inverted, at=there), "must be positive"),
    ):
        send(ready, bad, body("ball", SPHERE, at=pose(0.5, 0.9, 0.3)))
        ready.wait(lambda: reason in ready.status()["refused_input"], f"the refusal {reason}")  # noqa: B023
        wait_for_obstacles(ready, 1, 0)


def attached(name: str, *shapes: SolidPrimitive, operation: bytes = ADD, link: str = TOOL, at: Pose = HERE) -> Any:
    return moveit.AttachedCollisionObject(
        link_name=link, object=body(name, *shapes, at=at, operation=operation, frame=TOOL)
    )  # fmt: skip


def test_an_object_is_attached_and_left_where_the_hand_is(ready, skill):
    robot = Robot.named("panda")
    place = robot.forward(ready.arm)[0] + [0.0, 0.0, -0.03]
    small = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.02, 0.02, 0.04])
    send(ready, body("cup", small, at=pose(*place)))
    wait_for_obstacles(ready, 0, 1)
    # MoveIt's own form: without shapes it is the object of the scene.
    send(ready, attached=(attached("cup"),))
    ready.wait(lambda: ready.status()["holding"] == "cup/0", "the cup in the hand")
    wait_for_obstacles(ready, 0, 0)
    (held,) = ready.planner.planner.held
    assert held.dimensions == (0.02, 0.02, 0.04)
    there = robot.forward(ready.arm)
    centre, _ = TaskFrame(*there).to_base(np.array(held.position), np.array(held.quaternion))
    np.testing.assert_allclose(centre, place, atol=1e-6)
    ready.send_goal(skill.goal_pose)
    ready.wait(lambda: ready.status()["code"] == "OK" and ready.at_goal(), "the arm at the goal")
    send(ready, attached=(attached("cup", operation=REMOVE),))
    ready.wait(lambda: ready.status()["holding"] == "", "an empty hand")
    left = wait_for_obstacles(ready, 0, 1)
    tool = TaskFrame(*robot.forward(ready.arm))
    np.testing.assert_allclose(
        left.solids[0, :3], tool.points_to_base(np.array(held.position)[None])[0], atol=1e-3
    )  # fmt: skip


def test_what_cannot_be_attached_is_refused_and_the_arm_stands_until_it_is_known(ready):
    send(ready, attached=(attached("cup", SPHERE, link="panda_link5"),))
    ready.wait_for_code("BAD_INPUT", "attached to 'panda_link5'")
    send(ready, attached=(attached("cup", operation=REMOVE),))
    ready.wait_for_code("NO_GOAL")
    send(ready, attached=(attached("cup", SPHERE, at=pose(0.0, 0.0, 0.05)),))
    ready.wait(lambda: ready.status()["holding"] == "cup/0", "the cup in the hand")
