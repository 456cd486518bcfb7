"""Durations and their summary."""

from __future__ import annotations

import contextlib
import gc
import time

import pytest

from geodesic_motion_studies.benchmarks.stopwatch import (
    Stopwatch,
    no_garbage_among_what_stands,
    no_garbage_collection,
    percentiles_ms,
)


def test_waiting_takes_time_but_not_the_processors() -> None:
    watch = Stopwatch()
    for _ in range(2):
        with watch:
            time.sleep(0.05)
    assert len(watch.wall) == len(watch.cpu) == 2
    assert min(watch.wall) >= 0.05
    assert max(watch.cpu) < 0.05


def test_percentiles_are_in_milliseconds() -> None:
    assert percentiles_ms([0.001, 0.002, 0.009]) == pytest.approx({"p50": 2.0, "p99": 8.86, "max": 9.0})


def test_garbage_is_collected_again_after_an_error() -> None:
    with contextlib.suppress(KeyboardInterrupt), no_garbage_collection():
        assert not gc.isenabled()
        raise KeyboardInterrupt
    assert gc.isenabled()


def test_what_stands_is_left_out_of_collections_until_the_end() -> None:
    gc.unfreeze()  # a program that another test ran in this process may have left out what stood then
    frozen = gc.get_freeze_count()
    with contextlib.suppress(KeyboardInterrupt), no_garbage_among_what_stands():
        standing = gc.get_freeze_count()
        raise KeyboardInterrupt
    assert standing > 1000 > frozen
    assert gc.get_freeze_count() == frozen
