"""The latent dimension: the smallest within one standard error of the best, by demonstrations that were held out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.learning.dimension import FOLDS, DimensionFigures, compare_dimensions, folds
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.utils.errors import DemonstrationError

BRIEF = TrainingSettings(steps=60, samples=40, batch=64, hidden=(32, 16))


def figures(means: list[float], deviation: float = 1.0) -> DimensionFigures:
    """Of four demonstrations whose errors have a standard error of half the deviation."""
    spread = deviation * np.array([-1.0, -1.0, 1.0, 1.0]) * np.sqrt(0.75)
    return DimensionFigures(tuple(range(1, len(means) + 1)), np.array(means)[:, None] + spread)


@pytest.mark.parametrize(
    ("means", "chosen"),
    [
        ([9.0, 5.4, 5.0, 5.1, 5.2], 2),  # within half a unit of the best
        ([9.0, 5.6, 5.0, 5.1, 5.2], 3),
        ([5.0, 5.0, 5.0], 1),
        ([9.0, 8.0, 7.0, 6.0], 4),
        ([5.2, 9.0, 5.0], 1),  # whatever is between
    ],
)
def test_the_smallest_within_one_standard_error_of_the_best_is_chosen(means, chosen):
    compared = figures(means)
    np.testing.assert_allclose(compared.standard_errors, 0.5)
    assert compared.chosen == chosen
    kept = compared.as_dict()
    assert kept["chosen"] == chosen
    np.testing.assert_allclose(kept["held_out_mm"], 1e3 * np.array(means))


def test_every_demonstration_is_held_out_once():
    parts = list(folds(7))
    assert len(parts) == FOLDS
    np.testing.assert_array_equal(np.sort(np.concatenate([held_out for _, held_out in parts])), np.arange(7))
    for learned, held_out in parts:
        np.testing.assert_array_equal(np.sort(np.concatenate([learned, held_out])), np.arange(7))


@pytest.mark.parametrize("sheet", ["canonical", "raw"])
def test_what_is_held_out_is_not_learned_and_every_one_has_an_error(demonstrations, sheet):
    settings, seen = replace(BRIEF, sheet=sheet, orientation_model=None), []
    compared = compare_dimensions(
        demonstrations, settings, noted=lambda dimension, errors: seen.append(dimension), dimensions=(1, 4)
    )
    assert seen == [1, 4]
    assert compared.errors.shape == (2, len(demonstrations))
    assert np.all((compared.errors > 0.0) & np.isfinite(compared.errors))


def test_the_same_seed_compares_the_same(demonstrations):
    once, again = (compare_dimensions(demonstrations, BRIEF, dimensions=(2,)) for _ in range(2))
    np.testing.assert_array_equal(once.errors, again.errors)


def test_of_two_demonstrations_none_can_be_held_out(demonstrations):
    with pytest.raises(DemonstrationError, match="2 demonstrations: of less than 3"):
        compare_dimensions(Demonstrations(tuple(demonstrations)[:2]), BRIEF)
