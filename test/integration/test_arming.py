"""The planner of a real arm, on a twin: unarmed it shows, armed it moves, and after a surprise it is armed anew."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode


@pytest.fixture
def options(skill_folder):
    """A planner to be armed by hand, on a busy machine."""
    return {
        "skill": str(skill_folder), "state_timeout": 5.0, "resume_timeout": 60.0, "latency": 0.1,
        "latent_view_rate": 0.0, "armed": False, "required_obstacle_topics": ["none"],
    }  # fmt: skip


@pytest.fixture
def unarmed(bench, options, start_joints):
    """A bench with a twin, and a planner that knows of it and is not armed."""
    bench.watch_planner()
    bench.listen_to_log()
    bench.listen(JointTrajectory, "joint_trajectory")
    bench.listen(Path, "path")
    bench.listen(PoseStamped, "ee_pose")
    bench.add(TwinNode, initial_joint_positions=start_joints.tolist())
    bench.planner = bench.add(PlannerNode, **options)
    bench.wait_for_code("NO_GOAL")
    return bench


def arm(bench, armed: bool = True) -> SetBool.Response:
    return bench.call(SetBool, "planner/arm", SetBool.Request(data=armed))


def place(bench) -> np.ndarray:
    point = bench.heard["ee_pose"][-1].pose.position
    return np.array([point.x, point.y, point.z])


def turned(bench, start: np.ndarray) -> float:
    """How far the arm has turned a joint since the start, at most [rad]."""
    return float(np.max(np.abs(bench.planner.inputs.arm.joints - start)))


def test_unarmed_it_shows_the_path_and_armed_it_moves_with_the_next_goal(unarmed, skill):
    unarmed.send_goal(skill.goal_pose)
    unarmed.wait_for_code("HOLD_REQUESTED", "not armed: nothing is commanded; call ~/arm with data: true")
    shown = unarmed.wait(lambda: [path for path in unarmed.heard["path"] if path.poses], "the path")[-1]
    end = shown.poses[-1].pose.position
    np.testing.assert_allclose([end.x, end.y, end.z], skill.goal_pose[:3], atol=1e-3)
    unarmed.live(1.0)
    assert not unarmed.heard["joint_trajectory"]
    answer = arm(unarmed)
    assert (answer.success, answer.message) == (True, "armed: the arm moves with the next goal")
    unarmed.wait_for_code("NO_GOAL", "~/arm was called with true; send the goal again")
    unarmed.live(0.5)
    assert not unarmed.heard["joint_trajectory"]
    unarmed.send_goal(skill.goal_pose)
    unarmed.wait(lambda: np.linalg.norm(place(unarmed) - skill.goal_pose[:3]) < 0.003, "the arm at the goal")
    unarmed.wait(lambda: unarmed.logged("no longer NO_GOAL: OK"), "why it moves, in the log")


@pytest.mark.parametrize(
    ("surprise", "why"),
    [
        ("arm", "~/arm was called with false"),
        ("clear", "~/clear_obstacles was called"),
        ("reset", "from where it was sent"),
    ],
)
def test_in_motion_it_is_disarmed_and_moves_no_more_before_it_is_armed_anew(
    unarmed, skill, start_joints, surprise, why
):
    """By a person, by a person who clears obstacles, and by an arm that is found elsewhere."""
    arm(unarmed)
    unarmed.send_goal(skill.goal_pose)
    # An arm that was reset is found elsewhere where it has come farther than the tolerance, 0.1 rad.
    unarmed.wait(lambda: turned(unarmed, start_joints) > 0.3, "an arm in motion")
    if surprise == "arm":
        assert arm(unarmed, False).message.startswith("disarmed: the arm brakes")
    else:
        topic = "planner/clear_obstacles" if surprise == "clear" else "twin/reset"
        assert unarmed.call(Trigger, topic, Trigger.Request()).success
    unarmed.wait(lambda: unarmed.logged("disarmed: "), "that it is disarmed, in the log")
    assert why in unarmed.logged("disarmed: ")[0]
    unarmed.wait_for_code("NO_GOAL")
    unarmed.wait(unarmed.at_rest, "rest")
    unarmed.live(1.0)
    sent = len(unarmed.heard["joint_trajectory"])
    unarmed.send_goal(skill.goal_pose)
    unarmed.wait_for_code("HOLD_REQUESTED", why)
    unarmed.live(0.5)
    assert len(unarmed.heard["joint_trajectory"]) == sent
    arm(unarmed)
    unarmed.wait_for_code("NO_GOAL", "~/arm was called with true")
    unarmed.send_goal(skill.goal_pose)
    unarmed.wait(lambda: np.linalg.norm(place(unarmed) - skill.goal_pose[:3]) < 0.003, "the arm at the goal")


def test_it_is_not_armed_before_it_is_said_what_must_be_heard_of_obstacles(bench, options, start_joints):
    bench.watch_planner()
    bench.add(PlannerNode, **options | {"required_obstacle_topics": [""]})
    answer = arm(bench)
    assert not answer.success
    assert "required_obstacle_topics names nothing" in answer.message
    assert "['none']" in answer.message
