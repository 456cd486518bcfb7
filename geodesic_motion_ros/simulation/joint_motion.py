"""The joint command: a velocity inside the arm's limits, integrated to a position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.robot.inverse_kinematics import pose_error, twist_step
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError


@dataclass(frozen=True)
class CatchUp:
    """How an error to the target is closed: gain [1/s], that of the posture, and how hard tool or joints may brake and
    run doing so.
    """

    gain: float = 25.0
    posture_gain: float = 20.0
    linear_deceleration: float = 1.5
    linear_speed: float = 0.6
    angular_deceleration: float = 4.0
    angular_speed: float = 2.0
    joint_deceleration: float = 5.0
    joint_speed: float = 1.5


class JointMotion:
    """The commanded joints of an arm; its velocity and acceleration limits hold at each step.

    Attributes
    ----------
    positions, velocities : (n,) commanded [rad], [rad/s].

    Raises
    ------
    RobotError : the start lies outside the position limits, or the robot has no acceleration limits.
    """

    def __init__(self, robot: Robot, positions: np.ndarray, catch_up: CatchUp = CatchUp()) -> None:
        if not np.all(np.isfinite(robot.acceleration_limits)):
            raise RobotError("the robot has no acceleration limits: give its description a joint_limits.yaml")
        self.robot, self.catch_up = robot, catch_up
        self.positions = robot.checked(positions)
        self.velocities = np.zeros(len(positions))

    def follow(
        self,
        position: np.ndarray,
        quaternion: np.ndarray,
        twist: np.ndarray,
        dt: float,
        posture: np.ndarray | None = None,
    ) -> None:
        """Advance by `dt` [s] towards a tool pose that itself moves with `twist` (6,) [m/s, rad/s].

        posture : (n,) [rad] that the null space follows; None: it is drawn gently to `Robot.ready`.
        """
        error = pose_error(*self.robot.forward(self.positions), position, quaternion)
        settings = self.catch_up
        correction = np.concatenate(
            [
                _approach(error[:3], settings.gain, settings.linear_deceleration, settings.linear_speed),
                _approach(error[3:], settings.gain, settings.angular_deceleration, settings.angular_speed),
            ]
        )
        redundancy = {} if posture is None else {"posture": posture, "posture_gain": settings.posture_gain}
        self._advance(twist_step(self.robot, self.positions, twist + correction, dt, **redundancy), dt)

    def follow_joints(self, present: np.ndarray, ahead: np.ndarray, dt: float) -> None:
        """Advance by `dt` [s] along with joint positions (n,) [rad] that are `present` now and `ahead` then.

        A motion within the limits is followed exactly from a point on it; from elsewhere it is caught up with.
        """
        settings = self.catch_up
        correction = _approach(
            present - self.positions, settings.gain, settings.joint_deceleration, settings.joint_speed
        )
        wanted = (ahead - present) / dt + correction
        self._advance(wanted / max(1.0, float(np.max(np.abs(wanted) / self.robot.velocity_limits))), dt)

    def stop(self, dt: float) -> None:
        """Advance by `dt` [s] while braking to rest as hard as the acceleration limits allow."""
        self._advance(np.zeros_like(self.velocities), dt)

    def _advance(self, wanted: np.ndarray, dt: float) -> None:
        """Move on with the wanted velocities, changed all in one proportion as far as accelerations allow."""
        robot = self.robot
        change = wanted - self.velocities
        excess = np.max(np.abs(change) / (robot.acceleration_limits * dt))
        velocities = self.velocities + change / max(1.0, excess)
        velocities = np.minimum(velocities, self._braking_speed(robot.upper - self.positions, dt))
        velocities = np.maximum(velocities, -self._braking_speed(self.positions - robot.lower, dt))
        positions = np.clip(self.positions + velocities * dt, robot.lower, robot.upper)
        self.velocities = (positions - self.positions) / dt
        self.positions = positions

    def _braking_speed(self, distance: np.ndarray, dt: float) -> np.ndarray:
        """Largest speed (n,) now that steps of `dt` can still brake to rest within a distance (n,) [rad].

        With m whole steps of braking, distance = dt ((m + 1) v - m (m + 1) a dt / 2), solved for v.
        """
        change = self.robot.acceleration_limits * dt
        distance = np.clip(distance, 0.0, 2.0 * np.pi)
        whole_steps = np.floor(0.5 * np.sqrt(1.0 + 8.0 * distance / (change * dt)) - 0.5)
        return distance / ((whole_steps + 1.0) * dt) + 0.5 * whole_steps * change


def _approach(error: np.ndarray, gain: float, deceleration: float, speed: float) -> np.ndarray:
    """Velocity (k,) that closes an error (k,): gain * error when near, sqrt(2 deceleration error) when far.

    Both meet smoothly at deceleration / gain^2, so that the deceleration is never exceeded in between.
    """
    size = float(np.linalg.norm(error))
    near = deceleration / gain**2
    if size <= near:
        return gain * error
    return min(np.sqrt(2.0 * deceleration * (size - 0.5 * near)), speed) / size * error
