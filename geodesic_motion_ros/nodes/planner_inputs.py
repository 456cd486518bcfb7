"""Everything the planner node hears: callbacks check and store, the control cycle takes a snapshot."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.filtering.offer import OfferRequest
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.nodes.arm_state import ArmState
from geodesic_motion_ros.nodes.arming import Arming
from geodesic_motion_ros.nodes.cycle import CycleInputs
from geodesic_motion_ros.nodes.delivery import TransitWatch, stamp_of
from geodesic_motion_ros.nodes.described_arm import DescribedArm
from geodesic_motion_ros.nodes.drive_watch import DRIVE_TOPIC
from geodesic_motion_ros.nodes.listener import Listener
from geodesic_motion_ros.nodes.messages import MessageRefused, read_joint_positions, read_pose, seconds
from geodesic_motion_ros.nodes.obstacle_inputs import ObstacleInputs
from geodesic_motion_ros.nodes.parameters import NodeParameters
from geodesic_motion_ros.nodes.publishers import LATCHED
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.planning.streaming_planner import StreamingPlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import SelfFilter

# A joint state that was lost is replaced by the next one. The queue is short, but a message to be refused must not push
# out the good one before it.
RECENT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
GOALS = QoSProfile(depth=10)


#: Goals wait in one queue for transforms: the newest counts, whichever topic it came on.
_GOAL = "goal"
#: Goals with this frame id are relative to the task frame, and move with it.
TASK_FRAME = "task_frame"


class PlannerInputs:
    """The subscriptions of the planner and what they have brought.

    Callbacks run in the executor and hold a lock for microseconds; `snapshot` is called by the control loop, which
    reads the joint states that have come.

    Attributes
    ----------
    listener : what all inputs share. obstacles : what is heard of obstacles, and of what the hand holds.
    arming : whether the arm may be commanded.
    arm : what the joint states say. drive : what the arm's drive says that it commands.
    noun : what a person calls that which the node is asked for.
    """

    noun = StreamingPlanner.noun

    def __init__(
        self,
        node: Node,
        parameters: NodeParameters,
        robot: Robot,
        skill_robot: str,
        changed: Callable[[], None],
        armed: bool = True,
    ) -> None:
        """robot : its names are those of messages; skill_robot : what the arm is called.
        changed : called when something new is known of obstacles, or is offered, from the thread that heard it.
        armed : as of `Arming`.
        """
        self._parameters, self._robot, self._changed = parameters, robot, changed
        self.listener = Listener(node, parameters)
        self.refusals = self.listener.refusals
        self._lock = threading.Lock()
        self.arming = Arming(armed, parameters["required_obstacle_topics"], self.noun)
        self._described = DescribedArm(robot, skill_robot, node.resolve_topic_name("robot_description"))
        self.arm = ArmState(robot, self.refusals, parameters["joint_prefix"])
        self._transit = TransitWatch()
        self.drive = ArmState(robot, self.refusals, parameters["joint_prefix"], DRIVE_TOPIC)
        self._goal: GoalRequest | OfferRequest | Refusal | None = None
        self._goal_number = 0
        self._withdrawn = 0, ""
        self._task_frame: tuple[np.ndarray, np.ndarray] | None = None
        self._task_frame_taken: float | None = None
        self._hold = False
        self._publishers: tuple[str, ...] = ()
        self._subscribers: tuple[str, ...] | None = None
        for topic, receive in (("joint_states", self.on_joint_states), (DRIVE_TOPIC, self.on_drive)):
            node.create_subscription(JointState, topic, receive, RECENT, raw=True)
        describe = lambda message: self._described.receive(message.data)  # noqa: E731
        self.listener.subscribe(String, "robot_description", describe, LATCHED)
        self._subscribe_goals()
        self_filter = SelfFilter(robot, CollisionModel.named(skill_robot))
        self.obstacles = ObstacleInputs(self.listener, robot, self.arm, self_filter, self.arming.required, changed)

    def start(self) -> None:
        """Begin to look at point clouds."""
        self.obstacles.clouds.start()

    def stop(self) -> None:
        """End the thread that does so; harmless when it has ended or never began."""
        self.obstacles.clouds.stop()

    def snapshot(self) -> CycleInputs:
        """Return what is known now."""
        self.arm.update()
        self.drive.update()
        moment = self.listener.time.read()
        now = moment.running
        joints, age = self.arm.joints, now - self.arm.taken
        with self._lock:
            goal, number, hold, withdrawn = self._goal, self._goal_number, self._hold, self._withdrawn
            transit = self._transit.longest(now)
            task_frame = self._task_frame
            publishers, subscribers = self._publishers, self._subscribers
        return CycleInputs(
            measured=joints,
            state_age=age,
            goal=goal,
            goal_number=number,
            hold=hold,
            task_frame=task_frame,
            publishers=publishers,
            subscribers=subscribers,
            now=moment.now,
            has_clock=moment.has_clock,
            clock_stood=moment.stood,
            heard=now,
            simulated=moment.simulated,
            set_by=moment.set_by,
            state_fault=self.arm.fault(now),
            drive=self.drive.joints,
            drive_age=now - self.drive.taken,
            transit=transit,
            unarmed=self.arming.unarmed,
            withdrawn=withdrawn,
            other_arm=self._described.fault,
            **self.obstacles.known(now)._asdict(),
        )

    def ages(self) -> dict[str, float]:
        """Return the seconds since the newest data of each input was taken."""
        now = self.listener.time.running()
        ages = self.obstacles.ages(now)
        if self.arm.joints is not None:
            ages["joint_states"] = now - self.arm.taken
        if self.drive.joints is not None:
            ages[DRIVE_TOPIC] = now - self.drive.taken
        with self._lock:
            if self._task_frame_taken is not None:
                ages["task_frame"] = now - self._task_frame_taken
        return ages

    def remarks(self) -> dict[str, str]:
        """Return what a person should know of inputs that are taken, by kind; to be asked once a second."""
        now = self.listener.time.running()
        remarks = self.arm.remarks(now, self._parameters["state_timeout"])
        with self._lock:
            late = self._transit.remark(now)
        remarks |= {"late": late} if late else {}
        return remarks | ({"description": self._described.remark} if self._described.remark else {})

    def request_hold(self, hold: bool) -> None:
        """Take the request of a hold, or of its end."""
        with self._lock:
            self._hold = hold

    def set_nodes_on_commands(self, publishers: tuple[str, ...], subscribers: tuple[str, ...]) -> None:
        """Say which nodes publish the commands, and which receive them."""
        with self._lock:
            self._publishers, self._subscribers = publishers, subscribers

    def _subscribe_goals(self) -> None:
        """Hear where the arm is to go."""
        origin = np.array(self._parameters["task_frame"])
        self._task_frame = origin[:3], origin[3:]
        self.listener.subscribe(PoseStamped, "goal_pose", self._on_goal, GOALS, _GOAL)
        self.listener.subscribe(JointState, "goal_joints", self._on_goal_joints, GOALS, _GOAL)
        self.listener.subscribe(PoseStamped, "task_frame", self.on_task_frame, GOALS)

    def on_joint_states(self, message: bytes) -> None:
        """Take a serialised JointState."""
        moment = self.listener.time.read()
        self.arm.receive(message, moment)
        with self._lock:
            self._transit.take(stamp_of(message), moment)

    def on_drive(self, message: bytes) -> None:
        """Take a serialised JointState of what the drive commands."""
        self.drive.receive(message, self.listener.time.read())

    def request_goal(self, topic: str, message: PoseStamped | JointState, numbered: Callable[[int], None]) -> None:
        """Take a goal as if it came on a topic; only the thread that spins the node calls this. numbered : called with
        its number, whether it is refused or not.
        """
        take = {"goal_pose": self._on_goal, "goal_joints": self._on_goal_joints}[topic]

        def receive() -> None:
            with self.refusals.guard(topic):
                take(message, numbered)

        self.listener.late.take(_GOAL, receive)

    def withdraw_goal(self, number: int, why: str) -> None:
        """Have a goal dropped, by its number, where it is still what the planner goes to."""
        with self._lock:
            self._withdrawn = number, why

    def _on_goal(self, message: PoseStamped, numbered: Callable[[int], None] = lambda _: None) -> None:
        in_task_frame = message.header.frame_id == TASK_FRAME
        if not in_task_frame:
            self.listener.late.need([message.header])
        try:
            frame = TASK_FRAME if in_task_frame else self.listener.base_frame
            pose = Pose(*read_pose(message, frame, self.listener.frames))
        except MessageRefused as error:
            numbered(self._set_goal(Refusal(VerdictCode.BAD_INPUT, f"goal_pose: {error}")))
            raise
        numbered(self._set_goal(GoalRequest(pose, in_task_frame)))

    def _on_goal_joints(self, message: JointState, numbered: Callable[[int], None] = lambda _: None) -> None:
        try:
            goal = GoalRequest(configuration=read_joint_positions(message, self._robot.joint_names))
        except MessageRefused as error:
            numbered(self._set_goal(Refusal(VerdictCode.BAD_INPUT, f"goal_joints: {error}")))
            raise
        numbered(self._set_goal(goal))

    def _set_goal(self, goal: GoalRequest | OfferRequest | Refusal) -> int:
        """Take a goal, and return its number."""
        with self._lock:
            self._goal = goal
            self._goal_number += 1
            return self._goal_number

    def on_task_frame(self, message: PoseStamped) -> None:
        """Take the pose of the task frame."""
        self.listener.late.need([message.header])
        frame = read_pose(message, self.listener.base_frame, self.listener.frames)
        moment = self.listener.time.read()
        with self._lock:
            self._task_frame = frame
            self._task_frame_taken = moment.running - max(0.0, moment.transit(seconds(message.header.stamp)))
