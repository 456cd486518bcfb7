"""Pacing: no burst after a stall, misses counted, errors heard. Time is passed in wherever it is judged."""

from __future__ import annotations

import threading

import pytest

from geodesic_motion_ros.nodes.steady_loop import Schedule, SteadyLoop, _Recorder


def test_on_time_ticks_follow_the_grid():
    schedule = Schedule(period=0.01, start=5.0)
    for tick in range(1, 200):
        assert schedule.finish(schedule.due + 0.004) == 1
        assert schedule.due == pytest.approx(5.0 + 0.01 * tick)
    assert schedule.misses == 0


def test_an_overrun_is_counted_and_the_next_tick_starts_at_once_on_the_old_grid():
    schedule = Schedule(period=0.01, start=0.0)
    assert schedule.finish(0.0131) == 1
    assert schedule.misses == 1
    assert schedule.due == pytest.approx(0.01)
    assert schedule.finish(0.018) == 1
    assert schedule.misses == 1
    assert schedule.due == pytest.approx(0.02)


def test_an_overload_never_piles_up():
    schedule, now = Schedule(period=0.01, start=0.0), 0.0
    for _ in range(50):
        now = max(now, schedule.due) + 0.015
        schedule.finish(now)
        assert now - schedule.due < 0.02


def test_a_stall_is_skipped_not_made_up():
    schedule = Schedule(period=0.01, start=0.0)
    assert schedule.finish(1.0051) == 101
    assert schedule.misses == 100
    assert schedule.due == pytest.approx(1.01)
    assert schedule.finish(1.012) == 1


def test_loop_ticks_until_stopped_and_knows_its_rate():
    enough, periods = threading.Event(), []

    def tick(count: int) -> None:
        periods.append(count)
        if len(periods) >= 30:
            enough.set()

    loop = SteadyLoop(tick, 200.0, failed=lambda error: None)
    loop.start()
    assert enough.wait(20.0)
    assert loop.stop(20.0)
    ticks = len(periods)
    statistics = loop.statistics()
    assert statistics.ticks == ticks
    assert statistics.misses == loop.misses
    assert min(periods) >= 1
    # every period is either a tick or a miss
    assert sum(periods[1:]) <= ticks + statistics.misses
    assert 0.0 < statistics.rate <= 220.0
    assert 0.0 <= statistics.tick_p50 <= statistics.tick_p99


def test_a_loop_in_a_hurry_does_not_wait_until_the_next_tick_is_due_but_for_its_period():
    """A period of a minute: what comes within the test's patience has not waited."""
    ticks = [threading.Event() for _ in range(3)]
    count = iter(ticks)
    loop = SteadyLoop(lambda _: next(count).set(), 1.0 / 60.0, failed=lambda error: None)
    loop.start()
    assert ticks[0].wait(20.0)
    assert not ticks[1].wait(0.2)
    loop.hurry()
    assert ticks[1].wait(20.0)
    loop.hurry()
    assert not ticks[2].wait(0.2)
    assert loop.misses == 0
    assert loop.stop(20.0)


def test_a_tick_before_its_time_is_the_only_one_of_its_period():
    schedule = Schedule(period=0.01, start=5.0)
    schedule.finish(5.001)
    assert schedule.earliest == pytest.approx(5.0)
    assert schedule.finish(5.004) == 1
    assert schedule.earliest == pytest.approx(5.01)
    assert schedule.due == pytest.approx(5.02)
    assert schedule.misses == 0


@pytest.mark.parametrize("slow_for", [1.5, 3.0])
def test_rate_and_durations_are_those_of_the_last_second(slow_for):
    recorder, now = _Recorder(1000), 0.0
    for _ in range(500):
        recorder.add(now, 0.001)
        now += 0.01
    assert recorder.statistics(0, now - 0.01).rate == pytest.approx(100.0)
    end = now + slow_for
    while now < end:
        recorder.add(now, 0.015)
        now += 0.02
    statistics = recorder.statistics(0, now - 0.02)
    assert statistics.rate == pytest.approx(50.0)
    assert statistics.tick_p50 == pytest.approx(0.015)


def test_after_a_long_pause_the_rate_is_low():
    recorder = _Recorder(1000)
    for start in (0.0, 0.01, 0.02, 5.02):
        recorder.add(start, 0.001)
    assert recorder.statistics(0, 5.02).rate == pytest.approx(0.2)


@pytest.mark.parametrize("begin", [3.0, 3.2, 3.5, 3.9])
def test_no_pause_falls_between_two_looks_a_second_apart(begin):
    """0.3 s of a second without a tick, wherever they lie: who looks once a second sees them."""
    recorder, rates, look = _Recorder(1000), [], 1.0
    for number in range(700):
        now = 0.01 * number
        if now >= look:
            rates.append(recorder.statistics(0, now - 0.01).rate)
            look += 1.0
        if not begin <= now < begin + 0.3:
            recorder.add(now, 0.001)
    assert rates[:2] == pytest.approx([100.0, 100.0])
    assert min(rates) < 86.0
    assert rates[-1] == pytest.approx(100.0)


def test_an_error_ends_the_loop_and_is_reported_once():
    heard, done = [], threading.Event()

    def tick(count: int) -> None:
        raise ZeroDivisionError("in the tick")

    def failed(error: BaseException) -> None:
        heard.append(error)
        done.set()

    loop = SteadyLoop(tick, 100.0, failed)
    loop.start()
    assert done.wait(20.0)
    assert loop.stop(20.0)
    assert len(heard) == 1
    assert isinstance(heard[0], ZeroDivisionError)


def test_stopping_what_never_started_is_harmless():
    assert SteadyLoop(lambda count: None, 100.0, failed=lambda error: None).stop()
