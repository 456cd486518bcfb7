"""Transport in joint space: carrying decoded configurations to a query, so that a path begins and ends where it must.

Where tau in [0, 1] is the goal's share of the offsets (`manifold.transport`), the tool is to move by
x = (1 - tau) x0 + tau x1, a translation [m] and a rotation vector [rad], and the joints, as far as the tool leaves them
free, by e = (1 - tau) d0 + tau d1, where d0, d1 are the joint offsets of start and goal and x0, x1 what they mean to
the tool. A configuration theta is carried by

    D(theta, tau) = J^+ x + (1 - J^+ J) e,       J the tool's Jacobian at theta, J^+ its damped inverse,

plus what the linearisation leaves at both ends, blended linearly, so that these are met exactly. Adding e alone would
do so too, but in between, where the arm may stand quite differently than at its start, the same joint offsets move the
tool elsewhere: with elbows swung out by 75 degrees by 30 mm instead of 6 on average.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.manifold.transport import blended, corrections_at, faded
from geodesic_motion_ros.robot.inverse_kinematics import damped_step, pose_error
from geodesic_motion_ros.robot.kinematics import Robot, jacobian


@dataclass(frozen=True)
class JointOffsets:
    """The displacements that move decoded configurations so that they begin and end at a query's start and goal.

    Attributes
    ----------
    tool : (2, 6) x0 and x1; joints : (2, eta) d0 and d1 [rad]; rest : (2, eta) what the linearisation leaves [rad].
    start_progress, goal_progress : progress of the latent points that are carried onto start and goal.
    corrections : (K, S, eta) corrections of the decoder along K mean paths [rad], added before; K may be 0.
    fade : exponent with which the start's offset fades.
    """

    robot: Robot
    tool: np.ndarray
    joints: np.ndarray
    rest: np.ndarray
    start_progress: float
    goal_progress: float
    corrections: np.ndarray
    fade: float = 1.0

    @classmethod
    def between(
        cls,
        robot: Robot,
        demonstrated: np.ndarray,
        requested: np.ndarray,
        progress: tuple[float, float] = (0.0, 1.0),
        corrections: np.ndarray | None = None,
        fade: float = 1.0,
    ) -> JointOffsets:
        """From demonstrated ends (2, eta) to requested ones (2, eta) [rad]: start and goal, at so much progress.

        The demonstrated ends are corrected ones, where there are corrections.
        """
        joints, ends = requested - demonstrated, zip(demonstrated, requested, strict=True)
        tool = np.stack([pose_error(*robot.forward(before), *robot.forward(after)) for before, after in ends])
        rest = joints - _tool_steps(np.ascontiguousarray(demonstrated), tool, joints, robot.chain)
        none = np.zeros((0, 2, joints.shape[1]))
        return cls(robot, tool, joints, rest, *progress, none if corrections is None else corrections, fade)

    @classmethod
    def none(cls, robot: Robot, mean_paths: int = 0) -> JointOffsets:
        """Leaves every configuration of a graph with so many mean paths where it is."""
        joints = len(robot.joint_names)
        still = np.zeros((2, joints))
        return cls(robot, np.zeros((2, 6)), still, still, 0.0, 1.0, np.zeros((mean_paths, 2, joints)))

    def carried(self, configurations: np.ndarray, progress: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Configurations (n, eta) carried to the query, at progress (n,) and shares (n, K) of the mean paths."""
        corrected = configurations + corrections_at(self.corrections, progress, shares)
        return corrected + self.displacements(corrected, progress)

    def displacements(self, configurations: np.ndarray, progress: np.ndarray) -> np.ndarray:
        """D (n, eta) [rad] of configurations (n, eta) that are corrected already."""
        tau = self.blended(progress)[:, None]
        tool, joints, rest = ((1.0 - tau) * ends[0] + tau * ends[1] for ends in (self.tool, self.joints, self.rest))
        return _tool_steps(np.ascontiguousarray(configurations), tool, joints, self.robot.chain) + rest

    def carried_by(self, steps: ToolSteps) -> np.ndarray:
        """The same (n, eta) for configurations whose steps are known."""
        return _stepped(steps, self.blended(steps.progress), self.tool, self.joints, self.rest)

    def blended(self, progress: np.ndarray) -> np.ndarray:
        """tau (n,) in [0, 1], the share of the goal's offset, at progress (n,)."""
        return faded(blended(progress, self.start_progress, self.goal_progress), self.fade)


class ToolSteps(NamedTuple):
    """How configurations are moved by whatever offsets: worked out once for those that many queries carry.

    Attributes
    ----------
    corrected : (n, eta) [rad] configurations with the corrections of the decoder. progress : (n,) theirs.
    pulls : (n, eta, 6) J^+ there. drifts : (n, eta, eta) 1 - J^+ J.
    """

    corrected: np.ndarray
    progress: np.ndarray
    pulls: np.ndarray
    drifts: np.ndarray

    @classmethod
    def of(
        cls, configurations: np.ndarray, progress: np.ndarray, shares: np.ndarray, corrections: np.ndarray, robot: Robot
    ) -> ToolSteps:
        """Of configurations as of `JointOffsets.carried`, with corrections (K, S, eta)."""
        corrected = np.ascontiguousarray(configurations + corrections_at(corrections, progress, shares))
        return cls(corrected, progress, *_step_operators(corrected, robot.chain))


@numba.njit(cache=True, nogil=True)
def _step_operators(configurations, chain):
    """J^+ (n, eta, 6) and 1 - J^+ J (n, eta, eta), by the columns that `_tool_steps` makes of unit vectors."""
    count, joints = configurations.shape
    pulls, drifts, free = np.empty((count, joints, 6)), np.empty((count, joints, joints)), np.ones(joints)
    task, drift = np.zeros(6), np.zeros(joints)
    for i in range(count):
        matrix = jacobian(configurations[i], chain)
        for k in range(6):
            task[k] = 1.0
            pulls[i, :, k] = damped_step(matrix, free, task, drift, -1.0)
            task[k] = 0.0
        for k in range(joints):
            drift[k] = 1.0
            drifts[i, :, k] = damped_step(matrix, free, task, drift, -1.0)
            drift[k] = 0.0
    return pulls, drifts


@numba.njit(cache=True, nogil=True)
def _stepped(steps, tau, tool, joints, rest):
    """Configurations (n, eta) carried by x (2, 6), e (2, eta) and what is left (2, eta) of both ends."""
    count, size = steps.corrected.shape
    result = steps.corrected.copy()
    # x, e and the rest are linear in tau, and so is the step.
    for i in range(count):
        for j in range(size):
            for end in range(2):
                share = tau[i] if end else 1.0 - tau[i]
                step = rest[end, j]
                for k in range(6):
                    step += steps.pulls[i, j, k] * tool[end, k]
                for k in range(size):
                    step += steps.drifts[i, j, k] * joints[end, k]
                result[i, j] += share * step
    return result


@numba.njit(cache=True, nogil=True)
def _tool_steps(configurations, tool, joints, chain):
    """J^+ x + (1 - J^+ J) e (n, eta) at configurations (n, eta), for x (n, 6) and e (n, eta)."""
    steps = np.empty_like(joints)
    free = np.ones(joints.shape[1])
    for i in range(len(configurations)):
        # A negative damping is chosen by how near the arm is to a singular posture.
        steps[i] = damped_step(jacobian(configurations[i], chain), free, tool[i], joints[i], -1.0)
    return steps
