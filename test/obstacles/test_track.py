"""One obstacle: which messages about it were overtaken, and where it may be once no more of them come."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geodesic_motion_ros.obstacles.track import (
    MOTION_LASTS,
    REORDER_WINDOW,
    UNCERTAINTY_GROWTH_PERIOD,
    UNCERTAINTY_GROWTH_TIME,
    MessageOrder,
    Track,
)
from geodesic_motion_ros.obstacles.velocity_filter import ObstacleMotion

RADIUS, LAST = 0.05, 0.4


def track(velocity: np.ndarray) -> Track:
    """A sphere that was seen at a velocity (3,) [m/s] until LAST."""
    motion = ObstacleMotion()
    for time in np.arange(0.0, LAST + 1e-9, 0.1):
        motion.see(tuple((time * velocity).tolist()), float(time))
    return Track(tuple((LAST * velocity).tolist()), RADIUS, LAST, LAST, math.inf, motion=motion)


def test_a_message_that_was_overtaken_is_ignored_and_one_of_the_same_instant_is_not() -> None:
    order = MessageOrder()
    assert [order.register(taken) for taken in (1.0, 1.2, 1.1, 1.2, 1.3)] == [False, False, True, False, False]


def test_a_clock_that_was_set_back_is_believed_at_once_or_as_it_goes_on() -> None:
    """The control: as many messages behind the newest, in disorder."""
    far, near, mixed = MessageOrder(), MessageOrder(), MessageOrder()
    assert not any(order.register(5.0) for order in (far, near, mixed))
    assert not far.register(5.0 - 1.01 * REORDER_WINDOW)
    assert [near.register(taken) for taken in (4.5, 4.6, 4.7, 4.8)] == [True, True, False, False]
    assert all(mixed.register(taken) for taken in (4.7, 4.6, 4.5, 4.4))


@pytest.mark.parametrize("late", [0.1, 1.0, 1.9])
def test_what_moved_and_is_not_published_any_more_may_stand_anywhere_on_its_line(late: float) -> None:
    """Every point of it there is in one of its places. The control: published lately, it is where it was seen."""
    random, velocity = np.random.default_rng(0), np.array([0.3, -0.1, 0.2])
    moved = track(velocity)
    assert len(moved.places(LAST + 0.9 * MOTION_LASTS, 1)) == 1
    now = LAST + MOTION_LASTS + late
    places = moved.places(now, 1)
    centres, radii = np.array([place.centre for place in places]), np.array([place.radius for place in places])
    for passed in np.linspace(0.0, min(now - LAST, UNCERTAINTY_GROWTH_TIME), 50):
        out = random.normal(size=(50, 3))
        points = moved.centre + passed * velocity + RADIUS * out / np.linalg.norm(out, axis=1, keepdims=True)
        apart = np.linalg.norm(points[:, None] - centres, axis=-1)
        assert np.all(np.any(apart <= radii + 1e-9, axis=1))
    assert not any(np.any(place.velocity) for place in places[1:])


def test_where_it_may_be_changes_by_itself_while_that_grows_and_never_of_what_stands() -> None:
    moved = track(np.array([0.3, 0.0, 0.0]))
    assert moved.changes(LAST) == pytest.approx(LAST + MOTION_LASTS)
    doubted = LAST + MOTION_LASTS
    assert moved.changes(doubted) == pytest.approx(doubted + UNCERTAINTY_GROWTH_PERIOD)
    assert math.isinf(moved.changes(LAST + UNCERTAINTY_GROWTH_TIME))
    stands = track(np.zeros(3))
    assert math.isinf(stands.changes(LAST))
    assert len(stands.places(LAST + 2.0 * MOTION_LASTS, 1)) == 1
