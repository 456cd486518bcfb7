"""The volume term: measured as it is learned with, and a table of what it changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.learning.body_layer import EPSILON
from geodesic_motion_ros.learning.likelihoods import TOOL_AXES
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.robot.body_points import (
    BodyPoints,
    body_point_jacobians,
    points_along_links,
    tool_orientation_jacobians,
)
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.volume import Volume, log_volumes

#: Two latent dimensions: a graph of 100 x 100 nodes stands at once.
SMALL = JointTrainingSettings.paper(
    latent_dimension=2, steps=400, hidden=(64, 32), samples=60, kernels=100, precision_samples=2,
    precision_iterations=40, batch=64,
)  # fmt: skip


@pytest.mark.parametrize("metric", [JointMetricSettings(), JointTrainingSettings.paper().metric], ids=["ours", "paper"])
def test_the_volume_of_a_posture_is_that_of_the_learning(metric: JointMetricSettings) -> None:
    """Of the metric's points and the tool's orientation, which three points tell where the metric does not know it; the
    Jacobians are of the kernels here.
    """
    robot = Robot.named("panda")
    configurations = robot.sample(50, np.random.default_rng(0))
    beside = {} if metric.orientation_weight > 0.0 else {robot.tool_link: (TOOL_AXES * np.eye(3)).tolist()}
    body = BodyPoints.of(robot, points_along_links(robot, metric.point_spacing) | beside)
    jacobians = body_point_jacobians(configurations, body.frames, body.offsets, robot.chain)
    turning = metric.orientation_weight * tool_orientation_jacobians(configurations, robot)
    stacked = np.concatenate([jacobians.reshape(len(jacobians), -1, 7), turning], axis=1)
    gram = stacked.transpose(0, 2, 1) @ stacked + EPSILON**2 * np.eye(7)
    np.testing.assert_allclose(log_volumes(configurations, robot, metric), 0.5 * np.linalg.slogdet(gram)[1], atol=1e-6)


def test_a_strong_term_makes_the_body_move_less(reach_demonstrations: JointDemonstrations, tmp_path: Path) -> None:
    """So strong that hardly anything is learned of the demonstrations besides."""
    report = Volume(weights=(0.0, 3e4), seeds=(0,), shown=reach_demonstrations, training=SMALL).measure(tmp_path)
    without, strong = report.rows
    assert np.mean(strong.volumes) < np.mean(without.volumes) - 0.1
    assert strong.error_mm > 5.0 * without.error_mm
    assert report.table().count("\n") == 3
    report.draw(tmp_path / "volume.png")
    assert (tmp_path / "volume.png").stat().st_size > 10_000
    (again,) = Volume(weights=(0.0,), seeds=(0,), shown=reach_demonstrations, training=SMALL).measure(tmp_path).rows
    assert again.seconds is None
    np.testing.assert_array_equal(again.volumes, without.volumes)


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(ParameterError, match="no volume weights"):
        Volume(weights=())
    with pytest.raises(ParameterError, match="raw sheet"):
        Volume(training=replace(SMALL, sheet="canonical"))
