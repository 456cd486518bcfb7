import numpy as np
import pytest
import torch

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.tools.geodesic import GeodesicSettings, continuous_geodesic
from geodesic_motion_studies.tools.metric import AmbientFactor, PullbackMetric, curve_energy, curve_length

QUICK = GeodesicSettings(control_points=12, samples=80, iterations=60)


def flat(latent):
    """A skewed but constant metric."""
    return torch.tensor([[4.0, 1.0], [1.0, 2.0]]).double().expand(len(latent), 2, 2)


def poincare_half_plane(latent):
    return torch.eye(2).double() / latent[:, 1, None, None] ** 2


@pytest.mark.parametrize("bump", [0.0, 0.5])
def test_on_a_flat_metric_it_is_the_straight_line_at_constant_speed(bump):
    start, end = np.array([-1.0, 0.5]), np.array([2.0, 1.0])
    t = np.linspace(0.0, 1.0, 40)[:, None]
    detour = (1.0 - t) * start + t * end + bump * np.sin(np.pi * t) * np.array([0.3, 1.0])
    found = continuous_geodesic(flat, start, end, detour, QUICK)
    line = np.linspace(start, end, QUICK.samples)
    np.testing.assert_allclose(found.curve, line, atol=2e-3)
    assert found.length == pytest.approx(np.sqrt((end - start) @ [[4.0, 1.0], [1.0, 2.0]] @ (end - start)), rel=1e-4)
    assert found.converged


def test_in_the_hyperbolic_plane_it_is_the_arc_of_a_circle():
    start, end = np.array([-1.0, 0.5]), np.array([1.0, 0.5])
    found = continuous_geodesic(poincare_half_plane, start, end, settings=GeodesicSettings(iterations=300))
    # Circle through both ends, centred on the boundary; distance arcosh(1 + |a - b|^2 / (2 y_a y_b)).
    np.testing.assert_allclose(np.linalg.norm(found.curve, axis=1), np.hypot(1.0, 0.5), rtol=2e-3)
    assert found.length == pytest.approx(np.arccosh(1.0 + 4.0 / (2.0 * 0.25)), rel=1e-3)
    assert found.energy == pytest.approx(found.length**2, rel=1e-2)
    assert found.length < found.initial_length


@pytest.mark.parametrize(("first", "last", "initial"), [(35, 60, "line"), (0, 99, "codes")])
def test_on_a_learned_metric_it_is_shorter_than_where_it_began_and_keeps_its_ends(skill, decoder, first, last, initial):
    metric = PullbackMetric(decoder)
    start, end = skill.codes[0, first], skill.codes[1, last]
    guess = None if initial == "line" else skill.codes[0]
    found = continuous_geodesic(metric, start, end, guess, QUICK)
    np.testing.assert_allclose(found.curve[[0, -1]], [start, end], atol=1e-12)
    assert found.length < found.initial_length
    curve = torch.tensor(found.curve)
    assert found.length == pytest.approx(float(curve_length(metric, curve)))
    assert found.energy == pytest.approx(float(curve_energy(metric, curve)))
    assert found.energy >= found.length**2


def test_where_a_curve_cannot_get_shorter_it_is_returned_as_it_was():
    """A spline of three control points cannot follow a corner, so the corner's own curve is the shorter one."""

    def corridor(latent):
        off = torch.minimum(latent[:, 0].abs(), latent[:, 1].abs())
        return (1.0 + 1e6 * off**2)[:, None, None] * torch.eye(2).double()

    corner = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    stiff = GeodesicSettings(control_points=3, samples=81)
    found = continuous_geodesic(corridor, corner[0], corner[-1], corner, stiff)
    assert found.length <= found.initial_length * (1.0 + 1e-12)
    assert found.length == pytest.approx(2.0, rel=1e-3)


def test_an_obstacle_bends_the_geodesic_away():
    """In a plane that decodes to itself; without the obstacle the line goes right through."""

    def plane_with(ambient):
        return lambda z: ambient(torch.nn.functional.pad(z, (0, 1)))[:, None, None] * torch.eye(2).double()

    obstacle, radius = torch.tensor([[0.5, 0.01, 0.0]]).double(), torch.tensor([0.1]).double()
    closest = {}
    for strength in (0.0, 50.0):
        metric = plane_with(AmbientFactor(obstacle, radius, strength))
        found = continuous_geodesic(metric, np.zeros(2), np.array([1.0, 0.0]), settings=QUICK)
        closest[strength] = np.linalg.norm(found.curve - obstacle[0, :2].numpy(), axis=1).min()
    assert closest[0.0] < 0.02
    assert closest[50.0] > 0.2


def test_the_callers_curve_is_left_alone():
    guess = np.linspace([0.0, 0.0], [1.0, 1.0], 5)
    kept = guess.copy()
    continuous_geodesic(flat, np.array([0.5, 0.0]), np.array([1.0, 2.0]), guess, QUICK)
    np.testing.assert_array_equal(guess, kept)


def test_equal_ends_give_a_curve_of_no_length():
    found = continuous_geodesic(flat, np.ones(2), np.ones(2), settings=QUICK)
    assert found.length == 0.0
    np.testing.assert_array_equal(found.curve, np.ones((QUICK.samples, 2)))


@pytest.mark.parametrize(
    ("start", "end", "initial"),
    [
        (np.zeros(2), np.zeros(3), np.zeros((5, 2))),
        (np.zeros(2), np.ones(2), np.zeros((5, 3))),
        (np.zeros(2), np.array([np.nan, 1.0]), None),
    ],
)
def test_points_that_make_no_curve_are_refused(start, end, initial):
    with pytest.raises(ParameterError):
        continuous_geodesic(flat, start, end, initial, QUICK)


@pytest.mark.parametrize("wrong", [{"control_points": 2}, {"samples": 10}, {"iterations": 0}, {"tolerance": 0.0}])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong)).replace("_", " ")):
        GeodesicSettings(**wrong)
