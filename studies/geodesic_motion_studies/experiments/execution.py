"""Playing a joint reference with the arm of the digital twin, by itself and without a planner: what the arm does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints

#: Physics steps between two samples, and time the arm is given to come to rest [s].
_STEPS, _SETTLING = 4, 0.3


@dataclass(frozen=True, eq=False)
class Execution:
    """What an arm did.

    Attributes
    ----------
    times : (k,) [s]; configurations : (k, eta) [rad] as measured; tool : (k, 3) [m] positions of the tool.
    tracking_error : largest difference of a joint from what it was to do at the time [rad].
    clearance : least distance [m] that was asked for, by PyBullet.
    """

    times: np.ndarray
    configurations: np.ndarray
    tool: np.ndarray
    tracking_error: float
    clearance: float


def play(world: ArmWorld, reference: JointReference, distance: Callable[[], float]) -> Execution:
    """Put the arm where a reference begins, let it play that, and measure.

    distance : of the arm in the world as it is [m], of which the least is kept.
    """
    world.reset(reference.positions[0])
    world.set_joint_trajectory(
        JointWaypoints(reference.times, reference.positions, reference.velocities, reference.accelerations)
    )
    times, done, clearance = [], [], np.inf
    while world.time < reference.duration + _SETTLING:
        times.append(world.time)
        done.append(world.joint_positions)
        clearance = min(clearance, distance())
        for _ in range(_STEPS):
            world.step()
    configurations = np.array(done)
    tool = np.array([world.robot.forward(configuration)[0] for configuration in configurations])
    behind = np.abs(configurations - reference.samples(np.array(times))[0])
    return Execution(np.array(times), configurations, tool, float(behind.max()), float(clearance))
