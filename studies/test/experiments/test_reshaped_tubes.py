"""The metric that is drawn among obstacles: that of the graph without any, and linear in what stretches it."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.experiments.reshaped_tubes import (
    DISTANCES,
    Cut,
    ReshapedTubes,
    riemannian_length,
    tensors,
)

NOTHING = np.empty((0, 3)), np.empty(0), 0.0


@pytest.fixture(scope="module")
def skill() -> Skill:
    return Skill.load("paper_reach")


def test_without_obstacles_it_is_the_metric_of_the_graph(skill: Skill) -> None:
    graph = skill.graph((14, 14, 14))
    rows, columns = np.triu_indices(3)
    spacing = graph.grid.spacing
    expected = graph.field(None, 1.0).tensors[:, 0] / (spacing[rows] * spacing[columns])
    found = tensors(skill, graph.latent, *NOTHING)[:, rows, columns]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())


def test_spheres_stretch_in_proportion_to_their_strength(skill: Skill) -> None:
    latent = skill.codes[:3, ::40].reshape(-1, skill.codes.shape[-1])
    sphere = np.array([[0.4, 0.0, 0.4]]), np.array([0.3])
    free, once, twice = (tensors(skill, latent, *sphere, strength) for strength in (0.0, 50.0, 100.0))
    np.testing.assert_allclose(twice - free, 2.0 * (once - free), rtol=1e-6, atol=1e-9 * np.abs(twice).max())
    assert np.all(np.linalg.eigvalsh(once - free) > -1e-9 * np.abs(once).max())
    assert np.all(np.linalg.slogdet(once)[1] > np.linalg.slogdet(free)[1])


def test_the_length_of_a_curve_does_not_depend_on_how_finely_it_is_cut(skill: Skill) -> None:
    ends = skill.codes[0, [20, 24]]
    coarse, fine = (
        riemannian_length(skill, ends[0] + np.linspace(0.0, 1.0, count)[:, None] * (ends[1] - ends[0]), *NOTHING)
        for count in (60, 240)
    )
    assert coarse == pytest.approx(fine, rel=0.02)


def test_a_cut_holds_the_path_that_it_is_made_for() -> None:
    flat = np.random.default_rng(0).normal(size=(30, 2)) @ np.array([[1.0, 2.0, 0.5], [0.0, -1.0, 3.0]])
    cut = Cut.through(flat)
    np.testing.assert_allclose(cut.points(cut.seen(flat)), flat, atol=1e-9)


def test_moments_are_measured_and_drawn(skill: Skill, tmp_path) -> None:
    report = ReshapedTubes(shape=(12, 12, 12)).measured(skill)
    lengths = [moment.length for moment in report.moments]
    assert len(lengths) == len(DISTANCES)
    assert lengths[-1] > 1.5 * lengths[0]
    assert report.table().count("\n") == 2 + len(DISTANCES)
    report.draw(tmp_path / "reshaped.png")
    assert (tmp_path / "reshaped.png").stat().st_size > 20_000
