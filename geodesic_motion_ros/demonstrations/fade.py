"""The fade of a start's offset along demonstrations: the exponent that leaves them most alike.

The start's offset is taken out with the share (1 - t)^fade at progress t, and the goal's with the rest
(`manifold.transport`). People who set out from afar may join the common path long before the goal; with a share that
fades linearly their mean is then bent by what is left of their offsets where all of them pass the same place.

The fade is that with the smallest Bayesian information criterion (G. Schwarz, "Estimating the dimension of a model",
Annals of Statistics 1978),

    n / 2 ln S(fade) + k / 2 ln n,      n = OBSERVATIONS N,

S the sum of the squared deviations of N demonstrations from the mean of their mode, and k the parameters that were
fitted: none for a fade of 1, else one. Demonstrations that all begin at one place say nothing of it, and it stays 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

#: Exponents that are tried. Below 1 an offset would fade at an infinite rate at the goal.
FADES = (1.0, 2.0, 4.0)
#: Samples along each demonstration that are compared.
FADE_SAMPLES = 50
#: Independent observations that a demonstration counts as: deviations vary slowly along a motion.
OBSERVATIONS = 2


def likeliest_fade(scatter: Callable[[float], float], count: int) -> float:
    """Choose the one of FADES that so many demonstrations speak for, `scatter` their S at a fade."""
    linear = scatter(1.0)
    if linear == 0.0:
        return 1.0

    observations = OBSERVATIONS * count

    def criterion(fade: float) -> float:
        ratio = max(scatter(fade) / linear, np.finfo(float).tiny)
        return 0.5 * observations * math.log(ratio) + (0.5 * math.log(observations) if fade != 1.0 else 0.0)

    return min(FADES, key=criterion)


def scatter_within(curves: np.ndarray, modes: np.ndarray) -> float:
    """Sum S, the squared deviations of curves (N, T, D) from the mean of their mode (N,)."""
    members = [curves[modes == mode] for mode in np.unique(modes)]
    return float(sum(np.sum((own - own.mean(axis=0)) ** 2) for own in members))
