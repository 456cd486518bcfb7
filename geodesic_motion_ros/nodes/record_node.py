"""Node `record`: one demonstration for each key press, or service call, out of the joint states of any driver."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from geodesic_motion_ros.demonstrations.message_samples import JointSamples
from geodesic_motion_ros.demonstrations.take_folder import TakeFolder
from geodesic_motion_ros.nodes.joint_watch import JointWatch
from geodesic_motion_ros.nodes.keys import Keys
from geodesic_motion_ros.nodes.messages import MessageRefused
from geodesic_motion_ros.nodes.parameter_tables import RECORD
from geodesic_motion_ros.nodes.parameters import NodeParameters
from geodesic_motion_ros.nodes.publishers import publishers_of
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.running import STEADY, LoopingNode, run_node
from geodesic_motion_ros.nodes.usage import PROGRAMS
from geodesic_motion_ros.utils.errors import DemonstrationError

# None may be lost while a take is judged: at 1 kHz those of some seconds. Drivers of either reliability are received.
_EVERY = QoSProfile(depth=5000, reliability=ReliabilityPolicy.BEST_EFFORT)
_KEYS_EVERY, _PROGRESS_EVERY = 0.05, 1.0
_KEYS = "space or enter begins and ends a take, d deletes the last one, q quits"
_SERVICES = "~/begin, ~/end, ~/delete_last"


class RecordNode(LoopingNode):
    """A node that records takes into a folder that `inspect` and `train` read.

    A take begins where joint states arrive that have all joints and stamps that go on, and is judged at its end
    (`TakeFolder.keep`); what it came to is logged, and answered, in one line. One that is not ended is never written.

    Raises
    ------
    ParameterError, RobotError, DemonstrationError : a parameter, the robot, or a file in the folder cannot be used.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("record", **node_options)

    def _build(self) -> None:
        values = NodeParameters(self, RECORD)
        self._folder = TakeFolder(Path(values["folder"]), values["robot"], values["joint_prefix"])
        self._watch = JointWatch(self._folder.joint_names)
        self._samples: JointSamples | None = None
        self._began = 0.0
        self._keys: Keys | None = None
        self._refusals = RefusalLog(self.get_logger().warning)
        # keys that are pressed twice within a second are answered twice
        self._requests = RefusalLog(self.get_logger().warning, quiet=0.0)
        self._joint_states = self.create_subscription(JointState, "joint_states", self._on_joint_states, _EVERY)
        for name, work in (("begin", self._begin), ("end", self._end), ("delete_last", self._delete_last)):
            self.create_service(Trigger, f"~/{name}", self._serving(f"~/{name}", work))
        self.create_timer(_PROGRESS_EVERY, self._show_progress, clock=STEADY)
        self.create_timer(_KEYS_EVERY, self._read_keys, clock=STEADY)

    def _introduction(self) -> str:
        return (
            f"ready: takes of {self._joint_states.topic_name} go into {self._folder.folder}, where "
            f"{len(self._folder)} stand; {_KEYS} (in a terminal), or services {_SERVICES}"
        )

    def start(self) -> None:
        """Take the keys of the terminal."""
        self._keys = Keys()

    def stop(self) -> None:
        """Give the terminal back; what is recorded of a take that has not ended is dropped. Harmless when done before.
        """
        if self._keys is not None:
            self._keys.close()
        if self._samples is not None:
            self.get_logger().warning(
                f"{self._folder.next_name} had not ended: its {self._lasted():.1f} s are dropped, nothing of it was "
                f"written; {len(self._folder)} takes stand in {self._folder.folder}"
            )
            self._samples = None

    def _on_joint_states(self, message: JointState) -> None:
        with self._refusals.guard("joint_states"):
            self._watch.receive(message, time.monotonic())
            if self._samples is not None:
                self._samples.add(self.get_clock().now().nanoseconds, message)

    def _serving(self, name: str, work: Callable[[], str]) -> Callable[[Any, Any], Any]:
        def serve(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            return self._do(name, work, response)

        return serve

    def _do(self, name: str, work: Callable[[], str], response: Trigger.Response) -> Trigger.Response:
        """Do what was requested by a service or a key, and log what came of it."""

        def refusing() -> str:
            try:
                return work()
            except DemonstrationError as error:
                raise MessageRefused(str(error)) from error

        self._requests.answer(name, response, refusing)
        if response.success:
            self.get_logger().info(response.message)
        return response

    def _begin(self) -> str:
        if self._samples is not None:
            raise MessageRefused(f"{self._folder.next_name} is being recorded: end it first")
        if self.get_clock().ros_time_is_active and self.get_clock().now().nanoseconds == 0:
            raise MessageRefused("use_sim_time is true and nothing arrives on /clock: start the simulation first")
        self._refuse_silence()
        self._samples, self._began = JointSamples(self._folder.joint_names), time.monotonic()
        return f"recording {self._folder.next_name}"

    def _end(self) -> str:
        if self._samples is None:
            raise MessageRefused("no take is being recorded: begin one first")
        samples, self._samples = self._samples, None
        try:
            self._refuse_silence()
            return self._folder.keep(samples)
        except (MessageRefused, DemonstrationError) as error:
            raise MessageRefused(f"{error}; nothing of {self._folder.next_name} is written") from error

    def _delete_last(self) -> str:
        if self._samples is not None:
            raise MessageRefused(f"{self._folder.next_name} is being recorded: end it first")
        return self._folder.delete_last()

    def _refuse_silence(self) -> None:
        if objection := self._watch.objection(time.monotonic()):
            topic = self._joint_states.topic_name
            names = " and ".join(publishers_of(self, topic)) or "nobody: start the driver"
            raise MessageRefused(f"{objection} ({topic} is published by {names})")

    def _lasted(self) -> float:
        """[s] since the take began."""
        return time.monotonic() - self._began

    def _show_progress(self) -> None:
        if self._samples is None:
            return
        progress = f"recording {self._folder.next_name}: {self._lasted():.0f} s, {len(self._samples)} samples"
        if objection := self._watch.objection(time.monotonic()):
            self.get_logger().warning(f"{progress}; {objection}")
        else:
            self.get_logger().info(progress)

    def _read_keys(self) -> None:
        for key in self._keys.read() if self._keys is not None else "":
            if key in " \r\n":
                name, work = ("begin", self._begin) if self._samples is None else ("end", self._end)
                self._do(name, work, Trigger.Response())
            elif key in "dD":
                self._do("delete_last", self._delete_last, Trigger.Response())
            elif key in "qQ":
                signal.raise_signal(signal.SIGINT)  # as Ctrl-C
            else:
                self.get_logger().info(f"{key!r} is no key here: {_KEYS}")


def main(args: list[str] | None = None) -> int:
    """Record until SIGINT or SIGTERM; returns the exit code."""
    return run_node(PROGRAMS["record"], RecordNode, args)


if __name__ == "__main__":
    sys.exit(main())
