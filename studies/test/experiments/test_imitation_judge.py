"""What is measured of a prediction, with a skill of the fan whose ends vary."""

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.queries.pose_path import PosePathPlanner
from geodesic_motion_studies.experiments.imitation_judge import (
    EVERY_END,
    Judge,
    conditional_mean,
    people,
    sheet_oracle,
)
from geodesic_motion_studies.tools.similarity import compare


def test_people_are_as_far_apart_as_their_demonstrations_are_on_average(varying_fan):
    first, second, third = (item.curve for item in list(varying_fan)[:3])
    three = replace(varying_fan, items=varying_fan.items[:3])
    apart = [compare(*pair) for pair in ((first, second), (first, third), (second, third))]
    found = people(three)
    assert found["dtw_mm"] == pytest.approx(1e3 * np.mean([pair.dtw for pair in apart]))
    assert found["orientation_deg"] == pytest.approx(np.rad2deg(np.mean([pair.orientation for pair in apart])))
    assert np.isnan(people(replace(three, has_orientation=False))["orientation_deg"])


def test_the_conditional_mean_goes_from_the_start_to_the_goal_that_are_asked_for(canonical_fan_skill, varying_fan):
    for item in varying_fan:
        ends = item.curve.start, item.curve.goal
        mean = conditional_mean(canonical_fan_skill, *ends)
        for reached, requested in zip((mean.start, mean.goal), ends, strict=True):
            np.testing.assert_allclose(reached[0], requested[0], atol=1e-9)
            assert angle_between(reached[1], requested[1]) < 1e-6


def test_the_oracle_is_nearer_to_a_demonstration_than_the_planners_path(canonical_fan_skill, varying_fan):
    planner = PosePathPlanner(canonical_fan_skill, EVERY_END)
    for item in list(varying_fan)[::3]:
        planned = planner.plan(*item.curve.start, *item.curve.goal)
        oracle = sheet_oracle(planner, item)
        assert compare(oracle, item.curve).dtw < 0.8 * compare(planned, item.curve).dtw


def test_a_motion_that_a_person_showed_is_no_distance_from_the_closest_shown(varying_fan):
    pytest.importorskip("movement_primitives")
    judge = Judge(varying_fan, has_orientation=True)
    measured = {item.row: item for item in judge.baselines(2, varying_fan.items[2])}
    assert measured["people"].values["to_closest_mm"] == pytest.approx(0.0, abs=1e-9)
    nearest = measured["nearest_demonstration"].values
    assert nearest["dtw_mm"] == pytest.approx(0.0, abs=1e-3)
    assert nearest["endpoint_before_mm"] == pytest.approx(0.0, abs=1e-9)
    assert measured["task_line"].values["dtw_mm"] > 1.0
