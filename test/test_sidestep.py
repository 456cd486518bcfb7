"""Sidesteps: places all around, and no further from what was shown than is allowed."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.sidestep import places_beside

HERE, FURTHEST = np.array([0.4, -0.1, 0.3]), 0.05


def test_there_are_places_on_all_sides_and_none_is_further_than_allowed() -> None:
    places = places_beside(HERE, HERE, FURTHEST * (1.0 + 1e-9))
    away = places - HERE
    assert np.max(np.linalg.norm(away, axis=1)) == pytest.approx(FURTHEST)
    for direction in np.random.default_rng(0).normal(size=(50, 3)):
        cosines = away @ direction / np.linalg.norm(away, axis=1) / np.linalg.norm(direction)
        assert np.max(cosines) > np.cos(np.radians(30.0))


def test_a_tool_that_is_off_what_was_shown_goes_no_further_off() -> None:
    shown = HERE + [0.0, 0.0, FURTHEST - 1e-6]
    places = places_beside(HERE, shown, FURTHEST)
    assert len(places) > 0
    assert np.all(np.linalg.norm(places - shown, axis=1) <= FURTHEST)
    assert np.all(places[:, 2] > HERE[2])
