"""The page in a real browser: a user drags a sphere into the arm's path, and the arm passes it. Real nodes over DDS."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bench import Bench
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.demo.demo_run import Processes, isolated_environment
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill

pytest.importorskip("viser", reason="viser is not installed: `make view`")

import browser
from browser import Browser

from geodesic_motion_ros.nodes.view_node import ViewNode

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.skipif(browser.program() is None, reason="no Chromium: apt install chromium (Debian), snap (Ubuntu)"),
]
SKILL, SCENE = "panda_reach_to_grasp", "table"
#: A sphere that has not come along for so long is not held [s].
DRAGGED = 20.0


@pytest.fixture
def arm(tmp_path: Path) -> Iterator[Processes]:
    """A twin and a planner, as processes."""
    with Processes(tmp_path, isolated_environment(int(os.environ["ROS_DOMAIN_ID"]))) as processes:
        processes.start("twin", {"skill": SKILL, "scene": SCENE})
        # A browser draws without a graphics card: nodes that get little of the processor are late, not lost.
        late = {
            "tracking_tolerance_joint": 0.5, "state_timeout": 5.0, "resume_timeout": 60.0, "latency": 0.1,
            "obstacle_timeout": 30.0,
        }  # fmt: skip
        processes.start("planner", {"skill": SKILL, "scene": SCENE, **late})
        yield processes


def projected(view: ViewNode, points: np.ndarray, canvas: tuple[float, float, float, float]) -> np.ndarray:
    """Pixels (n, 2) of points (n, 3) [m] on the page."""
    (client,) = view.page.clients
    left, top, width, height = canvas
    seen = to_rotation(np.array(client.camera.wxyz)).inv().apply(points - client.camera.position)
    focal = 0.5 * height / np.tan(0.5 * client.camera.fov)
    return np.array([left + 0.5 * width, top + 0.5 * height]) + focal * seen[:, :2] / seen[:, 2:]


def gaps(planner: ReactivePlanner, configurations: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """Distances (n,) [m] of the arm's spheres from an obstacle, in configurations (n, eta)."""
    arm = planner.collision.positions(planner.robot, np.ascontiguousarray(configurations))
    return np.min(np.linalg.norm(arm - centre, axis=2) - planner.collision.radii, axis=1) - radius


def place_on_the_path(
    planner: ReactivePlanner, motion: np.ndarray, sphere: np.ndarray, radius: float, forward: np.ndarray
) -> np.ndarray:
    """Where a mouse drags a sphere (3,) [m], past the arm at its start, that the motion (n, eta) would touch, and that
    leaves another path.

    forward : (3,), where the camera looks: a mouse drags across it.
    """
    skill = planner.skill
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    across = 0.04 * np.array([[i, j] for i in range(-16, 17) for j in range(-14, 9)])
    places = []
    for place in sphere + across @ np.stack([right, np.cross(right, forward)]):
        line = sphere + np.linspace(0.0, 1.0, 12)[:, None] * (place - sphere)
        near = gaps(planner, motion, place, radius)
        past = min(gaps(planner, motion[:1], point, radius)[0] for point in line)
        if -0.1 < np.min(near) < -0.03:
            places.append((min(past, near[-1]), place.tolist()))
    start, goal = skill.start_pose, skill.goal_pose
    for free, place in sorted(places, reverse=True):
        planner.set_obstacles(np.array([place]), np.array([radius]))
        if free > 0.04 and planner.plan(start[:3], start[3:], goal[:3], goal[3:]).verdict.ok:
            return np.array(place)
    raise AssertionError("the camera sees no place on the path that leaves another one")


def test_an_arm_passes_what_a_user_drags_into_its_path(arm: Processes, bench: Bench, tmp_path: Path) -> None:
    planner = ReactivePlanner(Skill.load(SKILL), scene=DeclaredScene.from_name(SCENE))
    for kind, topic in ((JointState, "joint_states"), (MarkerArray, "obstacles")):
        bench.listen(kind, topic)
    bench.watch_planner()
    view = bench.add(ViewNode, port=0, control=True, skill=SKILL)
    # Nodes that begin beside the browser would get little of the processor.
    bench.wait_for_code("NO_GOAL")
    chromium = Browser(tmp_path / "profile", view.page.address)
    try:
        bench.poll(lambda: view.page.spheres and "To the goal" in chromium.text(), "the page")

        def press_until(label: str, code: str) -> None:
            """Press a button, as a user does who sees nothing happen: the page unfolds while it is pressed."""

            def answered() -> bool:
                chromium.click(label)
                return bool(bench.status()["code"] == code)

            bench.poll(answered, f"{code} after {label}")

        def motion() -> np.ndarray:
            """Press the button, and return the configurations (n, 7) until the arm has arrived."""
            bench.heard["joint_states"].clear()

            press_until("To the goal", "OK")
            bench.poll(lambda: bench.status()["code"] == "OK" and bench.at_goal(), "the arrival")
            bench.poll(lambda: "At the goal" in chromium.text(), "the page that says so")
            return np.array([message.position for message in bench.heard["joint_states"]])

        undisturbed = motion()
        chromium.picture(tmp_path / "undisturbed.png")
        press_until("Reset the twin", "NO_GOAL")

        def drag() -> bool:
            """Drag the sphere to where it is in the path; whether it came there: a mouse that is quicker than the
            picture takes hold of the view instead.
            """
            ((_, sphere, radius),) = view.page.spheres
            (client,) = view.page.clients
            forward = to_rotation(np.array(client.camera.wxyz)).apply((0.0, 0.0, 1.0))
            place = place_on_the_path(planner, undisturbed[:: len(undisturbed) // 60], sphere, radius, forward)
            begin, *steps = projected(view, np.linspace(sphere, place, 7), chromium.canvas())
            chromium.hover(*begin)
            chromium.press(*begin)
            for step in steps:
                chromium.move(*step)
            # Released once it is there: the browser renders a picture in seconds.
            end = time.monotonic() + DRAGGED
            while not (there := np.linalg.norm(view.page.spheres[0][1] - place) < 0.02) and time.monotonic() < end:
                chromium.move(*steps[-1])
            chromium.release(*steps[-1])
            return bool(there)

        assert any(drag() for _ in range(10)), "the sphere cannot be dragged"
        ((_, centre, radius),) = view.page.spheres
        assert np.min(gaps(planner, undisturbed, centre, radius)) < -0.01  # the control: it would be touched

        def heard_there() -> bool:
            shown = bench.heard["obstacles"][-1].markers[-1].pose.position
            return bool(np.linalg.norm(np.array([shown.x, shown.y, shown.z]) - centre) < 1e-6)

        bench.poll(heard_there, "the obstacle where the sphere is")
        passed = motion()
        chromium.picture(tmp_path / "passed.png")
        assert np.min(gaps(planner, passed, centre, radius)) > 0.0
    finally:
        chromium.close()
