"""The band: a detour of the lattice drawn tight is shorter, stays clear, and holds its poses."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planning.arm_in_scene import ArmInScene, clearance_at
from geodesic_motion_ros.planning.detour_band import Band, drawn_tight
from geodesic_motion_ros.planning.detour_frame import DetourFrame
from geodesic_motion_ros.planning.detour_search import LatticePath, cheapest_detour, stretch
from geodesic_motion_ros.planning.settings import DETOUR_METRES_PER_SWIVEL
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

PANDA, ARM = Robot.panda(), CollisionModel.panda()
MARGIN, KEEP, REACH = 0.005, 0.015, 0.22
SWING = PANDA.ready + np.linspace(-1.0, 1.0, 60)[:, None] * np.eye(7)[0]
FRAME = DetourFrame.along(PANDA, SWING, np.linspace(0.0, 1.0, 60)[:, None], np.zeros((60, 3, 3)))


def among(centre: np.ndarray, radius: float) -> ArmInScene:
    return ArmInScene.of(PANDA, ARM, Obstacles.of_spheres(centre[None], np.array([radius])))


def length(samples: np.ndarray, displacements: np.ndarray, swivels: np.ndarray) -> float:
    """Of a polyline through (m,), (m, 3), (m,) by the detour's metric without obstacles, finely cut."""
    points = np.column_stack([FRAME.step * samples, displacements, DETOUR_METRES_PER_SWIVEL * swivels])
    cut = np.concatenate([np.linspace(a, b, 20, endpoint=False) for a, b in pairwise(points)])
    cut = np.vstack([cut, points[-1:]])
    phi = np.array([stretch(FRAME.precisions[0], *p[1:4], p[4] / DETOUR_METRES_PER_SWIVEL) for p in cut])
    return float(np.sum(0.5 * (phi[1:] + phi[:-1]) * np.linalg.norm(np.diff(cut, axis=0), axis=1)))


@pytest.fixture(scope="module", params=["hand", "wrist"])
def found(request: pytest.FixtureRequest) -> tuple[ArmInScene, LatticePath, Band]:
    """A sphere that the hand, or the wrist, meets half way; the lattice's path and its band."""
    frames = PANDA.link_frames(FRAME.configurations[len(FRAME) // 2])[1]
    above_the_wrist = frames[6] + [0.0, 0.0, 0.12]
    centre = FRAME.positions[len(FRAME) // 2] if request.param == "hand" else above_the_wrist
    arm = among(centre, 0.04)
    path = cheapest_detour(FRAME, arm, REACH, MARGIN)
    assert not isinstance(path, str), path
    band = drawn_tight(FRAME, arm, path, REACH, KEEP)
    assert band is not None
    return arm, path, band


def test_it_is_shorter_than_the_path_on_the_lattice(found: tuple[ArmInScene, LatticePath, Band]) -> None:
    _, path, band = found
    before = length(path.samples, path.displacements, path.swivels)
    after = length(band.progress, band.displacements, band.swivels)
    assert after < 0.9 * before


def test_it_stays_clear(found: tuple[ArmInScene, LatticePath, Band]) -> None:
    """Points between two nodes of the lattice begin as clear as their middle was found to be; none becomes less."""
    arm, path, band = found
    nodes = min(clearance_at(q, arm, KEEP) for q in path.configurations)
    assert min(clearance_at(q, arm, KEEP) for q in band.configurations) >= min(nodes, MARGIN) - 1e-9


def test_ends_stay_and_all_of_it_is_held(found: tuple[ArmInScene, LatticePath, Band]) -> None:
    _, path, band = found
    np.testing.assert_allclose(band.progress[[0, -1]], [0.0, len(FRAME) - 1.0])
    np.testing.assert_allclose(band.configurations[[0, -1]], path.configurations[[0, -1]], atol=2e-5)
    assert np.all(np.diff(band.progress) >= -1e-9)
    assert np.max(np.linalg.norm(band.displacements, axis=1)) <= REACH + 1e-9
    for progress, displacement, q in zip(band.progress, band.displacements, band.configurations, strict=True):
        low = min(int(progress), len(FRAME) - 2)
        share = progress - low
        on_base = (1.0 - share) * FRAME.positions[low] + share * FRAME.positions[low + 1]
        np.testing.assert_allclose(PANDA.forward(q)[0], on_base + displacement, atol=1e-5)
    steps = np.max(np.abs(np.diff(band.configurations, axis=0)), axis=1)
    assert np.max(steps) < 0.2


def test_deviations_are_mahalanobis_distances(found: tuple[ArmInScene, LatticePath, Band]) -> None:
    *_, band = found
    # Of the narrowest spread, 2 cm, where no demonstration varied.
    np.testing.assert_allclose(band.deviations, np.linalg.norm(band.displacements, axis=1) / 0.02, rtol=1e-6, atol=1e-9)


def test_without_obstacles_a_path_beside_falls_back_onto_the_base_path() -> None:
    arm = ArmInScene.of(PANDA, ARM, Obstacles.none())
    beside = cheapest_detour(FRAME, among(FRAME.positions[len(FRAME) // 2], 0.04), REACH, MARGIN)
    assert not isinstance(beside, str)
    band = drawn_tight(FRAME, arm, beside, REACH, KEEP)
    assert band is not None
    before = length(beside.samples, beside.displacements, beside.swivels)
    # The base path is as long as the frame; of what the detour adds to that less than half is left.
    shortest = FRAME.step * (len(FRAME) - 1)
    assert length(band.progress, band.displacements, band.swivels) - shortest < 0.5 * (before - shortest)
