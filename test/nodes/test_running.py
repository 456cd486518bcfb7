"""How the process of a node runs, in a process of the test's own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

#: The priorities of all threads after `go_first`, among them one that was there before it.
PRIORITIES = """
import os, threading
from geodesic_motion_ros.nodes.running import go_first
ended = threading.Event()
threading.Thread(target=ended.wait).start()
go_first()
print(*{os.getpriority(os.PRIO_PROCESS, int(thread)) for thread in os.listdir("/proc/self/task")})
ended.set()
"""


def test_all_threads_go_first() -> None:
    done = subprocess.run([sys.executable, "-c", PRIORITIES], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    if done.stdout.split() == [str(os.getpriority(os.PRIO_PROCESS, 0))]:
        pytest.skip("priorities may not be raised here")
    assert done.stdout.split() == ["-10"]
