"""Motions of a tool on an arm that need not be the one that showed them: planned, played in the twin, compared.

*Ours*: the planner of this package, with the arm's kinematics, limits and certificate, the task frame where the
demonstrations are for the arm; the twin plays the joint trajectory by position control. *Literal*: the paper's planner
knows poses alone. They are commanded at 100 Hz, the twin's arm follows them by inverse kinematics, and nothing but its
limits is looked at.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import angle_between, continuous_signs, normalise
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.paper.follower import followed
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.utils.errors import RobotError
from geodesic_motion_studies.experiments.execution import play
from geodesic_motion_studies.experiments.joint_imitation import tool_curve
from geodesic_motion_studies.tools.similarity import Similarity, compare

#: Physics steps a second, and between two commanded poses of the literal rows.
RATE_HZ = 200.0
_STEPS = 2
#: What is commanded rests so long after the end of a path, at the latest [s].
_SETTLING = 5.0


@dataclass(frozen=True, eq=False)
class PlayedMotion:
    """What an arm did of a motion of its tool.

    Attributes
    ----------
    planned, played : from the demonstration that was to be met, of the planned and of the measured path of the tool.
    lag, lag_angle : largest distance [m] and angle [rad] of the tool from where it was to be at the time.
    duration : of what was commanded [s].
    clearance : least distance of the arm from itself [m], by its meshes in PyBullet; inf where that is large.
    tool : measured, in the frame of the demonstrations. configurations : (k, eta) [rad] measured, evenly in time.
    """

    planned: Similarity
    played: Similarity
    lag: float
    lag_angle: float
    duration: float
    clearance: float
    tool: PoseCurve
    configurations: np.ndarray

    @classmethod
    def of(
        cls,
        shown: PoseCurve,
        planned: PoseCurve,
        commanded: PoseCurve,
        configurations: np.ndarray,
        world: ArmWorld,
        frame: TaskFrame,
        duration: float,
        clearance: float,
    ) -> PlayedMotion:
        """commanded : where the tool was to be as the configurations (k, eta) were measured, in the arm's base frame;
        shown, planned : in that of the demonstrations, which stands in `frame`.
        """
        measured = tool_curve(configurations, world.robot)
        lag = np.linalg.norm(measured.positions - commanded.positions, axis=1).max()
        lag_angle = angle_between(measured.quaternions, commanded.quaternions).max()
        tool = in_frame(measured, frame)
        return cls(
            compare(planned, shown), compare(tool, shown), float(lag), float(lag_angle), duration, clearance, tool,
            configurations,
        )  # fmt: skip


def in_frame(curve: PoseCurve, frame: TaskFrame) -> PoseCurve:
    """A curve of the base frame as the frame sees it."""
    positions, quaternions = frame.to_task(curve.positions, curve.quaternions)
    return PoseCurve(positions, continuous_signs(quaternions))


def play_ours(
    planner: ReactivePlanner, world: ArmWorld, frame: TaskFrame, shown: PoseCurve
) -> PlayedMotion | str:
    """From the start of a demonstration to its goal, or why the planner refuses."""
    planner.set_task_frame(frame.origin, frame.quaternion)
    plan = planner.plan(*frame.to_base(*shown.start), *frame.to_base(*shown.goal))
    reference = plan.reference
    if reference is None:
        return f"{plan.verdict.code.name}: {plan.verdict.reason}"
    done = play(world, reference, lambda: world.own_clearance()[0])
    commanded = tool_curve(reference.samples(done.times)[0], world.robot)
    return PlayedMotion.of(
        shown, in_frame(commanded, frame), commanded, done.configurations, world, frame, reference.duration,
        done.clearance,
    )  # fmt: skip


def play_literal(planner: PaperPlanner, world: ArmWorld, frame: TaskFrame, shown: PoseCurve) -> PlayedMotion | str:
    """From the node nearest to the start of a demonstration to that nearest to its goal, or why the arm cannot."""
    path = planner.plan(shown.start, shown.goal)
    period = _STEPS * world.dt
    most = math.ceil((path.duration + _SETTLING) / period)
    places, _, _ = followed(path.times, path.places, 0.0, path.places[0], np.zeros(7), period, most)
    commanded = PoseCurve(*frame.to_base(places[:, :3], normalise(places[:, 3:])))
    configurations, clearance = [], math.inf
    try:
        world.reset(tool_pose=commanded.start)
        for pose in zip(commanded.positions, commanded.quaternions, strict=True):
            configurations.append(world.joint_positions)
            clearance = min(clearance, world.own_clearance()[0])
            world.set_target_pose(*pose)
            for _ in range(_STEPS):
                world.step()
    except RobotError as error:
        return str(error)
    return PlayedMotion.of(
        shown, PoseCurve(*planner.tool_poses(path)), commanded, np.array(configurations), world, frame,
        period * (len(places) - 1), clearance,
    )  # fmt: skip
