"""Pouring in task space: the spheres of the tool hold the bottle, and its distance from an obstacle is exact."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.pouring_task import PouringTaskSettings, bottle_distance, bottle_settings
from geodesic_motion_ros.graph.tool_points import tool_points
from geodesic_motion_ros.quaternions import to_rotation
from geodesic_motion_ros.simulation.teacher import bottle_in_hand


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


@pytest.mark.parametrize("wrong", [{"shown": 0}, {"seeds": ()}])
def test_impossible_settings_are_refused(wrong) -> None:
    with pytest.raises(ParameterError):
        PouringTaskSettings(**wrong)
