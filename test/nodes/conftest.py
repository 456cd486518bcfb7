"""A skill without training, so that tests of the parts of nodes need no torch; and inputs that hear what they say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import rclpy

from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder
from geodesic_motion_ros.manifold.pose_graph import MetricSettings
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.urdf import read_urdf
from geodesic_motion_ros.skill.skill import Skill
from test.nodes.inputs_bench import Bench


@pytest.fixture(scope="session")
def flat_skill() -> Skill:
    """The square [-1, 1]^2 of latent space laid on a nearly flat, half a metre wide sheet above the table.

    The first latent axis runs along y, as the demonstrations do, the second along z; the tool looks down.
    """
    scale = 0.05
    first = np.zeros((2, 2))
    first[0, 0] = first[1, 1] = scale
    out = np.zeros((7, 2))
    out[1, 0] = out[2, 1] = 1.0 / scale
    bias = np.zeros(7)
    bias[4] = 1.0
    centres = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2)
    decoder = TaskSpaceDecoder(
        W1=first, b1=np.zeros(2), W2=np.eye(2), b2=np.zeros(2), W3=out, b3=bias,
        position_offset=np.array([0.45, 0.0, 0.35]), position_scale=np.array(0.25),
        rbf_centres=centres, rbf_rate=np.array(4.0),
        sigma_weights=np.full((3, len(centres)), 100.0), sigma_floor=np.full(3, 1.0),
        kappa_weights=np.full(len(centres), 400.0), kappa_floor=np.array(1.0),
    )  # fmt: skip
    along = np.linspace(-0.9, 0.9, 100)
    codes = np.stack([np.stack([along, np.full(100, height)], axis=1) for height in (-0.5, -0.2, 0.1, 0.4)])
    ends = decoder.decode(np.array([[-0.9, 0.0], [0.9, 0.0]]))
    poses = np.concatenate([ends.positions, ends.quaternions], axis=1)
    return Skill(
        name="flat", decoder=decoder, codes=codes, latent_lower=np.full(2, -1.0), latent_upper=np.full(2, 1.0),
        sigma_support=0.01, energy_per_edge=1.0, start_pose=poses[0], goal_pose=poses[1],
        metric=MetricSettings(sigma_weight=1.0), base_frame="panda_link0", tool_frame="panda_grasptarget",
    )  # fmt: skip


@pytest.fixture(scope="session")
def endless_robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A Panda whose joints have no ends."""
    root = read_urdf(Robot.named("panda").urdf)
    for joint in root.iterfind("joint[@type='revolute']"):
        joint.set("type", "continuous")
    path = tmp_path_factory.mktemp("robots") / "endless.urdf"
    path.write_text(ElementTree.tostring(root, encoding="unicode"))
    return Robot.from_urdf(path, "panda_link0", "panda_grasptarget")


@pytest.fixture
def node() -> Iterator[Any]:
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("listener", context=context)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.fixture
def bench(node) -> Bench:
    return Bench(node)
