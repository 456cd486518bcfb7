"""The life of a node of this package, and its end: one clear line when it cannot start, exit code 0 on SIGINT and
SIGTERM.
"""

from __future__ import annotations

import gc
import math
import os
import signal
import sys
import threading
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from geodesic_motion_ros.nodes.float_lists import arguments_with_floats
from geodesic_motion_ros.nodes.usage import Program, answer
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError

# A Python thread waits this long [s] for another one to let go of the interpreter. The default, 5 ms, is
# half a control period.
_SWITCH_INTERVAL = 0.00005
_LAST = 19
# How long a node waits for its arm to rest before it ends [s]; signals so close are one [s].
_BRAKING, _SAME = 2.0, 0.5

#: Of timers that go on while a simulation stands.
STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class LoopingNode(Node, ABC):
    """A ROS node with threads of its own. `start` begins them, `stop` ends them; an executor spins the callbacks.

    `failure` is set when a thread has died that the node cannot do without. `niceness` is that of its threads, where
    that is allowed: below 0 they run before whatever else keeps the cores busy.
    """

    niceness = -10

    def __init__(self, name: str, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self.failure = threading.Event()
        try:
            self._build()
        except BaseException:
            # An interrupt may leave a subscription half made, which cannot be destroyed.
            with suppress(Exception):
                self.destroy_node()
            raise
        # rclpy's first line looks through all modules, 0.1 s and more in which no other thread runs: not in a loop.
        self.get_logger().info(self._introduction())

    @abstractmethod
    def _build(self) -> None:
        """Declare parameters and make everything that may fail; nothing runs yet."""

    @abstractmethod
    def _introduction(self) -> str:
        """What the node is ready for, what it publishes and what it waits for, in one line of the log."""

    @abstractmethod
    def start(self) -> None:
        """Begin the threads."""

    def brake(self) -> None:
        """Have what this node commands come to rest, for the node is to end."""

    @property
    def is_at_rest(self) -> bool:
        """Whether what this node commands rests."""
        return True

    @abstractmethod
    def stop(self) -> None:
        """End the threads; harmless when they have ended or never began."""

    def destroy_node(self) -> None:
        """Destroy the node and all that it has."""
        destroy_actions(self)
        super().destroy_node()

    def _died(self, error: BaseException) -> None:
        """Called by the loop that an exception has ended."""
        self.get_logger().fatal("the loop ended: " + "".join(traceback.format_exception(error)))
        self.failure.set()


def destroy_actions(node: Node) -> None:
    """Destroy the action servers and clients of a node: `Node.destroy_node` does not, and they keep the node alive."""
    for waitable in tuple(node.waitables):
        if isinstance(waitable, ActionServer | ActionClient):
            waitable.destroy()


class StopRequest:
    """SIGINT and SIGTERM: an exception while starting up, later a flag that the spinning loop looks at.

    `insists` is set by a second one. One within half a second is the same: a terminal and a launch file both pass it
    on.
    """

    def __init__(self) -> None:
        self.starting, self.insists = True, False
        self._first = math.inf
        self._requested = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._handle)

    def __bool__(self) -> bool:
        return self._requested.is_set()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._first = min(self._first, time.monotonic())
        self.insists = time.monotonic() > self._first + _SAME
        self._requested.set()
        if self.starting:
            raise KeyboardInterrupt


def run_node(program: Program, create: Callable[[], LoopingNode], args: list[str] | None) -> int:
    """Create a node, spin it until it is requested to end, and take it down in the order that never aborts.

    Before it ends, what it commands comes to rest: for `_BRAKING` at most, and not after a second signal.

    Returns the exit code: 0 after SIGINT or SIGTERM, 1 when the node could not start or its loop died.
    """
    request = StopRequest()
    node = None
    try:
        if (code := answer(program, args)) is not None:
            return code
        _initialise(args)
        node = create()
        request.starting = False
        if not request:
            with cores_awake():
                _spin(node, request)
        return 1 if node.failure.is_set() else 0
    except KeyboardInterrupt:
        return 0
    except SystemError:
        # what compiled code makes of the interrupt
        if not request:
            raise
        return 0
    except GeodesicMotionError as error:
        print(f"{program.name}: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    finally:
        request.starting = False
        if node is not None:
            node.stop()
            _share_one_core()
            node.destroy_node()
        rclpy.try_shutdown()


def _initialise(args: list[str] | None) -> None:
    try:
        with TemporaryDirectory() as folder:
            given = arguments_with_floats(sys.argv if args is None else args, Path(folder))
            # rclpy's own handlers shut the context down under the running threads; ours end the threads first.
            rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # what rcl makes of an argument or a parameter file it cannot read
        raise ParameterError(str(error)) from error


def go_first(niceness: int = LoopingNode.niceness) -> None:
    """Run before whatever else keeps the cores busy, where that is allowed: all threads of this process.

    One of low priority that is preempted while it holds a lock would stop the control loop as well: a Python thread the
    interpreter's, one of Fast DDS that of a topic. Threads inherit the priority from the one that starts them.

    Where Linux groups the processes of a session (man 7 sched, "The autogroup feature"), such a priority counts inside
    the group alone: then that of the group is raised too.
    """
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(niceness))
    with suppress(PermissionError):
        for thread in os.listdir("/proc/self/task"):
            with suppress(ProcessLookupError):
                os.setpriority(os.PRIO_PROCESS, int(thread), niceness)


@contextmanager
def cores_awake() -> Iterator[None]:
    """Keep the cores of this machine awake as long as this lasts, where that is allowed.

    A core that slept between two cycles begins the next one late, and with cold caches. Linux wakes cores within the
    shortest time [us] that an open file of this name holds ("PM Quality Of Service Interface"): 0 here.
    """
    with ExitStack() as files:
        with suppress(OSError):
            files.enter_context(open("/dev/cpu_dma_latency", "wb", buffering=0)).write(bytes(4))
        yield


def _share_one_core() -> None:
    """Keep all threads of this process on one core from now on, and let this one go last.

    While a participant is destroyed, Fast DDS 2.14 waits for its discovery callbacks in a loop that lets go of their
    lock for an instant only (`DomainParticipant::set_listener` without a timeout). Where nodes end together, a callback
    on another core may wait for that lock for good; on the same core it gets its turn.
    """
    core = {min(os.sched_getaffinity(0))}
    for thread in os.listdir("/proc/self/task"):
        with suppress(ProcessLookupError):
            os.sched_setaffinity(int(thread), core)
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LAST)


def _spin(node: LoopingNode, request: StopRequest) -> None:
    go_first(node.niceness)
    sys.setswitchinterval(_SWITCH_INTERVAL)
    # What was built so far lives as long as the process: the collector need not walk through it at every
    # pass.
    gc.collect()
    gc.freeze()
    # Its waiting is not Python: the others rebuild their wait set in Python for every message and take the interpreter
    # from the control loop two thirds of the time.
    executor = EventsExecutor()
    executor.add_node(node)
    node.start()
    try:
        while not request and not node.failure.is_set():
            executor.spin_once(timeout_sec=0.1)
        node.brake()
        until = time.monotonic() + _BRAKING
        while not (node.is_at_rest or node.failure.is_set() or request.insists or time.monotonic() > until):
            executor.spin_once(timeout_sec=0.01)
    except ExternalShutdownException:
        return
    finally:
        node.stop()
        executor.shutdown()
