"""What is commanded of an arm never steps: planner and twin, and a wire between them that has flaws of real ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bench import STEP, Bench
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt32
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode

#: A servo leaves the arm so far beside its command [rad].
OFF = np.array([0.001, -0.003, 0.002, 0.0, 0.001, 0.0, 0.0])


class Wire:
    """Hands messages over between the planner and a twin in the namespace /arm.

    off : (7,) [rad] the joints are measured beside where they are. tells : whether what the drive commands is handed
    over. late : [s] so much later, by the nodes' clock, within a step of it. known : whether messages of the arm are
    late, too.
    """

    def __init__(
        self,
        bench: Bench,
        off: np.ndarray | None = None,
        tells: bool = True,
        late: float = 0.0,
        known: bool = True,
    ) -> None:
        self._bench = bench
        self._held: deque[tuple[float, Any, Any]] = deque()
        back = late if known else 0.0
        self._hand_over(JointState, "arm/joint_states", "joint_states", back, lambda message: _moved(message, off))
        if tells:
            self._hand_over(JointState, "arm/commanded_joint_states", "commanded_joint_states", back)
        self._hand_over(JointTrajectory, "joint_trajectory", "arm/joint_trajectory", late)
        if late:
            bench.repeat(STEP, self._deliver)

    def _hand_over(
        self,
        kind: type,
        source: str,
        target: str,
        late: float,
        change: Callable[[Any], Any] = lambda message: message,
    ) -> None:
        publisher = self._bench.probe.create_publisher(kind, target, 10)

        def hand_over(message: Any) -> None:
            if late:
                self._held.append((self._bench.now() + late, publisher, change(message)))
            else:
                publisher.publish(change(message))

        self._bench.probe.create_subscription(kind, source, hand_over, 50)

    def _deliver(self) -> None:
        while self._held and self._held[0][0] <= self._bench.now():
            _, publisher, message = self._held.popleft()
            publisher.publish(message)


def _moved(message: JointState, off: np.ndarray | None) -> JointState:
    if off is not None:
        message.position = (np.array(message.position) + off).tolist()
    return message


@pytest.fixture
def options(skill_folder):
    """A planner for a busy machine."""
    return {
        "skill": str(skill_folder), "state_timeout": 5.0, "resume_timeout": 60.0, "latency": 0.1,
        "latent_view_rate": 0.0,
    }  # fmt: skip


@pytest.fixture
def arm(bench, start_joints):
    """A bench with a twin in the namespace /arm, at the start of the skill."""
    bench.watch_planner()
    bench.listen_to_log()
    bench.listen(UInt32, "arm/twin/discontinuities")
    bench.listen(JointTrajectory, "joint_trajectory")
    bench.listen(JointState, "arm/commanded_joint_states")
    bench.add(TwinNode, namespace="/arm", initial_joint_positions=start_joints.tolist())
    return bench


def arrive(bench: Bench, goal: np.ndarray) -> None:
    bench.wait(lambda: bench.status().get("code") == "NO_GOAL", "a planner that knows of the arm")
    bench.send_goal(goal)
    bench.wait(lambda: bench.status()["code"] == "OK" and bench.at_goal(), "rest at the goal")


def steps(bench: Bench) -> int:
    """How often what the twin was to do has stepped, up to now."""
    return bench.heard["arm/twin/discontinuities"][-1].data


@pytest.mark.parametrize("tells", [False, True], ids=["control: the drive says nothing", "the drive says where"])
def test_motions_begin_where_the_drive_commands_an_arm_that_rests_beside_it(arm, options, skill, start_joints, tells):
    Wire(arm, off=OFF, tells=tells)
    arm.add(PlannerNode, **options)
    # The drive may be heard a moment after the joints.
    said = "3.00 mrad in 'panda_joint2' from where it is measured" if tells else "nothing is heard of what the drive"
    arm.wait(lambda: arm.logged(said), "where motions begin, in the log")
    before = len(arm.heard["joint_trajectory"])
    arrive(arm, skill.goal_pose)
    # Without a word of the drive it may be that the trajectory arrives before its begin, and the twin leads over to it.
    assert steps(arm) == 0 or not tells
    first = np.array(arm.heard["joint_trajectory"][before].points[0].positions)
    np.testing.assert_allclose(first, start_joints + (0.0 if tells else OFF), atol=1e-5)
    stays = "at rest the arm stays 3.0 mrad in 'panda_joint2' from where it is commanded"
    arm.wait(lambda: stays in arm.status()["reason"], "the steady error")
    arm.wait(lambda: arm.logged(stays), "the steady error in the log")
    assert float(arm.status()["steady_error_mrad"]) == pytest.approx(3.0, abs=0.1)
    assert arm.status()["steady_error_joint"] == "panda_joint2"


@pytest.mark.parametrize("known", [False, True], ids=["control: that is not known", "that is measured"])
def test_takeovers_give_no_step_though_trajectories_arrive_late(arm, options, skill, known):
    """By 0.16 s, more than the latency, as goals change in motion; the twin counts steps, as an arm does by itself."""
    Wire(arm, late=0.16, known=known)
    arm.add(PlannerNode, **options)
    arm.wait(lambda: arm.status().get("code") == "NO_GOAL", "a planner that knows of the arm")
    for number in range(6):
        goal = skill.goal_pose.copy()
        goal[1] += 0.02 * (-1) ** number
        arm.send_goal(goal)
        arm.wait(lambda number=number: arm.status()["goal_number"] == str(number + 1), "the goal at the planner")
        arm.live(0.5)
    arm.wait(lambda: arm.status()["code"] == "OK" and arm.at_goal(), "rest at the goal")
    assert (steps(arm) == 0) == known
    if known:
        assert float(arm.status()["takeover_delay"]) == pytest.approx(0.15)
        assert arm.status()["trajectories_not_taken"] == "0"
