"""A cubic spline fitted to a path by least squares: how the paper makes a smooth curve of a shortest path on a graph.

With few coefficients the spline does not follow the corners of the grid, which an interpolating one would
(Beik-Mohammadi et al., IJRR 2023; C. de Boor, "A Practical Guide to Splines", ch. XIV).
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

_DEGREE = 3


def fitted_spline(path: np.ndarray, coefficients: int = 10) -> BSpline:
    """Fit a spline over [0, 1] to a path (n, d), by the length of its polyline; the ends stay where they are.

    coefficients : of the spline, control points; fewer where the path has fewer points that differ.

        >>> corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]])
        >>> fitted_spline(corners, 4)([0.0, 0.5, 1.0]).round(6).tolist()
        [[0.0, 0.0], [1.0, 0.5], [2.0, 1.0]]
    """
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    differs = np.concatenate([[True], steps > 1e-12 * np.sum(steps)])
    points = path[differs]
    if len(points) < 2:
        return BSpline([0.0, 0.0, 1.0, 1.0], path[[0, -1]], 1)
    lengths = np.concatenate([[0.0], np.cumsum(steps[differs[1:]])])
    count = max(2, min(coefficients, len(points)))
    degree = min(_DEGREE, count - 1)
    inner = np.linspace(0.0, 1.0, count - degree + 1)[1:-1]
    knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    basis = BSpline.design_matrix(lengths / lengths[-1], knots, degree).toarray()
    ends = path[[0, -1]]
    between, *_ = np.linalg.lstsq(basis[:, 1:-1], points - basis[:, [0, -1]] @ ends, rcond=None)
    return BSpline(knots, np.concatenate([ends[:1], between, ends[1:]]), degree)
