"""The twin's camera: planner and twin over DDS, with what the twin renders as the planner's only obstacles."""

from __future__ import annotations

import numpy as np
from bench import Bench
from sensor_msgs.msg import PointCloud2

from geodesic_motion_ros.geometry.quaternions import rotate
from geodesic_motion_ros.nodes.messages import read_cloud, seconds
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.simulation.depth_camera import DepthCameraSettings

REACH, DELAY = "panda_reach_to_grasp", 0.1
CENTRE, RADIUS = np.array([0.45, -0.45, 0.6]), 0.05
BALL = f"{{ball: {{kind: static, centre: {CENTRE.tolist()}, radius: {RADIUS}}}}}"
PLACE, TARGET = [1.4, -0.8, 1.2], [0.35, 0.0, 0.35]


def test_the_planner_knows_the_ball_by_the_twins_camera_and_not_the_arm(bench: Bench) -> None:
    position, quaternion = DepthCameraSettings(tuple(PLACE), tuple(TARGET)).pose
    bench.watch_planner()
    bench.listen(PointCloud2, "obstacle_cloud")
    ages: list[float] = []
    bench.probe.create_subscription(
        PointCloud2, "obstacle_cloud", lambda message: ages.append(bench.now() - seconds(message.header.stamp)), 10
    )
    bench.add(
        TwinNode, skill=REACH, cloud_rate=10.0, cloud_delay=DELAY, camera_place=PLACE, camera_target=TARGET,
        spheres=BALL, spawn_at_start=True,
    )  # fmt: skip
    planner = bench.add(
        PlannerNode, skill=REACH, state_timeout=5.0, obstacle_timeout=30.0, latent_view_rate=0.0,
        required_obstacle_topics=["obstacle_cloud"], camera_frame="twin_camera",
        camera_pose=[*position.tolist(), *quaternion.tolist()],
    )  # fmt: skip

    def clusters() -> np.ndarray:
        """Spheres (k, 4) [m] that come from clouds alone."""
        known = planner.inputs.snapshot().obstacles
        of_cloud = [label.startswith("obstacle_cloud/") for label in known.labels[: len(known.radii)]]
        return np.column_stack([known.centres, known.radii])[of_cloud]

    bench.wait(lambda: len(clusters()) > 0, "the ball in a cloud")
    # Its points, and `obstacle_cloud_radius` around them; of the arm nothing is left.
    np.testing.assert_allclose(clusters()[:, :3], [CENTRE] * len(clusters()), atol=0.03)
    assert np.all(np.linalg.norm(clusters()[:, :3] - CENTRE, axis=1) + RADIUS < clusters()[:, 3] + 0.01)
    figures = planner.inputs.obstacles.clouds.figures
    assert figures.of_arm > 300
    assert figures.clusters == 1
    cloud = bench.heard["obstacle_cloud"][-1]
    assert cloud.header.frame_id == "twin_camera"
    points, _ = read_cloud(cloud, "base", lambda *_: (position, quaternion))
    sent, _ = read_cloud(cloud, "twin_camera")
    np.testing.assert_allclose(points, position + rotate(quaternion, sent), atol=1e-6)
    of_ball = np.linalg.norm(points - CENTRE, axis=1) < 2.0 * RADIUS
    assert np.sum(of_ball) > 50
    # Both clocks are read one after the other.
    assert min(ages) > DELAY - 0.001
