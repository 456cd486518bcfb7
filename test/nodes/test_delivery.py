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


@pytest.mark.parametrize(("rate", "stamped"), [(500.0, True), (100.0, True), (100.0, False), (20.0, False)])
def test_a_pause_of_the_messages_counts_beyond_their_period(rate, stamped):
    """The sender stood still: none was in transit meanwhile."""
    watch, now = TransitWatch(), 0.0
    for number in range(int(3.0 * rate)):
        now += 1.0 / rate + (0.08 if number == int(2.5 * rate) else 0.0)
        watch.take(TODAY + now - 0.001 if stamped else 0.0, arrival(now))
        if number == int(2.4 * rate):
            assert watch.longest(now) <= 0.001 + ROUNDING
    assert watch.longest(now) == pytest.approx(0.08, abs=0.002)
    assert watch.remark(now) == ""


def test_a_silence_is_no_pause_and_what_is_too_late_to_be_allowed_for_is_a_remark():
    watch, now = TransitWatch(), 0.0
    for number in range(300):
        now += 0.01 + (2.0 if number == 100 else 0.0)
        watch.take(TODAY + now - 0.001, arrival(now))
    assert watch.longest(now) <= 0.001 + ROUNDING
    now += 0.2
    watch.take(TODAY + now - 0.001, arrival(now))
    assert "up to 190 ms late" in watch.remark(now)
    assert "planned for with 150 ms" in watch.remark(now)


@pytest.mark.parametrize("ahead", [-3.0, 3.0, -TODAY + 5.0])
def test_of_another_clock_only_what_a_message_took_longer_than_others_counts(ahead):
    assert watched(10 * [0.002] + [0.032] + 5 * [0.002], ahead) == pytest.approx(0.03, abs=ROUNDING)


def test_messages_that_came_before_a_simulated_clock_make_later_ones_no_later():
    watch, now = TransitWatch(), 0.0
    for number in range(20):
        now += 0.1
        heard = number >= 5
        watch.take(TODAY + now - 0.002, Moment(now, now, True, 0.0, round(1e9 * (TODAY + now)) if heard else 0))
    assert watch.longest(now) <= 0.002 + ROUNDING


def test_messages_without_a_stamp_that_come_steadily_are_not_late():
    watch = TransitWatch()
    for now in np.arange(5.0, 8.0, 0.01):
        watch.take(0.0, arrival(float(now)))
    assert watch.longest(8.0) < 1e-3


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
