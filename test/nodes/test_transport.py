"""How nodes talk: without shared memory, which holds publishers up when programs join."""

import os
import subprocess
import sys

import pytest

from geodesic_motion_ros.utils.shared_files import find_shared

CHOSEN = "FASTDDS_BUILTIN_TRANSPORTS"
#: The files in shared memory that a node of its own has mapped.
NODE = """
import rclpy
rclpy.init()
node = rclpy.create_node("alone")
print(*{line.split()[-1] for line in open("/proc/self/maps") if "/dev/shm/fastrtps" in line})
node.destroy_node()
rclpy.shutdown()
"""


def said(script: str, environment: dict[str, str]) -> str:
    """What a script prints."""
    return subprocess.run(
        [sys.executable, "-c", script], env=environment, check=True, capture_output=True, text=True
    ).stdout.strip()


@pytest.mark.parametrize(("given", "used"), [({}, "UDPv4?sockets_size=4MB"), ({CHOSEN: "LARGE_DATA"}, "LARGE_DATA")])
def test_nodes_choose_udp_where_the_user_has_not_chosen(given: dict[str, str], used: str) -> None:
    environment = {name: value for name, value in os.environ.items() if name != CHOSEN} | given
    assert said(f"import os, geodesic_motion_ros.nodes; print(os.environ['{CHOSEN}'])", environment) == used


def test_the_profile_for_this_machine_alone_does_without_shared_memory_where_localhost_does_not() -> None:
    profile = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(find_shared("config/loopback.xml")),
    }
    assert said(NODE, os.environ | profile) == ""
    assert "fastrtps" in said(NODE, os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"})
