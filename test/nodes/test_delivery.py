"""How late messages are: the longest lately, by stamps of this clock and of others, in steps for takeovers."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from geodesic_motion_ros.nodes.delivery import COUNTED, LATEST, Lately, TransitWatch, stamp_of, takeover_delay
from geodesic_motion_ros.nodes.node_time import Moment

#: A time of today [s]: such a float is a multiple of 0.24 us.
TODAY, ROUNDING = 1.8e9, 1e-6


def arrival(at: float) -> Moment:
    """At so many seconds after TODAY."""
    return Moment(at, at, False, 0.0, round(1e9 * (TODAY + at)))


def watched(transits: list[float], ahead: float = 0.0) -> float:
    """The longest transit of messages that took so long [s], a tenth of a second apart, by a clock so far ahead [s]."""
    watch, now = TransitWatch(), 0.0
    for transit in transits:
        now += 0.1
        watch.take(TODAY + now - transit + ahead, arrival(now))
    return watch.longest(now)


def test_the_longest_transit_of_late_counts():
    assert watched([0.002, 0.03, 0.004]) == pytest.approx(0.03, abs=ROUNDING)
    assert watched([0.06] + 20 * [0.002]) == pytest.approx(0.06, abs=ROUNDING)


def test_it_is_forgotten_after_a_while_though_no_message_comes():
    watch = TransitWatch()
    watch.take(TODAY - 0.06, arrival(0.0))
    assert watch.longest(COUNTED) == pytest.approx(0.06, abs=ROUNDING)
    assert watch.longest(COUNTED + 1.0) == 0.0


def test_a_clock_that_is_ahead_hears_of_what_begins_by_so_much_later():
    """What is stamped for now is of the past there."""
    assert watched([0.002, 0.002], ahead=0.05) == pytest.approx(0.048, abs=ROUNDING)


@pytest.mark.parametrize("ahead", [-3.0, 3.0, -TODAY + 5.0])
def test_of_another_clock_only_what_a_message_took_longer_than_others_counts(ahead):
    assert watched(10 * [0.002] + [0.032] + 5 * [0.002], ahead) == pytest.approx(0.03, abs=ROUNDING)


def test_no_stamp_says_nothing():
    watch = TransitWatch()
    watch.take(0.0, arrival(5.0))
    assert watch.longest(5.0) == 0.0


def test_the_largest_figure_of_every_span_is_kept_as_long_as_it_counts():
    random = np.random.default_rng(2)
    lately, figures = Lately(), []
    for now in np.arange(0.0, 3.0 * COUNTED, 0.05):
        figures.append((now, float(random.exponential())))
        lately.add(figures[-1][1], float(now))
        counted = [figure for time, figure in figures if time >= now - COUNTED]
        possible = [figure for time, figure in figures if time >= now - COUNTED - 1.0]
        assert max(counted) <= lately.largest(float(now)) <= max(possible)


@pytest.mark.parametrize(
    ("late", "delay"), [(-0.004, 0.0), (0.0, 0.0), (0.001, 0.01), (0.01, 0.01), (0.0551, 0.06), (5.0, LATEST)]
)
def test_takeovers_are_later_in_whole_steps_and_never_by_less_than_messages(late, delay):
    assert takeover_delay(late) == pytest.approx(delay, abs=1e-12)


def test_the_stamp_is_that_of_the_message():
    message = JointState(name=["one"], position=[0.5])
    message.header.stamp.sec, message.header.stamp.nanosec = 1_800_000_000, 250_000_000
    assert stamp_of(serialize_message(message)) == pytest.approx(TODAY + 0.25, abs=ROUNDING)
