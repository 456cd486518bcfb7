"""Chunks that an arm can play are played: none is refused, the path is kept, and so are the times."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_studies.experiments.chunks import OFF, is_slow
from geodesic_motion_studies.experiments.feasible_chunks import SHORT, DrawnMotions, play
from test.filtering.conftest import BEGIN, DURATION, MOVED, Filtering, offered


@pytest.mark.parametrize("arm", ["panda", "ur5"])
def test_motions_that_are_drawn_are_played_as_they_are_offered(arm: str) -> None:
    """Some hundred chunks; `geodesic-motion experiment chunks` plays thousands."""
    motion_filter = MotionFilter(arm, DeclaredScene.empty())
    drawn = (motion for motion in DrawnMotions(arm, np.random.default_rng(5)) if motion.duration >= SHORT)
    played = [play(motion_filter, motion) for motion in islice(drawn, 12)]
    assert {bool(each.drawn.hertz) for each in played} == {True, False}
    assert sum(each.chunks for each in played) > 100
    for each in played:
        assert not each.refused, each.drawn
        assert not each.stops, each.drawn
        assert each.path <= OFF, each.drawn
        assert not is_slow(each), each.drawn


@pytest.mark.parametrize("ahead", [0.5, 2.0])
def test_one_point_is_come_to_in_its_time(filtering: Filtering, ahead: float) -> None:
    """As joint_trajectory_controller takes it: from where the arm is; the first point of more as well."""
    end = BEGIN + 0.25 * MOVED
    assert filtering.filter.offer(np.array([ahead]), end[None]).ok
    filtering.run(ahead + 0.2)
    left = np.max(np.abs(filtering.positions - end), axis=1)
    latency = filtering.filter.latency
    assert np.flatnonzero(left > 1e-3)[-1] * 0.01 == pytest.approx(ahead + latency, rel=0.15)
    assert left[-1] < 1e-6


def test_a_chunk_whose_first_point_is_still_to_come_is_led_into(filtering: Filtering) -> None:
    """Chunks that say what is to be from the next point on, at once, twenty a second."""
    ahead = np.arange(1, 16) / 30.0

    def send(now: float) -> None:
        if round(now * 100) % 5 == 0:
            assert filtering.filter.offer(ahead, offered(now + ahead)[0]).ok

    filtering.run(DURATION + 0.5, send)
    delay = filtering.filter.latency
    wanted, _ = offered(0.01 * np.arange(len(filtering.positions)) - delay)
    np.testing.assert_allclose(filtering.positions, wanted, atol=0.02)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-6)
