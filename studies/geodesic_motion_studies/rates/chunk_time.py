"""From a chunk's message to the command that plays it, on the wire: sender, filter and twin as processes of their own.

The sender offers a slow motion to and fro, each chunk half a second of it, thirty points a second, at once. Every chunk
makes the filter send another trajectory; the next one that is heard is the answer. The other row is a node that
forwards chunks as they are (`forwarder`): the floor of DDS and Python. Times end when the trajectory is heard.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.demo.demo_run import DemoError, Processes, isolated_environment
from geodesic_motion_ros.nodes.stolen_time import StolenTime
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table

#: The arm; how far its joints go [rad] and in which time to and fro [s]; what a chunk holds of that [s], at what rate.
ROBOT, FAR, ROUND, AHEAD, POINTS_HZ = "panda", 0.15, 4.0, 0.5, 30.0
#: To wait for nodes [s].
PATIENCE = 90.0
_MODULES = {"filter": "", "forwards": "geodesic_motion_studies.rates.forwarder"}


@dataclass(frozen=True)
class ChunkRow:
    """Times [ms] from chunk to command; the rate of the filter's cycles meanwhile [Hz], how many missed their deadline,
    and the share of the processor that was taken from this machine.
    """

    name: str
    chunks_hz: float
    chunks: int
    answered: int
    p50: float
    p99: float
    worst: float
    rate: float
    misses: int
    stolen_percent: float


def measure_chunks(folder: Path, hertz: float = 50.0, chunks: int = 1000, domain: int = 85) -> list[ChunkRow]:
    """Offer so many chunks to a filter, so many a second, and to a node that forwards them.

    Raises
    ------
    ParameterError : a number that is not positive. DemoError : a node ends or does not answer.
    """
    if not (hertz > 0.0 and chunks > 0):
        raise ParameterError(f"hertz {hertz}, chunks {chunks}: must be positive")
    return [_measure(name, folder, hertz, chunks, domain) for name in _MODULES]


def table(rows: list[ChunkRow]) -> str:
    """The rows as plain text."""
    head = [
        "node", "chunks a second", "chunks", "answered", "chunk to command p50 ms", "p99 ms", "max ms", "cycles Hz",
        "misses", "stolen %",
    ]  # fmt: skip
    return text_table(head, [list(astuple(row)) for row in rows], digits=1)


class _Sender:
    """Publishes chunks, and notes when the next command was heard after each."""

    def __init__(self, processes: Processes, domain: int) -> None:
        self._processes, self._domain = processes, domain
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("chunk_sender", context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._robot = Robot.named(ROBOT)
        self._chunks = self._node.create_publisher(JointTrajectory, "filter/joint_trajectory", QoSProfile(depth=10))
        self._node.create_subscription(JointTrajectory, "joint_trajectory", self._hear, QoSProfile(depth=10), raw=True)
        self._node.create_subscription(DiagnosticArray, "filter/status", self._on_status, QoSProfile(depth=50))
        self._sent: list[float] = []
        self.answers: dict[int, float] = {}
        self.status: dict[str, str] = {}

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def wait(self, condition: Callable[[], object], patience: float = PATIENCE) -> None:
        deadline = time.monotonic() + patience
        while not condition():
            self._executor.spin_once(timeout_sec=0.002)
            self._processes.check()
            if time.monotonic() > deadline:
                raise DemoError(f"timed out after {patience:g} s; the filter says: {self.status.get('code')}")

    @property
    def is_heard(self) -> bool:
        return bool(self._chunks.get_subscription_count())

    def offer(self, hertz: float, count: int) -> None:
        """Offer so many chunks, so many a second."""
        self._sent.clear()
        self.answers.clear()
        begin = time.monotonic()
        for number in range(count):
            self.wait(lambda number=number: time.monotonic() >= begin + number / hertz)
            chunk = self._chunk(time.monotonic() - begin)
            self._sent.append(time.monotonic())
            self._chunks.publish(chunk)
        self.wait(lambda: len(self.answers) == count or time.monotonic() > begin + count / hertz + 0.2)

    def _chunk(self, now: float) -> bytes:
        ahead = np.arange(round(AHEAD * POINTS_HZ) + 1) / POINTS_HZ
        turn = 2.0 * np.pi / ROUND
        moved = FAR * (1.0 - np.cos(turn * (now + ahead)))[:, None] * np.ones(len(self._robot.ready))
        speeds = FAR * turn * np.sin(turn * (now + ahead))[:, None] * np.ones(len(self._robot.ready))
        positions = self._robot.ready + moved * np.sign(-self._robot.ready + 1e-9)
        velocities = speeds * np.sign(-self._robot.ready + 1e-9)
        # Accelerations are not looked at. A stamp of 0: at once.
        still = np.zeros_like(positions)
        return joint_trajectory_bytes(self._robot.joint_names, ahead, positions, velocities, still, 0)

    def _hear(self, _: bytes) -> None:
        if self._sent:
            self.answers.setdefault(len(self._sent), time.monotonic() - self._sent[-1])

    def _on_status(self, message: DiagnosticArray) -> None:
        self.status = {pair.key: pair.value for pair in message.status[0].values}


def _measure(name: str, folder: Path, hertz: float, chunks: int, domain: int) -> ChunkRow:
    is_filter = name == "filter"
    with Processes(folder / f"chunks_{name}", isolated_environment(domain)) as processes:
        ready = Robot.named(ROBOT).ready.tolist()
        processes.start("twin", {"robot": ROBOT, "skill": "", "initial_joint_positions": ready})
        if is_filter:
            processes.start("filter", {"robot": ROBOT, "scene": "none"})
        else:
            processes.run(name, [sys.executable, "-m", _MODULES[name]])
        sender = _Sender(processes, domain)
        try:
            received = "commands_received_by"
            sender.wait(lambda: sender.is_heard and (not is_filter or sender.status.get(received)))
            sender.wait(lambda: not is_filter or sender.status["code"] == "NO_GOAL")
            # The first ones are not measured.
            sender.offer(hertz, round(2.0 * hertz))
            before, began, stolen = dict(sender.status), time.monotonic(), StolenTime()
            sender.offer(hertz, chunks)
            passed, taken = time.monotonic() - began, stolen.percent()
        finally:
            sender.close()
    answers = 1e3 * np.array(list(sender.answers.values()))
    p50, p99, worst = np.percentile(answers, [50.0, 99.0, 100.0]) if len(answers) else np.full(3, np.nan)
    if not is_filter:
        return ChunkRow(name, hertz, chunks, len(answers), p50, p99, worst, math.nan, 0, taken)
    ticks, misses = (int(sender.status[key]) - int(before[key]) for key in ("tick", "deadline_misses"))
    return ChunkRow(name, hertz, chunks, len(answers), p50, p99, worst, ticks / passed, misses, taken)
