"""A simulated Franka Research 3 that speaks the network protocol of a real one, with all its reflexes: franka-sim.

    .venv-robot-server/bin/python robot_server.py MODEL ADDRESS JOINTS SPEED

MODEL : a MuJoCo model of the arm. ADDRESS : of this machine, 127.x.y.z; the port is Franka's. JOINTS : where it stands,
q1,...,q7 [rad]. SPEED : a number, how many times as fast as real time it is at most; or `real`.

With a number it lives in a time of its own: each of its milliseconds waits for the answer to the one before, for half
a second at most, so that a busy machine is hardly ever a reason for a reflex. Who has left ten in a row unanswered is
not waited for. With `real` its milliseconds are those of the machine, as franka-sim has them.

It is run by its path in an environment of its own, and imports nothing of this package.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from typing import Any

import franka_sim.mujoco_franka_sim as mujoco_sim
import numpy as np
from franka_sim.franka_sim_server import FrankaSimServer

#: An answer is waited for so long [s]: libfranka gives a connection up that sends it no state for a second.
_PATIENCE = 0.5
#: Who owes so many answers in a row is silent, and is not waited for: the arm stops itself at 20.
_MOST_OWED = 10
#: A wait looks again after so long [s].
_LOOK = 5e-5
_PERIOD = 1e-3
#: In real time, where it is permitted: below that of who commands the arm.
_PRIORITY = 20
#: The arm's time goes on by itself where nobody has asked for it for so long [s].
_ALONE = 0.02


class OwnTime(mujoco_sim.MujocoFrankaSim):
    """Physics that goes on by a millisecond with each state that is sent, and by itself where nobody is connected."""

    def __init__(self) -> None:
        super().__init__()
        self._physics = threading.Lock()
        self._asked = time.monotonic()

    def get_robot_state(self) -> dict[str, Any]:
        """The state after the next millisecond."""
        with self._physics:
            if self.model is not None:
                self.step()
            self._asked = time.monotonic()
        return super().get_robot_state()

    def run_simulation(self) -> None:
        """Go on while nobody asks."""
        while self.running:
            with self._physics:
                if time.monotonic() - self._asked > _ALONE:
                    self.step()
            time.sleep(_PERIOD)


class PatientServer(FrankaSimServer):
    """A server each of whose milliseconds waits for the answer to the one before."""

    def __init__(self, speed: float, **options: Any) -> None:
        super().__init__(**options)
        self._shortest = _PERIOD / speed
        self._owed = 0

    def _drain_gate(self, answer_deadline: float = 0.0) -> float:
        """Wait for the answer, and for the pace; returns how long that took [s]."""
        began = time.perf_counter()
        pace = answer_deadline - _PERIOD + self._shortest
        patience = _PATIENCE if self._owed < _MOST_OWED else 0.0
        while self.comm.awaiting_answer and time.perf_counter() - began < patience:
            time.sleep(_LOOK)
        self._owed = self._owed + 1 if self.comm.awaiting_answer else 0
        super()._drain_gate(answer_deadline)
        if (left := pace - time.perf_counter()) > 0.0:
            time.sleep(left)
        return time.perf_counter() - began


def main() -> None:
    """Serve until SIGINT or SIGTERM."""
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    model, address, joints, speed = sys.argv[1:]
    os.environ["FR3_MJCF"] = model
    mujoco_sim.ARM_INITIAL_Q = np.array([float(value) for value in joints.split(",")])
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    # a thread that waits for another one to let go of the interpreter does so for 5 ms by default
    sys.setswitchinterval(1e-4)
    enforced = {"enforce_comm_constraints": True, "enforce_motion_limits": True}
    if speed == "real":
        # An arm has a computer of its own: it does not wait for what else this one does.
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))
        server = FrankaSimServer(host=address, enable_gripper=False, **enforced)
    else:
        server = PatientServer(float(speed), host=address, enable_gripper=False, physics_sim=OwnTime(), **enforced)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: os._exit(0))  # it holds nothing but memory
    print(f"an arm at {address}, until Ctrl-C", flush=True)
    server.start()


if __name__ == "__main__":
    main()
