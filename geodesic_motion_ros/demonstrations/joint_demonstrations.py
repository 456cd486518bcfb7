"""Demonstrations of the whole arm: recordings of its joints as checked arrays in SI units.

Symbols: eta moving joints; a configuration is a point (eta,) [rad] of joint space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geodesic_motion_ros.demonstrations.checks import (
    Abscissa,
    check_columns,
    check_resampling,
    check_rising_times,
    check_samples,
)
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations, DemonstrationSet
from geodesic_motion_ros.geometry.curves import arc_length
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.utils.checked_numbers import LARGEST_TURN
from geodesic_motion_ros.utils.errors import DemonstrationError, RobotError

if TYPE_CHECKING:
    from geodesic_motion_ros.robot.kinematics import Robot

SHORTEST_PATH = 1e-3
"""A path shorter than this [rad] is noise of an arm that stood still: nothing to resample by."""


@dataclass(frozen=True, eq=False)
class JointDemonstration:
    """One motion of an arm that a person guided. The arrays are checked copies and cannot be written to.

    Attributes
    ----------
    configurations : (T, eta) joint positions [rad], base first.
    times : (T,) [s], strictly increasing.
    name : what error messages and tables call it.

    Raises
    ------
    DemonstrationError
        Names the demonstration, the sample and the joint (counted from 1) of what cannot be used: fewer than two
        samples, wrong shapes, NaN or infinite values, times that do not increase.
    """

    configurations: np.ndarray
    times: np.ndarray
    name: str

    def __post_init__(self) -> None:
        joints = np.shape(self.configurations)[-1] if np.ndim(self.configurations) == 2 else 1
        names = [f"joint {number}" for number in range(1, joints + 1)]
        configurations = check_columns(self.configurations, names, self.name)
        times = check_rising_times(self.times, self.name)
        if len(configurations) != len(times):
            raise DemonstrationError(
                f"demonstration '{self.name}' has {len(configurations)} configurations and {len(times)} times; "
                "it needs one of each per sample"
            )
        check_samples(len(times), self.name)
        for name, array in (("configurations", configurations), ("times", times)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def length(self) -> float:
        """Length [rad] of the path in joint space, the sum of sqrt(sum_j dq_j^2) over its steps."""
        return float(arc_length(self.configurations)[-1])

    def resample(self, samples: int = 200, by: Abscissa = "arc_length") -> JointDemonstration:
        """Resample the motion at `samples` instants, equally spaced in arc length in joint space or in time.

        Configurations and times are interpolated linearly. Times stay those of the recording. Raises
        DemonstrationError for fewer than 2 samples, another `by`, or an arc length of zero.
        """
        check_resampling(samples, by)
        if by == "arc_length" and self.length < SHORTEST_PATH:
            raise DemonstrationError(
                f"demonstration '{self.name}' moves {self.length:.3g} rad in all: it has no arc length; "
                "resample by 'time'"
            )
        abscissa = arc_length(self.configurations) if by == "arc_length" else self.times
        at = np.linspace(abscissa[0], abscissa[-1], samples)
        configurations = np.stack([np.interp(at, abscissa, joint) for joint in self.configurations.T], axis=1)
        times = at if by == "time" else np.interp(at, abscissa, self.times)
        return JointDemonstration(configurations, times, self.name)


@dataclass(frozen=True, eq=False)
class JointDemonstrations(DemonstrationSet[JointDemonstration]):
    """Demonstrations of one task by one arm.

    Attributes
    ----------
    items : at least one JointDemonstration, all of the same joints.
    joint_names : (eta,) names of the joints, base first.
    robot : name of the arm, as `Robot.named` knows it.
    """

    joint_names: tuple[str, ...]
    robot: str

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        for item in self.items:
            joints = item.configurations.shape[1]
            if joints != len(self.joint_names):
                raise DemonstrationError(
                    f"demonstration '{item.name}' has {joints} joints; {len(self.joint_names)} are named: "
                    f"{', '.join(self.joint_names)}"
                )

    def configurations_array(self) -> np.ndarray:
        """Stack configurations (N, T, eta) [rad]; DemonstrationError where the numbers of samples differ."""
        return self.stacked("configurations")

    def tool_demonstrations(self, robot: Robot) -> Demonstrations:
        """Compute the poses of the robot's tool in its base frame, with the same names and times.

        Raises
        ------
        DemonstrationError : the robot has other joints, or a configuration is outside its limits.
        """
        self.check_robot(robot)
        items = tuple(_tool_demonstration(item, robot) for item in self)
        return Demonstrations(items, frame=robot.base_link, has_times=self.has_times)

    def check_robot(self, robot: Robot) -> None:
        """Refuse a robot that cannot have moved so: DemonstrationError names joint, or demonstration and sample."""
        if self.joint_names != robot.joint_names:
            raise DemonstrationError(
                f"the demonstrations are of the joints {', '.join(self.joint_names)}; "
                f"the robot has {', '.join(robot.joint_names)}"
            )
        for item in self:
            inside = (item.configurations >= robot.lower) & (item.configurations <= robot.upper)
            for sample in np.flatnonzero(~inside.all(axis=1)):
                configuration = item.configurations[sample]
                try:
                    robot.checked(configuration)
                except RobotError as error:
                    radians = np.radians(configuration)
                    degrees = np.all((radians >= robot.lower) & (radians <= robot.upper))
                    hint = "; are these degrees? Joints are read in radians without --units deg" if degrees else ""
                    raise DemonstrationError(f"demonstration '{item.name}', sample {sample}: {error}{hint}") from error
            turned = float(np.abs(item.configurations).max())
            if turned > LARGEST_TURN:  # of joints without an end
                raise DemonstrationError(
                    f"demonstration '{item.name}': a joint turns to {turned:.4g} rad, at most {LARGEST_TURN:.4g}; "
                    "are these degrees? Joints are read in radians without --units deg"
                )


def _tool_demonstration(item: JointDemonstration, robot: Robot) -> Demonstration:
    poses = [robot.forward(configuration) for configuration in item.configurations]
    positions, quaternions = map(np.array, zip(*poses, strict=True))
    return Demonstration(positions, continuous_signs(quaternions), item.times, item.name)
