"""What `train` does with a recording of an arm's joints."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from geodesic_motion_ros.cli.arguments import RECORDING_OPTIONS, given

if TYPE_CHECKING:
    import numpy as np

    from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
    from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
    from geodesic_motion_ros.learning.dimension import DimensionFigures
    from geodesic_motion_ros.learning.settings import JointTrainingSettings
    from geodesic_motion_ros.learning.workload import Workload
    from geodesic_motion_ros.robot.kinematics import Robot
    from geodesic_motion_ros.skill.skill import Skill

_SETTINGS = ("joint_density", "volume_weight", "body_sigma")
#: What only recordings of joints have.
OPTIONS = (*RECORDING_OPTIONS["joint"], *_SETTINGS, "joint_weight")


def add_options(group: argparse._ArgumentGroup) -> None:
    """Settings of the training that task space does not have."""
    group.add_argument(
        "--joint-density", choices=("gaussian", "wrapped"),
        help="wrapped: the same for angles that whole turns separate; gaussian without it",
    )  # fmt: skip
    group.add_argument(
        "--volume-weight", type=float,
        help="of the change of variables from joint angles to the body; 0 without it, the paper: 1",
    )  # fmt: skip
    group.add_argument(
        "--body-sigma", type=float,
        help="likelihood scale of the body's points [m]; 0.003 without it, 0 leaves them out as the paper does",
    )  # fmt: skip
    group.add_argument(
        "--joint-weight", type=float,
        help="what a radian of a joint counts in the metric beside the body's motion [m]; 0.05 without it",
    )  # fmt: skip


@dataclass(frozen=True)
class JointTraining:
    """A recording of joints and how it is learned; `held_out` are the indices to measure on, perhaps none."""

    demonstrations: JointDemonstrations
    robot: Robot
    held_out: tuple[int, ...]
    settings: JointTrainingSettings

    @classmethod
    def from_arguments(
        cls, arguments: argparse.Namespace, demonstrations: JointDemonstrations, shared: tuple[str, ...]
    ) -> JointTraining:
        """Read the settings; `shared` are the names of the options that all spaces have."""
        from geodesic_motion_ros.learning.settings import JointTrainingSettings
        from geodesic_motion_ros.robot.kinematics import Robot

        settings_of = JointTrainingSettings.paper if arguments.paper else JointTrainingSettings
        metric = replace(settings_of().metric, **given(arguments, "sigma_weight", "joint_weight"))
        settings = settings_of(metric=metric, **given(arguments, *shared, *_SETTINGS))
        return cls(demonstrations, Robot.named(demonstrations.robot), arguments.held_out or (), settings)

    @property
    def learned_from(self) -> JointDemonstrations:
        """The demonstrations that are not held out."""
        return self.demonstrations.split(self.held_out)[0] if self.held_out else self.demonstrations

    def tool_demonstrations(self) -> Demonstrations:
        """How the tool moves in what is learned from."""
        return self.learned_from.tool_demonstrations(self.robot)

    def workload(self) -> Workload:
        """The size of the training."""
        from geodesic_motion_ros.learning.workload import Workload

        return Workload.of(len(self.learned_from), self.settings)

    def compare_dimensions(
        self, progress: Callable[[str, int, int], None], noted: Callable[[int, np.ndarray], None]
    ) -> DimensionFigures:
        """As of `learning.dimension`."""
        from geodesic_motion_ros.learning.dimension import compare_dimensions

        return compare_dimensions(self.learned_from, self.settings, None, progress, noted)

    def learn(self, name: str, progress: Callable[[str, int, int], None], provenance: dict[str, Any]) -> Skill:
        from geodesic_motion_ros.learning.training import train_skill

        return train_skill(self.learned_from, self.settings, name, progress, provenance)
