"""A sphere on its line reshapes the metric where it is, leaves it as it was elsewhere; random geodesics are counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.visualization.latent_view import magnification_factor
from geodesic_motion_studies.experiments.reshaped_metric import (
    PLACES_ON_LINE,
    Change,
    ReshapedMetric,
    change_of_groups,
    draw_reshaped_metric,
    reshape_metric,
)


@pytest.fixture(scope="module")
def report(pouring_pose_skill) -> ReshapedMetric:
    return reshape_metric(pouring_pose_skill, pairs=4)


def test_the_sphere_only_adds_to_the_magnification_factor(report, pouring_pose_skill) -> None:
    assert [item.place for item in report.snapshots] == list(PLACES_ON_LINE)
    free = magnification_factor(pouring_pose_skill, len(report.snapshots[0].magnification))
    for item in report.snapshots:
        assert np.all(item.magnification >= free - 1e-9)
    on_the_path = next(item for item in report.snapshots if item.place == 0.0)
    assert (on_the_path.magnification - free).max() > 3.0
    # The sphere's centre is a point of the path without it.
    assert on_the_path.nearest_without == pytest.approx(-0.04, abs=2e-3)


def test_ends_stay_and_geodesics_keep_farther_from_a_sphere_on_their_path(report) -> None:
    for item in report.snapshots:
        np.testing.assert_allclose(item.geodesic[[0, -1]], report.without[[0, -1]], atol=1e-12)
    on_the_path = next(item for item in report.snapshots if item.place == 0.0)
    assert on_the_path.nearest > on_the_path.nearest_without


def test_shares_of_random_geodesics_are_shares(report) -> None:
    assert len(report.geodesics) == 4
    for item in report.geodesics:
        assert 0.0 <= item.supported <= 1.0
        assert 0.0 <= item.line_supported <= 1.0
    assert report.as_dict()["random_geodesics"]["pairs"] == 4
    assert "4 geodesics between random supported points" in report.lines()[-1]


def test_a_change_of_groups_is_named_and_drawn_and_else_there_is_none(report, tmp_path) -> None:
    place = report.skill.decoder.decode(report.without).positions[50]
    change = Change(place, report.without, report.snapshots[2].geodesic, (0, 2, 0), 0.028, 0.019, 0.007, 39, 10, 9)
    whole = replace(report, change=change)
    assert "of 39 places clear in 10, in 9 of these through other groups; drawn: 0, 2, 0, 28.0 mm" in whole.lines()[0]
    assert whole.as_dict()["change"]["passed"] == (0, 2, 0)
    draw_reshaped_metric(whole, tmp_path / "metric.png")
    assert (tmp_path / "metric_change.png").read_bytes().startswith(b"\x89PNG")
    draw_reshaped_metric(replace(report, change=None), tmp_path / "none.png")
    assert not (tmp_path / "none_change.png").exists()


#: Three groups that are shown, straight on and 10 cm apart.
GROUPS = np.array([[[x, y, 0.0] for x in np.linspace(0.0, 1.0, 101)] for y in (0.0, 0.1, 0.2)])


def straight_on(group: int, deviation: float):
    """A search whose geodesic deviates by so much [m] at the sphere, from 0.1 before it to 0.1 behind."""

    def geodesic(centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        latent = GROUPS[group, :, :2].copy()
        for centre in centres:
            latent[np.abs(latent[:, 0] - centre[0]) <= 0.1, 1] += deviation
        return latent

    return geodesic


def flat(latent: np.ndarray) -> np.ndarray:
    """The tool is where the latent point is."""
    return np.column_stack([latent, np.zeros(len(latent))])


def test_a_change_follows_another_group_past_the_sphere_and_the_nearest_to_what_was_shown_is_kept() -> None:
    # The first comes clear off the demonstrations, the second beside them, the third stays on its own.
    change = change_of_groups([straight_on(0, 0.08), straight_on(1, 0.1), straight_on(2, 0.03)], flat, GROUPS)
    assert change.passed == (2, 1)  # kept is the first of the nearest; of a tenth on its own before, nothing is said
    assert (change.tried, change.clear, change.found) == (39, 39, 26)
    assert change.off == pytest.approx(0.0, abs=1e-12)
    # nearest are the samples of its own group just before it leaves
    assert change.nearest == pytest.approx(min(0.1, 0.11) - 0.02, abs=1e-9)


def test_through_the_sphere_or_among_the_own_demonstrations_is_no_change() -> None:
    through, near = straight_on(0, 0.0), straight_on(1, 0.03)
    assert change_of_groups([through, near], flat, GROUPS) is None
    # Without a sphere it follows another group already: not tried.
    assert change_of_groups([straight_on(1, 0.1)], flat, GROUPS) is None
