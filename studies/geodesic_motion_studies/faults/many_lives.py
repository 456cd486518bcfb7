"""Creates and destroys the two nodes again and again in one process, and tells what has leaked, as JSON.

Run as a process of its own: what leaks is then of nobody else.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import threading
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode

#: Lives after which what is kept for good is there.
_SETTLED = 5


def leaked(skill: str, lives: int) -> dict[str, float]:
    """Threads, descriptors and memory [MB] that a process has more of after so many lives of both nodes."""
    for life in range(lives):
        _live(skill)
        # What waits for Python's collector is no leak, and it does not count how large that is.
        gc.collect()
        if life == min(_SETTLED, lives - 2):
            before = _resources_in_use()
    after = _resources_in_use()
    return {name: after[name] - before[name] for name in after}


def _live(skill: str) -> None:
    rclpy.init()
    parameters = [Parameter("skill", value=skill)]
    executor = SingleThreadedExecutor()
    nodes = [kind(parameter_overrides=parameters) for kind in (TwinNode, PlannerNode)]
    for node in nodes:
        executor.add_node(node)
        node.start()
    for _ in range(10):
        executor.spin_once(timeout_sec=0.01)
    for node in nodes:
        node.stop()
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def _resources_in_use() -> dict[str, float]:
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return {
        "threads": threading.active_count(),
        "descriptors": len(os.listdir("/proc/self/fd")),
        "memory": int(status["VmRSS"].split()[0]) / 1024.0,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("skill")
    parser.add_argument("lives", type=int)
    options = parser.parse_args()
    print(json.dumps(leaked(options.skill, options.lives)))
