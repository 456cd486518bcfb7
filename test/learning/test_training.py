from dataclasses import replace

import numpy as np
import pytest
import torch

from geodesic_motion_ros.demonstrations.canonical import PoseForm
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.modes import blend_weights
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.learning import training
from geodesic_motion_ros.learning.likelihoods import PoseLikelihood
from geodesic_motion_ros.learning.optimisation import descend
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.learning.shown_task import ShownPoses
from geodesic_motion_ros.learning.training import train_model, train_skill
from geodesic_motion_ros.manifold.encoder import PRIOR_REACH, TaskSpaceEncoder
from geodesic_motion_ros.manifold.pose_graph import MetricSettings
from geodesic_motion_ros.utils.errors import ParameterError

#: One worker trains the skills of both files.
pytestmark = pytest.mark.xdist_group("trained skills")

TINY = TrainingSettings(
    sheet="raw", steps=30, samples=20, batch=32, hidden=(16, 8), kernels=20, precision_iterations=10
)


def train(demonstrations, settings, progress=None):
    shown = ShownPoses(replace(demonstrations, has_orientation=False), settings)
    return train_model(shown.learned_curves(), shown.likelihood, progress)


def poses_of(demonstrations, samples=40):
    even = demonstrations.resample(samples)
    return even.positions_array(), even.quaternions_array()


def test_training_is_reproducible_bit_by_bit_and_depends_on_the_seed(demonstrations):
    first, again = (train(demonstrations, TINY).state_dict() for _ in range(2))
    other = train(demonstrations, replace(TINY, seed=1)).state_dict()
    assert all(torch.equal(first[name], again[name]) for name in first)
    weight = "decoder.perceptron.layers.0.weight"
    assert not torch.equal(first[weight], other[weight])


def test_training_leaves_the_callers_random_state_and_threads_alone(demonstrations):
    threads, state = torch.get_num_threads(), torch.get_rng_state()
    train(demonstrations, TINY)
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), state)


def test_progress_counts_every_stage_to_its_end(demonstrations):
    calls = []
    train(demonstrations, TINY, lambda *call: calls.append(call))
    last = {stage: (step, steps) for stage, step, steps in calls}
    assert last == {"means": (30, 30), "sigma and kappa": (10, 10)}


@pytest.mark.parametrize("model", ["two_cluster", "sign_blind"])
def test_demonstrations_are_reconstructed(request, demonstrations, model):
    """Half a metre long, they turn the tool by 100 degrees. What is left differs from machine to machine."""
    skill = request.getfixturevalue("trained_skill" if model == "two_cluster" else "sign_blind_skill")
    positions, quaternions = poses_of(demonstrations)
    codes = TaskSpaceEncoder.from_arrays(skill.encoder_arrays).encode(positions, quaternions)
    decoded = skill.decoder.decode(codes.reshape(-1, 2))
    assert np.mean(np.linalg.norm(decoded.positions - positions.reshape(-1, 3), axis=1)) < 0.03
    assert np.degrees(np.mean(angle_between(decoded.quaternions, quaternions.reshape(-1, 4)))) < 6.0


def test_sigma_and_kappa_say_how_far_off_the_means_are(demonstrations, trained_skill):
    """Standardised residuals of the order of one on the demonstrations: the likelihood's maximum, not just any number.

    Somewhat below one: it was fitted on noisy codes, these are their means.
    """
    positions, quaternions = poses_of(demonstrations)
    codes = TaskSpaceEncoder.from_arrays(trained_skill.encoder_arrays).encode(positions, quaternions)
    decoded = trained_skill.decoder.decode(codes.reshape(-1, 2))
    standardised = (decoded.positions - positions.reshape(-1, 3)) / decoded.sigma
    assert 0.2 < np.sqrt(np.mean(standardised**2)) < 2.0
    half_angle = 0.5 * angle_between(decoded.quaternions, quaternions.reshape(-1, 4)) / decoded.spread
    assert 0.2 < np.sqrt(np.mean(half_angle**2) / 3.0) < 2.0


def test_uncertainty_grows_away_from_the_demonstrations(trained_skill):
    skill = trained_skill
    on = skill.decoder.decode(skill.codes.reshape(-1, 2))
    far = skill.decoder.decode(np.array([[30.0, 30.0]]))
    assert np.median(on.sigma) < 0.05
    np.testing.assert_allclose(far.sigma, 1.0)
    assert far.kappa[0] < 0.02 < np.median(on.kappa)


def test_two_clusters_keep_the_signs_apart_and_the_mixture_does_not_care(
    trained_skill, sign_blind_skill, demonstrations
):
    positions, quaternions = poses_of(demonstrations)

    def signed_dot(skill):
        encoder = TaskSpaceEncoder.from_arrays(skill.encoder_arrays)
        codes = encoder.encode(positions, -quaternions).reshape(-1, 2)
        return np.sum(skill.decoder.decode(codes).quaternions * -quaternions.reshape(-1, 4), axis=1)

    assert np.all(signed_dot(trained_skill) > 0.9)
    assert np.all(np.abs(signed_dot(sign_blind_skill)) > 0.9)
    first, second = np.split(trained_skill.codes, 2)
    gap = np.linalg.norm(first[:, None, :, None] - second[None, :, None, :], axis=-1).min()
    assert gap > 0.0


def test_a_canonical_sheet_is_a_strip_along_the_first_axis(canonical_skill):
    along = canonical_skill.codes[..., 0]
    expected = PRIOR_REACH * (2.0 * np.linspace(0.0, 1.0, along.shape[1]) - 1.0)
    assert np.abs(along - expected).max() < 0.5 * PRIOR_REACH
    assert np.all(along[:, 10:] > along[:, :-10])
    assert len(canonical_skill.codes) == 4


def test_canonical_demonstrations_are_reconstructed_without_clusters(canonical_skill):
    sheet = canonical_skill.canonical
    decoded = canonical_skill.decoder.decode(canonical_skill.codes.reshape(-1, 2))
    assert np.mean(np.linalg.norm(decoded.positions - sheet.positions.reshape(-1, 3), axis=1)) < 0.03
    assert np.degrees(np.mean(angle_between(decoded.quaternions, sheet.quaternions.reshape(-1, 4)))) < 6.0
    # On one side of the sphere throughout, whichever that is.
    dots = np.sum(decoded.quaternions * sheet.quaternions.reshape(-1, 4), axis=1)
    assert np.abs(dots).min() > 0.9
    assert np.ptp(np.sign(dots)) == 0.0
    assert canonical_skill.orientation_model == "sign_blind"


def test_canonical_training_is_reproducible_and_depends_on_the_seed(demonstrations):
    canonical = replace(TINY, sheet="canonical", orientation_model=None)
    first, again = (train_skill(demonstrations, canonical) for _ in range(2))
    np.testing.assert_array_equal(first.codes, again.codes)
    np.testing.assert_allclose(first.pace, PoseForm(demonstrations, canonical.rotation_length).times(100).mean(axis=0))
    other = train_skill(replace(demonstrations, has_times=False), replace(canonical, seed=3))
    assert other.pace is None
    assert not np.array_equal(first.codes, other.codes)


def test_blends_are_learned_besides_the_demonstrations_and_lie_between_them(demonstrations):
    settings = replace(TINY, sheet="canonical", orientation_model=None, blends=3)
    shown = replace(demonstrations, has_orientation=False)
    own, quaternions = ShownPoses(shown, settings).learned_curves()
    form = PoseForm(demonstrations, settings.rotation_length).sheet(settings.samples)
    assert own.shape == (16, settings.samples, 3)
    np.testing.assert_allclose(own[:4], form.positions, atol=1e-12)
    assert np.all(own[4:] <= form.positions.max(axis=0) + 1e-12)
    assert np.all(own[4:] >= form.positions.min(axis=0) - 1e-12)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=-1), 1.0, atol=1e-12)
    alone, _ = ShownPoses(shown, replace(settings, blends=0)).learned_curves()
    np.testing.assert_allclose(alone, form.positions, atol=1e-12)


@pytest.mark.parametrize(("sheet", "model"), [("canonical", None), ("raw", "sign_blind"), ("raw", "two_cluster")])
def test_orientations_of_the_canonical_sheet_are_learned_with_one_sign(demonstrations, sheet, model) -> None:
    """A density that is blind to the sign would let the decoder change it within the sheet."""
    items = list(demonstrations)
    flipped = replace(demonstrations, items=(replace(items[0], quaternions=-items[0].quaternions), *items[1:]))
    shown = ShownPoses(flipped, replace(TINY, sheet=sheet, orientation_model=model))
    _, quaternions = shown.learned_curves()
    agree = np.sum(quaternions * quaternions[:1], axis=-1) > 0.0
    if sheet == "canonical":
        assert np.all(agree)
    else:
        np.testing.assert_array_equal(np.sort(agree[:, 0]), [False] * len(items) + [True] * len(items))
    assert shown.likelihood.sign_blind is (model == "sign_blind")


def test_the_weight_of_the_divergence_is_chosen_by_the_sheet_unless_it_is_given() -> None:
    for kind in (TrainingSettings, JointTrainingSettings):
        assert (kind().kl_weight, kind(sheet="raw").kl_weight, kind(kl_weight=0.0).kl_weight) == (0.6, 0.3, 0.0)
        assert kind.paper().kl_weight == 1.0


@pytest.mark.parametrize("sheet", ["canonical", "raw"])
def test_only_the_canonical_sheet_is_learned_gently(demonstrations, monkeypatch, sheet) -> None:
    """The raw one as the paper's models always were."""
    seen = []

    def watched(*given, **named) -> None:
        seen.append(named["gently"])
        descend(*given, **named)

    monkeypatch.setattr(training, "descend", watched)
    shown = ShownPoses(demonstrations, replace(TINY, sheet=sheet, orientation_model=None, steps=2))
    train_model(shown.learned_curves(), shown.likelihood)
    assert seen == [sheet == "canonical"]


def test_blends_never_mix_two_modes():
    modes = np.array([0, 1, 0, 1, 1])
    weights = blend_weights(modes, 20, seed=0)
    assert weights.shape == (100, 5)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert weights.min() >= 0.0
    mixed = (weights[:, modes == 0].sum(axis=1) > 0.0) & (weights[:, modes == 1].sum(axis=1) > 0.0)
    assert not np.any(mixed)


def test_joint_schedule_learns_too(demonstrations):
    settings = replace(TINY, schedule="joint", steps=1500, hidden=(40, 20), kernels=60, learning_rate=4e-3, batch=64)
    curves = ShownPoses(replace(demonstrations, has_orientation=False), replace(settings, samples=40)).learned_curves()
    vae = train_model(curves, PoseLikelihood(settings))
    positions, quaternions = (values.reshape(-1, values.shape[-1]) for values in curves)
    with torch.no_grad():
        codes, _ = vae.encoder(torch.tensor(positions), torch.tensor(quaternions))
        decoded = vae.decoder.to_numpy().decode(codes.numpy())
    error = np.mean(np.linalg.norm(decoded.positions - positions, axis=1))
    assert error < 0.15 * np.mean(np.linalg.norm(positions - positions.mean(axis=0), axis=1))
    assert np.all(decoded.sigma < 0.1)


def test_poses_are_spread_over_turns_as_well_as_over_lengths():
    """Half a turn on the spot in the middle of a straight line."""
    turn = np.concatenate([np.zeros(50), np.linspace(0.0, np.pi, 50), np.full(50, np.pi)])
    line = np.concatenate([np.linspace(0.0, 0.2, 50), np.full(50, 0.2), np.linspace(0.2, 0.4, 50)])
    quaternions = np.stack([np.cos(turn / 2), np.sin(turn / 2), 0.0 * turn, 0.0 * turn], axis=1)
    positions = np.stack([line, 0.0 * line, 0.0 * line], axis=1)
    shown = Demonstrations((Demonstration(positions, quaternions, np.arange(150) * 0.01, "turn"),))
    largest = {}
    for rotation_length in (0.0, 0.1):
        settings = replace(TINY, samples=100, rotation_length=rotation_length)
        resampled = ShownPoses(shown, settings).learned_curves()[1][0]
        largest[rotation_length] = np.degrees(angle_between(resampled[1:], resampled[:-1]).max())
    assert largest[0.0] > 100.0
    assert largest[0.1] < 10.0


def test_planar_recordings_without_orientation_give_one_cluster(demonstrations):
    flat = Demonstrations(
        tuple(
            Demonstration(
                item.positions * [1.0, 1.0, 0.0],
                np.tile([1.0, 0.0, 0.0, 0.0], (len(item), 1)),
                item.times,
                "",
            )
            for item in demonstrations
        ),
        has_orientation=False,
    )
    settings = replace(TINY, steps=300, learning_rate=4e-3)
    skill = train_skill(flat, settings)
    assert skill.codes.shape == (4, 100, 2)
    decoded = skill.decoder.decode(skill.codes.reshape(-1, 2))
    assert np.all(np.isfinite(decoded.sigma))
    assert np.all(np.isfinite(decoded.kappa))
    assert 0.1 < np.median(decoded.sigma[:, 2]) / settings.position_resolution < 10.0


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"orientation_model": "both"}, "sign_blind"),
        ({"sheet": "canonical", "orientation_model": "two_cluster"}, "canonical sheet has no clusters"),
        ({"sheet": "flat"}, "canonical, raw"),
        ({"progress_deviation": 0.0}, "progress_deviation"),
        ({"blends": -1}, "blends"),
        ({"schedule": "paper"}, "two_stage"),
        ({"hidden": (200,)}, "exactly 2"),
        ({"latent_dimension": 0}, "latent_dimension is 0; a latent space has 1 to 6"),
        ({"steps": 0}, "steps"),
        ({"fixed_sigma": float("nan")}, "fixed_sigma"),
        ({"far_kappa": -1.0}, "far_kappa"),
        ({"far_kappa": 1600.0}, "from 1e-09 to less than fixed_kappa, 1600"),
        ({"far_sigma": 0.005}, "more than fixed_sigma, 0.005, and at most 1e"),
        ({"far_sigma": 1e10}, "at most 1e"),
        ({"metric": MetricSettings(sigma_weight=float("inf"))}, "metric.sigma_weight"),
    ],
)
def test_impossible_settings_are_refused(wrong, match):
    with pytest.raises(ParameterError, match=match):
        TrainingSettings(**wrong)


@pytest.mark.parametrize(
    ("changes", "match"), [({"sheet": "raw"}, "canonical sheet"), ({"latent_dimension": 4}, "2 or 3")]
)
def test_rounds_are_learned_on_the_canonical_sheet_in_two_dimensions_or_three(changes, match) -> None:
    with pytest.raises(ParameterError, match=match):
        TrainingSettings(closed=True, **changes)
