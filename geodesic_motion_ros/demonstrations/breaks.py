"""Breaks between samples of a recording that are not of one motion: gaps, jumps, and what changes there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

#: [s], and in usual steps of time: shorter gaps are jitter.
GAP, GAP_STEPS = 0.2, 5.0
#: A step so many times as fast as the fastest of so many before and after it is none of their motion.
FAR_BEYOND, BESIDE = 10.0, 5
#: Smaller steps, as a share of the extent of a whole recording, are noise of an arm at rest.
SMALLEST_JUMP = 0.01
#: A column that says which demonstration a sample is of keeps its value for so many samples.
FEWEST_ALIKE = 10


def is_gap(steps: np.ndarray) -> np.ndarray:
    """Tell whether each step of time (T - 1,) [s] is a gap."""
    return steps > max(GAP, GAP_STEPS * float(np.median(steps)))


def is_far_beyond(speeds: np.ndarray) -> np.ndarray:
    """Tell whether each of the speeds (T - 1,) from sample to sample is far beyond those beside it."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(speeds, BESIDE), 2 * BESIDE + 1)
    beside = np.delete(windows, BESIDE, axis=1).max(axis=1)
    return speeds > FAR_BEYOND * beside


def is_break(values: np.ndarray, times: np.ndarray | None) -> np.ndarray:
    """Tell whether a gap or a jump is between each sample and the next (T - 1,).

    values : (T, C) positions or joints, in any unit. times : (T,) [s]; None: samples are equally far apart in time.
    """
    if len(values) < 2:
        return np.zeros(0, dtype=bool)
    lengths = np.linalg.norm(np.diff(values, axis=0), axis=1)
    steps = np.ones(len(lengths)) if times is None else np.diff(times)
    # messages that were held up arrive together
    speeds = lengths / np.maximum(steps, max(float(np.median(steps)), 1e-9))
    large = lengths > SMALLEST_JUMP * np.linalg.norm(np.ptp(values, axis=0))
    return (is_far_beyond(speeds) & large) | (False if times is None else is_gap(steps))


def find_changing_column(breaks: np.ndarray, columns: Mapping[str, Sequence[Any]]) -> tuple[str, int] | None:
    """Find the first column that keeps its value for long and changes at breaks alone, and its first changed sample.

    breaks : (T - 1,) as of `is_break`. columns : cells (T,) by their names.
    """
    if not np.any(breaks):
        return None
    for name, cells in columns.items():
        changes = np.array([one != other for one, other in pairwise(cells)])
        places = np.flatnonzero(changes) + 1
        lasting = np.diff([0, *places, len(cells)])
        if len(places) and not np.any(changes & ~breaks) and lasting.min() >= FEWEST_ALIKE:
            return name, int(places[0])
    return None
