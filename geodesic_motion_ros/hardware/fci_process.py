"""The process that talks to a Franka every millisecond, through libfranka, and to the node `franka` by a socket.

    python -m geodesic_motion_ros.hardware.fci_process SOCKET MEMORY '{"address": ...}'

It is a process of its own for the interpreter's sake: reading a message of ROS takes it longer than the arm waits. What
it hears are requests, what it says are answers and events (`fci_link.py`), and the arm's state lies in shared memory.
When the node has ended, the arm plays to the rest at the end of what it had, and the process ends.

The arm moves between a request `arm` and the next request `disarm`, reflex, or loss of the connection; then only after
another one. Nothing recovers by itself but the connection.
"""

from __future__ import annotations

import gc
import json
import mmap
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import pylibfranka as fci

from geodesic_motion_ros.hardware.command_stream import CommandStream, load_kernels
from geodesic_motion_ros.hardware.drive_state import SIZE, DriveMode, SharedState
from geodesic_motion_ros.hardware.drive_talk import Notice, Request
from geodesic_motion_ros.hardware.judged_commands import PERIOD
from geodesic_motion_ros.hardware.reflexes import errors_of, explained, late_commands
from geodesic_motion_ros.hardware.robot_clock import RobotClock
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.utils.errors import RobotError

#: Between two attempts to connect [s], in which requests are answered.
_RETRY, _LISTEN = 1.0, 0.02
#: Of the threads of this process, where it is permitted: below the kernel's own that serve the network.
_PRIORITY = 40
#: What ends a connection; a `ControlException` ends a motion. They have no ancestor of their own in common.
_LOST = (fci.FrankaException, fci.NetworkException, fci.CommandException, fci.InvalidOperationException)
#: What the arm is at where it is not commanded, by the mode that it reports.
_MODES = {
    fci.RobotMode.Idle: DriveMode.DISARMED,
    fci.RobotMode.Reflex: DriveMode.REFLEX,
    fci.RobotMode.UserStopped: DriveMode.USER_STOPPED,
}


class FciProcess:
    """The state of the process: its arm, and what it has been asked for."""

    def __init__(self, link: Connection, memory: mmap.mmap, options: dict[str, Any]) -> None:
        """options : address, robot, clock_from_robot, and epoch [ns], from which seconds count."""
        self._link, self._shared = link, SharedState(memoryview(memory))
        self._address, self._by_robot = options["address"], options["clock_from_robot"]
        self._epoch = options["epoch"]
        robot = Robot.named(options["robot"])
        self._limits, self._names = JointLimits.of(robot), robot.joint_names
        self._clock = RobotClock(self._shown())
        self._robot_time: float | None = None
        self._robot: fci.Robot | None = None
        self._closing = False
        self._lost, self._success = 0, 1.0
        self._said = ""

    def run(self) -> None:
        """Serve until the node ends."""
        load_kernels(self._limits)
        self._make_realtime()
        gc.collect()
        gc.disable()  # a collection takes longer than the arm waits
        while not self._closing:
            try:
                self._connect()
                while not self._closing:
                    if self._stand():
                        self._follow()
            except _LOST as error:
                self._lose(error)
        self._shared.write(DriveMode.ENDED, self._clock.now)

    # ------------------------------------------------------------------ connection

    def _connect(self) -> None:
        self._shared.write(DriveMode.CONNECTING, self._clock.now)
        # What is scheduled is this thread, above: libfranka would refuse to begin on a kernel without PREEMPT_RT.
        self._robot = fci.Robot(self._address, fci.RealtimeConfig.kIgnore)
        self._robot_time, self._said = None, ""
        self._tell("info", f"connected to the arm at {self._address}; it follows nothing before ~/arm")

    def _lose(self, error: Exception) -> None:
        """Give a connection up: after a time-out libfranka's is dead for good."""
        in_motion = self._robot is not None and bool(self._shared.read().commanded_velocities.any())
        self._robot = None
        self._shared.write(DriveMode.CONNECTING, self._clock.now)
        reason = f"no connection to the arm at {self._address}: {_brief(error)}"
        asked = list(self._requests())  # so it hears that the node ends: then nothing is tried again
        if self._closing and in_motion:
            self._tell("error", f"{reason}; it was lost before the arm rested, which then stops itself")
        elif not self._closing and reason != self._said:
            self._said = reason
            text = f"{reason}; tried again every {_RETRY:g} s; then it needs ~/arm anew"
            self._tell("error", text, mode=DriveMode.CONNECTING)
        until = time.monotonic() + _RETRY
        while not self._closing:
            for request in asked:
                self._refuse(request, reason)
            if time.monotonic() > until:
                return
            asked = list(self._requests(_LISTEN))

    # ------------------------------------------------------------------ standing

    def _stand(self) -> bool:
        """Read states until the node asks to follow, which is when this returns True, or ends."""
        mode = None
        while not self._closing:
            state = self._robot.read_once()
            before, mode = mode, _MODES.get(state.robot_mode, DriveMode.NOT_READY)
            if mode is not before:  # said first: who sees the mode then knows why
                self._say_mode(mode, state)
            self._note(mode, state)
            for request in self._requests():
                if request.kind == "arm" and mode is DriveMode.DISARMED:
                    self._answer(request, True, "armed: the arm follows joint_trajectory from now on")
                    return True
                self._serve_standing(request, mode, state)
        return False

    def _serve_standing(self, request: Request, mode: DriveMode, state: fci.RobotState) -> None:
        if request.kind == "recover" and mode is DriveMode.REFLEX:
            try:
                self._robot.automatic_error_recovery()
            except (fci.CommandException, fci.ControlException) as error:
                self._answer(request, False, _brief(error))
            else:
                self._answer(request, True, "recovered: the arm follows nothing before ~/arm")
        elif request.kind == "recover":
            self._answer(request, False, f"nothing to recover from: {self._standing(mode, state)}")
        elif request.kind == "disarm":
            self._answer(request, True, "disarmed: the arm follows nothing")
        else:
            self._refuse(request, self._standing(mode, state))

    def _say_mode(self, mode: DriveMode, state: fci.RobotState) -> None:
        kind = "info" if mode is DriveMode.DISARMED else "error"
        self._tell(kind, self._standing(mode, state), mode=mode)

    def _standing(self, mode: DriveMode, state: fci.RobotState) -> str:
        """Say why the arm follows nothing, and what to do."""
        if mode is DriveMode.DISARMED:
            return "the arm is not armed: call ~/arm with data: true"
        if mode is DriveMode.REFLEX:
            names = errors_of(state.last_motion_errors) or errors_of(state.current_errors)
            why = explained(names) + late_commands(self._success)
            return f"the arm has stopped itself: {why}; then call ~/recover, and ~/arm"
        if mode is DriveMode.USER_STOPPED:
            return "the arm is stopped by its user: release the stop, or press the enabling device, then call ~/arm"
        return f"the arm is in mode {state.robot_mode.name}: set it to execution and FCI in its Desk, then call ~/arm"

    # ------------------------------------------------------------------ following

    def _follow(self) -> None:
        """Command the arm until it is to rest and does, or stops itself."""
        control, self._success = None, 1.0
        try:
            control = self._robot.start_joint_position_control(fci.ControllerMode.JointImpedance)
            self._play(control)
            self._tell("info", "the arm rests and follows nothing before ~/arm")
        except fci.ControlException as error:
            # One that is still referred to keeps the next one from beginning, and a recovery from being heard.
            control = None
            self._tell("error", f"the arm stopped itself: {_brief(error)}")
        except fci.CommandException as error:
            self._tell("error", f"the arm does not let itself be commanded: {_brief(error)}")

    def _play(self, control: fci.ActiveControlBase) -> None:
        state, period = control.readOnce()
        if not self._by_robot:
            self._clock = RobotClock(self._shown())
        # No other beginning is taken by the arm than what it holds itself to be commanded.
        commanded = np.array(state.q_d)
        stream, resting, finished = CommandStream(commanded, self._limits, self._names), False, False
        self._tell("info", "the arm follows joint_trajectory")
        while True:
            now = self._step(period.to_sec())
            self._robot_time = state.time.to_sec()  # what has passed until here is counted
            for request in self._requests():
                resting = self._serve_following(request, stream, now, resting)
            wanted, refused = stream.command(now)
            if refused:
                self._tell("refused", f"{refused}; the arm goes on to rest on the one before")
            finished = (resting or self._closing) and not wanted[1:].any()
            command = fci.JointPositions(wanted[0].tolist())
            command.motion_finished = finished
            control.writeOnce(command)
            mode = DriveMode.RESTING if resting else DriveMode.FOLLOWING
            arm = (state.q, state.dq, wanted[0], wanted[1])
            self._success = state.control_command_success_rate
            self._shared.write(mode, now, arm, self._success, self._lost)
            if finished:
                return
            state, period = control.readOnce()
            self._lost += max(0, round(period.to_sec() / PERIOD) - 1)

    def _serve_following(self, request: Request, stream: CommandStream, now: float, resting: bool) -> bool:
        """Serve a request while the arm is commanded; returns whether it is to rest and follow nothing then."""
        if request.kind == "disarm":
            self._answer(request, True, "disarmed: the arm goes on to rest, and follows nothing then")
            return True
        if request.kind == "arm" and not resting:
            self._answer(request, True, "armed already")
        elif request.kind == "trajectory" and not resting:
            try:
                stream.receive(request.waypoints, request.begin, now)
            except RobotError as error:
                self._tell("refused", str(error))
        else:
            self._refuse(request, "it goes on to rest" if resting else "the arm has not stopped itself")
        return resting

    # ------------------------------------------------------------------ clock and messages

    def _shown(self) -> float:
        """What the clock of the machine shows [s]."""
        return 1e-9 * (time.time_ns() - self._epoch)

    def _step(self, period: float) -> float:
        return self._clock.step(period, None if self._by_robot else self._shown())

    def _note(self, mode: DriveMode, state: fci.RobotState) -> None:
        """Share a state in which the arm is not commanded."""
        time_before, self._robot_time = self._robot_time, state.time.to_sec()
        if self._by_robot:
            # The time of an arm that was started again begins again.
            self._clock.step(max(0.0, self._robot_time - (time_before or self._robot_time)), None)
        else:
            self._clock.now = self._shown()
        self._shared.write(mode, self._clock.now, (state.q, state.dq, state.q_d, state.dq_d), 0.0, self._lost)

    def _requests(self, patience: float = 0.0) -> Iterator[Request]:
        """What has been asked for; waits so long [s] for the first."""
        try:
            while not self._closing and self._link.poll(patience):
                yield self._link.recv()
                patience = 0.0
        except (EOFError, OSError):
            self._closing = True

    def _refuse(self, request: Request, why: str) -> None:
        if request.kind == "trajectory":
            self._tell("refused", f"nothing is followed: {why}")
        else:
            self._answer(request, False, why)

    def _answer(self, request: Request, done: bool, text: str) -> None:
        self._tell("done" if done else "failed", text, request.number)

    def _tell(self, kind: str, text: str, number: int = 0, mode: DriveMode | None = None) -> None:
        with suppress(OSError):  # the node has ended: the next look for requests finds that
            self._link.send(Notice(kind, text, number, mode))

    # ------------------------------------------------------------------ beginning

    def _make_realtime(self) -> None:
        if self._by_robot:
            return
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        except PermissionError:
            self._tell(
                "warning",
                "no real-time priority is permitted (rtprio in /etc/security/limits.conf): a busy machine answers "
                "the arm late, and it stops itself",
            )


def _brief(error: Exception) -> str:
    return " ".join(str(error).split())


def main() -> None:
    """Serve the node at the other end of a socket."""
    # It ends when the node does, and not before the arm rests: who interrupts a whole group means the node.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    socket, memory, options = sys.argv[1:]
    FciProcess(Connection(int(socket)), mmap.mmap(int(memory), SIZE), json.loads(options)).run()


if __name__ == "__main__":
    main()
