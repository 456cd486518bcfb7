"""The state of a drive in memory that two processes share: one writes, the other never waits."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

JOINTS = 7
# Slots: counter of writes, states so far, mode, time [s], success rate, lost cycles, then three rows of joints.
_WRITES, _COUNT, _MODE, _TIME, _SUCCESS, _LOST, _ROWS = range(7)
#: Bytes of the shared memory.
SIZE = 8 * (_ROWS + 4 * JOINTS)


class DriveMode(IntEnum):
    """What the drive is at. In FOLLOWING alone it is commanded."""

    CONNECTING = 0
    DISARMED = 1
    FOLLOWING = 2
    RESTING = 3
    REFLEX = 4
    USER_STOPPED = 5
    NOT_READY = 6
    ENDED = 7


@dataclass(frozen=True)
class DriveState:
    """One state of the arm.

    Attributes
    ----------
    count : how many states there were so far. time : of the clock of commands [s].
    success : share of the last 100 commands that reached the arm in time. lost : milliseconds without an answer so far.
    positions, velocities : measured (7,) [rad], [rad/s]. commanded, commanded_velocities : what it is commanded.
    """

    count: int
    mode: DriveMode
    time: float
    success: float
    lost: int
    positions: np.ndarray
    velocities: np.ndarray
    commanded: np.ndarray
    commanded_velocities: np.ndarray


class SharedState:
    """A view of the shared memory, `SIZE` bytes."""

    def __init__(self, memory: memoryview) -> None:
        self._slots = np.frombuffer(memory, dtype=float)
        self._rows = self._slots[_ROWS:].reshape(4, JOINTS)

    def write(
        self, mode: DriveMode, time: float, arm: tuple[object, ...] = (), success: float = 0.0, lost: int = 0
    ) -> None:
        """Write a state; only one process does. arm : positions, velocities, commanded ones of both, or () where there
        is nothing new of them.
        """
        slots = self._slots
        slots[_WRITES] += 1.0  # odd: being written
        slots[_MODE], slots[_TIME], slots[_SUCCESS], slots[_LOST] = mode, time, success, lost
        if arm:
            slots[_COUNT] += 1.0
            for row, values in zip(self._rows, arm, strict=True):
                row[:] = values
        slots[_WRITES] += 1.0

    def read(self) -> DriveState:
        """Read the newest state, never half of one."""
        while True:
            copy = self._slots.copy()
            if copy[_WRITES] % 2 == 0 and copy[_WRITES] == self._slots[_WRITES]:
                break
        rows = copy[_ROWS:].reshape(4, JOINTS)
        return DriveState(
            int(copy[_COUNT]),
            DriveMode(int(copy[_MODE])),
            float(copy[_TIME]),
            float(copy[_SUCCESS]),
            int(copy[_LOST]),
            *rows,
        )
