"""Canonical, that is endpoint-normalised, form of joint-space demonstrations: where a task begins and ends taken out.

With s in [0, 1] the fraction of a demonstration's arc, canonical curves y(s) are those that `manifold.joint_transport`
carries onto the demonstrations: theta(s) = y(s) + D(y(s), s), with the fade of `demonstrations.fade`. The arc counts
what the metric counts: the mean squared motion of the body points, and with a small weight that of the joints.

Offsets are counted from the mean of all starts (ends), and where that is no configuration to count from, because some
lie further from it than an offset may reach, from the mean of those alone that start (end) in the same family of
configurations: two that hold the tool in one pose with the elbow on two sides are never averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.demonstrations.fade import FADE_SAMPLES, likeliest_fade, scatter_within
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.modes import cluster_modes
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Starts and goals may lie this far [rad], over all joints, from the mean of their group.
LARGEST_OFFSET = 1.5
#: y = theta - D(y, s) is solved by so many fixed-point iterations.
_ITERATIONS = 8


@dataclass(frozen=True)
class CanonicalJointDemonstrations:
    """Demonstrations (N) in canonical form at the same fractions s (T,) of their arcs.

    Attributes
    ----------
    configurations : (N, T, eta) [rad].
    start_offsets, goal_offsets : (N, eta) [rad], from the pole of the demonstration's group.
    start_groups, goal_groups : (N,) numbers of the groups; start_poles, goal_poles : (G, eta) their means [rad].
    fade : exponent with which start offsets were taken out.
    """

    configurations: np.ndarray
    start_offsets: np.ndarray
    goal_offsets: np.ndarray
    start_groups: np.ndarray
    goal_groups: np.ndarray
    start_poles: np.ndarray
    goal_poles: np.ndarray
    fade: float


def body_arc(configurations: np.ndarray, robot: Robot, metric: JointMetricSettings) -> np.ndarray:
    """Arc [m] up to each configuration of a motion (T, eta) [rad]; (T,), from 0.

    It counts sqrt(mean_k |dp_k|^2 + joint_weight^2 |dtheta|^2), with p_k the metric's body points.
    """
    body = metric.body_points(robot)
    points = place_body_points(np.ascontiguousarray(configurations), body.frames, body.offsets, robot.chain)
    moved = np.sum(np.diff(points, axis=0) ** 2, axis=-1).mean(axis=1)
    turned = np.sum(np.diff(configurations, axis=0) ** 2, axis=1)
    return np.append(0.0, np.cumsum(np.sqrt(moved + metric.joint_weight**2 * turned)))


def along_body_arc(
    configurations: np.ndarray, robot: Robot, metric: JointMetricSettings, samples: int
) -> np.ndarray:
    """Configurations (samples, eta) [rad], equally spaced along the arc of a motion (T, eta) [rad]."""
    arc = body_arc(configurations, robot, metric)
    at = np.linspace(0.0, arc[-1], samples)
    return np.stack([np.interp(at, arc, column) for column in configurations.T], axis=1)


def canonical_joint_form(
    demonstrations: JointDemonstrations,
    robot: Robot,
    metric: JointMetricSettings,
    samples: int,
    fade: float | None = None,
) -> CanonicalJointDemonstrations:
    """Resample demonstrations along their arcs and take their start and goal offsets out.

    fade : exponent with which start offsets fade; None: the likeliest.

    Raises
    ------
    DemonstrationError : a demonstration starts or ends far from all others of its group.
    """
    curves = np.stack([along_body_arc(item.configurations, robot, metric, samples) for item in demonstrations])
    start_groups, start_poles, start_offsets = _grouped(curves[:, 0])
    goal_groups, goal_poles, goal_offsets = _grouped(curves[:, -1])
    for verb, offsets in (("starts", start_offsets), ("ends", goal_offsets)):
        sizes = np.linalg.norm(offsets, axis=1)
        if np.any(sizes > LARGEST_OFFSET):
            listed = ", ".join(f"{item.name} {size:.2f}" for item, size in zip(demonstrations, sizes, strict=True))
            raise DemonstrationError(
                f"demonstration '{demonstrations[int(np.argmax(sizes))].name}' {verb} further than "
                f"{LARGEST_OFFSET:g} rad from the others like it: one skill is learned from demonstrations of one "
                f"task; distances [rad] from the mean are {listed}"
            )
    ends = np.stack([start_poles[start_groups], goal_poles[goal_groups]], axis=1)
    if fade is None:
        few = np.stack([along_body_arc(item.configurations, robot, metric, FADE_SAMPLES) for item in demonstrations])
        modes = cluster_modes(_without_all(few, ends, robot, 1.0))
        fade = likeliest_fade(lambda tried: scatter_within(_without_all(few, ends, robot, tried), modes), len(few))
    canonical = _without_all(curves, ends, robot, fade)
    return CanonicalJointDemonstrations(
        canonical, start_offsets, goal_offsets, start_groups, goal_groups, start_poles, goal_poles, fade
    )


def _without_all(curves: np.ndarray, ends: np.ndarray, robot: Robot, fade: float) -> np.ndarray:
    return np.stack([without_offsets(curve, poles, robot, fade) for curve, poles in zip(curves, ends, strict=True)])


def without_offsets(curve: np.ndarray, poles: np.ndarray, robot: Robot, fade: float = 1.0) -> np.ndarray:
    """y (T, eta) with y + D(y, s) = curve (T, eta), which is equally spaced in s, for poles (2, eta) [rad]."""
    offsets = JointOffsets.between(robot, poles, curve[[0, -1]], fade=fade)
    s = np.linspace(0.0, 1.0, len(curve))
    canonical = curve
    for _ in range(_ITERATIONS):
        canonical = curve - offsets.displacements(canonical, s)
    return canonical


def _grouped(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Groups (N,) of configurations (N, eta), the groups' means (G, eta), and the offsets (N, eta) from them."""
    groups = np.zeros(len(ends), dtype=int)
    if np.any(np.linalg.norm(ends - ends.mean(axis=0), axis=1) > LARGEST_OFFSET):
        groups = cluster_modes(ends[:, None])
    poles = np.stack([ends[groups == group].mean(axis=0) for group in range(groups.max() + 1)])
    return groups, poles, ends - poles[groups]
