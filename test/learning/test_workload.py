"""What is said of a training beforehand is what it then does and takes."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.learning.optimisation import MOST_DRAWN, drawn_rows
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.learning.shown_task import ShownConfigurations, ShownPoses
from geodesic_motion_ros.learning.workload import Workload

#: Peak of the memory of a process that fits `rows` rows of three dimensions by `kernels` kernels, less what it had.
PEAK = """
import re, sys, torch
from pathlib import Path
from geodesic_motion_ros.learning.networks import RadialBasisNetwork

def resident(name):
    return 1024 * int(re.search(name + r":\\s+(\\d+)", Path("/proc/self/status").read_text()).group(1))

rows, kernels = map(int, sys.argv[1:])
like = {"dtype": torch.double}
one = torch.ones(1, **like)
network = RadialBasisNetwork(torch.rand(kernels, 3, **like), one, one, one)
network.activations(torch.rand(10, 3, **like))
before = resident("VmRSS")
network.activations(torch.rand(rows, 3, **like))
print(resident("VmHWM") - before)
"""


@pytest.mark.parametrize("sheet", ["canonical", "raw"])
def test_samples_are_counted_as_the_training_has_them(demonstrations, reach_demonstrations, sheet) -> None:
    settings = TrainingSettings(sheet=sheet, samples=30)
    positions, _ = ShownPoses(demonstrations, settings).learned_curves()
    assert Workload.of(len(demonstrations), settings, signs=2).samples == np.prod(positions.shape[:2])
    joints = JointTrainingSettings(sheet=sheet, samples=30)
    (configurations,) = ShownConfigurations(reach_demonstrations, joints).learned_curves()
    assert Workload.of(len(reach_demonstrations), joints).samples == np.prod(configurations.shape[:2])


def test_deviations_are_fitted_on_so_many_draws(demonstrations) -> None:
    few, many = (Workload.of(count, JointTrainingSettings()) for count in (4, 400))
    assert few.fitted == len(drawn_rows(few.samples, JointTrainingSettings().precision_samples)) < MOST_DRAWN
    assert many.fitted == MOST_DRAWN
    assert many.memory == Workload.of(40_000, JointTrainingSettings()).memory  # no longer in proportion


def test_the_memory_that_is_stated_is_what_the_kernels_take() -> None:
    settings = JointTrainingSettings(samples=100, kernels=100)
    size = Workload.of(20, settings)
    done = subprocess.run(
        [sys.executable, "-c", PEAK, str(size.fitted), str(size.kernels)], capture_output=True, text=True, check=True
    )
    # Beside them lie the draws themselves and some pages of the program.
    assert size.memory <= int(done.stdout) <= size.memory + 2**25


def test_it_says_what_is_about_to_happen() -> None:
    said = str(Workload.of(253, JointTrainingSettings()))
    for words in ("253 demonstrations", "151800 samples", "5000 steps", "then 200", "500 kernels", "0.64 GB"):
        assert words in said
    assert "then" not in str(Workload.of(1, replace(JointTrainingSettings.paper(), steps=70)))


def test_a_training_that_does_more_is_expected_to_take_longer() -> None:
    """By factors that no busy machine makes up for; both stages count."""
    settings = JointTrainingSettings(steps=200, precision_iterations=20)
    little = Workload.of(16, settings).measure_seconds()
    assert little > 0.0
    assert Workload.of(16, replace(settings, steps=20_000)).measure_seconds() > 3.0 * little
    assert Workload.of(16, replace(settings, precision_iterations=2_000)).measure_seconds() > 3.0 * little
