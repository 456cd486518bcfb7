"""The natural cubic spline is SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geodesic_motion_ros.cubic_spline import natural_bends, spline_samples


@pytest.mark.parametrize("count", [2, 3, 4, 100])
def test_it_is_the_spline_of_scipy_with_all_derivatives_and_beyond_its_ends(count):
    random = np.random.default_rng(count)
    knots = np.cumsum(random.uniform(0.05, 0.3, count))
    values = random.normal(size=(count, 3))
    at = np.concatenate([random.uniform(knots[0] - 0.1, knots[-1] + 0.1, 50), knots])
    expected = CubicSpline(knots, values, bc_type="natural")
    found = spline_samples(knots, values, natural_bends(knots, values), at)
    for order in range(3):
        np.testing.assert_allclose(found[order], expected(at, order), atol=1e-8)


def test_a_straight_line_stays_straight():
    knots = np.array([0.0, 0.1, 0.5, 0.6])
    values = np.outer(knots, [1.0, -2.0])
    np.testing.assert_allclose(natural_bends(knots, values), 0.0, atol=1e-12)
