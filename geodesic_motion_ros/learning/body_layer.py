"""The robot's forward kinematics as a fixed, differentiable layer: body points and their volume."""

from __future__ import annotations

import numpy as np
import pytorch_kinematics
import torch
from torch import Tensor, nn

from geodesic_motion_ros.robot.body_points import BodyPoints
from geodesic_motion_ros.robot.kinematics import Robot

#: What keeps the volume finite where the arm is singular [m].
EPSILON = 0.01


class BodyLayer(nn.Module):
    """Body points p_k(theta), their stacked Jacobian J(theta), and log V = 1/2 log det(J^T J + epsilon^2 I).

    V measures how much volume of the body's configurations a volume of joint angles makes; it is what a change of
    variables from joint angles to the body divides a density by (Beik-Mohammadi et al., IJRR 2023, eq. 27).
    epsilon [m] keeps it finite where the arm is singular.

    Link frames come from pytorch-kinematics. Its own Jacobian is of the tool alone; that of the body points follows
    from the joints' axes: a x (p - o) for a revolute joint, a for a prismatic one.
    """

    def __init__(
        self, robot: Robot, body: BodyPoints, orientation_weight: float = 0.0, epsilon: float = EPSILON
    ) -> None:
        """orientation_weight : what the tool's unit quaternion counts in J beside the motion of one point [m]."""
        super().__init__()
        self._chain = pytorch_kinematics.build_serial_chain_from_urdf(
            robot.urdf.read_bytes(), robot.tool_link, robot.base_link
        )
        _, _, axes, joint_index, prismatic = robot.chain
        moving = np.flatnonzero(joint_index >= 0)
        self._link_names = robot.link_names
        self.epsilon, self.orientation_weight = epsilon, orientation_weight
        # Row of a joint's frame among the links: that of its child.
        self.register_buffer("joint_rows", torch.tensor(moving + 1))
        self.register_buffer("axes", torch.tensor(axes[moving]))
        self.register_buffer("prismatic", torch.tensor(prismatic[moving]))
        self.register_buffer("frames", torch.tensor(body.frames))
        self.register_buffer("offsets", torch.tensor(body.offsets))
        # Whether joint j moves point k, (K, eta).
        self.register_buffer("moves", self.frames[:, None] >= self.joint_rows[None])

    def points(self, configurations: Tensor) -> Tensor:
        """Body points (B, K, 3) [m] at configurations (B, eta) [rad]."""
        return self._placed(*self._link_frames(configurations))

    def jacobians(self, configurations: Tensor) -> Tensor:
        """Jacobians (B, K, 3, eta) [m/rad] of the body points at configurations (B, eta) [rad]."""
        return self._jacobians(*self._link_frames(configurations))

    def orientation_jacobians(self, configurations: Tensor) -> Tensor:
        """Jacobians (B, 3, eta) [1/rad] of the tool's unit quaternion, half of its angular ones: |dq| = |omega| / 2."""
        return self._orientation_jacobians(self._link_frames(configurations)[0])

    def _jacobians(self, rotations: Tensor, origins: Tensor) -> Tensor:
        arms = self._placed(rotations, origins)[:, :, None] - origins[:, None, self.joint_rows]
        axes = self._joint_axes(rotations)[:, None].expand_as(arms)
        columns = torch.where(self.prismatic[:, None], axes, torch.linalg.cross(axes, arms))
        return (columns * self.moves[None, :, :, None]).transpose(-1, -2)

    def _orientation_jacobians(self, rotations: Tensor) -> Tensor:
        axes = self._joint_axes(rotations)
        return 0.5 * torch.where(self.prismatic[:, None], torch.zeros_like(axes), axes).transpose(-1, -2)

    def _joint_axes(self, rotations: Tensor) -> Tensor:
        """Directions of the joints' axes in the base frame, (B, eta, 3)."""
        return torch.einsum("bjac,jc->bja", rotations[:, self.joint_rows], self.axes.to(rotations))

    def _placed(self, rotations: Tensor, origins: Tensor) -> Tensor:
        turned = torch.einsum("bkij,kj->bki", rotations[:, self.frames], self.offsets.to(rotations))
        return origins[:, self.frames] + turned

    def log_volume(self, configurations: Tensor) -> Tensor:
        """log V (B,) at configurations (B, eta)."""
        rotations, origins = self._link_frames(configurations)
        stacked = self._jacobians(rotations, origins).flatten(1, 2)
        if self.orientation_weight > 0.0:
            turning = self.orientation_weight * self._orientation_jacobians(rotations)
            stacked = torch.cat([stacked, turning], dim=1)
        identity = torch.eye(stacked.shape[-1], dtype=stacked.dtype)
        return 0.5 * torch.logdet(stacked.transpose(1, 2) @ stacked + self.epsilon**2 * identity)

    def _link_frames(self, configurations: Tensor) -> tuple[Tensor, Tensor]:
        """Rotations (B, links, 3, 3) and origins (B, links, 3) of the chain's links, base first."""
        self._chain.to(dtype=configurations.dtype)
        frames = self._chain.forward_kinematics(configurations, end_only=False)
        count = len(configurations)
        matrices = torch.stack([frames[name].get_matrix().expand(count, 4, 4) for name in self._link_names], 1)
        return matrices[..., :3, :3], matrices[..., :3, 3]
