"""Learning joint-space skills: the same from the same seed, to the paper's letter where asked, refused where wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.learning.calibration import dearest_energy
from geodesic_motion_ros.learning.likelihoods import ConfigurationLikelihood, body_layer, counted_log_volume
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.learning.shown_task import ShownConfigurations
from geodesic_motion_ros.learning.training import train_model, train_skill
from geodesic_motion_ros.manifold import sampled_nodes
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.latent_graph import connected_pieces
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import kept_graph
from geodesic_motion_ros.utils.errors import ParameterError, SkillError

ROBOT = Robot.named("panda")
IN_NO_TIME = JointTrainingSettings(
    steps=40, batch=64, hidden=(24, 16), samples=40, kernels=30, precision_samples=1, precision_iterations=20
)


def weights(configurations: np.ndarray, settings: JointTrainingSettings) -> dict[str, torch.Tensor]:
    return train_model((configurations,), ConfigurationLikelihood(settings, ROBOT)).state_dict()


@pytest.fixture(scope="module")
def configurations(reach_demonstrations) -> np.ndarray:
    (curves,) = ShownConfigurations(reach_demonstrations, IN_NO_TIME).learned_curves()
    return curves


@pytest.fixture(scope="module")
def learned(configurations) -> dict[str, torch.Tensor]:
    return weights(configurations, IN_NO_TIME)


def test_the_same_seed_gives_the_same_model_bit_by_bit(configurations, learned) -> None:
    torch.manual_seed(123)  # what was drawn before must not matter, nor be disturbed
    expected = torch.Generator().manual_seed(123)
    again = weights(configurations, IN_NO_TIME)
    assert learned.keys() == again.keys()
    assert all(torch.equal(learned[name], again[name]) for name in learned)
    assert torch.equal(torch.rand(3), torch.rand(3, generator=expected))


def test_another_seed_gives_another_model(configurations, learned) -> None:
    other = weights(configurations, replace(IN_NO_TIME, seed=1))
    assert not torch.equal(other["encoder.perceptron.layers.0.weight"], learned["encoder.perceptron.layers.0.weight"])


def test_the_volume_term_takes_part_where_it_is_asked_for(configurations, learned) -> None:
    other = weights(configurations, replace(IN_NO_TIME, volume_weight=1.0))
    name = "decoder.perceptron.layers.0.weight"
    assert torch.isfinite(other[name]).all()
    assert not torch.equal(other[name], learned[name])


def test_no_mean_gains_by_being_more_singular_than_what_it_stands_for(configurations) -> None:
    """Two configurations stand for each other: the one of more volume is led to the other's, and that one nowhere."""
    body = body_layer(ROBOT, IN_NO_TIME.metric)
    ends = torch.tensor(configurations[0][[0, -1]])
    volumes = body.log_volume(ends)
    larger = int(volumes.argmax())
    assert volumes[larger] > volumes[1 - larger]
    means = ends.clone().requires_grad_()
    counted = counted_log_volume(body, means, ends.flip(0))
    torch.testing.assert_close(counted.detach(), volumes.max().expand(2))
    counted.sum().backward()
    assert torch.any(means.grad[larger] != 0.0)
    assert torch.all(means.grad[1 - larger] == 0.0)


def test_the_volume_term_leads_no_mean_to_where_the_arm_is_more_singular_than_shown(configurations) -> None:
    """Whatever it counts: log V of singular postures is lower by several units than of those shown."""
    body = body_layer(ROBOT, IN_NO_TIME.metric)
    settings = replace(IN_NO_TIME, volume_weight=1e4, steps=100)
    trained = train_model((configurations,), ConfigurationLikelihood(settings, ROBOT))
    shown = torch.tensor(configurations.reshape(-1, 7))
    decoded = body.log_volume(trained.decoder.means(trained.encoder(shown)[0]).coordinates)
    assert decoded.min() > body.log_volume(shown).min() - 0.5


def test_the_papers_schedule_learns_means_and_sigma_together(configurations) -> None:
    """Without sigma in the bound, or with a body that counts, the same seed gives other means."""
    paper = replace(
        JointTrainingSettings.paper(), steps=40, batch=64, hidden=(24, 16), samples=40, kernels=30, volume_weight=0.0
    )
    together = weights(configurations, paper)
    name = "decoder.perceptron.layers.0.weight"
    settled = weights(configurations, replace(paper, schedule="two_stage"))
    assert together["decoder.inverse_sigma.raw_weights"].abs().max() > 0.0
    assert not torch.equal(together[name], settled[name])
    assert not torch.equal(together[name], weights(configurations, replace(paper, body_sigma=0.003))[name])
    assert not torch.equal(together[name], weights(configurations, replace(paper, volume_weight=1.0))[name])


def test_canonical_demonstrations_and_their_blends_are_learned(reach_demonstrations, configurations) -> None:
    assert configurations.shape == (8 * (1 + IN_NO_TIME.blends), 40, 7)
    np.testing.assert_allclose(configurations[:, 0] - configurations[0, 0], 0.0, atol=1e-6)
    # A blend lies in the hull of one family, which no mean of both does.
    swung = configurations[:, 20, 0] - configurations[:, 20, 0].mean()
    shown = np.abs(swung[:8]).min()
    assert np.all(np.abs(swung[8:]) > 0.8 * shown)


def test_the_raw_sheet_learns_what_was_recorded(reach_demonstrations) -> None:
    (raw,) = ShownConfigurations(reach_demonstrations, replace(IN_NO_TIME, sheet="raw")).learned_curves()
    assert raw.shape == (8, 40, 7)
    for curve, item in zip(raw, reach_demonstrations, strict=True):
        np.testing.assert_array_equal(curve[[0, -1]], item.configurations[[0, -1]])


def test_a_raw_skill_of_two_dimensions_is_whole(reach_demonstrations) -> None:
    settings = replace(IN_NO_TIME, sheet="raw", latent_dimension=2, steps=150)
    licence = {"licence": "CC0-1.0"}
    skill = train_skill(reach_demonstrations, settings, name="flat", provenance=licence)
    assert (skill.space, skill.sheet, skill.decoder.latent_dimension) == ("joint", "raw", 2)
    assert skill.codes.shape[::2] == (8, 2)
    assert skill.provenance["licence"] == "CC0-1.0"
    assert skill.provenance["settings"]["latent_dimension"] == 2


def test_a_skill_reproduces_what_it_was_shown(reach_demonstrations) -> None:
    """Half a metre long, they turn the tool by 90 degrees. What is left differs from machine to machine."""
    settings = replace(IN_NO_TIME, latent_dimension=2, steps=600, hidden=(64, 32), samples=60, batch=128, kernels=100)
    skill = train_skill(reach_demonstrations, settings, name="reach")
    assert skill.quality["training_position_error_mm"] < 80.0
    assert skill.quality["training_orientation_error_deg"] < 20.0
    assert skill.canonical.modes.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert skill.provenance["demonstrations"] == [item.name for item in reach_demonstrations]
    for pose, end in ((skill.start_pose, 0), (skill.goal_pose, -1)):
        shown = np.mean([ROBOT.forward(item.configurations[end])[0] for item in reach_demonstrations], axis=0)
        np.testing.assert_allclose(pose[:3], shown, atol=5e-3)


def test_the_threshold_of_energy_is_that_of_paths_along_the_demonstrations(reach_skill) -> None:
    graph = reach_skill.graph()
    found = dearest_energy(graph, ShownConfigurations.energies(graph), reach_skill.codes)
    assert found == pytest.approx(reach_skill.energy_per_edge, rel=1e-9)


def test_of_a_literal_model_the_support_need_not_join_the_ends(reach_skill) -> None:
    """Where it is torn across all demonstrations, what is left of them counts."""
    graph, codes = reach_skill.graph(), reach_skill.codes
    energies = ShownConfigurations.energies(graph)
    intact = dearest_energy(graph, energies, codes)
    assert dearest_energy(graph, energies, codes, whole=False) == intact
    early = graph.progress[graph.edges] < 0.3
    kept = early[:, 0] == early[:, 1]
    edges = graph.edges[kept]
    torn = replace(graph, edges=edges, component=connected_pieces(edges, len(graph.latent)))
    with pytest.raises(SkillError, match="connected inside the support"):
        dearest_energy(torn, energies[kept], codes)
    assert 0.0 < dearest_energy(torn, energies[kept], codes, whole=False) < np.inf


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sheet": "flat"}, "sheet is 'flat'; it must be one of canonical, raw"),
        ({"schedule": "paper"}, "schedule is 'paper'; it must be one of two_stage, joint"),
        ({"latent_dimension": 7}, "latent_dimension is 7; a latent space has 1 to 6"),
        ({"hidden": (10,)}, "hidden has 1 layers"),
        ({"steps": 0}, "must be positive and finite: steps"),
        ({"far_sigma": 0.05}, "far_sigma is 0.05; it must be more than fixed_sigma"),
        ({"body_sigma": float("nan")}, "must be positive and finite: body_sigma"),
        ({"metric": JointMetricSettings(sigma_weight=float("nan"))}, "positive and finite: metric.sigma_weight"),
        ({"volume_weight": -1.0}, "must be positive and finite: volume_weight"),
    ],
)
def test_wrong_settings_are_named(changes, words) -> None:
    with pytest.raises(ParameterError, match=words):
        JointTrainingSettings(**changes)


def test_the_graph_of_a_skill_of_four_dimensions_is_kept_to_the_last_bit(
    reach_demonstrations, tmp_path, monkeypatch
) -> None:
    """And edges that bend are longer than their chords."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(kept_graph, "SMALLEST", 1)
    monkeypatch.setattr(sampled_nodes, "MOST_NODES", 400)
    settings = replace(IN_NO_TIME, latent_dimension=4, steps=300, hidden=(64, 32), samples=60, kernels=60)
    skill = train_skill(reach_demonstrations, settings)
    made, read = skill.graph(), skill.graph()
    assert len(list((tmp_path / "cache" / "graphs").iterdir())) > 0
    for name, array in made.arrays().items():
        assert array.tobytes() == read.arrays()[name].tobytes(), name
    for one, other in zip(*(graph.progress_map(made.latent[:5]) for graph in (made, read)), strict=True):
        np.testing.assert_array_equal(one, other)
    chords = replace(made, _bends=np.ones(len(made.edges)))
    longer = ShownConfigurations.energies(made) / ShownConfigurations.energies(chords)
    assert longer.min() >= 1.0 - 1e-9
    assert longer.max() > 1.0


def test_rounds_are_closed_before_they_are_learned_and_where_one_begins_chooses_nothing() -> None:
    """The control: as motions that lead elsewhere they would be chosen, the wider the further to one side they lie."""
    turned, items = np.linspace(0.0, 2.0 * np.pi, 80)[:, None], []
    for size in (0.8, 0.85, 0.9, 1.0, 1.1, 1.15, 1.2):
        round_trip = 0.2 * size * (np.cos(turned) * np.eye(7)[0] + np.sin(turned) * np.eye(7)[1])
        gap = 0.005 * turned * np.eye(7)[3]
        configurations = ROBOT.ready + round_trip + gap + (size - 1.0) * np.eye(7)[0]
        items.append(JointDemonstration(configurations, turned[:, 0], f"{size}"))
    demonstrations = JointDemonstrations(tuple(items), ROBOT.joint_names, "panda")
    shown = ShownConfigurations(demonstrations, replace(IN_NO_TIME, closed=True))
    (curves,), sheet = shown.coded_curves()
    np.testing.assert_allclose(curves[:, 0], curves[:, -1], atol=1e-9)
    assert sheet is not None
    assert np.isinf(sheet.penalty)
    assert np.isfinite(replace(sheet, configurations=curves).with_regression().penalty)
