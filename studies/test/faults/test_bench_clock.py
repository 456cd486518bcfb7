"""What the simulated clock shows; time passes by a steady clock of the test's own."""

from __future__ import annotations

import pytest

from geodesic_motion_studies.faults import bench_clock
from geodesic_motion_studies.faults.bench_clock import BenchClock


class Machine:
    """A machine's clocks, and a node that makes nothing."""

    def __init__(self) -> None:
        self.now = 50.0

    def monotonic(self) -> float:
        return self.now

    def time(self) -> float:
        return 1000.0 + self.now

    def create_publisher(self, *_) -> None: ...

    def create_timer(self, *_) -> None: ...


@pytest.fixture
def machine(monkeypatch) -> Machine:
    machine = Machine()
    monkeypatch.setattr(bench_clock, "time", machine)
    return machine


def test_it_is_the_systems_until_it_is_simulated(machine) -> None:
    clock = BenchClock(machine)
    machine.now += 3.0
    assert clock.at(51.0) == pytest.approx(1051.0)


def test_it_jumps_stands_and_slows_down_and_knows_what_it_has_shown(machine) -> None:
    clock = BenchClock(machine)
    clock.run(True)
    machine.now = 60.0
    clock.jump(-5.0)
    machine.now = 61.0
    clock.set_speed(0.0)
    machine.now = 63.0
    clock.set_speed(0.5)
    shown = {55.0: 1055.0, 60.5: 1055.5, 62.0: 1056.0, 65.0: 1057.0}
    assert {moment: clock.at(moment) for moment in shown} == pytest.approx(shown)


@pytest.mark.parametrize(("late", "shown"), [(0.02, [1060.02, 1055.02]), (0.2, [1055.2, 1055.2])])
def test_a_node_may_not_have_heard_of_a_change_just_before(machine, late, shown) -> None:
    clock = BenchClock(machine)
    clock.run(True)
    machine.now = 60.0
    clock.jump(-5.0)
    assert [clock.at(60.0 + late, near) for near in (1060.0, 1055.0)] == pytest.approx(shown)
    assert clock.at(60.0 + late) == pytest.approx(1055.0 + late)
    assert clock.at(59.99, 1054.99) == pytest.approx(1059.99)
