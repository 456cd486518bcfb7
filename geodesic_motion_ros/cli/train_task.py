"""What `train` does with a recording of the tool's poses."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from geodesic_motion_ros.cli.arguments import RECORDING_OPTIONS, given, read_recording
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT, RobotDescription
from geodesic_motion_ros.utils.errors import DemonstrationError

if TYPE_CHECKING:
    from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.skill.skill import Skill

# A demonstration that stays within this [m], [rad] of its first pose does not move.
_STILL_DISTANCE, _STILL_ANGLE = 1e-3, 0.02

_SETTINGS = ("orientation_model", "position_weight", "orientation_weight")
#: What only recordings of poses have.
OPTIONS = (*RECORDING_OPTIONS["task"], *_SETTINGS, "orientation_scale")


def add_options(group: argparse._ArgumentGroup) -> None:
    """Settings of the training that joint space does not have."""
    group.add_argument(
        "--orientation-model", choices=("two_cluster", "sign_blind"),
        help="q and -q in clusters of their own (default of the raw sheet), or the paper's antipodal mixture",
    )  # fmt: skip
    group.add_argument(
        "--orientation-scale", choices=("spread", "kappa"),
        help="what of kappa enters the metric: kappa^(-1/2) (default), or kappa as in the paper",
    )  # fmt: skip
    group.add_argument("--position-weight", type=float, help="beta1 of the evidence lower bound")
    group.add_argument("--orientation-weight", type=float, help="beta2 of the evidence lower bound")


@dataclass(frozen=True)
class TaskTraining:
    """A recording of the tool and how it is learned; `held_out` are the indices to measure on, perhaps none."""

    demonstrations: Demonstrations
    held_out: tuple[int, ...]
    settings: TrainingSettings
    robot: str

    @classmethod
    def from_arguments(cls, arguments: argparse.Namespace, shared: tuple[str, ...]) -> TaskTraining:
        """Read and check; `shared` are the names of the options that all spaces have."""
        from geodesic_motion_ros.learning.settings import TrainingSettings

        settings_of = TrainingSettings.paper if arguments.paper else TrainingSettings
        metric = replace(settings_of().metric, **given(arguments, "sigma_weight", "orientation_scale"))
        demonstrations = read_recording(arguments, arguments.demos)
        settings = settings_of(metric=metric, **given(arguments, *shared, *_SETTINGS))
        robot = arguments.robot or DEFAULT_ROBOT
        RobotDescription.named(robot)  # refused now, not after the training
        training = cls(demonstrations, arguments.held_out or (), settings, robot)
        refuse_motionless(training.tool_demonstrations())
        return training

    def tool_demonstrations(self) -> Demonstrations:
        """What is learned from."""
        return self.demonstrations.split(self.held_out)[0] if self.held_out else self.demonstrations

    def learn(self, name: str, progress: Callable[[str, int, int], None], provenance: dict[str, Any]) -> Skill:
        from geodesic_motion_ros.learning.training import train_task_space_skill

        return train_task_space_skill(
            self.tool_demonstrations(), self.settings, name, progress, provenance, self.robot
        )


def refuse_motionless(demonstrations: Demonstrations) -> None:
    """Refuse what nothing can be learned from: DemonstrationError names the demonstration that does not move."""
    for item in demonstrations:
        moved = float(np.linalg.norm(item.positions - item.positions[0], axis=1).max())
        turned = float(angle_between(item.quaternions, item.quaternions[0]).max())
        if moved < _STILL_DISTANCE and turned < _STILL_ANGLE:
            raise DemonstrationError(
                f"demonstration '{item.name}' does not move: {1e3 * moved:.2g} mm and {math.degrees(turned):.2g} deg "
                "at most from its first pose; leave it out of the file"
            )
