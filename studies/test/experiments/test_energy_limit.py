"""A limit to the energy of the paper's paths: floors change what is far from the data alone, and all is handed over."""

from __future__ import annotations

import json

import numpy as np

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.energy_limit import EnergyLimitReport, Ratios, with_floor
from geodesic_motion_studies.tools.cost_limit import CostLimit


def test_a_lower_floor_is_felt_far_from_the_data_and_not_on_it() -> None:
    skill = Skill.load("paper_reach")
    low = with_floor(skill, 1e4)
    codes, far = skill.codes[:, ::20].reshape(-1, 3), skill.latent_upper[None] + 50.0
    np.testing.assert_array_equal(low.decoder.configurations(codes), skill.decoder.configurations(codes))
    # Without a kernel that reaches there sigma is the floor's.
    np.testing.assert_allclose(low.decoder.uncertainty(far), 1e4, rtol=1e-9)
    np.testing.assert_allclose(with_floor(low, 1.0).decoder.uncertainty(far), 1.0, rtol=1e-9)
    before, after = skill.decoder.uncertainty(codes), low.decoder.uncertainty(codes)
    lost = np.broadcast_to(skill.decoder.sigma_floor - 1e-4, before.shape)
    np.testing.assert_allclose(1.0 / before - 1.0 / after, lost, rtol=1e-6)


def test_sets_and_floors_are_taken_together_over_their_seeds(tmp_path) -> None:
    costs = [CostLimit(np.array([2.0 + seed]), np.array([1.0, 1.1])) for seed in range(2)]
    within, across = np.array([0.2, 0.3]), np.array([2.5, 4e6])
    ratios = [Ratios("separated", seed, 1.0, costs[seed], within + seed, across + seed) for seed in range(2)]
    report = EnergyLimitReport((*ratios, Ratios("meeting", 0, 1.0, costs[0], within, np.empty(0))))
    whole = report.of_all("separated", 1.0)
    assert (len(whole.hits), len(whole.clear), whole.area) == (2, 4, 1.0)
    assert report.table().count("\n") == 1 + 3 + 2
    together = next(line for line in report.table().splitlines() if line.split()[:2] == ["separated", "all"])
    assert together.split()[3:5] == ["1.30", "2.5"]
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert [item["area"] for item in content["ratios"]] == [1.0, 1.0, 1.0]
    report.draw(tmp_path / "energy_limit.png")
    assert (tmp_path / "energy_limit.png").read_bytes().startswith(b"\x89PNG")
