"""The node `view` beside a real planner: what it sends, and that it sends nothing unless it is to."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench import BASE, Bench
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.publishers import LATCHED, publishers_of
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.robot_file import published_urdf

pytest.importorskip("viser", reason="viser is not installed: `make view`")

from geodesic_motion_ros.nodes.view_node import ViewNode


def view_on(bench: Bench, **parameters: Any) -> ViewNode:
    """A page beside the planner of a bench, on any free port, that knows the arm."""
    view = bench.add(ViewNode, port=0, **parameters)
    description = bench.probe.create_publisher(String, "robot_description", LATCHED)
    description.publish(String(data=published_urdf(Robot.named("panda").urdf)))
    return view


@pytest.fixture
def controlled(ready: Bench, skill_folder: Path) -> Bench:
    """A bench with a planner that has no goal, and a page that commands it."""
    ready.listen(MarkerArray, "obstacles")
    ready.listen(MarkerArray, "planner/markers")
    ready.view = view_on(ready, control=True, skill=str(skill_folder))
    return ready


def sent(bench: Bench) -> list[Marker]:
    """The newest obstacles that the page has sent."""
    heard = bench.heard["obstacles"]
    return heard[-1].markers if heard else []


def test_without_control_it_publishes_nothing_that_commands(ready: Bench) -> None:
    view = view_on(ready)
    ready.poll(lambda: view.page.spheres == [] and view._frame == BASE, "a page that has heard the planner")
    for topic in ("/obstacles", "/goal_pose", "/goal_joints", "/joint_trajectory"):
        assert "/view" not in publishers_of(ready.probe, topic)
    assert not [name for name, _ in view.get_client_names_and_types_by_node("view", "/")]
    assert view.page.address.startswith("http://127.0.0.1:")


def test_what_is_dragged_is_an_obstacle_of_the_planner_until_it_is_removed(controlled: Bench) -> None:
    controlled.wait(lambda: sent(controlled), "the first sphere")
    (marker,) = sent(controlled)
    assert (marker.ns, marker.type, marker.header.frame_id) == ("view", Marker.SPHERE, BASE)
    ((_, centre, radius),) = controlled.view.page.spheres
    place = marker.pose.position
    np.testing.assert_allclose((place.x, place.y, place.z, marker.scale.x), (*centre, 2.0 * radius), atol=1e-6)

    def counted(action: int) -> list[Marker]:
        """The obstacles that the planner has shown, or deleted, in its newest markers."""
        newest = controlled.heard["planner/markers"][-1].markers if controlled.heard["planner/markers"] else []
        return [one for one in newest if one.ns == "obstacles" and one.action == action]

    controlled.view.page.drag(0, np.array([0.3, 0.4, 0.5]))
    controlled.wait(
        lambda: any((one.pose.position.x, one.pose.position.y) == (0.3, 0.4) for one in counted(Marker.ADD)),
        "the obstacle where it was dragged",
    )
    controlled.view.page.remove_sphere()
    controlled.wait(lambda: sent(controlled)[-1].action == Marker.DELETE, "the deletion")
    controlled.wait(lambda: counted(Marker.DELETE), "a planner that counts it no longer")


def test_what_is_pressed_reaches_the_planner(controlled: Bench, skill: Any) -> None:
    controlled.wait(lambda: controlled.view._frame, "the planner's frame")
    controlled.view.page.press("go")
    controlled.wait_for_code("OK")
    controlled.view.page.press("hold", True)
    controlled.wait_for_code("HOLD_REQUESTED")
    controlled.view.page.press("hold", False)
    controlled.wait_for_code("OK")
    controlled.view.page.press("speed", 0.25)
    controlled.wait(
        lambda: controlled.planner.get_parameter("speed_override").value == 0.25, "the share of the speed"
    )
    controlled.wait(controlled.at_rest, "the arrival")
    controlled.wait(lambda: controlled.view._status.has_arrived, "the page that says so")


def test_a_page_that_ends_takes_its_obstacles_with_it(controlled: Bench) -> None:
    controlled.wait(lambda: sent(controlled), "the first sphere")
    controlled.view.stop()
    controlled.wait(lambda: sent(controlled)[-1].action == Marker.DELETE, "the deletion")


def test_a_library_that_is_not_installed_is_one_line_that_says_what_brings_it() -> None:
    code = (
        "import sys; sys.modules['viser'] = None; from geodesic_motion_ros.nodes.view_node import main; "
        "sys.exit(main(['--ros-args', '-p', 'port:=0']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("view: viser, which shows the page, is not installed: pip install ")
    assert "Traceback" not in done.stderr
