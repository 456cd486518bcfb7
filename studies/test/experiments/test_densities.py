"""Densities side by side on held-out demonstrations: a row for each, likelihoods on the same footing."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import SkillError
from geodesic_motion_studies.experiments import densities
from geodesic_motion_studies.experiments.densities import OF_JOINTS, OF_POSES, Densities
from geodesic_motion_studies.experiments.held_out_likelihood import log_densities


def with_densities(skill: Skill, settings: TrainingSettings) -> Skill:
    """A skill of poses whose densities are those of the settings, with the numbers that it has."""
    decoder = skill.decoder
    if settings.position_density == "full":
        decoder = replace(decoder, sigma_shears=np.zeros_like(decoder.sigma_weights))
    if settings.orientation_density == "angular_central_gaussian":
        decoder = replace(decoder, kappa_weights=np.tile(decoder.kappa_weights, (3, 1)))
    return replace(skill, decoder=decoder)


@pytest.fixture(autouse=True)
def asked(monkeypatch: pytest.MonkeyPatch, reach_pose_skill: Skill) -> list:
    """Skills that there are in the place of trained ones; the settings that were asked for."""
    seen = []

    def there(name: str, shown: object, settings: object, *_: object) -> Skill:
        seen.append(settings)
        if isinstance(settings, TrainingSettings):
            return with_densities(reach_pose_skill, settings)
        return Skill.load("panda_reach_to_grasp")

    monkeypatch.setattr(densities, "trained_once", there)
    return seen


def test_every_density_of_poses_has_a_row(reach_poses: Demonstrations, asked: list, tmp_path: Path) -> None:
    report = Densities({"reach": reach_poses}, "0", seeds=(5,), steps=7).measure(tmp_path)
    rows = {row.densities: row for row in report.rows}
    assert list(rows) == list(OF_POSES)
    assert {(settings.seed, settings.steps) for settings in asked} == {(5, 7)}
    plain, full, axes = (rows[name] for name in ("diagonal, vMF", "full, vMF", "diagonal, ACG"))
    # Without shears a full covariance is the diagonal one.
    assert full.position == pytest.approx(plain.position, abs=1e-9)
    assert full.dtw_mm == pytest.approx(plain.dtw_mm, rel=1e-6)
    assert axes.position == plain.position
    assert axes.orientation != plain.orientation
    for row in rows.values():
        assert row.nats == pytest.approx(row.position + row.orientation)
        assert row.worst_tenth <= row.nats
        assert row.unanswered == 0
        assert 0.0 < row.over_mean < 10.0
    assert report.table().count("\n") == 1 + len(OF_POSES)
    assert len(report.as_dict()["rows"]) == len(OF_POSES)
    report.draw(tmp_path / "densities.png")
    assert (tmp_path / "densities.png").stat().st_size > 5_000


def test_joints_have_one_likelihood(reach_demonstrations: JointDemonstrations, tmp_path: Path) -> None:
    report = Densities({"reach": reach_demonstrations}, "0").measure(tmp_path)
    assert [row.densities for row in report.rows] == list(OF_JOINTS)
    gaussian, wrapped = report.rows
    assert math.isnan(gaussian.orientation)
    assert gaussian.nats == gaussian.position == pytest.approx(wrapped.nats)


def test_a_quaternion_and_its_opposite_are_as_likely(reach_poses: Demonstrations, reach_pose_skill: Skill) -> None:
    """Whatever the sign that was recorded: the density of one sign would be higher by log 2, and that of none lower."""
    item = reach_poses[0]
    for choice in OF_POSES.values():
        settings = TrainingSettings(**choice)
        skill = with_densities(reach_pose_skill, settings)
        one, other = (
            log_densities(skill, settings, each) for each in (item, replace(item, quaternions=-item.quaternions))
        )
        assert one.shape == (100, 2)
        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_a_training_that_makes_no_skill_has_no_figures(
    reach_poses: Demonstrations, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refused(*_: object) -> Skill:
        raise SkillError("no demonstration's start and goal are connected")

    monkeypatch.setattr(densities, "trained_once", refused)
    for row in Densities({"reach": reach_poses}, "0,1").measure(tmp_path).rows:
        assert row.unanswered == 2
        assert math.isnan(row.nats)
        assert math.isnan(row.dtw_mm)
