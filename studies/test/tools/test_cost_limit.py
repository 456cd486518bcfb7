"""A limit to costs: what it refuses, and the area under the curve of what all limits refuse."""

from __future__ import annotations

import math

import numpy as np

from geodesic_motion_studies.tools.cost_limit import CostLimit, limit_columns


def test_a_limit_between_refuses_all_hits_that_cost_more() -> None:
    apart = CostLimit(np.array([2.0, 3.0]), np.array([1.0, 1.2, 1.1]))
    assert apart.area == 1.0
    assert apart.refused(1.5) == (2, 0)
    assert apart.refused(1.05) == (2, 2)
    assert CostLimit(apart.clear, apart.hits).area == 0.0


def test_the_area_is_that_under_the_curve_over_all_limits() -> None:
    random = np.random.default_rng(0)
    costs = CostLimit(np.round(random.normal(1.0, 1.0, 40), 1), np.round(random.normal(0.0, 1.0, 30), 1))
    limits = np.append(-np.inf, np.unique(np.concatenate([costs.hits, costs.clear])))
    curve = np.array([costs.refused(limit) for limit in limits[::-1]]) / [40, 30]
    under = np.sum(np.diff(curve[:, 1]) * 0.5 * (curve[1:, 0] + curve[:-1, 0]))
    np.testing.assert_allclose(costs.area, under, rtol=1e-12)


def test_a_row_has_a_cell_for_every_column_also_without_hits() -> None:
    for hits in (np.empty(0), np.array([2.0])):
        costs = CostLimit(hits, np.array([1.0]))
        assert len(costs.cells((1.5, 2.0))) == len(limit_columns((1.5, 2.0)))
    assert math.isnan(CostLimit(np.empty(0), np.array([1.0])).area)
