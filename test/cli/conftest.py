"""What the trainings by the command share: they are brief."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from geodesic_motion_ros.learning import joint_training, training
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.skill import skill
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization import skill_report

SMALL = {"hidden": (48, 32), "samples": 60, "batch": 128, "precision_samples": 2, "precision_iterations": 40}


def brief(train: Callable[..., Skill]) -> Callable[..., Skill]:
    """A training of a small network, whatever the settings say of its size."""

    def briefly(*given: Any) -> Skill:
        of_training = (TrainingSettings, JointTrainingSettings)
        return train(*(replace(each, **SMALL) if isinstance(each, of_training) else each for each in given))

    return briefly


@pytest.fixture(scope="module")
def brief_training() -> Iterator[None]:
    """What the command has no option for: small networks and latent graphs, and one place for a sphere in the report.

    What is learned so briefly is supported nearly everywhere: a graph of the usual size would take longest of all.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "train_task_space_skill", brief(training.train_task_space_skill))
        patch.setattr(joint_training, "train_joint_space_skill", brief(joint_training.train_joint_space_skill))
        patch.setattr(skill_report, "PLACES", 1)
        for dimension, shape in ((2, (30, 30)), (3, (9, 9, 9))):
            patch.setitem(skill.GRID_SHAPES, dimension, shape)
        yield
