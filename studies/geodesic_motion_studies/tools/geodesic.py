"""Continuous geodesics: a cubic spline bent by gradient descent until its energy is least.

The paper's first solver, which lowers the length of the spline (eq. 29) where this one lowers its energy. It refines a
curve that a graph search found, or starts from a straight line, from which it may end in a local minimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.tools.metric import Metric, curve_energy, curve_length


@dataclass(frozen=True)
class GeodesicSettings:
    """How a continuous geodesic is computed.

    Attributes
    ----------
    control_points : of the spline, both ends included; the inner ones are free.
    samples : points of the curve at which its energy is evaluated.
    iterations : of L-BFGS, at most.
    tolerance : relative gain in energy over ten iterations below which the descent has converged.
    """

    control_points: int = 20
    samples: int = 200
    iterations: int = 200
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        if not 3 <= self.control_points < self.samples:
            raise ParameterError(
                f"{self.control_points} control points and {self.samples} samples: "
                "at least 3 control points, and more samples than that, are needed"
            )
        if self.iterations < 1 or not self.tolerance > 0.0:
            raise ParameterError(f"iterations {self.iterations} and tolerance {self.tolerance} must both be positive")


@dataclass(frozen=True)
class Geodesic:
    """A locally shortest curve.

    Attributes
    ----------
    curve : (T, d) from start to end, close to constant speed.
    length, energy : Riemannian length and energy of that polyline.
    initial_length : length of the curve the descent began from.
    iterations : L-BFGS iterations used; converged : whether the tolerance was met within them.
    """

    curve: np.ndarray
    length: float
    energy: float
    initial_length: float
    iterations: int
    converged: bool


def continuous_geodesic(
    metric: Metric,
    start: np.ndarray,
    end: np.ndarray,
    initial: np.ndarray | None = None,
    settings: GeodesicSettings = GeodesicSettings(),
) -> Geodesic:
    """Minimise the energy of a natural cubic spline between two latent points.

    Parameters
    ----------
    metric : latent points (n, d) to tensors (n, d, d), differentiable, float64.
    start, end : (d,) fixed ends.
    initial : (m, d) curve to begin from, a graph path for example; None: the straight line. Its first and
        last point are replaced by the ends.

    The result is never longer than the curve it began from. Raises ParameterError for ill-shaped or
    non-finite points.
    """
    guess = _initial_curve(np.asarray(start, dtype=float), np.asarray(end, dtype=float), initial)
    polyline = torch.tensor(_at_constant_speed(metric, guess, settings.samples))
    controls = torch.tensor(_at_constant_speed(metric, guess, settings.control_points))
    spline = torch.tensor(_spline_matrix(settings.control_points, settings.samples))
    fixed = spline[:, :1] * controls[0] + spline[:, -1:] * controls[-1]
    free = controls[1:-1].clone().requires_grad_(True)

    def curve() -> Tensor:
        return fixed + spline[:, 1:-1] @ free

    iterations, converged = _descend(lambda: curve_energy(metric, curve()), free, settings)
    with torch.no_grad():
        candidates = [curve(), polyline]
        lengths = [float(curve_length(metric, candidate)) for candidate in candidates]
        best = int(np.argmin(lengths))
        energy = float(curve_energy(metric, candidates[best]))
        return Geodesic(candidates[best].numpy(), lengths[best], energy, lengths[1], iterations, converged)


def _initial_curve(start: np.ndarray, end: np.ndarray, initial: np.ndarray | None) -> np.ndarray:
    guess = np.array([start, end] if initial is None else initial, dtype=float)
    if guess.ndim != 2 or len(guess) < 2 or not start.shape == end.shape == guess.shape[1:]:
        raise ParameterError(
            f"start {start.shape}, end {end.shape} and curve {guess.shape} must be (d,), (d,) and (points, d)"
        )
    guess[0], guess[-1] = start, end
    if not np.all(np.isfinite(guess)):
        raise ParameterError("start, end and initial curve of a geodesic must be finite")
    return guess


def _at_constant_speed(metric: Metric, curve: np.ndarray, count: int) -> np.ndarray:
    """Resample a polyline (m, d) to `count` points equally far apart in the Riemannian sense, ends kept."""
    fine = np.linspace(0.0, 1.0, 10 * max(count, len(curve)))
    dense = np.stack([np.interp(fine, np.linspace(0.0, 1.0, len(curve)), column) for column in curve.T], axis=1)
    points = torch.tensor(dense)
    with torch.no_grad():
        steps = points[1:] - points[:-1]
        tensors = metric(0.5 * (points[1:] + points[:-1]))
        pieces = torch.einsum("ni,nij,nj->n", steps, tensors, steps).clamp_min(0.0).sqrt().numpy()
    travelled = np.concatenate([[0.0], np.cumsum(pieces)])
    if travelled[-1] == 0.0:
        return np.repeat(curve[:1], count, axis=0)
    even = np.linspace(0.0, travelled[-1], count)
    resampled = np.stack([np.interp(even, travelled, column) for column in dense.T], axis=1)
    resampled[0], resampled[-1] = curve[0], curve[-1]
    return resampled


def _spline_matrix(control_points: int, samples: int) -> np.ndarray:
    """Matrix (samples, control_points) that takes control points of a natural cubic spline to points on
    it.
    """
    knots = np.linspace(0.0, 1.0, control_points)
    basis = CubicSpline(knots, np.eye(control_points), bc_type="natural")
    return basis(np.linspace(0.0, 1.0, samples))


def _descend(energy: Callable[[], Tensor], free: Tensor, settings: GeodesicSettings) -> tuple[int, bool]:
    """L-BFGS in blocks of ten iterations until a block gains less than the tolerance; keeps the best point
    seen.
    """
    block = 10
    optimiser = torch.optim.LBFGS([free], max_iter=block, history_size=20, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        optimiser.zero_grad()
        loss = energy()
        loss.backward()
        return loss

    previous = float(energy().detach())
    for done in range(block, settings.iterations + block, block):
        kept = free.detach().clone()
        optimiser.step(closure)
        reached = float(energy().detach())
        if not reached < previous:
            with torch.no_grad():
                free.copy_(kept)
            return done, True
        if previous - reached < settings.tolerance * previous:
            return done, True
        previous = reached
    return settings.iterations, False
