"""Continuous geodesics of skills of configurations in any number of latent dimensions, by Gauss and Newton.

A curve is measured by chords, as `manifold.configuration_graph` measures its edges, but between points as near to each
other as one likes, each decoded: no tensor of a node, no interpolation, nothing of a graph takes part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.manifold.mean_path import LARGEST_EXPONENT, MeanPaths
from geodesic_motion_ros.queries.path_smoothing import resample_latent
from geodesic_motion_ros.robot.body_points import (
    BodyPoints,
    body_point_jacobians,
    place_body_points,
    tool_orientation_jacobians,
)
from geodesic_motion_ros.robot.kinematics import Robot

#: Pieces of a curve that is moved, and by which its length is measured.
PIECES, FINE = 300, 1500
#: Derivatives are differences over this share of a unit to either side.
_NUDGE = 1e-4
#: Steps at most, the relative gain below which no more follow, and the damping: at first, and its largest.
_STEPS, _GAIN, _DAMPING, _MOST_DAMPING = 25, 1e-4, 1e-3, 1e6


class DecodedPoints(NamedTuple):
    """Points (n, d), what is decoded there (n, eta) [rad], sigma times its weight, the body's points (n, K, 3) [m], and
    the features of progress (n, f).
    """

    points: np.ndarray
    configurations: np.ndarray
    sigma: np.ndarray
    body: np.ndarray
    progress: np.ndarray

    def part(self, which: slice) -> DecodedPoints:
        """Return some of them."""
        return DecodedPoints(*(each[which] for each in self))


@dataclass(frozen=True)
class ChordMetric:
    """The metric of a skill of configurations, with the conformal factor of mean paths.

    Attributes
    ----------
    decoder, settings, robot : of the skill.
    unit : (d,) what coordinates are counted in: an axis that the data hardly use does not spoil the equations.
    mean_paths : None for no factor. strength : as of `MeanPaths.conformal_factors`.
    """

    decoder: JointSpaceDecoder
    settings: JointMetricSettings
    robot: Robot
    unit: np.ndarray
    mean_paths: MeanPaths | None = None
    strength: float = 1.0

    @cached_property
    def _body(self) -> BodyPoints:
        return self.settings.body_points(self.robot)

    def decoded(self, points: np.ndarray) -> DecodedPoints:
        """Decode points (n, d), in units of `unit`."""
        metric, decoder, latent = self.settings, self.decoder, points * self.unit
        configurations = decoder.configurations(latent)
        body = self._body
        return DecodedPoints(
            points,
            configurations,
            metric.sigma_weight * decoder.uncertainty(latent),
            place_body_points(configurations, body.frames, body.offsets, self.robot.chain),
            decoder.progress_features(latent, metric.progress_length, metric.sigma_weight),
        )

    def residuals(self, begin: DecodedPoints, end: DecodedPoints) -> np.ndarray:
        """Make vectors (n, m) as long as the pieces from points to points are."""
        metric, body = self.settings, self._body
        turned, spread = end.configurations - begin.configurations, end.sigma - begin.sigma
        middle = 0.5 * (begin.configurations + end.configurations)
        jacobians = body_point_jacobians(middle, body.frames, body.offsets, self.robot.chain)
        seen = end.body - begin.body, np.einsum("nkaj,nj->nka", jacobians, spread)
        parts = [each.reshape(len(turned), -1) / math.sqrt(len(body)) for each in seen]
        parts += [metric.joint_weight * turned, metric.joint_weight * spread, end.progress - begin.progress]
        if metric.orientation_weight > 0.0:
            turning = metric.orientation_weight / math.sqrt(len(body)) * tool_orientation_jacobians(middle, self.robot)
            parts += [np.einsum("naj,nj->na", turning, each) for each in (turned, spread)]
        exponents, _ = self.exponents(0.5 * (begin.points + end.points))
        return np.exp(0.5 * exponents)[:, None] * np.concatenate(parts, axis=1)

    def exponents(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the exponents (n,) of the conformal factor, and their curvatures (n, d, d), at points (n, d)."""
        count, d = points.shape
        if self.mean_paths is None:
            return np.zeros(count), np.zeros((count, d, d))
        centres, precisions = self.mean_paths.centres.reshape(-1, d), self.mean_paths.precisions.reshape(-1, d, d)
        penalties = np.repeat(self.mean_paths.penalties, self.mean_paths.centres.shape[1])
        away = (points * self.unit)[:, None] - centres
        squared = np.einsum("nsa,sab,nsb->ns", away, precisions, away, optimize=True) + penalties
        nearest = np.argmin(squared, axis=1)
        exponents = self.strength * squared[np.arange(count), nearest]
        curvatures = 2.0 * self.strength * precisions[nearest] * self.unit[:, None] * self.unit
        curvatures[exponents >= LARGEST_EXPONENT] = 0.0
        return np.minimum(exponents, LARGEST_EXPONENT), curvatures

    def pieces(self, points: np.ndarray) -> np.ndarray:
        """Make the vectors (n - 1, m) of the pieces of a polyline (n, d), in units of `unit`."""
        decoded = self.decoded(points)
        return self.residuals(decoded.part(slice(None, -1)), decoded.part(slice(1, None)))

    def length(self, curve: np.ndarray) -> float:
        """Measure the Riemannian length of a polyline (m, d) of latent points."""
        points = resample_latent(curve / self.unit, math.inf, minimum=FINE)
        return float(np.linalg.norm(self.pieces(points), axis=1).sum())


def shortened(metric: ChordMetric, curve: np.ndarray) -> np.ndarray:
    """Move the inner points of a curve (m, d) of latent points to where its energy is least: (PIECES + 1, d).

    Gauss and Newton's equations, damped as of Levenberg and Marquardt, are banded: a piece depends on its two ends.
    No step makes the curve longer than it began: a single piece could leap over a wall.
    """
    points, damping = resample_latent(curve / metric.unit, math.inf, minimum=PIECES + 1), _DAMPING
    residuals, longest = metric.pieces(points), metric.length(points * metric.unit)
    for _ in range(_STEPS):
        gradient, bands = _equations(metric, points, residuals)
        before = np.sum(residuals**2)
        while damping < _MOST_DAMPING:
            damped = bands.copy()
            damped[0] *= 1.0 + damping
            trial = points.copy()
            trial[1:-1] -= solveh_banded(damped, gradient, lower=True).reshape(trial[1:-1].shape)
            residuals = metric.pieces(trial)
            if np.sum(residuals**2) < before and metric.length(trial * metric.unit) <= longest:
                break
            damping *= 10.0
        else:
            break
        points, damping = trial, 0.1 * damping
        if before - np.sum(residuals**2) < _GAIN * before:
            break
    return points * metric.unit


def _equations(metric: ChordMetric, points: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half of the energy's gradient by the inner points, ((N - 1) d,), and lower bands (2 d, (N - 1) d) of half of its
    second derivatives, J^T J and that of the conformal factor.
    """
    d, pieces = points.shape[1], len(residuals)
    begins, ends = slice(None, -1), slice(1, None)
    here, by_begin, by_end = metric.decoded(points), np.zeros((*residuals.shape, d)), np.zeros((*residuals.shape, d))
    for axis, side in enumerate(_NUDGE * np.eye(d)):
        more, less = metric.decoded(points + side), metric.decoded(points - side)
        for moved, sign in ((more, 0.5 / _NUDGE), (less, -0.5 / _NUDGE)):
            by_begin[..., axis] += sign * metric.residuals(moved.part(begins), here.part(ends))
            by_end[..., axis] += sign * metric.residuals(here.part(begins), moved.part(ends))
    gradient = np.einsum("nra,nr->na", by_end[:-1], residuals[:-1])
    gradient += np.einsum("nra,nr->na", by_begin[1:], residuals[1:])
    own = by_end[:-1].transpose(0, 2, 1) @ by_end[:-1] + by_begin[1:].transpose(0, 2, 1) @ by_begin[1:]
    # Row z_{i+1}, column z_i.
    beside = by_end[1:-1].transpose(0, 2, 1) @ by_begin[1:-1]
    # On a mean path the conformal factor has no slope, but is a valley.
    valley = metric.exponents(0.5 * (points[:-1] + points[1:]))[1]
    valley *= 0.125 * np.sum(residuals**2, axis=1)[:, None, None]
    own, beside = own + valley[:-1] + valley[1:], beside + valley[1:-1]
    bands = np.zeros((2 * d, (pieces - 1) * d))
    for a in range(d):
        for b in range(d):
            if a >= b:
                bands[a - b, b::d] = own[:, a, b]
            bands[d + a - b, b : (pieces - 2) * d : d] = beside[:, a, b]
    return gradient.reshape(-1), bands
