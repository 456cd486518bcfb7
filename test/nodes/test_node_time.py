"""Real time is the steady clock's, whatever the ROS clock does; simulated time is the ROS clock's without its jumps."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from geodesic_motion_ros.nodes.node_time import NodeTime

SECOND = 1_000_000_000


class Clocks:
    """A ROS clock and a steady one, both set by hand [s]."""

    def __init__(self, simulated: bool, now: float = 1000.0) -> None:
        self.ros_time_is_active = simulated
        self.ros, self.steady = round(SECOND * now), 7 * SECOND
        self.time = NodeTime(self, lambda: self.steady)

    def now(self) -> SimpleNamespace:
        return SimpleNamespace(nanoseconds=self.ros)

    def go_on(self, ros: float, steady: float) -> None:
        self.ros += round(SECOND * ros)
        self.steady += round(SECOND * steady)


@pytest.mark.parametrize("simulated", [False, True])
def test_it_counts_the_ros_clock_from_the_beginning_and_says_whether_that_is_simulated(simulated) -> None:
    clocks = Clocks(simulated)
    clocks.go_on(0.25, 0.25)
    moment = clocks.time.read()
    assert moment.now == 0.25
    assert moment.ros_time == 1_000_250_000_000
    assert moment.simulated is simulated
    assert moment.set_by == 0.0


@given(steps=st.lists(st.tuples(st.floats(-10.0, 10.0), st.floats(0.0, 3.0)), min_size=1, max_size=20))
def test_real_time_is_that_of_the_steady_clock(steps) -> None:
    clocks = Clocks(False)
    for ros, steady in steps:
        clocks.go_on(ros, steady)
        assert clocks.time.running() == pytest.approx(1e-9 * clocks.steady, abs=1e-9)


@given(steps=st.lists(st.tuples(st.floats(0.0, 1.9), st.floats(0.0, 30.0)), min_size=1, max_size=20))
def test_simulated_time_is_that_of_the_ros_clock_at_any_speed(steps) -> None:
    clocks = Clocks(True)
    begin = clocks.time.running()
    for ros, steady in steps:
        clocks.go_on(ros, steady)
        moment = clocks.time.read()
        assert moment.running - begin == pytest.approx(moment.now, abs=1e-6)
        assert moment.set_by == 0.0


@pytest.mark.parametrize("simulated", [False, True])
@pytest.mark.parametrize("jump", [5.0, -5.0])
def test_it_goes_on_over_a_jump_which_is_reported(simulated, jump) -> None:
    clocks = Clocks(simulated)
    before = clocks.time.running()
    clocks.go_on(jump, 0.01)
    moment = clocks.time.read()
    assert moment.ros_time == round(SECOND * (1000.0 + jump))
    assert 0.0 <= moment.now <= 0.01 + 1e-9
    assert 0.0 <= moment.running - before <= 0.01 + 1e-9
    assert moment.set_by == pytest.approx(jump, abs=0.011)
    clocks.go_on(0.5, 0.5)
    after = clocks.time.read()
    assert after.running - moment.running == pytest.approx(0.5, abs=1e-6)
    assert after.set_by == moment.set_by


def test_a_process_that_stood_still_is_no_jump_of_a_real_clock() -> None:
    clocks = Clocks(False)
    clocks.go_on(60.0, 60.0)
    assert clocks.time.read().set_by == 0.0


def test_a_simulated_clock_that_is_set_back_a_little_stands_meanwhile() -> None:
    clocks = Clocks(True)
    before = clocks.time.running()
    clocks.go_on(-0.01, 0.01)
    assert clocks.time.running() == before


@pytest.mark.parametrize("jump", [0.0, 5.0, -5.0])
def test_a_time_is_stamped_to_the_nanosecond_by_the_clock_of_the_day_whenever_that_was_set(jump) -> None:
    clocks = Clocks(False, 1_795_722_000.0)
    clocks.go_on(jump, 0.0)
    clocks.go_on(0.02, 0.02)
    moment = clocks.time.read()
    assert moment.now == 0.02
    assert clocks.time.ros_time(moment.now) == moment.ros_time
    assert clocks.time.ros_time(moment.now + 0.030000001) - moment.ros_time == 30_000_001


def test_a_simulated_clock_that_was_never_heard_shows_no_time() -> None:
    clocks = Clocks(True, 0.0)
    assert not clocks.time.read().has_clock
    clocks.go_on(1_795_722_000.0, 0.01)
    assert clocks.time.read().has_clock
    assert Clocks(False, 0.0).time.read().has_clock


def test_it_is_known_for_how_long_a_simulated_clock_has_stood() -> None:
    """The control: a real one never stands."""
    for simulated, stood in ((True, 3.0), (False, 0.0)):
        clocks = Clocks(simulated)
        clocks.go_on(0.01, 0.01)
        assert clocks.time.read().stood == 0.0
        for _ in range(3):
            clocks.go_on(0.0, 1.0)
            moment = clocks.time.read()
        assert moment.stood == pytest.approx(stood)
        clocks.go_on(0.01, 0.5)
        assert clocks.time.read().stood == 0.0


def test_a_message_was_in_transit_as_long_as_its_stamp_says() -> None:
    moment = Clocks(False).time.read()
    assert moment.transit(0.0) == 0.0
    assert moment.transit(999.75) == pytest.approx(0.25, abs=1e-6)
    assert moment.transit(1000.5) == pytest.approx(-0.5, abs=1e-6)
