"""What `train` does with a recording of the tool's poses."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from geodesic_motion_ros.cli.arguments import RECORDING_OPTIONS, given
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT

if TYPE_CHECKING:
    import numpy as np

    from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
    from geodesic_motion_ros.learning.dimension import DimensionFigures
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.learning.workload import Workload
    from geodesic_motion_ros.skill.skill import Skill

_SETTINGS = (
    "orientation_model", "position_density", "orientation_density", "position_weight", "orientation_weight",
    "far_kappa",
)  # fmt: skip
#: What only recordings of poses have.
OPTIONS = (*RECORDING_OPTIONS["task"], *_SETTINGS, "orientation_scale")


def add_options(group: argparse._ArgumentGroup) -> None:
    """Settings of the training that joint space does not have."""
    group.add_argument(
        "--orientation-model", choices=("two_cluster", "sign_blind"),
        help="of the raw sheet: q and -q in clusters of their own (default), or the paper's antipodal mixture",
    )  # fmt: skip
    group.add_argument(
        "--orientation-scale", choices=("spread", "kappa"),
        help="what of kappa enters the metric: kappa^(-1/2) (default), or kappa as in the paper",
    )  # fmt: skip
    group.add_argument(
        "--position-density", choices=("diagonal", "full"), help="covariance of positions; diagonal without it"
    )
    group.add_argument(
        "--orientation-density", choices=("von_mises_fisher", "angular_central_gaussian"),
        help="as wide about every axis (default), or a concentration about each of the tool's",
    )  # fmt: skip
    group.add_argument("--position-weight", type=float, help="beta1 of the evidence lower bound")
    group.add_argument("--orientation-weight", type=float, help="beta2 of the evidence lower bound")
    group.add_argument(
        "--far-kappa", type=float,
        help="concentration of orientations far from the demonstrations; 0.01 without it; the paper states none",
    )  # fmt: skip


@dataclass(frozen=True)
class TaskTraining:
    """A recording of the tool and how it is learned; `held_out` are the indices to measure on, perhaps none."""

    demonstrations: Demonstrations
    held_out: tuple[int, ...]
    settings: TrainingSettings
    robot: str

    @classmethod
    def from_arguments(
        cls, arguments: argparse.Namespace, demonstrations: Demonstrations, shared: tuple[str, ...]
    ) -> TaskTraining:
        """Read the settings; `shared` are the names of the options that all spaces have."""
        from geodesic_motion_ros.learning.settings import TrainingSettings
        from geodesic_motion_ros.robot.kinematics import Robot, check_takes_poses

        settings_of = TrainingSettings.paper if arguments.paper else TrainingSettings
        metric = replace(settings_of().metric, **given(arguments, "sigma_weight", "orientation_scale"))
        settings = settings_of(metric=metric, **given(arguments, *shared, *_SETTINGS))
        robot = arguments.robot or DEFAULT_ROBOT
        check_takes_poses(Robot.named(robot))  # refused now, not after the training
        return cls(demonstrations, arguments.held_out or (), settings, robot)

    def tool_demonstrations(self) -> Demonstrations:
        """What is learned from."""
        return self.demonstrations.split(self.held_out)[0] if self.held_out else self.demonstrations

    def workload(self) -> Workload:
        """The size of the training."""
        from geodesic_motion_ros.learning.workload import Workload

        learned = self.tool_demonstrations()
        return Workload.of(len(learned), self.settings, 2 if learned.has_orientation else 1)

    def compare_dimensions(
        self, progress: Callable[[str, int, int], None], noted: Callable[[int, np.ndarray], None]
    ) -> DimensionFigures:
        """As of `learning.dimension`."""
        from geodesic_motion_ros.learning.dimension import compare_dimensions

        return compare_dimensions(self.tool_demonstrations(), self.settings, self.robot, progress, noted)

    def learn(self, name: str, progress: Callable[[str, int, int], None], provenance: dict[str, Any]) -> Skill:
        from geodesic_motion_ros.learning.training import train_skill

        return train_skill(self.tool_demonstrations(), self.settings, name, progress, provenance, self.robot)
