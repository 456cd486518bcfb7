"""How the planner keeps its rate while the goal moves: planner and twin as two processes, obstacles, a stream of goals.

Two rows in the same surroundings: the goal stays, and the goal jumps on a small circle many times a second, each time a
new query: the graph is transported anew, its obstacle-free field and the ridge's factors are found again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from visualization_msgs.msg import MarkerArray

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.nodes.demo_run import DemoError, Processes, isolated_environment
from geodesic_motion_ros.nodes.messages import pose_message, sphere_marker
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import text_table

#: Radius of the circle on which the goal jumps, and of the obstacles; how far those keep from the undisturbed way [m].
CIRCLE, OBSTACLE, BESIDE = 0.010, 0.03, 0.20
#: Times a second that the obstacles are told; seconds to wait for the nodes.
OBSTACLES_HZ, PATIENCE = 30.0, 60.0
_SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
_GREY = (0.5, 0.5, 0.5, 1.0)


@dataclass(frozen=True)
class RateRow:
    """What one stretch of the stream has shown: rates in Hz, durations in ms."""

    name: str
    rate: float
    tick_p50: float
    tick_p99: float
    misses: int
    goals: int
    ok_percent: float


def measure_goal_rate(
    skill: str, folder: Path, seconds: float = 8.0, goals_hz: float = 10.0, obstacles: int = 10, domain: int = 83
) -> list[RateRow]:
    """Stream goals to a planner that moves a twin, and read its rate off its own status.

    Parameters
    ----------
    seconds : length of each stretch; goals_hz : new goals a second in the second one; obstacles : how many.
    folder : parameter files and logs of the nodes go there.

    Raises
    ------
    ParameterError : a number that is not positive. DemoError : a node ends or does not answer.
    """
    if not (seconds > 0.0 and goals_hz > 0.0 and obstacles >= 0):
        raise ParameterError(f"seconds {seconds}, goals_hz {goals_hz}, obstacles {obstacles}: must be positive")
    known = Skill.load(skill)
    spheres = _beside_the_way(known, obstacles)
    rows = []
    for name, hertz in (("goal stays", 0.0), (f"goal moves {goals_hz:g} times a second", goals_hz)):
        with Processes(folder / name.replace(" ", "_"), isolated_environment(domain)) as processes:
            processes.start("twin", {"skill": skill})
            processes.start("planner", {"skill": skill, "latent_view_rate": 0.0})
            with _Stream(processes, known, spheres, domain) as stream:
                rows.append(stream.run(name, seconds, hertz))
    return rows


def table(rows: list[RateRow]) -> str:
    """The rows as plain text."""
    head = ["", "rate Hz", "tick p50 ms", "p99 ms", "misses", "goals", "OK %"]
    cells = [
        [row.name, row.rate, row.tick_p50, row.tick_p99, row.misses, row.goals, row.ok_percent] for row in rows
    ]
    return text_table(head, cells, digits=1)


def _beside_the_way(skill: Skill, count: int) -> np.ndarray:
    """Centres (count, 3) [m] of obstacles that are felt along the way and do not block it."""
    planner = ReactivePlanner(skill)
    plan = planner.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3]))
    assert plan.reference is not None
    random = np.random.default_rng(0)
    way = plan.reference.positions
    centres = []
    while len(centres) < count:
        aside = random.normal(size=3)
        centre = way[random.integers(len(way))] + BESIDE * aside / np.linalg.norm(aside)
        if np.linalg.norm(way - centre, axis=1).min() > 0.9 * BESIDE:
            centres.append(centre)
    return np.array(centres).reshape(-1, 3)


class _Stream:
    """Publishes goals and obstacles, and keeps the planner's status."""

    def __init__(self, processes: Processes, skill: Skill, spheres: np.ndarray, domain: int) -> None:
        self._processes, self._skill, self._spheres = processes, skill, spheres
        self._ticks: list[tuple[float, int, float, int, bool]] = []
        self._code = ""
        self._sent = 0
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("goal_rate", context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._goals = self._node.create_publisher(PoseStamped, "goal_pose", QoSProfile(depth=1))
        self._obstacles = self._node.create_publisher(MarkerArray, "obstacles", _SENSOR)
        self._node.create_subscription(DiagnosticArray, "planner/status", self._on_status, QoSProfile(depth=50))
        self._node.create_timer(1.0 / OBSTACLES_HZ, self._send_obstacles)

    def __enter__(self) -> _Stream:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def run(self, name: str, seconds: float, goals_hz: float) -> RateRow:
        """Wait for the planner, send the goal, or a stream of goals, and sum the ticks up."""
        self._wait(lambda: self._code == "NO_GOAL" and self._goals.get_subscription_count(), PATIENCE)
        self._ticks.clear()
        self._send_goal()
        if goals_hz > 0.0:
            self._node.create_timer(1.0 / goals_hz, self._send_goal)
        began = self._now()
        self._wait(lambda: self._now() - began > seconds, seconds + PATIENCE)
        stamps, numbers, durations, misses, fine = zip(*self._ticks, strict=True)
        p50, p99 = np.percentile(durations[1:], [50.0, 99.0])
        rate = (numbers[-1] - numbers[0]) / (stamps[-1] - stamps[0])
        counted = misses[-1] - misses[0]
        return RateRow(name, rate, float(p50), float(p99), counted, self._sent, 100.0 * float(np.mean(fine)))

    def _wait(self, condition: Any, patience: float) -> None:
        deadline = self._now() + patience
        while not condition():
            self._executor.spin_once(timeout_sec=0.05)
            self._processes.check()
            if self._now() > deadline:
                raise DemoError(f"waited {patience:g} s in vain; the planner says: {self._code or 'nothing'}")

    def _send_goal(self) -> None:
        angle = 2.4 * self._sent
        self._sent += 1
        shift = CIRCLE * np.array([math.cos(angle), math.sin(angle), 0.0]) if self._sent > 1 else np.zeros(3)
        goal, stamp = self._skill.goal_pose, self._node.get_clock().now().to_msg()
        self._goals.publish(pose_message(goal[:3] + shift, goal[3:], self._skill.base_frame, stamp))

    def _send_obstacles(self) -> None:
        stamp, frame = self._node.get_clock().now().to_msg(), self._skill.base_frame
        markers = [
            sphere_marker("obstacle", number, centre, OBSTACLE, _GREY, frame, stamp)
            for number, centre in enumerate(self._spheres)
        ]
        self._obstacles.publish(MarkerArray(markers=markers))

    def _on_status(self, message: DiagnosticArray) -> None:
        values = {pair.key: pair.value for pair in message.status[0].values}
        self._code = values["code"]
        figures = (int(values["tick"]), float(values["last_tick_ms"]), int(values["deadline_misses"]))
        if self._sent and (self._ticks or self._code != "NO_GOAL"):
            self._ticks.append((self._now(), *figures, self._code == "OK"))

    def _now(self) -> float:
        return 1e-9 * self._node.get_clock().now().nanoseconds
