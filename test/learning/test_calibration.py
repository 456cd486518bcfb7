import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.canonical import PoseForm
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.learning.calibration import dearest_energy
from geodesic_motion_ros.learning.shown_task import ShownPoses
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.pose_graph import build_pose_graph
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import SkillError

#: One worker trains the skills of both files.
pytestmark = pytest.mark.xdist_group("trained skills")


def calibrated(graph, codes):
    return dearest_energy(graph, ShownPoses.energies(graph), codes)


def test_codes_box_and_poses_belong_to_the_demonstrations(trained_skill, demonstrations):
    skill = trained_skill
    assert skill.codes.shape == (8, 100, 2)
    assert np.all(skill.codes > skill.latent_lower)
    assert np.all(skill.codes < skill.latent_upper)
    starts = np.stack([item.positions[0] for item in demonstrations])
    np.testing.assert_allclose(skill.start_pose[:3], starts.mean(axis=0))
    assert np.degrees(angle_between(skill.goal_pose[3:], demonstrations[0].quaternions[-1])) < 1.0
    decoded = skill.decoder.decode(skill.codes[:4, 0])
    assert np.all(np.sum(decoded.quaternions * skill.start_pose[3:], axis=1) > 0.9)


def test_a_canonical_skill_keeps_what_was_taken_out(canonical_skill, demonstrations):
    sheet = canonical_skill.canonical
    sheet.check(4, 100)
    starts = np.stack([item.positions[0] for item in demonstrations])
    np.testing.assert_allclose(canonical_skill.start_pose[:3], starts.mean(axis=0))
    np.testing.assert_allclose(sheet.start_offsets[:, :3], starts - starts.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(sheet.positions[:, 0], np.tile(canonical_skill.start_pose[:3], (4, 1)), atol=1e-12)
    np.testing.assert_array_equal(sheet.modes, 0)


def test_each_of_two_modes_has_a_mean_path_and_no_regression():
    s = np.linspace(0.0, 1.0, 80)[:, None]
    items = []
    for number, bulge in enumerate((0.12, 0.13, 0.14, -0.12, -0.13, -0.14)):
        positions = np.hstack([0.4 + 0.0 * s, 0.4 * (s - 0.5), 0.4 + bulge * np.sin(np.pi * s)])
        items.append(Demonstration(positions, np.tile([0.0, 1.0, 0.0, 0.0], (80, 1)), 2.0 * s[:, 0], f"{number}"))
    sheet = PoseForm(Demonstrations(tuple(items)), 0.1).sheet(50).with_regression()
    np.testing.assert_array_equal(sheet.modes, [0, 0, 0, 1, 1, 1])
    assert not sheet.regresses
    above, below = sheet.mean_curves(sheet.weights(np.zeros(6), np.zeros(6), conditioned=True))[0]
    assert above[25, 2] > 0.5
    assert below[25, 2] < 0.3


def test_support_is_the_99th_percentile_of_sigma(trained_skill):
    sigma = rms_sigma(trained_skill.decoder.decode(trained_skill.codes.reshape(-1, 2)).sigma)
    assert np.mean(sigma <= trained_skill.sigma_support) == pytest.approx(0.99, abs=0.005)


def test_threshold_separates_the_demonstrations_from_the_walls(skill):
    """Steps along the demonstrations are feasible, steps over the wall around them are not."""
    graph = skill.graph()
    assert calibrated(graph, skill.codes) == pytest.approx(skill.energy_per_edge, rel=1e-9)
    everywhere = build_pose_graph(
        skill.decoder, skill.codes, skill.latent_lower, skill.latent_upper, skill.metric, np.inf
    )
    energies = ShownPoses.energies(everywhere)
    on = everywhere.sigma[everywhere.edges].max(axis=1) < skill.sigma_support
    assert np.mean(energies[on] < skill.energy_per_edge) > 0.99
    assert energies.max() > 10.0 * skill.energy_per_edge


def test_threshold_scales_with_the_edges_it_was_measured_on(skill):
    """Half the grid spacing: half the length and a quarter of the energy of an edge."""
    coarse, fine = (calibrated(skill.graph((n, n)), skill.codes) for n in (40, 79))
    assert 2.0 < coarse / fine < 8.0


def test_ends_that_the_support_does_not_connect_are_reported(skill):
    """From the start of q to the goal of -q: the graph has no edge between the sheets."""
    crossing = np.stack([skill.codes[:4, 0], skill.codes[4:, -1]], axis=1)
    with pytest.raises(SkillError, match="connected"):
        calibrated(skill.graph((60, 60)), crossing)


def test_a_trained_skill_survives_the_disk(trained_skill, tmp_path):
    skill = trained_skill
    loaded = Skill.load(skill.save(tmp_path / "bend"))
    np.testing.assert_array_equal(loaded.codes, skill.codes)
    assert loaded.energy_per_edge == skill.energy_per_edge
    assert loaded.provenance["seed"] == 0
    assert loaded.provenance["demonstrations"] == [f"bend {i}" for i in range(4)]
    assert set(loaded.encoder_arrays) == set(skill.encoder_arrays)
