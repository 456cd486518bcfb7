"""Stands, cups and bottles of the pouring experiments: each once, and the tool over them where it is to be."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.simulation.joint_teacher import CUP_PLACES
from geodesic_motion_ros.simulation.teacher import CUP_REGION
from geodesic_motion_ros.studies.experiments.held_bottle import bottle_mouth
from geodesic_motion_ros.studies.experiments.pouring_places import PLACES, at_cup, pouring_strip, standing_there


def test_cups_stand_there_once_and_one_bottle_is_in_the_hand() -> None:
    assert len(standing_there(0)) == 1 + 3 * 2
    assert len(set(standing_there(1))) == len(standing_there(1))
    assert standing_there(0)[0] != standing_there(1)[0]


@pytest.mark.parametrize("cup", PLACES)
def test_the_bottle_is_poured_over_the_cups_axis(cup: int) -> None:
    mouth = bottle_mouth(*at_cup(cup))
    np.testing.assert_allclose(mouth[:2], CUP_REGION.at(np.array(CUP_PLACES[cup])), atol=1e-9)


def test_a_strip_shows_postures_that_differ() -> None:
    ready = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
    turned = ready + np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    strip = pouring_strip(np.stack([ready, turned]), 0, width=80, height=54, postures=2)
    assert strip.shape == (54, 160, 3)
    assert np.abs(strip[:, :80].astype(int) - strip[:, 80:].astype(int)).max() > 50
