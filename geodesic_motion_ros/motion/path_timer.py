"""PathTimer: a path through a latent graph -> a motion of the arm that begins in the state in which it takes over.

The path is smoothed, decoded and transported to its query, smoothed again as configurations, moved so that it meets its
ends exactly, and given the soonest times that the limits of the joints and of the tool allow
(`trajectory.timing.timed_joint_reference`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geodesic_motion_ros.certification.certificate import ArmCertifier, SweptArm
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.curves import arc_length_fractions
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.motion.plan import MotionState
from geodesic_motion_ros.queries.path_smoothing import resample_latent, smooth_latent
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.queries.search import LatentPath
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference

#: Width [grid steps] by which the times of a paced motion are smoothed: progress is tabulated on the grid, and its
#: changes from node to node would be changes of speed.
PACE_WIDTH = 3.0


@dataclass(frozen=True)
class JointCurve:
    """The configurations (m, eta) [rad] of a path that meets its ends, and its latent points (m, d).

    correction : how far the ends of the path were moved for that [rad].
    """

    configurations: np.ndarray
    latent: np.ndarray
    correction: float


@dataclass(frozen=True)
class TimedPath:
    """A path with times: smoothed into a latent curve (m, d), decoded and timed.

    correction : as of `JointCurve`.
    """

    latent: np.ndarray
    certifier: ArmCertifier
    reference: JointReference
    correction: float

    @cached_property
    def swept(self) -> SweptArm:
        """The places to which the reference takes the arm."""
        return self.certifier.sweep(self.reference)


class PathTimer:
    """A timer of paths through one graph, for any thread."""

    def __init__(
        self,
        graph: ConfigurationGraph | PoseGraph,
        smoothing: float,
        settings: PlannerSettings,
        limits: JointLimits,
        tool: LimitedTool,
        certifier: ArmCertifier,
        pace: np.ndarray | None = None,
    ) -> None:
        """smoothing : as of `OutputSpace`. pace : (S,) [s] of motions to a goal, as of `DemonstratedEnds`; None: they
        are as fast as can be.
        """
        self._step = graph.grid.step
        self._width = constants.REFINED_WIDTH if settings.refine else constants.UNREFINED_WIDTH
        self._joint_width = smoothing * self._width
        self._limits, self._tool, self._certifier = limits, tool, certifier
        self._progress_map = graph.progress_map
        self._pace = None if pace is None else pace / settings.speed_override

    @property
    def is_paced(self) -> bool:
        """Whether motions to a goal are slower than they could be."""
        return self._pace is not None

    def joint_curve(
        self, query: ArmQuery, start: np.ndarray, path: LatentPath, to_goal: bool
    ) -> JointCurve | Refusal:
        """Smooth a path, decode, transport, meet the ends exactly; or return why the arm cannot hold it."""
        latent = smooth_latent(resample_latent(path.polyline, self._step), self._width)
        configurations = query.configurations_along(latent, start)
        if isinstance(configurations, Refusal):
            return configurations
        curve = smooth_latent(configurations, self._joint_width)
        return meet_ends(curve, latent, start, query.goal if to_goal else curve[-1])

    def time_curve(
        self, state: MotionState, curve: JointCurve, longest: float = math.inf, paced: bool = True
    ) -> TimedPath | Refusal:
        """Time a curve that begins where the arm is; or return why no motion along it takes less than `longest` [s].

        paced : it is no faster than was shown. What evades is as fast as can be.
        """
        reference = timed_joint_reference(
            curve.configurations, curve.latent, self._limits, state.velocity, state.acceleration, tool=self._tool,
            longest=longest, shown=self._shown(curve.latent) if paced else None,
        )  # fmt: skip
        if reference is None:
            reason = self._untimed(state, curve.configurations, longest)
            return Refusal(VerdictCode.NO_FEASIBLE_PATH, reason)
        return TimedPath(curve.latent, self._certifier, reference, curve.correction)

    def _shown(self, latent: np.ndarray) -> np.ndarray | None:
        """When the motion that was shown passed latent points (m, d), (m,) [s]; where they lead back it stood."""
        if self._pace is None:
            return None
        progress, _ = self._progress_map(latent)
        passed = np.interp(progress, np.linspace(0.0, 1.0, len(self._pace)), self._pace)
        return smooth_latent(np.maximum.accumulate(passed)[:, None], PACE_WIDTH)[:, 0]

    def _untimed(self, state: MotionState, curve: np.ndarray, longest: float) -> str:
        """Why there is no motion along configurations (m, eta) from a state, within `longest` [s]."""
        if longest < math.inf:
            return f"no motion from the present one along the best path takes less than {longest:.2f} s: no gain"
        if np.any(state.velocity) or np.any(state.acceleration):
            return "stopping first: the path to the goal turns off the present motion, or leaves the joints' limits"
        beyond = np.max(np.maximum(self._limits.lower - curve, curve - self._limits.upper), axis=0)
        joint = int(np.argmax(beyond))
        if beyond[joint] > 0.0:
            name = self._tool.robot.joint_names[joint]
            return f"the path to the goal leads beyond the limit of joint '{name}', by {beyond[joint]:.3f} rad"
        return "no motion from rest along the path to the goal keeps the limits of the joints and of the tool"


def meet_ends(path: np.ndarray, latent: np.ndarray, start: np.ndarray, goal: np.ndarray) -> JointCurve:
    """Move a path (m, eta) linearly along its arc so that it begins and ends at two configurations.

    latent : (m, d) latent points of the path.
    """
    share = arc_length_fractions(path)[:, None]
    at_start, at_goal = start - path[0], goal - path[-1]
    moved = float(max(np.linalg.norm(at_start), np.linalg.norm(at_goal)))
    return JointCurve(path + (1.0 - share) * at_start + share * at_goal, latent, moved)
