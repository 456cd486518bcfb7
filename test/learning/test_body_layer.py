"""The kinematic layer: PyTorch's points, Jacobians and volumes are those of the compiled kernels."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.robot.body_points import (
    BodyPoints,
    body_point_jacobians,
    place_body_points,
    points_along_links,
    tool_orientation_jacobians,
)
from geodesic_motion_ros.robot.kinematics import Robot

ROBOT = Robot.named("panda")
BODY = BodyPoints.of(ROBOT, points_along_links(ROBOT, 0.2) | {ROBOT.tool_link: [[0.1, 0.0, 0.0]]})


@pytest.fixture(scope="module")
def layer() -> BodyLayer:
    return BodyLayer(ROBOT, BODY)


@pytest.fixture(scope="module")
def configurations() -> np.ndarray:
    random = np.random.default_rng(0)
    return random.uniform(ROBOT.lower, ROBOT.upper, (40, 7))


def test_points_are_those_of_the_compiled_kinematics(layer, configurations) -> None:
    placed = place_body_points(configurations, BODY.frames, BODY.offsets, ROBOT.chain)
    np.testing.assert_allclose(layer.points(torch.tensor(configurations)).numpy(), placed, atol=1e-6)


def test_jacobians_are_those_of_the_compiled_kinematics(layer, configurations) -> None:
    compiled = body_point_jacobians(configurations, BODY.frames, BODY.offsets, ROBOT.chain)
    np.testing.assert_allclose(layer.jacobians(torch.tensor(configurations)).numpy(), compiled, atol=1e-6)


def test_jacobians_are_the_points_finite_differences(layer, configurations) -> None:
    step = 1e-5
    jacobians = layer.jacobians(torch.tensor(configurations)).numpy()
    for joint in range(7):
        moved = step * np.eye(7)[joint]
        after, before = (layer.points(torch.tensor(configurations + sign * moved)).numpy() for sign in (1.0, -1.0))
        np.testing.assert_allclose(jacobians[..., joint], (after - before) / (2.0 * step), atol=1e-6)


def test_orientation_jacobians_are_half_of_the_angular_ones(layer, configurations) -> None:
    expected = 0.5 * np.stack([ROBOT.jacobian(configuration)[3:] for configuration in configurations])
    found = layer.orientation_jacobians(torch.tensor(configurations)).numpy()
    np.testing.assert_allclose(found, expected, atol=1e-6)
    # The compiled ones are another isometric form of the same.
    compiled = tool_orientation_jacobians(configurations, ROBOT)
    grams = [part.transpose(0, 2, 1) @ part for part in (compiled, expected)]
    np.testing.assert_allclose(*grams, atol=1e-9)


@pytest.mark.parametrize("orientation_weight", [0.0, 0.7])
def test_log_volume_is_that_of_the_stacked_jacobian(configurations, orientation_weight) -> None:
    layer = BodyLayer(ROBOT, BODY, orientation_weight)
    jacobians = body_point_jacobians(configurations, BODY.frames, BODY.offsets, ROBOT.chain)
    turning = orientation_weight * tool_orientation_jacobians(configurations, ROBOT)
    stacked = np.concatenate([jacobians.reshape(len(configurations), -1, 7), turning], axis=1)
    gram = np.einsum("nij,nik->njk", stacked, stacked) + layer.epsilon**2 * np.eye(7)
    volumes = layer.log_volume(torch.tensor(configurations)).numpy()
    np.testing.assert_allclose(volumes, 0.5 * np.linalg.slogdet(gram)[1], atol=1e-6)


def test_gradients_of_points_and_volume_flow_to_the_joints(layer, configurations) -> None:
    theta = torch.tensor(configurations[:3], requires_grad=True)
    weights = torch.randn(3, len(BODY), 3, generator=torch.Generator().manual_seed(0), dtype=torch.double)
    (layer.points(theta) * weights).sum().backward()
    expected = np.einsum("nkaj,nka->nj", layer.jacobians(theta).detach().numpy(), weights.numpy())
    np.testing.assert_allclose(theta.grad.numpy(), expected, atol=1e-6)
    assert torch.autograd.gradcheck(layer.log_volume, (theta,), eps=1e-6, atol=1e-4)


def test_an_arm_that_is_stretched_out_is_near_singular_and_stays_finite(layer) -> None:
    """Regularised: where the arm is singular the volume is small, and finite."""
    stretched, bent = torch.zeros(1, 7).double(), torch.tensor(ROBOT.ready)[None]
    tool = BodyLayer(ROBOT, BodyPoints.of(ROBOT), epsilon=1e-4)
    assert torch.isfinite(tool.log_volume(stretched)).all()
    assert tool.log_volume(stretched).item() < tool.log_volume(bent).item()
