"""Stands, cups and bottles of the pouring experiments: the tool over them, and a bottle held by its spheres."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.simulation.joint_teacher import CUP_PLACES
from geodesic_motion_ros.simulation.tabletop import fixed_to
from geodesic_motion_ros.simulation.teacher import CUP_REGION, bottle_in_hand
from geodesic_motion_studies.experiments.pouring_scene import (
    DEPTH,
    PLACES,
    SIDES,
    SPHERE_RADIUS,
    at_cup,
    bottle_distance,
    bottle_mouth,
    bottle_settings,
    pouring_strip,
    sphere_beside,
    standing_there,
)


def test_cups_stand_there_once_and_one_bottle_is_in_the_hand() -> None:
    assert len(standing_there(0)) == 1 + 3 * 2
    assert len(set(standing_there(1))) == len(standing_there(1))
    assert standing_there(0)[0] != standing_there(1)[0]


@pytest.mark.parametrize("cup", PLACES)
def test_the_bottle_is_poured_over_the_cups_axis(cup: int) -> None:
    mouth = bottle_mouth(*at_cup(cup))
    np.testing.assert_allclose(mouth[:2], CUP_REGION.at(np.array(CUP_PLACES[cup])), atol=1e-9)


def test_a_strip_shows_postures_that_differ() -> None:
    ready = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
    turned = ready + np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    strip = pouring_strip(np.stack([ready, turned]), 0, width=80, height=54, postures=2)
    assert strip.shape == (54, 160, 3)
    assert np.abs(strip[:, :80].astype(int) - strip[:, 80:].astype(int)).max() > 50


def test_the_spheres_hold_the_bottle_and_its_distance_is_exact() -> None:
    settings, random = bottle_settings(), np.random.default_rng(0)
    position, quaternion = np.array([0.5, 0.1, 0.4]), np.array([0.6, 0.8, 0.0, 0.0])
    spheres = tool_points(position[None], quaternion[None], np.array(settings.tool_points))[0]
    surface = []
    for part in bottle_in_hand():
        angle, along = random.uniform(0.0, 2.0 * np.pi, 3000), random.uniform(-0.5, 0.5, 3000) * part.height
        points = np.stack([part.radius * np.cos(angle), part.radius * np.sin(angle), along], axis=1)
        points = to_rotation(np.array(part.quaternion)).apply(points) + part.centre
        surface.append(to_rotation(quaternion).apply(points) + position)
    points = np.concatenate(surface)
    gaps = np.linalg.norm(points[:, None] - spheres, axis=2) - settings.tool_radii
    assert gaps.min(axis=1).max() < 1e-9
    for centre in position + random.uniform(-0.3, 0.3, (20, 3)):
        exact = bottle_distance(position[None], quaternion[None], centre[None], 0.02)
        seen = np.linalg.norm(points - centre, axis=1).min() - 0.02
        if exact > 0.0:
            assert exact <= seen + 1e-9
            assert exact == pytest.approx(seen, abs=0.02)


def test_the_mouth_is_the_end_of_the_neck_and_on_the_bottles_axis() -> None:
    position, quaternion = np.array([0.5, 0.1, 0.4]), np.array([0.6, 0.8, 0.0, 0.0])
    mouth = bottle_mouth(position, quaternion)
    assert bottle_distance(position[None], quaternion[None], mouth[None], 0.0) == pytest.approx(0.0, abs=1e-12)
    body, neck = (np.array(fixed_to(position, quaternion, part).centre) for part in bottle_in_hand())
    np.testing.assert_allclose(np.cross(mouth - neck, neck - body), 0.0, atol=1e-12)
    assert (mouth - neck) @ (neck - body) > 0.0


@pytest.mark.parametrize("side", SIDES)
def test_a_sphere_beside_the_bottle_is_as_deep_in_it_as_it_says(side) -> None:
    position, quaternion = np.array([0.5, 0.1, 0.4]), np.array([0.0, 1.0, 0.0, 0.0])
    centre = sphere_beside(position, quaternion, np.array(side))
    depth = bottle_distance(position[None], quaternion[None], centre[None], SPHERE_RADIUS)
    assert depth == pytest.approx(-DEPTH, abs=1e-9)
