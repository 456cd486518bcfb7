"""Which demonstrations a query resembles: ridge regression on where the motion starts and ends.

With centred features A (N, f) of the demonstrations and b (f,) of the query, the linear ridge regression of any
quantity y_i of the demonstrations predicts sum_i w_i y_i with

    w = 1 / N + H (A A^T + penalty s I)^-1 A b,     s = tr(A A^T) / N,   H the centring matrix,

the same weights for every quantity (C. Saunders, A. Gammerman, V. Vovk, "Ridge regression learning algorithm in dual
variables", ICML 1998). An infinite penalty leaves the mean, w = 1 / N.
"""

from __future__ import annotations

import math

import numpy as np

#: Penalties that are tried, relative to the features' own size.
PENALTIES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
#: By this many standard errors a regression has to beat the mean on the demonstrations it has not seen.
STANDARD_ERRORS = 2.0
#: Fewer demonstrations than this leave nothing to regress on when one is left out.
FEWEST_DEMONSTRATIONS = 4


def regression_weights(features: np.ndarray, query: np.ndarray, penalty: float) -> np.ndarray:
    """w (N,), summing to 1 and not all positive, for features (N, f), a query (f,) and a penalty, inf for the mean."""
    count = len(features)
    mean = np.full(count, 1.0 / count)
    centred = features - features.mean(axis=0)
    gram = centred @ centred.T
    size = np.trace(gram) / count
    if math.isinf(penalty) or size == 0.0:
        return mean
    dual = np.linalg.solve(gram + penalty * size * np.eye(count), centred @ (query - features.mean(axis=0)))
    return mean + dual - dual.mean()


def surest_penalty(features: np.ndarray, curves: np.ndarray) -> float:
    """Penalty whose gain over the mean is surest, by leaving one demonstration out; inf where none is sure.

    The gain is the mean distance of the left-out curve from the mean of the others, less that from their regression;
    sure is what exceeds STANDARD_ERRORS standard errors over the demonstrations.

    Parameters
    ----------
    features : (N, f); curves : (N, T, 3) positions [m] at equal fractions of the arc.
    """
    if len(features) < FEWEST_DEMONSTRATIONS:
        return math.inf
    sure = {penalty: _sure_gain(features, curves, penalty) for penalty in PENALTIES}
    best = max(PENALTIES, key=lambda penalty: sure[penalty])
    return best if sure[best] > 0.0 else math.inf


def _sure_gain(features: np.ndarray, curves: np.ndarray, penalty: float) -> float:
    """Mean gain [m] over the mean, less STANDARD_ERRORS standard errors."""
    gains = []
    for left_out in range(len(features)):
        others = np.arange(len(features)) != left_out
        weights = regression_weights(features[others], features[left_out], penalty)
        regressed = np.tensordot(weights, curves[others], axes=1)
        gains.append(_distance(curves[others].mean(axis=0), curves[left_out]) - _distance(regressed, curves[left_out]))
    return float(np.mean(gains) - STANDARD_ERRORS * np.std(gains, ddof=1) / math.sqrt(len(gains)))


def _distance(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.linalg.norm(first - second, axis=1).mean())
