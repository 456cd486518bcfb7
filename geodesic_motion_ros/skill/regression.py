"""Ridge regression on starts and goals: the weights of the demonstrations that a query resembles.

With centred features A (N, f) of the demonstrations and b (f,) of the query, the linear ridge regression of any
quantity y_i of the demonstrations predicts sum_i w_i y_i with

    w = 1 / N + H (A A^T + penalty s I)^-1 A b,     s = tr(A A^T) / N,   H the centring matrix,

the same weights for every quantity (C. Saunders, A. Gammerman, V. Vovk, "Ridge regression learning algorithm in dual
variables", ICML 1998). An infinite penalty leaves the mean, w = 1 / N.

A penalty gains where it predicts demonstrations that are left out in turn better than their mean does. The largest one
is taken whose gain is within one standard error of the best (L. Breiman et al., "Classification and Regression Trees",
1984). Whether the best is more than chance is tested by permutation (M. Ojala and G. C. Garriga, "Permutation tests for
studying classifier performance", JMLR 2010): with starts and goals shuffled among the demonstrations there is nothing
to find, and what is found then is what few demonstrations and the choice of a penalty leave to chance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: Penalties that are tried, relative to the features' own size.
PENALTIES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
#: So often may demonstrations whose starts and goals determine nothing be regressed on.
LEVEL = 0.1
#: Shuffles that a gain is compared with.
SHUFFLES = 499
#: Samples along each demonstration that are compared.
GAIN_SAMPLES = 50
#: Fewer demonstrations than this leave nothing to regress on when one is left out.
FEWEST_DEMONSTRATIONS = 4


def regression_weights(features: np.ndarray, query: np.ndarray, penalty: float) -> np.ndarray:
    """Compute w (N,), of sum 1, not all positive, from features (N, f), a query (f,) and a penalty; inf: the mean."""
    count = len(features)
    mean = np.full(count, 1.0 / count)
    centred = features - features.mean(axis=0)
    gram = centred @ centred.T
    size = np.trace(gram) / count
    if math.isinf(penalty) or size == 0.0:
        return mean
    dual = np.linalg.solve(gram + penalty * size * np.eye(count), centred @ (query - features.mean(axis=0)))
    return mean + dual - dual.mean()


def regression_penalty(features: np.ndarray, curves: np.ndarray) -> float:
    """Choose the penalty of the regression that the demonstrations speak for; inf where chance gains as much.

    The gain on a demonstration is the mean distance of its curve from the mean of the others, less that from their
    regression. At most LEVEL of SHUFFLES shuffled gains, each with the best penalty of its own, may reach the best.

    Parameters
    ----------
    features : (N, f); curves : (N, T, D) at equal fractions of the arc, positions [m] or configurations [rad].
    """
    count = len(features)
    if count < FEWEST_DEMONSTRATIONS:
        return math.inf
    few = curves[:, np.linspace(0, curves.shape[1] - 1, GAIN_SAMPLES).round().astype(int)]
    left_out = _LeftOut.of(features, PENALTIES)
    off_mean = _LeftOut.of(features, [math.inf]).distances(few)
    gains = off_mean - left_out.distances(few)
    best = gains[np.argmax(gains.mean(axis=1))]
    random, by_chance = np.random.default_rng(0), 0
    for _ in range(SHUFFLES):
        order = random.permutation(count)
        shuffled = off_mean - left_out.shuffled(order).distances(few)
        by_chance += bool(np.any(shuffled.mean(axis=1) >= best.mean()))
        if 1 + by_chance > LEVEL * (1 + SHUFFLES):
            return math.inf
    lost = best - gains
    within = lost.mean(axis=1) <= lost.std(axis=1, ddof=1) / math.sqrt(count)
    return max(penalty for penalty, near in zip(PENALTIES, within, strict=True) if near)


@dataclass(frozen=True)
class _LeftOut:
    """Regressions on all demonstrations but one, for each of N; the work of `distances` grows with N, not its square.

    features : (N, f). centres : (N, f) means of those of the others.
    slopes : (P, N, f), so that for each of P penalties the others' weights for demonstration i are 1 / (N - 1) +
        (features - centres[i]) @ slopes[:, i]: `regression_weights` for the features of i.
    """

    features: np.ndarray
    centres: np.ndarray
    slopes: np.ndarray

    @classmethod
    def of(cls, features: np.ndarray, penalties: Sequence[float]) -> _LeftOut:
        count, dimension = features.shape
        slopes = np.zeros((len(penalties), count, dimension))
        centres = (features.sum(axis=0) - features) / (count - 1)
        for i in range(count):
            centred = np.delete(features, i, axis=0) - centres[i]
            scatter = centred.T @ centred
            size = np.trace(scatter) / (count - 1)
            for k, penalty in enumerate(penalties):
                if size > 0.0 and not math.isinf(penalty):
                    ridge = scatter + penalty * size * np.eye(dimension)
                    slopes[k, i] = np.linalg.solve(ridge, features[i] - centres[i])
        return cls(features, centres, slopes)

    def shuffled(self, order: np.ndarray) -> _LeftOut:
        """Those of the features in another order."""
        return _LeftOut(self.features[order], self.centres[order], self.slopes[:, order])

    def distances(self, curves: np.ndarray) -> np.ndarray:
        """Mean distance (P, N) of each curve (N, T, D) from what is predicted for it."""
        rows = curves.reshape(len(curves), -1)
        others = rows.sum(axis=0) - rows
        of_its_own = np.sum(self.slopes * self.features, axis=-1, keepdims=True)
        of_centres = np.sum(self.slopes * self.centres, axis=-1, keepdims=True)
        moved = self.slopes @ (self.features.T @ rows) - of_its_own * rows - of_centres * others
        off = others / (len(rows) - 1) + moved - rows
        return np.linalg.norm(off.reshape(len(off), *curves.shape), axis=-1).mean(axis=-1)
