"""Averages of figures of which some have no value."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np


def mean(values: Iterable[float]) -> float | None:
    """Of those that are finite; None where there are none."""
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else None
