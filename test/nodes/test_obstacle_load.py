"""A loop that obstacles slow down says so, with a number of them that would fit."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.nodes.obstacle_load import ObstacleLoad, advice


class Clock:
    """Shows what it is set to [s]."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_share_is_that_of_the_time_since_the_last_look():
    spent, clock = Clock(), Clock()
    load = ObstacleLoad(spent, clock)
    for _ in range(10):
        with load.counted():
            spent.now += 0.03
        clock.now += 0.1
        spent.now += 0.5  # of other work
    assert load.share() == pytest.approx(0.3)
    clock.now += 1.0
    assert load.share() == 0.0


def test_what_fails_is_counted_too():
    spent, clock = Clock(), Clock()
    load = ObstacleLoad(spent, clock)

    def fail() -> None:
        with load.counted():
            spent.now += 0.2
            raise ValueError

    with pytest.raises(ValueError):
        fail()
    clock.now += 1.0
    assert load.share() == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("obstacles", "share", "tick", "fit"),
    [(1000, 0.6, 0.004, "about 500 would fit"), (1000, 0.0, 0.02, "about 200 would fit"), (40, 3.0, 0.0, "about 20 ")],
)
def test_too_many_obstacles_are_named_with_the_number_that_fits(obstacles, share, tick, fit):
    said = advice(obstacles, share, 100.0, tick)
    assert said.startswith(f"too many obstacles: {obstacles} take ")
    assert fit in said


@pytest.mark.parametrize(("obstacles", "share", "tick"), [(3, 2.0, 0.05), (1000, 0.1, 0.001)])
def test_where_obstacles_are_not_to_blame_the_machine_is(obstacles, share, tick):
    assert advice(obstacles, share, 100.0, tick) == "too slow or too busy a machine"
