"""Continuous refinement of a graph's shortest path: no bias towards the grid's directions.

The curve's inner points z_1, ..., z_{N-1} are moved to where its energy is least, with steps z_{i+1} - z_i measured by
the metric M_i of a `MetricField` in their middle:

    E = sum_i w_i e_i,      e_i = (z_{i+1} - z_i)^T M_i (z_{i+1} - z_i),      w_i = L_0 / sqrt(e_i) at the beginning.

With L_0 the length of the curve that is begun from, E is L_0^2 there and, by Cauchy and Schwarz, at least L^2
everywhere: where the energy sinks the length sinks, and points need not run along the curve to make it do so. Gauss and
Newton's Hessian is block tridiagonal; it has the curvature of the mean paths' exponent besides, which is positive too.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.manifold.metric_field import (
    MetricField,
    conformal_exponent,
    evaluate_around,
    evenly,
    nearest_along,
    nearest_samples,
    piecewise,
    tensor_at,
)
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation

#: Pieces of the refined curve, at most and at least: one for every step of the grid.
_MOST_PIECES, _LEAST_PIECES = 160, 8
#: Newton's steps, at most, and the relative gain below which no more follow; how often each is tried.
_SWEEPS, _GAIN, _ATTEMPTS = 5, 3e-3, 4
#: Nodes must hold this share of the cells that a curve is led through: that is what they hold of a cell half of whose
#: corners are nodes.
_SUPPORT = 0.5
#: Pieces much shorter than the average would weigh too much: this share of it.
_SHORTEST = 0.01
#: How often the curve that is begun from is smoothed, each time by a Gaussian of 0.7 pieces.
_SMOOTHINGS = 8
#: Where nodes are samples paths wind more: how often they are smoothed so again, as long as they become shorter, and
#: how often the curve that was found is refined anew.
_ROUNDS, _PASSES = 6, 2
#: Pieces a step of the grid by which the refined curve is judged against the path.
_JUDGED = 1


def refined(field: MetricField, evaluation: NodeEvaluation, margin: float, path: np.ndarray) -> np.ndarray:
    """A shorter curve (m, d) in the latent space from the first to the last point of a polyline (p, d) near it.

    It stays where nodes are and, as far as the polyline does, where they have a clearance of at least a margin [m]. It
    is never longer; where it would be it is the polyline.
    """
    best, shorter = field.coordinates(path), False
    for _ in range(1 if len(field.number) > 0 else _PASSES):
        curve = _shorter(field, evaluation, margin, best)
        if curve is None:
            break
        best, shorter = curve, True
    return field.latent(best) if shorter else path


def _shorter(
    field: MetricField, evaluation: NodeEvaluation, margin: float, path: np.ndarray
) -> np.ndarray | None:
    """A shorter curve (m, d) near a path (p, d), with no more faults; None where none was found."""
    begun, moved, cells = _refined(field, evaluation, margin, path)
    if not cells > 0.0:
        return None
    # Where the metric changes within a piece its middle may tell too little of it: then what was begun from is better.
    (faults, length), best = _judged(field, evaluation, margin, path, cells), None
    for curve in (begun, moved):
        new_faults, new_length = _judged(field, evaluation, margin, curve, cells)
        if new_faults <= faults and new_length < length:
            best, faults, length = curve, new_faults, new_length
    return best


@numba.njit(cache=True, nogil=True)
def _refined(
    field: MetricField, evaluation: NodeEvaluation, margin: float, path: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """The curve (N + 1, d) to begin from, which is a path (p, d), smoothed where that makes it shorter; that curve
    after a few of Newton's steps; and how many cells the path is long, 0 where it has no length.

    Each step keeps, or betters, how well nodes support each piece and how far it is from obstacles: where it would not
    the piece's points are fixed, and the step is looked for anew. Where the energy does not sink the step is halved.
    """
    cells, d = _polyline_length(path), path.shape[1]
    count = int(min(_MOST_PIECES, max(_LEAST_PIECES, math.ceil(cells))))
    curve = evenly(path, count)
    trial, nearest = curve.copy(), np.zeros((count, len(field.centres)), dtype=np.int64)
    nodes = np.full(count, -1, dtype=np.int64)
    energies, weights, support, clearance = np.empty(count), np.ones(count), np.empty(count), np.empty(count)
    new_energies, new_support, new_clearance = np.empty(count), np.empty(count), np.empty(count)
    gradient, diagonal, beside = np.empty((count + 1, d)), np.empty((count + 1, d, d)), np.empty((count, d, d))
    new_gradient, new_diagonal, new_beside = gradient.copy(), diagonal.copy(), beside.copy()
    fixed = np.empty(count + 1, dtype=np.bool_)
    _nearest_to_pieces(curve, field.centres, field.precisions, nearest)
    _assemble(
        field, evaluation, curve, weights, nearest, nodes, energies, support, clearance, gradient, diagonal, beside
    )
    length = _length(energies)
    for _ in range(1 if len(field.number) > 0 else _ROUNDS):
        _smooth(curve, trial)
        _assemble(
            field, evaluation, trial, weights, nearest, nodes, new_energies, new_support, new_clearance, gradient,
            diagonal, beside,
        )  # fmt: skip
        new_length = _length(new_energies)
        if not new_length < length or _worse(support, clearance, new_support, new_clearance, margin, fixed):
            break
        length, curve, trial = new_length, trial, curve
        energies, new_energies = new_energies, energies
        support, clearance, new_support, new_clearance = new_support, new_clearance, support, clearance
    if not length > 0.0:
        return path, path, 0.0
    for i in range(count):
        weights[i] = length / max(math.sqrt(energies[i]), _SHORTEST * length / count)
    before = _assemble(
        field, evaluation, curve, weights, nearest, nodes, energies, support, clearance, gradient, diagonal, beside
    )
    begun = curve.copy()
    for _ in range(_SWEEPS):
        after, share = math.inf, 1.0
        for i in range(count + 1):
            fixed[i] = False
        for _ in range(_ATTEMPTS):
            step = _newton_step(gradient, diagonal, beside, fixed)
            _move(curve, step, share, field.shape, trial)
            after = _assemble(
                field, evaluation, trial, weights, nearest, nodes, energies, new_support, new_clearance, new_gradient,
                new_diagonal, new_beside,
            )  # fmt: skip
            worse = _worse(support, clearance, new_support, new_clearance, margin, fixed)
            if after < before and not worse:
                break
            if not worse:
                share *= 0.5
            after = math.inf
        if not after < before:
            break
        curve, trial = trial, curve
        support, clearance, new_support, new_clearance = new_support, new_clearance, support, clearance
        gradient, new_gradient = new_gradient, gradient
        diagonal, new_diagonal = new_diagonal, diagonal
        beside, new_beside = new_beside, beside
        gained, before = before - after, after
        if gained < _GAIN * before:
            break
    return begun, curve, cells


# Loops, here and above, where numpy has a word for it: an array that is copied into another takes a second to compile.


@numba.njit(cache=True, nogil=True)
def _polyline_length(path: np.ndarray) -> float:
    """sum_i |z_{i+1} - z_i| of a polyline (p, d), in steps of the grid."""
    length = 0.0
    for i in range(len(path) - 1):
        squared = 0.0
        for a in range(path.shape[1]):
            squared += (path[i + 1, a] - path[i, a]) ** 2
        length += math.sqrt(squared)
    return length


@numba.njit(cache=True, nogil=True)
def _nearest_to_pieces(curve: np.ndarray, centres: np.ndarray, precisions: np.ndarray, nearest: np.ndarray) -> None:
    """Fill in the samples (N, R) of the R mean paths nearest to where the pieces of a curve (N + 1, d) begin."""
    nearest_samples(curve[0], centres, precisions, nearest[0])
    for i in range(1, len(nearest)):
        for k in range(nearest.shape[1]):
            nearest[i, k] = nearest[i - 1, k]
        nearest_along(curve[i], centres, precisions, nearest[i])


@numba.njit(cache=True, nogil=True)
def _move(curve: np.ndarray, step: np.ndarray, share: float, shape: tuple[int, ...], moved: np.ndarray) -> None:
    """Fill in the inner points of a curve (N + 1, d) after a share of a step (N + 1, d), kept inside the grid."""
    for i in range(1, len(curve) - 1):
        for a in range(curve.shape[1]):
            moved[i, a] = min(max(curve[i, a] + share * step[i, a], 0.0), shape[a] - 1.0)


@numba.njit(cache=True, nogil=True)
def _length(energies: np.ndarray) -> float:
    """Of a curve, by the squared lengths (N,) of its pieces."""
    length = 0.0
    for squared in energies:
        length += math.sqrt(squared)
    return length


@numba.njit(cache=True, nogil=True)
def _smooth(curve: np.ndarray, smoothed: np.ndarray) -> None:
    """Take the corners off a curve (N + 1, d), ends fixed."""
    for i in range(len(curve)):
        for a in range(curve.shape[1]):
            smoothed[i, a] = curve[i, a]
    for _ in range(_SMOOTHINGS):
        for a in range(curve.shape[1]):
            before = smoothed[0, a]
            for i in range(1, len(curve) - 1):
                here = smoothed[i, a]
                smoothed[i, a] = 0.25 * (before + 2.0 * here + smoothed[i + 1, a])
                before = here


@numba.njit(cache=True, nogil=True)
def _worse(
    support: np.ndarray,
    clearance: np.ndarray,
    new_support: np.ndarray,
    new_clearance: np.ndarray,
    margin: float,
    fixed: np.ndarray,
) -> bool:
    """Whether pieces (N,) of a curve are not as they should be and not as they were; marks their ends (N + 1,)."""
    worse = False
    for i in range(len(support)):
        if new_support[i] < min(_SUPPORT, support[i]) or new_clearance[i] < min(margin, clearance[i]):
            fixed[i], fixed[i + 1], worse = True, True, True
    return worse


@numba.njit(cache=True, nogil=True)
def _judged(
    field: MetricField, evaluation: NodeEvaluation, margin: float, curve: np.ndarray, cells: float
) -> tuple[int, float]:
    """How many of the pieces of a curve, one a step of the grid, are not as they should be, and its length."""
    energies, support, clearance = piecewise(field, evaluation, evenly(curve, math.ceil(_JUDGED * cells)))
    faults = 0
    for i in range(len(energies)):
        faults += support[i] < _SUPPORT or clearance[i] < margin
    return faults, _length(energies)


@numba.njit(cache=True, nogil=True)
def _assemble(
    field: MetricField,
    evaluation: NodeEvaluation,
    curve: np.ndarray,
    weights: np.ndarray,
    nearest: np.ndarray,
    nodes: np.ndarray,
    energies: np.ndarray,
    support: np.ndarray,
    clearance: np.ndarray,
    gradient: np.ndarray,
    diagonal: np.ndarray,
    beside: np.ndarray,
) -> float:
    """E of a curve (N + 1, d); fills energies e_i, support and clearance (N,) of its pieces, the gradient (N + 1, d),
    and the Hessian's blocks: diagonal (N + 1, d, d), and beside it (N, d, d), row z_i and column z_{i+1}.

    With D = z_{i+1} - z_i, the middle m, q = M D, and g the gradient of log e by the middle, the Hessian of e / 2 is

        dD M dD + (q dD) (g dm) + e / 4 (g dm)^2 + e / 2 dm C dm,      C the curvature of the mean paths' exponent.
    """
    _, _, shape, _, _, rows, columns, _, centres, precisions, penalties, strength, cap, _, _ = field
    d = len(shape)
    packed = d * (d + 1) // 2
    tensor, slopes, share, lean = np.empty(packed), np.empty((d, packed)), np.empty(d), np.empty((3, d))
    middle, along, pulled, slope = np.empty(d), np.empty(d), np.empty(d), np.empty(d)
    curvature = np.empty((d, d))
    gradient[:], diagonal[:], beside[:] = 0.0, 0.0, 0.0
    evaluate_around(field, evaluation, curve, nodes)
    energy = 0.0
    for i in range(len(weights)):
        for a in range(d):
            middle[a], along[a] = 0.5 * (curve[i, a] + curve[i + 1, a]), curve[i + 1, a] - curve[i, a]
        support[i], clearance[i] = tensor_at(
            middle, field, evaluation, nodes[i], tensor, slopes, share, lean, True
        )
        conformal = math.exp(
            conformal_exponent(
                middle, centres, precisions, penalties, strength, cap, nearest[i], slope, curvature
            )
        )
        for a in range(d):
            pulled[a] = 0.0
        for j in range(packed):
            pulled[rows[j]] += conformal * tensor[j] * along[columns[j]]
            if rows[j] != columns[j]:
                pulled[columns[j]] += conformal * tensor[j] * along[rows[j]]
        squared = 0.0
        for a in range(d):
            squared += pulled[a] * along[a]
        energies[i] = squared
        energy += weights[i] * squared
        if squared <= 0.0:
            continue
        weight = 2.0 * weights[i]
        for a in range(d):
            change = 0.0
            for j in range(packed):
                twice = 1.0 if rows[j] == columns[j] else 2.0
                change += twice * slopes[a, j] * along[rows[j]] * along[columns[j]]
            slope[a] += conformal * change / squared
        for a in range(d):
            common = 0.25 * weight * squared * slope[a]
            gradient[i, a] += common - weight * pulled[a]
            gradient[i + 1, a] += common + weight * pulled[a]
        for j in range(packed):
            a, b, stiffness = rows[j], columns[j], weight * conformal * tensor[j]
            diagonal[i, a, b] += stiffness
            diagonal[i + 1, a, b] += stiffness
            beside[i, a, b] -= stiffness
            if a != b:
                diagonal[i, b, a] += stiffness
                diagonal[i + 1, b, a] += stiffness
                beside[i, b, a] -= stiffness
        for a in range(d):
            for b in range(d):
                bowl = weight * squared * (0.125 * curvature[a, b] + 0.0625 * slope[a] * slope[b])
                even = 0.25 * weight * (pulled[a] * slope[b] + slope[a] * pulled[b])
                diagonal[i, a, b] += bowl - even
                diagonal[i + 1, a, b] += bowl + even
                beside[i, a, b] += bowl + 0.25 * weight * (slope[a] * pulled[b] - pulled[a] * slope[b])
    return energy


@numba.njit(cache=True, nogil=True)
def _newton_step(gradient: np.ndarray, diagonal: np.ndarray, beside: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Solve H step = -gradient (N + 1, d) for the inner points by Cholesky's factors of the block tridiagonal H.

    Steps of the ends, and of points that are fixed (N + 1,), are 0. A pivot that rounding makes small is raised.
    """
    factor, lower = _factorise(diagonal, beside, fixed)
    step = np.zeros(gradient.shape)
    _substitute(gradient, factor, lower, fixed, step)
    _substitute_back(factor, lower, step)
    return step


@numba.njit(cache=True, nogil=True)
def _factorise(diagonal: np.ndarray, beside: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cholesky's factors of the block tridiagonal H, (N + 1, d, d) each:

        lower_i = beside_{i-1}^T factor_{i-1}^-T,      factor_i factor_i^T = diagonal_i - lower_i lower_i^T.

    Points that are fixed (N + 1,) have the unit matrix, and are beside none.
    """
    count, d = diagonal.shape[:2]
    factor, lower = np.zeros((count, d, d)), np.zeros((count, d, d))
    for i in range(1, count - 1):
        if fixed[i]:
            for a in range(d):
                factor[i, a, a] = 1.0
            continue
        if i > 1 and not fixed[i - 1]:
            for a in range(d):
                for b in range(d):
                    value = beside[i - 1, b, a]
                    for k in range(b):
                        value -= lower[i, a, k] * factor[i - 1, b, k]
                    lower[i, a, b] = value / factor[i - 1, b, b]
        for a in range(d):
            for b in range(a + 1):
                value = diagonal[i, a, b]
                for k in range(d):
                    value -= lower[i, a, k] * lower[i, b, k]
                for k in range(b):
                    value -= factor[i, a, k] * factor[i, b, k]
                if a == b:
                    factor[i, a, a] = math.sqrt(max(value, 1e-6 * diagonal[i, a, a], 1e-300))
                else:
                    factor[i, a, b] = value / factor[i, b, b]
    return factor, lower


@numba.njit(cache=True, nogil=True)
def _substitute(
    gradient: np.ndarray, factor: np.ndarray, lower: np.ndarray, fixed: np.ndarray, step: np.ndarray
) -> None:
    """From the first inner point to the last, fill in step_i = factor_i^-1 (-gradient_i - lower_i step_{i-1})."""
    count, d = gradient.shape
    for i in range(1, count - 1):
        if fixed[i]:
            continue
        for a in range(d):
            step[i, a] = -gradient[i, a]
            if i > 1 and not fixed[i - 1]:
                for k in range(d):
                    step[i, a] -= lower[i, a, k] * step[i - 1, k]
            for k in range(a):
                step[i, a] -= factor[i, a, k] * step[i, k]
            step[i, a] /= factor[i, a, a]


@numba.njit(cache=True, nogil=True)
def _substitute_back(factor: np.ndarray, lower: np.ndarray, step: np.ndarray) -> None:
    """From the last inner point to the first, turn step_i into factor_i^-T (step_i - lower_{i+1}^T step_{i+1})."""
    count, d = step.shape
    for i in range(count - 2, 0, -1):
        for a in range(d - 1, -1, -1):
            value = step[i, a]
            if i < count - 2:
                for k in range(d):
                    value -= lower[i + 1, k, a] * step[i + 1, k]
            for k in range(a + 1, d):
                value -= factor[i, k, a] * step[i, k]
            step[i, a] = value / factor[i, a, a]
