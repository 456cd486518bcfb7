"""The earliest arrival on a path: with no obstacle on it, behind what leaves, past what comes by stepping back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geodesic_motion_studies.comparison.earliest_arrival import STEP, earliest_arrival, free_of, main, waited
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere


def test_a_free_path_takes_its_own_time_and_what_leaves_is_waited_for() -> None:
    free = np.ones((50, 11), dtype=bool)
    assert earliest_arrival(free) == pytest.approx(10 * STEP)
    free[:20, 5] = False
    assert earliest_arrival(free) == pytest.approx(25 * STEP)
    free[:, 5] = False
    assert earliest_arrival(free) == math.inf


def test_an_arm_steps_back_where_something_comes_along_its_path() -> None:
    """From place 3 to place 0 and behind it; who cannot go back is met."""
    free = np.ones((60, 11), dtype=bool)
    free[:10, 4:] = False
    for step in range(10, 13):
        free[step, 13 - step :] = False
    assert earliest_arrival(free) == pytest.approx((12 + 10) * STEP)
    free[12, 0] = False
    assert earliest_arrival(free) == math.inf


def test_a_sphere_bars_places_within_its_radius_while_it_is_there() -> None:
    positions = np.linspace(0.0, 1.0, 11)[:, None, None] * np.array([1.0, 0.0, 0.0])
    sphere = MovingSphere(0.1, 1.0, 2.0, np.array([0.0, 0.0, 0.0]), np.array([0.5, 0.0, 0.0]), False)
    free = free_of(positions, np.array([0.05]), (sphere,))
    assert free[: round(1.0 / STEP)].all()
    assert free[round(2.0 / STEP) + 1 :].all()
    np.testing.assert_array_equal(free[round(1.5 / STEP)], [True, *4 * [False], *6 * [True]])


def test_an_arm_waits_where_none_of_its_joints_moves() -> None:
    moving = np.cumsum(np.full((10, 7), 0.01), axis=0)
    assert waited(np.concatenate([moving, np.repeat(moving[-1:], 25, axis=0)])) == pytest.approx(25 * STEP)


def test_a_number_of_scenes_that_makes_no_sense_is_named(capsys) -> None:
    assert main(["--scenes", "0"]) == 2
    assert "--scenes 0" in capsys.readouterr().err
