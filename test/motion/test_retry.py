"""A search that found nothing is made again where its answer may be another one, and not more often than pays."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.motion.path_timer import JointCurve
from geodesic_motion_ros.motion.plan import MotionState
from geodesic_motion_ros.motion.retry import PastSearch, Question, Workings, is_due
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.search import LatentPath

PERIOD = 0.1
HERE, THERE = np.zeros(7), np.ones(7)


def sphere(height: float = 0.0, speed: float = 0.0) -> Obstacles:
    return Obstacles.of_spheres(np.array([[0.0, 0.0, height]]), np.array([0.1]), np.array([[speed, 0.0, 0.0]]), 0.0)


QUERY, OTHER = object(), object()
QUESTION = Question(QUERY, sphere(), HERE, extent=0.2)
#: What else may be asked after it: and whether the answer may be another one.
LATER = {
    "the same": (QUESTION, False),
    "obstacles received again": (replace(QUESTION, obstacles=sphere()), False),
    "from wherever the arm is": (replace(QUESTION, position=None), False),
    "obstacles elsewhere": (replace(QUESTION, obstacles=sphere(0.1)), True),
    "obstacles that move": (replace(QUESTION, obstacles=sphere(speed=0.1)), True),
    "from elsewhere": (replace(QUESTION, position=THERE), True),
    "farther": (replace(QUESTION, extent=0.3), True),
}


@pytest.mark.parametrize(("later", "changed"), LATER.values(), ids=LATER)
def test_a_search_is_made_again_a_period_later_where_something_has_changed_and_else_never(later, changed) -> None:
    asked = PastSearch(QUESTION, 1.0)
    for after, period in product((0.0, 0.5 * PERIOD, PERIOD, 100.0), (0.0, PERIOD)):
        assert is_due(asked, later, 1.0 + after, period) is (changed and after >= period)


def test_what_moves_is_asked_about_again_although_it_is_the_same() -> None:
    asked = PastSearch(Question(QUERY, sphere(speed=0.1)), 1.0)
    assert is_due(asked, asked.question, 1.0 + PERIOD, PERIOD)
    assert not is_due(asked, asked.question, 1.0 + 0.9 * PERIOD, PERIOD)


def test_another_query_is_searched_at_once_and_so_is_what_was_never_searched() -> None:
    assert is_due(None, QUESTION, 1.0, PERIOD)
    assert is_due(PastSearch(QUESTION, 1.0), replace(QUESTION, about=OTHER), 1.0, PERIOD)


def test_what_was_out_of_time_has_no_answer_yet() -> None:
    """The control: with the same question, in time."""
    for answered in (False, True):
        assert is_due(PastSearch(QUESTION, 1.0, answered), QUESTION, 1.0 + PERIOD, PERIOD) is not answered


class CountingTimer:
    """In the place of a PathTimer: how many paths were decoded, and timed."""

    def __init__(self) -> None:
        self.curves = self.timed_paths = 0

    def joint_curve(self, *_: object) -> JointCurve:
        self.curves += 1
        return JointCurve(np.zeros((2, 7)), np.zeros((2, 3)), 0.0)

    def time_curve(self, *_: object) -> Refusal:
        self.timed_paths += 1
        return Refusal(VerdictCode.NO_FEASIBLE_PATH, "timed")


def test_one_path_from_one_state_is_timed_once() -> None:
    """Not so another path, from another state, for another query, as far as another end, or at another pace: the
    controls.
    """
    timer, workings = CountingTimer(), Workings()
    path = LatentPath(np.arange(2), np.zeros((2, 3)), energy=0.0, gap=0.0)
    state = MotionState(0.0, HERE, HERE, HERE, None)
    first = workings.time_path(timer, QUERY, state, path, True, math.inf)
    assert workings.time_path(timer, QUERY, replace(state, time=7.0), path, True, math.inf) is first
    assert timer.timed_paths == 1
    others = [
        (QUERY, state, replace(path, polyline=np.ones((2, 3))), True), (QUERY, state, path, False),
        (QUERY, replace(state, velocity=THERE), path, True), (OTHER, state, path, True),
    ]  # fmt: skip
    assert workings.time_path(timer, QUERY, state, path, True, math.inf, paced=False) is not first
    # At another pace it is the same path: it is decoded once.
    assert timer.curves == 1
    for number, other in enumerate(others):
        assert workings.time_path(timer, *other, math.inf) is not first
        assert timer.timed_paths == number + 3


def test_a_copy_goes_on_and_its_original_stays_as_it_was() -> None:
    timer, workings = CountingTimer(), Workings()
    path = LatentPath(np.arange(2), np.zeros((2, 3)), energy=0.0, gap=0.0)
    state = MotionState(0.0, HERE, HERE, HERE, None)
    copy = workings.copy()
    copy.time_path(timer, QUERY, state, path, True, math.inf)
    assert (workings.timed_from, workings.motions) == (None, {})
    again = copy.copy()
    again.time_path(timer, QUERY, state, path, True, math.inf)
    assert timer.timed_paths == 1
