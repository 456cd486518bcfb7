import json
import math
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.crossing import (
    CrossingClusters,
    judged_summary,
    measure_crossings,
)
from geodesic_motion_studies.experiments.trained import Trained


@pytest.fixture(scope="module")
def skill(stored, demonstrations):
    settings = TrainingSettings(sheet="raw", steps=600, hidden=(64, 32), kernels=150)
    return stored("cup", lambda: train_skill(demonstrations, settings, name="cup"))


def test_changing_clusters_is_dear_and_flips_the_sign(skill, demonstrations):
    curves = [item.curve for item in demonstrations]
    crossings = measure_crossings(skill, curves)
    assert len(crossings) == len(curves)
    assert all(math.isfinite(item.across) and item.within > 0.0 for item in crossings)
    assert np.median([item.ratio for item in crossings]) > 10.0
    assert np.median([item.edge_ratio for item in crossings]) > 10.0
    assert all(item.sign_flip for item in crossings)


def test_a_path_across_changes_the_cluster_and_the_threshold_decides(skill, demonstrations):
    curves = [item.curve for item in demonstrations]
    for limit, refused in ((math.inf, False), (0.0, True)):
        for item in measure_crossings(replace(skill, energy_per_edge=limit), curves[:2]):
            within, across = item.judged_within["whole box"], item.judged_across["whole box"]
            assert within.offered
            assert across.offered
            # An odd number of changes ends in the other cluster, an even one in the same.
            assert across.changes % 2 == 1
            assert within.changes % 2 == 0
            assert (within.refused, across.refused) == (refused, refused)


def test_the_paths_within_are_among_what_the_support_offers(skill, demonstrations):
    items = measure_crossings(skill, [item.curve for item in demonstrations])
    summary = judged_summary(items, "support")
    assert summary["within_offered"] == len(demonstrations)
    assert summary["within_changes"] == 0


def test_what_is_handed_over_is_complete(skill, demonstrations, tmp_path):
    report = CrossingClusters().measured([Trained("cup", (0,), 0, skill, *demonstrations.split((0,)))])
    content = json.loads(write_json(tmp_path / "crossing.json", report.as_dict()).read_text())
    assert len(content["paths"]["cup"]) == 5
    assert content["summary"]["all"] == content["summary"]["cup"]
    assert content["energy_criterion"]["all"]["whole box"]["across_offered"] == 5
    assert "changes of cluster" in report.table()
    assert "cup" in report.table()
    report.draw(tmp_path / "crossing.png")
    assert (tmp_path / "crossing.png").read_bytes().startswith(b"\x89PNG")


def test_a_sign_blind_skill_has_nothing_to_cross(skill, demonstrations):
    sign_blind = replace(skill, orientation_model="sign_blind")
    with pytest.raises(ParameterError, match="sign_blind skill has no two clusters"):
        measure_crossings(sign_blind, [demonstrations[0].curve])
