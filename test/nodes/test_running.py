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
