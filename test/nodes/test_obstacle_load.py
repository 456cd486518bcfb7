"""A loop that obstacles slow down says so, with a number of them that would fit."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.nodes.obstacle_load import Load, ObstacleLoad, advice


class Clock:
    """Shows what it is set to [s]."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_load_is_that_of_the_time_since_the_last_look():
    spent, clock = Clock(), Clock()
    load = ObstacleLoad(spent, clock)
    for _ in range(10):
        with load.count_time():
            spent.now += 0.03
            load.count(4)
        clock.now += 0.1
        spent.now += 0.5  # of other work
    assert load.take() == pytest.approx((0.3, 40.0))
    clock.now += 1.0
    assert load.take() == (0.0, 0.0)


def test_what_fails_is_counted_too():
    spent, clock = Clock(), Clock()
    load = ObstacleLoad(spent, clock)

    def fail() -> None:
        with load.count_time():
            spent.now += 0.2
            raise ValueError

    with pytest.raises(ValueError):
        fail()
    clock.now += 1.0
    assert load.take().share == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("obstacles", "load", "tick", "fit"),
    [
        (1000, Load(0.5, 15000.0), 0.004, "about 7000 would fit, as 200 of them 30 times a second"),
        (1000, Load(1.0, 15000.0), 0.004, "about 3000 would fit, as 100 of them 30 times a second"),
        (1000, Load(0.0, 0.0), 0.02, "about 200 would fit"),
        (40, Load(0.0, 0.0), 0.03, "about 20 would fit"),
    ],
)
def test_too_many_obstacles_are_named_with_the_number_that_fits(obstacles, load, tick, fit):
    said = advice(obstacles, load, 100.0, tick)
    assert said.startswith("too many obstacles: ")
    assert fit in said


@pytest.mark.parametrize(("obstacles", "share", "tick"), [(3, 2.0, 0.05), (1000, 0.1, 0.001)])
def test_where_obstacles_are_not_to_blame_the_machine_is(obstacles, share, tick):
    assert advice(obstacles, Load(share, 30.0 * obstacles), 100.0, tick) == "too slow or too busy a machine"
