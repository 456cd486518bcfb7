"""How the process of a node runs, in a process of the test's own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from geodesic_motion_ros.nodes.running import cores_awake

#: The longest time [us] in which a core may wake, an int of four bytes, as Linux sees it for all programs together.
WAKING = Path("/dev/cpu_dma_latency")

#: The priorities of all threads after `go_first`, among them one that was there before it.
PRIORITIES = """
import os, threading
from geodesic_motion_ros.nodes.running import go_first
ended = threading.Event()
threading.Thread(target=ended.wait).start()
go_first()
print(*{os.getpriority(os.PRIO_PROCESS, int(thread)) for thread in os.listdir("/proc/self/task")})
ended.set()
group = "/proc/self/autogroup"
print(open(group).read().split()[-1] if os.path.exists(group) else -10)
"""


def test_all_threads_go_first_and_so_does_the_group_of_the_session() -> None:
    command = [sys.executable, "-c", PRIORITIES]
    done = subprocess.run(command, capture_output=True, text=True, start_new_session=True)
    assert done.returncode == 0, done.stderr
    threads, group = done.stdout.splitlines()
    if threads == str(os.getpriority(os.PRIO_PROCESS, 0)):
        pytest.skip("priorities may not be raised here")
    assert (threads, group) == ("-10", "-10")


@pytest.mark.skipif(not os.access(WAKING, os.R_OK | os.W_OK), reason="cores may not be kept awake here")
def test_cores_do_not_sleep_while_a_node_runs_and_may_afterwards() -> None:
    with cores_awake():
        assert WAKING.read_bytes()[:4] == bytes(4)
        assert str(WAKING) in _open_files()
    assert str(WAKING) not in _open_files()


def _open_files() -> set[str]:
    return {os.path.realpath(f"/proc/self/fd/{number}") for number in os.listdir("/proc/self/fd")}
