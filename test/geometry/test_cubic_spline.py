"""The spline passes through its points, is SciPy's for its ends, and bends at a cut as it bent there before."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geodesic_motion_ros.geometry.cubic_spline import spline_bends, spline_bends_between, spline_samples


@pytest.mark.parametrize("count", [2, 3, 4, 100])
def test_it_is_the_spline_of_scipy_with_all_derivatives_and_beyond_its_ends(count):
    random = np.random.default_rng(count)
    knots = np.cumsum(random.uniform(0.05, 0.3, count))
    values = random.normal(size=(count, 3))
    bends = spline_bends(knots, values)
    at = np.concatenate([random.uniform(knots[0] - 0.1, knots[-1] + 0.1, 50), knots])
    expected = CubicSpline(knots, values, bc_type=((2, bends[0]), (2, bends[-1])))
    found = spline_samples(knots, values, bends, at)
    for order in range(3):
        np.testing.assert_allclose(found[order], expected(at, order), atol=1e-7)
    np.testing.assert_allclose(bends[[0, -1]], bends[[1, -2]], atol=1e-9)


@pytest.mark.parametrize("with_slopes", [(True, True), (True, False), (False, True), (False, False)])
@pytest.mark.parametrize("count", [2, 3, 4, 5, 100])
def test_ends_with_a_slope_and_without_a_knot_are_those_of_scipy(count, with_slopes):
    # An end without a knot takes four points.
    with_slopes = with_slopes if count >= 4 else (True, True)
    random = np.random.default_rng(count)
    knots = np.cumsum(random.uniform(0.05, 0.3, count))
    values = random.normal(size=(count, 3))
    begin, end = (random.normal(size=3) if has else None for has in with_slopes)
    kinds = tuple("not-a-knot" if slope is None else (1, slope) for slope in (begin, end))
    expected = CubicSpline(knots, values, bc_type=kinds)(knots, 2)
    bends = spline_bends_between(knots, values, begin, end)
    np.testing.assert_allclose(bends, expected, atol=1e-9 * np.abs(expected).max())


def test_a_parabola_and_a_straight_line_stay_what_they_are():
    knots = np.array([0.0, 0.1, 0.5, 0.6])
    values = np.stack([1.0 - 2.0 * knots, 3.0 * knots**2 + knots], axis=1)
    np.testing.assert_allclose(spline_bends(knots, values), np.tile([0.0, 6.0], (4, 1)), atol=1e-9)


def test_a_cut_hardly_changes_how_a_curve_bends():
    knots = np.linspace(0.0, 1.0, 100)
    values = np.sin(7.0 * knots)[:, None]
    whole, cut = spline_bends(knots, values), spline_bends(knots[40:], values[40:])
    np.testing.assert_allclose(cut, whole[40:], atol=0.06 * np.abs(whole).max())
