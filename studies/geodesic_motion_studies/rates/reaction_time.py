"""From an obstacle's message to the trajectory that answers it, on the wire: a whole-arm skill, three processes.

The arm goes to and fro between the skill's ends. Again and again a sphere appears where the tool is about to be.
Nothing else changes, so the next trajectory that is not the same motion, published again to lead further, is the
answer: another path, or a stop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.messages import seconds
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.rates.planner_stream import PATIENCE, PlannerStream, no_spheres

#: The sphere's radius [m], how far ahead of the tool it appears [s], and for how long [s].
RADIUS, AHEAD, SHOWN = 0.05, 1.0, 0.4
#: Motions that are the same so far ahead [s], to rounding [rad], are the same.
_LOOKED_AT, _ROUNDING = 0.3, 1e-6
#: It takes the planner so long [s] to find that nothing blocks the path any more, and to say no more.
QUIET = 0.7


@dataclass(frozen=True)
class ReactionRow:
    """Times [ms] from message to trajectory at one rate of the planner [Hz]; not every sphere needs an answer."""

    rate: float
    spheres: int
    answered: int
    p50: float
    p99: float
    worst: float


class _Heard:
    """The newest trajectory, and when each one came [s] that was another motion than the one before."""

    def __init__(self, stream: PlannerStream) -> None:
        self._stream = stream
        self.message = JointTrajectory()
        self.times: list[float] = []
        stream.node.create_subscription(
            JointTrajectory, "joint_trajectory", self._on_trajectory, QoSProfile(depth=5), raw=True
        )

    def _on_trajectory(self, wire: bytes) -> None:
        # What it takes to make Python objects of hundreds of knots is not the planner's time.
        came = self._stream.now()
        before, self.message = self.message, deserialize_message(wire, JointTrajectory)
        if not before.points or _apart(before, self.message, came + _LOOKED_AT) > _ROUNDING:
            self.times.append(came)

    def left(self) -> float:
        """How much of what was sent is still to come [s]."""
        if not self.message.points:
            return 0.0
        end = seconds(self.message.header.stamp) + seconds(self.message.points[-1].time_from_start)
        return end - self._stream.now()

    def tool_at(self, time: float, robot: Robot) -> np.ndarray:
        """Where the tool is to be (3,) [m] at the first waypoint after a time [s], or where a shorter motion ends."""
        begin, points = seconds(self.message.header.stamp), self.message.points
        point = next((point for point in points if begin + seconds(point.time_from_start) >= time), points[-1])
        return end_effector_poses(np.array(point.positions)[None], robot.chain)[0][0]


def _apart(one: JointTrajectory, other: JointTrajectory, time: float) -> float:
    """How far apart [rad] two trajectories are at a time [s], in the joint where it is most."""
    first, second = (_reference(message).sample(time - seconds(message.header.stamp))[0] for message in (one, other))
    return float(np.max(np.abs(first - second)))


def _reference(message: JointTrajectory) -> JointReference:
    """The motion that a trajectory of the planner tells."""
    times = np.array([seconds(point.time_from_start) for point in message.points])
    columns = (
        np.array([getattr(point, name) for point in message.points])
        for name in ("positions", "velocities", "accelerations")
    )
    return JointReference(times, *columns, np.zeros((len(times), 0)))


def measure_reaction(
    skill: str, folder: Path, rates: Sequence[float] = (100.0,), spheres: int = 100, domain: int = 84
) -> list[ReactionRow]:
    """Show spheres to a planner that moves a twin, and time its answers, at one rate after the other.

    Raises
    ------
    ParameterError : a number that is not positive, or a skill that is not of joint space.
    DemoError : a node ends or does not answer.
    """
    if not (spheres > 0 and rates and min(rates) > 0.0):
        raise ParameterError(f"spheres {spheres}, rates {list(rates)}: must be positive")
    if Skill.load(skill).space != "joint":
        raise ParameterError(f"skill {skill} streams poses: reactions are timed on a skill of joint space")
    rows = []
    for rate in rates:
        with PlannerStream(skill, folder / f"reaction_{rate:g}_hz", rate, domain) as stream:
            rows.append(reaction_row(rate, spheres, answers(stream, spheres, _Shown(stream).show)))
    return rows


def reaction_row(rate: float, spheres: int, times: Sequence[float]) -> ReactionRow:
    """Sum up the times [s] of answers."""
    milliseconds = 1e3 * np.array(times)
    p50, p99, worst = np.percentile(milliseconds, [50.0, 99.0, 100.0]) if len(times) else np.full(3, np.nan)
    return ReactionRow(rate, spheres, len(times), p50, p99, worst)


def table(rows: list[ReactionRow]) -> str:
    """The rows as plain text."""
    head = ["planner Hz", "spheres shown", "answered", "message to trajectory p50 ms", "p99 ms", "max ms"]
    cells = [[row.rate, row.spheres, row.answered, row.p50, row.p99, row.worst] for row in rows]
    return text_table(head, cells, digits=1)


@dataclass
class _Shown:
    """A sphere that the stream shows as an obstacle of its own: the same one would be taken for a very fast one."""

    stream: PlannerStream

    def show(self, place: np.ndarray | None) -> None:
        """Show it at a place (3,) [m]; None: no longer."""
        if place is None:
            self.stream.spheres = no_spheres
            return
        self.stream.first_number += 1
        self.stream.spheres = lambda _: (place[None], np.array([RADIUS]))
        self.stream.tell_spheres()


def answers(stream: PlannerStream, count: int, show: Callable[[np.ndarray | None], None]) -> list[float]:
    """Return the times [s] from a sphere that is shown to the next trajectory, where one comes meanwhile.

    count : how many spheres. show : shows one where it is handed a place (3,) [m], and none where it is handed None.
    """
    heard, robot = _Heard(stream), Robot.named(stream.skill.robot)
    goals = [stream.skill.goal_pose, stream.skill.start_pose]
    found = []
    for _ in range(count):
        if not stream.time_to_goal >= AHEAD + SHOWN:
            stream.wait(lambda: heard.left() <= 0.0, PATIENCE)
            before = len(heard.times)
            stream.send_goal(*np.split(goals[0], [3]))
            stream.wait(lambda before=before: len(heard.times) > before, PATIENCE)
            goals.reverse()
            stream.spend(QUIET)
        place = heard.tool_at(stream.now() + AHEAD, robot)
        before = len(heard.times)
        shown = stream.now()
        show(place)
        stream.spend(SHOWN)
        found += [time - shown for time in heard.times[before : before + 1]]
        show(None)
        stream.spend(QUIET)
    return found
