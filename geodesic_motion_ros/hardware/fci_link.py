"""The node's end of the process that commands a Franka: it starts it, asks it, and reads the arm's state."""

from __future__ import annotations

import importlib.util
import json
import mmap
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotDoneInTime
from multiprocessing.connection import Connection

from geodesic_motion_ros.hardware.drive_state import SIZE, DriveState, SharedState
from geodesic_motion_ros.hardware.drive_talk import Notice, Request
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_ros.utils.errors import RobotError

#: An answer is waited for so long [s]: a recovery takes an arm seconds.
PATIENCE = 20.0
#: The longest that an arm plays to its rest [s].
_REST = 15.0


class FciLink:
    """A link to the process `fci_process`.

    Parameters
    ----------
    address : of the arm. robot : name or folder of its description. clock_from_robot : whether the arm's time is all
        the time there is, as of a simulated arm that may be slower than real. epoch : seconds count from it [ns].
    hear : called with each event, from a thread of the link. died : called there when the process has ended by itself.

    Raises
    ------
    RobotError : pylibfranka is not installed.
    """

    def __init__(
        self,
        address: str,
        robot: str,
        clock_from_robot: bool,
        epoch: int,
        hear: Callable[[Notice], None],
        died: Callable[[BaseException], None],
    ) -> None:
        if importlib.util.find_spec("pylibfranka") is None:
            raise RobotError(
                "pylibfranka, Franka's own library, is not installed: pip install pylibfranka, or this package with "
                "its extra [franka] (Linux with glibc 2.34 or newer, Python 3.10 to 3.12)"
            )
        options = {"address": address, "robot": robot, "clock_from_robot": clock_from_robot, "epoch": epoch}
        self._options = json.dumps(options)
        self._hear, self._died = hear, died
        self._answers: dict[int, Future[Notice]] = {}
        self._number = 0
        self._lock = threading.Lock()
        self._closing = False
        self._process: subprocess.Popen[bytes] | None = None
        memory = os.memfd_create("fci_state")
        os.ftruncate(memory, SIZE)
        self._memory = memory
        self._shared = SharedState(memoryview(mmap.mmap(memory, SIZE)))

    def start(self) -> None:
        """Start the process, which connects to the arm, and hear it."""
        here, there = socket.socketpair()
        command = [sys.executable, "-m", "geodesic_motion_ros.hardware.fci_process"]
        with there:
            # In a session of its own: what interrupts the node's group must not reach it before the arm rests.
            self._process = subprocess.Popen(
                [*command, str(there.fileno()), str(self._memory), self._options],
                pass_fds=(there.fileno(), self._memory), stdin=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
        self._link = Connection(here.detach())
        self._thread = threading.Thread(target=self._listen, name="fci", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Let the arm go on to rest and the process end; harmless when done before.

        A process that has not ended after `_REST`, as it hangs or compiles kernels, is killed: an arm that it commands
        hears nothing more then, and stops itself.
        """
        if self._closing or self._process is None:
            return
        self._closing = True
        # Not closed: a thread reads from it. The other end sees that nothing more comes.
        with socket.socket(fileno=os.dup(self._link.fileno())) as link:
            link.shutdown(socket.SHUT_WR)
        try:
            self._process.wait(_REST)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join(1.0)

    def state(self) -> DriveState:
        """Read the newest state of the arm."""
        return self._shared.read()

    def send(self, waypoints: JointWaypoints, begin: float | None) -> None:
        """Have a trajectory played, from a time [s] since the epoch; what is wrong with it is heard later."""
        self._send(Request("trajectory", 0, waypoints, begin))

    def ask(self, kind: str) -> str:
        """Ask for `arm`, `disarm` or `recover`; returns what was done.

        Raises
        ------
        RobotError : it was not done; says why.
        """
        answer: Future[Notice] = Future()
        with self._lock:
            self._number += 1
            number = self._number
            self._answers[number] = answer
        self._send(Request(kind, number))
        try:
            notice = answer.result(PATIENCE)
        except NotDoneInTime as error:
            raise RobotError(f"the arm did not answer within {PATIENCE:g} s") from error
        finally:
            del self._answers[number]
        if notice.kind != "done":
            raise RobotError(notice.text)
        return notice.text

    def _send(self, request: Request) -> None:
        with self._lock:
            try:
                self._link.send(request)
            except OSError as error:
                raise RobotError("the process that commands the arm has ended") from error

    def _listen(self) -> None:
        try:
            while True:
                notice = self._link.recv()
                if answer := self._answers.get(notice.number):
                    answer.set_result(notice)
                elif not notice.number:
                    self._hear(notice)
        except (EOFError, OSError):
            code = self._process.wait()
            if not self._closing:
                self._died(RobotError(f"the process that commands the arm has ended with exit code {code}"))
