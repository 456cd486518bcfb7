"""The state that two processes share."""

from __future__ import annotations

import mmap
import threading

import numpy as np

from geodesic_motion_ros.hardware.drive_state import SIZE, DriveMode, SharedState


def test_what_is_written_is_read() -> None:
    memory = memoryview(mmap.mmap(-1, SIZE))
    writer, reader = SharedState(memory), SharedState(memory)
    rows = tuple(np.arange(7.0) + 10.0 * row for row in range(4))
    writer.write(DriveMode.FOLLOWING, 12.5, rows, 0.98, 3)
    writer.write(DriveMode.REFLEX, 12.6, success=0.0, lost=4)
    state = reader.read()
    assert (state.count, state.mode, state.time, state.success, state.lost) == (1, DriveMode.REFLEX, 12.6, 0.0, 4)
    given = state.positions, state.velocities, state.commanded, state.commanded_velocities
    np.testing.assert_array_equal(given, rows)


def test_half_of_a_state_is_never_read() -> None:
    memory = memoryview(mmap.mmap(-1, SIZE))
    writer, reader = SharedState(memory), SharedState(memory)
    done = threading.Event()

    def write() -> None:
        for number in range(20_000):
            writer.write(DriveMode.FOLLOWING, float(number), (np.full(7, float(number)),) * 4)
        done.set()

    thread = threading.Thread(target=write)
    thread.start()
    torn = 0
    while not done.is_set():
        state = reader.read()
        rows = np.concatenate([state.positions, state.velocities, state.commanded, state.commanded_velocities])
        torn += not np.all(rows == state.time) and state.count > 0
    thread.join()
    assert not torn
    assert reader.read().count == 20_000
