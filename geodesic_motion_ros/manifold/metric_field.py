"""The metric of a latent graph between its nodes: what continuous curves cost.

At a latent point z, in units of the grid's spacing, the squared length of a small step dz is

    dz^T M(z) dz,      M(z) = exp(phi(z)) sum_c w_c(z) (M_c + sum_k (m_k(c) - 1) M_ck) / sum_c w_c(z)

over the corners c of the grid's cell that holds z and are nodes, with their multilinear weights w_c. M_c is the
pull-back metric at a node, M_ck the share of body point k in it and m_k(c) its ambient factor there. phi = min(a u^2,
cap) is the exponent of the mean paths' conformal factor (`mean_path.py`), which varies within a cell and is taken where
z is.

Where nodes are samples (`sampled_nodes.py`) c runs over the node nearest to z and those beside it, with the weights

    w_c(z) = exp(-|z - z_c|^2) / tr M_c.

They are farther apart than those of a grid, and within a step walls of sigma grow many times as high: divided by their
size tensors have the harmonic mean of their sizes, where the mean would have that of the highest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_ros.manifold.mean_path import LARGEST_EXPONENT, MeanPaths
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.manifold.sampled_nodes import SampledNodes

#: The nearest of a mean path's samples is looked for from the best of every so many.
_STRIDE = 5
#: Of coordinates, in steps of the grid.
_ROUNDING = 1e-9
#: Of sampled nodes: how support fades with the squared distance from the nearest, half of it is left at two steps; and
#: the smallest size of a tensor [m^2].
_FADING, _SMALLEST = 6.0, 1e-12
#: The squared distance from which on the nearest node is looked for among all.
_FAR = 4.0
#: Derivatives of decoders are differences over this share of a grid step to either side.
NUDGE = 1e-3


class MetricField(NamedTuple):
    """Metric tensors at n nodes of a grid, and what turns them into those between; compiled kernels read it.

    Attributes
    ----------
    lower, spacing : (d,) of the grid; shape : d numbers, its lattice points along each axis. A tuple, not an array:
        so compiled code knows d, and has no loops of two or three rounds.
    number : (prod(shape),) of the node at every lattice point, -1 where there is none; empty where nodes are samples.
    strides : (d,) from one to the next along each axis.
    rows, columns : (T,) places of the upper triangle of a (d, d) tensor, T = d (d + 1) / 2.
    tensors : (n, 1 + K, T) M_c without obstacles, and of it the shares M_ck of K body points, in units of the spacing.
    centres, precisions, penalties : (R, S, d), (R, S, d, d), (R,) as of `MeanPaths`, in units of the spacing, R >= 0.
    strength, cap : a, and the largest exponent of the conformal factor.
    places, beside : (n, d) sampled nodes, in units of the spacing, and of each itself and the nearest, (n, B); empty
        for a grid.
    """

    lower: np.ndarray
    spacing: np.ndarray
    shape: tuple[int, ...]
    strides: np.ndarray
    number: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    tensors: np.ndarray
    centres: np.ndarray
    precisions: np.ndarray
    penalties: np.ndarray
    strength: float
    cap: float
    places: np.ndarray
    beside: np.ndarray

    @classmethod
    def of(
        cls,
        grid: LatentGrid | SampledNodes,
        number: np.ndarray,
        tensors: np.ndarray,
        mean_paths: MeanPaths | None = None,
        strength: float = 1.0,
        cap: float = LARGEST_EXPONENT,
        sampled: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> MetricField:
        """number : in the grid's shape, as of `LatentGrid.numbering`; tensors : (n, 1 + K, T) of `packed_tensors`.

        sampled : places and beside, of sampled nodes.
        """
        dimension, spacing = len(grid.shape), grid.spacing
        shape = tuple(int(count) for count in grid.shape)
        strides = np.append(np.cumprod(shape[:0:-1])[::-1], 1).astype(np.int64)
        if mean_paths is None:
            centres, precisions = np.empty((0, 1, dimension)), np.empty((0, 1, dimension, dimension))
            penalties = np.empty(0)
        else:
            centres, penalties = np.ascontiguousarray(grid.coordinates(mean_paths.centres)), mean_paths.penalties
            precisions = mean_paths.precisions * spacing[:, None] * spacing
        if sampled is None:
            sampled = np.empty((0, dimension)), np.empty((0, 1), dtype=np.int32)
        return cls(
            np.asarray(grid.lower, dtype=float), spacing, shape, strides, np.ascontiguousarray(number).reshape(-1),
            *np.triu_indices(dimension), tensors, centres, precisions, penalties, float(strength), float(cap),
            *sampled,
        )  # fmt: skip

    def coordinates(self, latent: np.ndarray) -> np.ndarray:
        """Latent points (m, d) in units of the spacing."""
        return (latent - self.lower) / self.spacing

    def latent(self, coordinates: np.ndarray) -> np.ndarray:
        """Latent points of their coordinates (m, d)."""
        return self.lower + coordinates * self.spacing


def pulled_back(slopes: np.ndarray) -> np.ndarray:
    """J^T J (n, d, d) of derivatives J (n, r, d) of what is decoded by the d latent coordinates."""
    return slopes.transpose(0, 2, 1) @ slopes


def packed_tensors(shares: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(n, 1 + K, T) for a `MetricField`, of shares (n, K, d, d) and what no obstacle stretches, (n, d, d)."""
    both = np.concatenate([(rest + shares.sum(axis=1))[:, None], shares], axis=1)
    rows, columns = np.triu_indices(rest.shape[-1])
    return np.ascontiguousarray(both[..., rows, columns])


def curve_length(field: MetricField, evaluation: NodeEvaluation, curve: np.ndarray, samples: int = 1000) -> float:
    """Riemannian length of a polyline (m, d) in the latent space among obstacles, by so many pieces of it.

    inf where a piece is outside the grid, or in a cell without a node.
    """
    energies, support, _ = piecewise(field, evaluation, evenly(field.coordinates(curve), samples))
    return float(np.sum(np.sqrt(energies))) if np.all(support > 0.0) else math.inf


@numba.njit(cache=True, nogil=True)
def evenly(points: np.ndarray, pieces: int) -> np.ndarray:
    """Points (pieces + 1, d) that cut a polyline (m, d) into pieces of the same length."""
    count, d = points.shape
    length = np.zeros(count)
    for i in range(1, count):
        squared = 0.0
        for a in range(d):
            squared += (points[i, a] - points[i - 1, a]) ** 2
        length[i] = length[i - 1] + math.sqrt(squared)
    even, at = np.empty((pieces + 1, d)), 1
    for i in range(pieces + 1):
        wanted = i / pieces * length[-1]
        while at < count - 1 and length[at] < wanted:
            at += 1
        stretch = length[at] - length[at - 1]
        share = min(1.0, (wanted - length[at - 1]) / stretch) if stretch > 0.0 else 1.0
        for a in range(d):
            even[i, a] = points[at - 1, a] + share * (points[at, a] - points[at - 1, a])
    return even


@numba.njit(cache=True, nogil=True)
def piecewise(
    field: MetricField, evaluation: NodeEvaluation, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the pieces of a polyline (m + 1, d), in units of the spacing, by the metric in their middle, (m,) each:
    squared length, share of the middle's cell that nodes hold, and clearance there [m].
    """
    _, _, shape, _, _, rows, columns, _, centres, precisions, penalties, strength, cap, _, _ = field
    count, d = len(points) - 1, len(shape)
    energies, support, clearance = np.empty(count), np.empty(count), np.empty(count)
    tensor, slopes, share, lean = np.empty(len(rows)), np.empty((d, len(rows))), np.empty(d), np.empty((3, d))
    middle, gradient, curvature = np.empty(d), np.empty(d), np.empty((d, d))
    nearest = np.empty(len(centres), dtype=np.int64)
    nearest_samples(points[0], centres, precisions, nearest)
    nodes = np.full(count, -1, dtype=np.int64)
    evaluate_around(field, evaluation, points, nodes)
    for i in range(count):
        for a in range(d):
            middle[a] = 0.5 * (points[i, a] + points[i + 1, a])
        support[i], clearance[i] = tensor_at(
            middle, field, evaluation, nodes[i], tensor, slopes, share, lean, False
        )
        exponent = conformal_exponent(
            middle, centres, precisions, penalties, strength, cap, nearest, gradient, curvature
        )
        squared = 0.0
        for j in range(len(rows)):
            a, b = rows[j], columns[j]
            product = (points[i + 1, a] - points[i, a]) * (points[i + 1, b] - points[i, b])
            squared += (1.0 if a == b else 2.0) * tensor[j] * product
        energies[i] = math.exp(exponent) * squared
    return energies, support, clearance


@numba.njit(cache=True, nogil=True)
def evaluate_around(field: MetricField, evaluation: NodeEvaluation, points: np.ndarray, nodes: np.ndarray) -> None:
    """Work out what obstacles do to the nodes that `tensor_at` reads in the middles of a polyline's pieces.

    nodes : (m,) of sampled nodes near the nearest ones to these middles, which they become; -1: the one of the piece
        before is near.
    """
    shape, strides, number, evaluated = field.shape, field.strides, field.number, evaluation.evaluated
    if len(number) == 0:
        _evaluate_beside(field, evaluation, points, nodes)
        return
    d, count = len(shape), 0
    unknown = np.empty((len(points) - 1) << d, dtype=np.int64)
    for i in range(len(points) - 1):
        begin = 0
        for a in range(d):
            cell = min(max(math.floor(0.5 * (points[i, a] + points[i + 1, a])), 0.0), shape[a] - 2.0)
            begin += int(cell) * strides[a]
        for corner in range(1 << d):
            at = begin
            for a in range(d):
                at += strides[a] * (corner >> a & 1)
            if number[at] >= 0 and not evaluated[number[at]]:
                unknown[count] = number[at]
                count += 1
    if count > 0:
        evaluate_nodes(unknown[:count], evaluation)


@numba.njit(cache=True, nogil=True)
def _evaluate_beside(field: MetricField, evaluation: NodeEvaluation, points: np.ndarray, nodes: np.ndarray) -> None:
    """`evaluate_around` of sampled nodes."""
    beside, evaluated, count = field.beside, evaluation.evaluated, 0
    unknown, middle = np.empty(len(nodes) * beside.shape[1], dtype=np.int64), np.empty(points.shape[1])
    for i in range(len(nodes)):
        for a in range(points.shape[1]):
            middle[a] = 0.5 * (points[i, a] + points[i + 1, a])
        begin = nodes[i] if nodes[i] >= 0 or i == 0 else nodes[i - 1]
        nodes[i] = _nearest_sample(middle, begin, field.places, beside)
        for j in range(beside.shape[1]):
            if not evaluated[beside[nodes[i], j]]:
                unknown[count] = beside[nodes[i], j]
                count += 1
    if count > 0:
        evaluate_nodes(unknown[:count], evaluation)


@numba.njit(cache=True, nogil=True)
def _nearest_sample(point: np.ndarray, begin: int, places: np.ndarray, beside: np.ndarray) -> int:
    """The node (n, d) nearest to a point, found from one near it by going on to nearer ones beside; -1: from none.

    Where that ends far off, as at a node with none beside it on one side, all are looked at.
    """
    nearest, best = begin, math.inf
    if begin >= 0:
        best, here = _squared_distance(point, places, begin), -1
        while here != nearest:
            here = nearest
            for j in range(1, beside.shape[1]):
                squared = _squared_distance(point, places, beside[here, j])
                if squared < best:
                    best, nearest = squared, beside[here, j]
    if best > _FAR:
        for i in range(len(places)):
            squared = _squared_distance(point, places, i)
            if squared < best:
                best, nearest = squared, i
    return nearest


@numba.njit(cache=True, nogil=True, inline="always")
def _squared_distance(point: np.ndarray, places: np.ndarray, i: int) -> float:
    squared = 0.0
    for a in range(len(point)):
        squared += (places[i, a] - point[a]) ** 2
    return squared


@numba.njit(cache=True, nogil=True, inline="always")
def _add_node(
    node: int,
    weight: float,
    tensors: np.ndarray,
    evaluation: NodeEvaluation,
    tensor: np.ndarray,
    slopes: np.ndarray,
    lean: np.ndarray,
    derived: bool,
) -> None:
    """Add a node's tensor among obstacles to a weighted sum (T,), and by lean[0] (d,) to its slopes (d, T)."""
    factors, affected = evaluation.factors, evaluation.affected
    for j in range(len(tensor)):
        value = tensors[node, 0, j]
        if affected[node]:
            for k in range(factors.shape[1]):
                value += (factors[node, k] - 1.0) * tensors[node, 1 + k, j]
        tensor[j] += weight * value
        if derived:
            for a in range(slopes.shape[0]):
                slopes[a, j] += lean[0, a] * value


@numba.njit(cache=True, nogil=True)
def _tensor_beside(
    point: np.ndarray,
    field: MetricField,
    evaluation: NodeEvaluation,
    nearest: int,
    tensor: np.ndarray,
    slopes: np.ndarray,
    lean: np.ndarray,
    derived: bool,
) -> tuple[float, float]:
    """`tensor_at` among sampled nodes. The share of support is exp(-|z - z_c|^2 / _FADING) of the nearest node."""
    places, beside, tensors = field.places, field.beside, field.tensors
    clearance, within = evaluation.clearance, evaluation.within
    rows, columns, d, packed = field.rows, field.columns, places.shape[1], len(tensor)
    least = _squared_distance(point, places, nearest)
    total, room = 0.0, 0.0
    lean[:2] = 0.0
    tensor[:], slopes[:] = 0.0, 0.0
    for c in range(beside.shape[1]):
        node = beside[nearest, c]
        size = 0.0
        for j in range(packed):
            size += tensors[node, 0, j] if rows[j] == columns[j] else 0.0
        # All weights may be multiplied by the same: none is so small that it is lost.
        weight = math.exp(least - _squared_distance(point, places, node)) / max(size, _SMALLEST)
        total += weight
        room += weight * min(clearance[node], within)
        if derived:
            for a in range(d):
                lean[0, a] = 2.0 * weight * (places[node, a] - point[a])
                lean[1, a] += lean[0, a]
        _add_node(node, weight, tensors, evaluation, tensor, slopes, lean, derived)
    for j in range(packed):
        tensor[j] /= total
        for a in range(d):
            slopes[a, j] = (slopes[a, j] - tensor[j] * lean[1, a]) / total
    return math.exp(-least / _FADING), room / total


@numba.njit(cache=True, nogil=True, inline="always")
def tensor_at(
    point: np.ndarray,
    field: MetricField,
    evaluation: NodeEvaluation,
    nearest: int,
    tensor: np.ndarray,
    slopes: np.ndarray,
    share: np.ndarray,
    lean: np.ndarray,
    derived: bool,
) -> tuple[float, float]:
    """Fill the tensor (T,) at a point (d,), without the conformal factor; where `derived` its slopes (d, T).

    evaluation : has evaluated the cell's nodes. nearest : the sampled node nearest to the point, of `evaluate_around`.
    share, lean : (d,), (3, d) for the kernel's own use. Returns the share
    of the cell that nodes hold, weighted, and 0 outside the grid; and the clearance [m] there, at most what the
    evaluation distinguishes, -inf without any node. For use within compiled loops.
    """
    shape, strides, number, tensors = field.shape, field.strides, field.number, field.tensors
    if len(number) == 0:
        return _tensor_beside(point, field, evaluation, nearest, tensor, slopes, lean, derived)
    clearance, within = evaluation.clearance, evaluation.within
    d = len(shape)
    packed = d * (d + 1) // 2
    begin, total, room, inside = 0, 0.0, 0.0, 1.0
    for a in range(d):
        cell = min(max(math.floor(point[a]), 0.0), shape[a] - 2.0)
        if abs(point[a] - cell - 0.5) > 0.5 + _ROUNDING:
            inside = 0.0
        share[a] = min(1.0, max(0.0, point[a] - cell))
        begin += int(cell) * strides[a]
        lean[1, a] = 0.0
    for j in range(packed):
        tensor[j] = 0.0
        for a in range(d):
            slopes[a, j] = 0.0
    for corner in range(1 << d):
        at, weight = begin, 1.0
        for a in range(d):
            upper = corner >> a & 1
            at += strides[a] * upper
            lean[2, a] = share[a] if upper else 1.0 - share[a]
            weight *= lean[2, a]
        if number[at] < 0:
            continue
        # Unsigned: compiled code need not look for negative indices.
        node = np.uint32(number[at])
        total += weight
        room += weight * min(clearance[node], within)
        if derived:
            for a in range(d):
                lean[0, a] = 1.0 if corner >> a & 1 else -1.0
                for b in range(d):
                    if b != a:
                        lean[0, a] *= lean[2, b]
                lean[1, a] += lean[0, a]
        _add_node(node, weight, tensors, evaluation, tensor, slopes, lean, derived)
    if total > 0.0:
        room /= total
        for j in range(packed):
            tensor[j] /= total
            for a in range(d):
                slopes[a, j] = (slopes[a, j] - tensor[j] * lean[1, a]) / total
    else:
        room = -math.inf
    return inside * total, room


@numba.njit(cache=True, nogil=True, inline="always")
def _squared(point: np.ndarray, centres: np.ndarray, precisions: np.ndarray, k: int, s: int) -> float:
    """(z - r_k(s))^T C_k(s)^-1 (z - r_k(s))."""
    squared = 0.0
    for a in range(len(point)):
        across = 0.0
        for b in range(len(point)):
            across += precisions[k, s, a, b] * (point[b] - centres[k, s, b])
        squared += (point[a] - centres[k, s, a]) * across
    return squared


@numba.njit(cache=True, nogil=True)
def nearest_samples(point: np.ndarray, centres: np.ndarray, precisions: np.ndarray, nearest: np.ndarray) -> None:
    """Fill in the best (R,) of every few samples of each mean path, for `conformal_exponent` to begin from."""
    for k in range(len(centres)):
        best = math.inf
        for s in range(0, centres.shape[1], _STRIDE):
            squared = _squared(point, centres, precisions, k, s)
            if squared < best:
                best, nearest[k] = squared, s


@numba.njit(cache=True, nogil=True, inline="always")
def _nearest(point: np.ndarray, centres: np.ndarray, precisions: np.ndarray, k: int, s: int) -> tuple[float, int]:
    """The same at the sample of a mean path nearest to a point, and which it is; found where s is not far from it."""
    begin, squared = s, _squared(point, centres, precisions, k, s)
    for step in (1, -1):
        # Nothing is nearer behind where it became nearer ahead.
        while s * step >= begin * step and 0 <= s + step < centres.shape[1]:
            further = _squared(point, centres, precisions, k, s + step)
            if further >= squared:
                break
            squared, s = further, s + step
    return squared, s


@numba.njit(cache=True, nogil=True)
def nearest_along(point: np.ndarray, centres: np.ndarray, precisions: np.ndarray, nearest: np.ndarray) -> None:
    """Move on along each mean path from samples (R,) to the nearest ones; they are found where they are not far."""
    for k in range(len(centres)):
        _, nearest[k] = _nearest(point, centres, precisions, k, nearest[k])


@numba.njit(cache=True, nogil=True, inline="always")
def conformal_exponent(
    point: np.ndarray,
    centres: np.ndarray,
    precisions: np.ndarray,
    penalties: np.ndarray,
    strength: float,
    cap: float,
    nearest: np.ndarray,
    gradient: np.ndarray,
    curvature: np.ndarray,
) -> float:
    """phi at a point (d,); fills its gradient (d,) and its curvature (d, d) across the nearest path, 0 from the cap on.

    nearest : (R,) samples near the nearest ones, which they become.
    """
    gradient[:], curvature[:] = 0.0, 0.0
    if len(centres) == 0:
        return 0.0
    best, nearest_path = math.inf, 0
    for k in range(len(centres)):
        squared, nearest[k] = _nearest(point, centres, precisions, k, nearest[k])
        if squared + penalties[k] < best:
            best, nearest_path = squared + penalties[k], k
    if strength * best >= cap:
        return cap
    for a in range(len(point)):
        for b in range(len(point)):
            curvature[a, b] = 2.0 * strength * precisions[nearest_path, nearest[nearest_path], a, b]
            gradient[a] += curvature[a, b] * (point[b] - centres[nearest_path, nearest[nearest_path], b])
    return strength * best
