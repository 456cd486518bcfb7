"""The steady error: a mean over a rest, named from a milliradian on, and said again when it changes."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.nodes.arm_watch import REST_TIME
from geodesic_motion_ros.nodes.deviation import REST_JOINT
from geodesic_motion_ros.nodes.steady_error import SteadyError

COMMANDED = np.array([0.5, -1.0])
STEP = 0.01


def rest(steady: SteadyError, error: np.ndarray, seconds: float, begin: float = 0.0, noise: float = 0.0) -> None:
    random = np.random.default_rng(1)
    for time in np.arange(begin, begin + seconds + 0.5 * STEP, STEP):
        steady.add(COMMANDED + error + random.normal(0.0, noise, 2), COMMANDED, float(time))


@pytest.fixture
def steady() -> SteadyError:
    return SteadyError(("shoulder", "elbow"))


def test_it_is_known_once_the_arm_has_rested_and_is_named_with_its_joint(steady):
    rest(steady, np.array([0.001, -0.003]), REST_TIME - 2.0 * STEP)
    assert np.isnan(steady.size)
    assert steady.reason == ""
    rest(steady, np.array([0.001, -0.003]), REST_TIME)
    assert steady.size == pytest.approx(0.003)
    assert steady.reason == "at rest the arm stays 3.0 mrad in 'elbow' from where it is commanded"


def test_noise_is_averaged(steady):
    """Of the mean of fifty the standard deviation is a seventh: six of these are 0.9 mrad."""
    rest(steady, np.array([0.0, 0.003]), REST_TIME, noise=0.001)
    assert steady.size == pytest.approx(0.003, abs=0.9e-3)


def test_less_than_a_milliradian_is_a_figure_and_no_reason(steady):
    rest(steady, np.array([0.0009, 0.0]), REST_TIME)
    assert (steady.size, steady.joint) == (pytest.approx(0.0009), "shoulder")
    assert steady.reason == ""
    assert steady.take_news() == ""


def test_an_arm_that_moves_does_not_rest(steady):
    rest(steady, np.zeros(2), REST_TIME)
    rest(steady, np.array([1.5 * REST_JOINT, 0.0]), 0.5 * REST_TIME, begin=REST_TIME + STEP)
    assert np.isnan(steady.size)


def test_it_is_forgotten_with_the_rest(steady):
    rest(steady, np.array([0.0, 0.003]), REST_TIME)
    steady.forget()
    assert np.isnan(steady.size)
    rest(steady, np.array([0.0, 0.002]), 0.5 * REST_TIME, begin=5.0)
    assert np.isnan(steady.size)


def test_it_is_news_once_and_again_when_it_has_changed_by_a_milliradian_or_is_another_joints(steady):
    said = []
    for number, error in enumerate(([0.0, 0.003], [0.0, 0.0035], [0.0, 0.0042], [0.005, 0.0042])):
        rest(steady, np.array(error), 3.0 * REST_TIME, begin=10.0 * number)
        said.append(bool(steady.take_news()))
        assert steady.take_news() == ""
        steady.forget()
    assert said == [True, False, True, True]


def test_a_state_that_is_not_new_is_no_rest(steady):
    """As where joint states are missing: the arm may be anywhere since."""
    for _ in range(200):
        steady.add(COMMANDED + 0.003, COMMANDED, 1.0)
    assert np.isnan(steady.size)
