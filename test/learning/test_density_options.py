"""Skills with other densities than the default: trained, stored, read again, and asked for a path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.learning.autoencoder import DecoderNetwork
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.learning.shown_task import ShownConfigurations
from geodesic_motion_ros.learning.training import train_model, train_skill
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.tools.metric import PullbackMetric

BRIEF = TrainingSettings(
    steps=150, samples=40, batch=64, hidden=(24, 16), kernels=60, precision_samples=2, precision_iterations=20
)
BOTH = {"position_density": "full", "orientation_density": "angular_central_gaussian"}


@pytest.fixture(scope="module")
def skill(demonstrations: Demonstrations) -> Skill:
    return train_skill(demonstrations, replace(BRIEF, **BOTH), name="bend")


def test_a_skill_comes_back_as_it_was_and_answers(
    skill: Skill, demonstrations: Demonstrations, tmp_path: Path
) -> None:
    loaded = Skill.load(skill.save(tmp_path / "bend"))
    arrays = loaded.decoder.arrays()
    assert loaded.decoder.full
    assert arrays["kappa_weights"].shape[0] == 3
    assert np.abs(arrays["sigma_shears"]).max() > 0.0
    for name, array in skill.decoder.arrays().items():
        np.testing.assert_array_equal(arrays[name], array)
    curve = demonstrations[0].curve
    path = PosePathPlanner(loaded).plan(*curve.start, *curve.goal)
    assert isinstance(path, PosePath)
    np.testing.assert_allclose(path.positions[[0, -1]], [curve.start[0], curve.goal[0]], atol=1e-6)


def test_the_decoder_agrees_with_its_twin_in_torch(skill: Skill) -> None:
    latent = np.concatenate([skill.codes.reshape(-1, 2)[::11], [[40.0, 40.0]]])
    network = DecoderNetwork.from_numpy(skill.decoder)
    precisions = network.precisions(torch.tensor(latent))
    decoded = skill.decoder.decode(latent)
    np.testing.assert_allclose(decoded.kappas, precisions.kappa, rtol=1e-9)
    root = PullbackMetric(network, skill.metric).features(torch.tensor(latent))[:, 3:9]
    np.testing.assert_allclose(decoded.root, root, rtol=1e-9, atol=1e-12)
    again = network.to_numpy()
    for name, array in skill.decoder.arrays().items():
        np.testing.assert_allclose(again.arrays()[name], array, rtol=1e-9, atol=1e-12, err_msg=name)


def test_the_metric_of_the_graph_is_the_pull_back_of_all_features(skill: Skill) -> None:
    graph = skill.graph((30, 30))
    tensors = PullbackMetric(DecoderNetwork.from_numpy(skill.decoder), graph.metric)(torch.tensor(graph.latent)).numpy()
    rows, columns = np.triu_indices(2)
    expected = (tensors * np.outer(graph.grid.spacing, graph.grid.spacing))[:, rows, columns]
    found = graph.tensors(np.zeros((1, 3)))[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


def test_the_means_are_those_of_the_default(skill: Skill, demonstrations: Demonstrations) -> None:
    """They are learned before the precisions, by the same density."""
    plain = train_skill(demonstrations, BRIEF, name="bend")
    np.testing.assert_array_equal(plain.codes, skill.codes)
    np.testing.assert_array_equal(plain.decoder.W3, skill.decoder.W3)
    assert not plain.decoder.full
    weights = skill.decoder.kappa_weights
    assert (weights.max(axis=0) / weights.min(axis=0)).max() > 1.2


@pytest.mark.parametrize("choice", [{"position_density": "full"}, {"orientation_density": "angular_central_gaussian"}])
def test_the_papers_schedule_learns_the_papers_densities_alone(choice: dict[str, str]) -> None:
    with pytest.raises(ParameterError, match="schedule joint learns diagonal and von_mises_fisher"):
        TrainingSettings(schedule="joint", **choice)
    with pytest.raises(ParameterError, match="must be one of"):
        TrainingSettings(**dict.fromkeys(choice, "bingham"))


def test_wrapped_joints_are_learned_as_gaussian_ones_within_a_turn(reach_demonstrations: JointDemonstrations) -> None:
    brief = JointTrainingSettings(
        steps=40, batch=64, hidden=(24, 16), samples=40, kernels=30, precision_samples=1, precision_iterations=5
    )
    codes = []
    for settings in (brief, replace(brief, joint_density="wrapped")):
        shown = ShownConfigurations(reach_demonstrations, settings)
        curves = shown.learned_curves()
        codes.append(train_model(curves, shown.likelihood).encoder(torch.tensor(curves[0]))[0])
    torch.testing.assert_close(*codes, rtol=1e-2, atol=1e-2)
    with pytest.raises(ParameterError, match="joint_density is 'uniform'"):
        JointTrainingSettings(joint_density="uniform")
