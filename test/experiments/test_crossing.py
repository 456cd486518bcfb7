import math
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.crossing import measure_crossings
from geodesic_motion_ros.manifold.training import TrainingSettings, train_task_space_skill


@pytest.fixture(scope="module")
def skill(demonstrations):
    return train_task_space_skill(demonstrations, TrainingSettings(steps=600, hidden=(64, 32), kernels=150))


def test_changing_clusters_is_dear_and_the_graph_of_the_planner_forbids_it(skill, demonstrations):
    curves = [item.curve for item in demonstrations]
    crossings = measure_crossings(skill, curves)
    assert len(crossings) == len(curves)
    assert all(math.isfinite(item.across) and item.within > 0.0 for item in crossings)
    assert np.median([item.ratio for item in crossings]) > 10.0
    assert all(item.flagged for item in crossings)


def test_a_sign_blind_skill_has_nothing_to_cross(skill, demonstrations):
    sign_blind = replace(skill, orientation_model="sign_blind")
    with pytest.raises(ParameterError, match="sign_blind skill has no two clusters"):
        measure_crossings(sign_blind, [demonstrations[0].curve])
