"""What the scripted teachers have in common: pace, style and the unsteady hand of a person."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.quaternions import continuous_signs, from_rotation, to_rotation
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError

RATE_HZ = 100.0
STEPS_PER_SAMPLE = 2  # physics at 200 Hz, so that every sample falls on a step


def check_count(name: str, count: int) -> None:
    """Refuse a number of demonstrations below one: ParameterError."""
    if count < 1:
        raise ParameterError(f"{name} is {count}: at least one demonstration is needed")


def style(generator: np.random.Generator) -> np.ndarray:
    """The two hidden numbers of a demonstration (2,): of standard normal distribution, cut at two."""
    return np.clip(generator.normal(size=2), -2.0, 2.0)


def pacing(duration: float, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) [s] and phases (T,) in [0, 1], from rest to rest; the pace varies by some 8 %."""
    samples = int(RATE_HZ * duration * np.exp(0.08 * np.clip(generator.normal(), -2.0, 2.0))) + 1
    # clipped, as rounding may pass one
    return np.arange(samples) / RATE_HZ, np.clip(smooth_step(np.linspace(0.0, 1.0, samples)), 0.0, 1.0)


def smooth_step(fraction: np.ndarray, gentle: bool = False) -> np.ndarray:
    """From 0 at 0 to 1 at 1; with zero velocity and acceleration at both ends, or gentle: nearly straight."""
    x = np.clip(fraction, 0.0, 1.0)
    step = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    return 0.7 * x + 0.3 * step if gentle else step


def hand(phase: np.ndarray, size: float, generator: np.random.Generator, components: int = 3) -> np.ndarray:
    """Slow waves (T, components) that vanish at both ends; `size` is about their standard deviation in the middle."""
    waves = np.arange(1, 4)
    heights = size / waves[:, None] * generator.normal(size=(3, components))
    return np.sin(np.pi * phase[:, None] * waves) @ heights


def outwards(start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Horizontal unit vector (3,) to the right of the line from start to goal."""
    line = goal - start
    return np.array([line[1], -line[0], 0.0]) / np.hypot(line[0], line[1])


def about(axis: str, angle: float | np.ndarray) -> Rotation:
    """Rotation, or n of them, about a fixed axis by an angle [rad], or n of them."""
    return Rotation.from_rotvec(np.multiply.outer(angle, np.eye(3)["xyz".index(axis)]))


DOWN = about("x", np.pi)
"""Of a hand that points straight down."""


def as_mounted(robot: Robot, quaternions: np.ndarray) -> np.ndarray:
    """Tool orientations (T, 4) of a robot that hold what orientations (T, 4) of a Panda's tool do.

    Tools differ by a turn about the axis along which they point: it is the one between `DOWN` and the robot's tool in
    its ready posture, in which all shipped robots point down.
    """
    turn = DOWN.inv() * to_rotation(robot.forward(robot.ready)[1])
    return continuous_signs(from_rotation(to_rotation(quaternions) * turn))
