import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.manifold.pose_graph import MetricSettings
from geodesic_motion_studies.tools.metric import (
    AmbientFactor,
    PullbackMetric,
    curve_energy,
    curve_length,
    magnification_factor,
)


@pytest.fixture(scope="module", params=["spread", "kappa"])
def metric(request, decoder):
    return PullbackMetric(decoder, MetricSettings(sigma_weight=10.0, orientation_scale=request.param))


def central_differences(function, latent, step=1e-4):
    """Fourth-order central differences of a batch function, (n, ..., d)."""
    columns = []
    for axis in range(latent.shape[1]):
        shift = torch.zeros_like(latent)
        shift[:, axis] = step
        near = function(latent + shift) - function(latent - shift)
        far = function(latent + 2 * shift) - function(latent - 2 * shift)
        columns.append((8.0 * near - far) / (12.0 * step))
    return torch.stack(columns, dim=-1)


def relative_error(value, expected, axes):
    """Largest difference over the largest entry along the axes, worst of the rest."""
    return float(((value - expected).abs().amax(axes) / expected.abs().amax(axes)).max())


def test_jacobian_agrees_with_finite_differences(metric, latent):
    expected = central_differences(metric.features, latent)
    assert relative_error(metric.jacobian(latent), expected, (1, 2)) < 1e-6


def test_metric_is_the_pull_back_of_its_features(decoder, metric, latent):
    """Every term, from finite differences of the numpy decoder that the graph uses."""
    exported = decoder.to_numpy()

    def decoded(name):
        return central_differences(
            lambda z: torch.tensor(getattr(exported.decode(z.numpy()), name)).reshape(len(z), -1), latent
        )

    scale = decoded("spread" if metric.settings.orientation_scale == "spread" else "kappa")
    weighted = [
        (decoded("positions"), 1.0),
        (decoded("sigma"), 10.0**2),
        (decoded("quaternions"), 1.0),
        (scale, 1.0),
    ]
    expected = sum(weight * jacobian.mT @ jacobian for jacobian, weight in weighted)
    assert relative_error(metric(latent), expected, (1, 2)) < 1e-6


def test_obstacles_stretch_position_and_sigma_and_nothing_else(decoder, metric, latent):
    centre = decoder.means(latent[:1]).coordinates
    ambient = AmbientFactor(centre, torch.tensor([0.05], dtype=torch.float64), 100.0)
    factor = ambient(decoder.means(latent).coordinates)
    jacobian = metric.jacobian(latent)
    stretched = jacobian[:, :3].mT @ jacobian[:, :3] + 10.0**2 * jacobian[:, 3:6].mT @ jacobian[:, 3:6]
    expected = metric(latent) + (factor - 1.0)[:, None, None] * stretched
    torch.testing.assert_close(PullbackMetric(decoder, metric.settings, ambient)(latent), expected)
    assert float(factor[0]) == pytest.approx(101.0)


def test_ambient_factor_adds_obstacles_and_fades_to_one():
    ambient = AmbientFactor(
        torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]).double(), torch.tensor([0.1, 0.2]).double(), 50.0
    )
    points = torch.tensor([[0.5, 0.0, 0.0], [9.0, 9.0, 9.0]]).double()
    expected = 1.0 + 50.0 * (np.exp(-0.5 * 5.0**2) + np.exp(-0.5 * 2.5**2))
    np.testing.assert_allclose(ambient(points), [expected, 1.0])


@settings(max_examples=25, deadline=None)
@given(corner=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)), strength=st.floats(0.0, 1e4))
def test_metric_is_symmetric_and_positive_definite_and_obstacles_only_enlarge_it(skill, decoder, corner, strength):
    lower, upper = torch.tensor(skill.latent_lower), torch.tensor(skill.latent_upper)
    point = (lower + torch.tensor(corner) * (upper - lower))[None]
    ambient = AmbientFactor(decoder.means(point).coordinates + 0.01, torch.tensor([0.04]).double(), strength)
    free, stretched = PullbackMetric(decoder)(point), PullbackMetric(decoder, ambient=ambient)(point)
    torch.testing.assert_close(free, free.mT)
    assert torch.linalg.eigvalsh(free).min() > 0.0
    assert torch.linalg.eigvalsh(stretched - free).min() > -1e-9 * stretched.abs().max()


def test_magnification_is_the_logarithm_of_the_volume(metric, latent):
    tensors = metric(latent)
    volume = (tensors[:, 0, 0] * tensors[:, 1, 1] - tensors[:, 0, 1] ** 2).sqrt()
    torch.testing.assert_close(magnification_factor(metric, latent).exp(), volume, rtol=1e-4, atol=0.0)


def test_magnification_is_larger_away_from_the_demonstrations(skill, decoder):
    metric = PullbackMetric(decoder)
    on = torch.tensor(skill.codes[:4].reshape(-1, 2))
    box = np.random.default_rng(0).uniform(skill.latent_lower, skill.latent_upper, (400, 2))
    sigma = skill.decoder.uncertainty(box)[0][:, 0]
    wall = torch.tensor(box[(sigma > 0.05) & (sigma < 0.5)])
    assert len(wall) > 10
    assert magnification_factor(metric, wall).median() > magnification_factor(metric, on).median() + 1.0


def demonstration_curve(skill, parameter):
    codes = skill.codes[0]
    at = parameter * (len(codes) - 1)
    return torch.tensor(np.stack([np.interp(at, np.arange(len(codes)), column) for column in codes.T], axis=1))


def test_length_does_not_depend_on_the_parametrisation_but_energy_does(skill, decoder):
    metric = PullbackMetric(decoder)
    t = np.linspace(0.0, 1.0, 2001)
    even, hurried = demonstration_curve(skill, t), demonstration_curve(skill, t**2)
    assert float(curve_length(metric, hurried)) == pytest.approx(float(curve_length(metric, even)), rel=2e-3)
    assert float(curve_energy(metric, hurried)) > 1.1 * float(curve_energy(metric, even))


def test_energy_is_at_least_the_squared_length(skill, decoder):
    metric = PullbackMetric(decoder)
    rng = np.random.default_rng(4)
    for _ in range(5):
        curve = torch.tensor(rng.uniform(skill.latent_lower, skill.latent_upper, (30, 2)))
        assert curve_energy(metric, curve) >= curve_length(metric, curve) ** 2


def test_length_of_a_demonstration_is_at_least_what_its_tool_travels(skill, decoder):
    curve = demonstration_curve(skill, np.linspace(0.0, 1.0, 1000))
    positions = decoder.means(curve).coordinates
    travelled = (positions[1:] - positions[:-1]).norm(dim=-1).sum()
    assert curve_length(PullbackMetric(decoder), curve) > travelled
