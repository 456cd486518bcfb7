"""The band: a detour of the lattice drawn tight is shorter, stays clear, and holds its poses."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_in_scene import ArmInScene, clearance_at
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.detours.detour_band import Band, band_cost, draw_tight
from geodesic_motion_ros.detours.detour_frame import DetourFrame
from geodesic_motion_ros.detours.detour_search import LatticePath, cheapest_detour
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

PANDA, ARM = Robot.named("panda"), CollisionModel.named("panda")
MARGIN, REACH = 0.005, 0.25
SWING = PANDA.ready + np.linspace(-1.0, 1.0, 60)[:, None] * np.eye(7)[0]
FRAME = DetourFrame.of_base_path(PANDA, SWING, np.linspace(0.0, 1.0, 60)[:, None], np.zeros((60, 3, 3)))


def among(centre: np.ndarray, radius: float) -> ArmInScene:
    return ArmInScene.of(PANDA, ARM, Obstacles.of_spheres(centre[None], np.array([radius])))


def lattice_cost(path: LatticePath, arm: ArmInScene) -> float:
    """Of a path of the lattice, by the cost of bands."""
    count = len(path.samples)
    return band_cost(
        FRAME, arm,
        Band(
            path.samples.astype(float), path.displacements, path.swivels, path.configurations, np.zeros((count, 1)),
            np.zeros(count),
        ),
    )  # fmt: skip


@pytest.fixture(scope="module", params=["hand", "wrist"])
def found(request: pytest.FixtureRequest) -> tuple[ArmInScene, LatticePath, Band]:
    """A sphere that the hand, or the wrist, meets halfway; the lattice's path and its band."""
    frames = PANDA.link_frames(FRAME.configurations[len(FRAME) // 2])[1]
    above_the_wrist = frames[6] + [0.0, 0.0, 0.12]
    centre = FRAME.positions[len(FRAME) // 2] if request.param == "hand" else above_the_wrist
    arm = among(centre, 0.04)
    path = cheapest_detour(FRAME, arm, REACH, MARGIN)
    assert not isinstance(path, Refusal), path
    band = draw_tight(FRAME, arm, path, REACH, MARGIN)
    assert band is not None
    return arm, path, band


def test_it_costs_less_than_the_path_on_the_lattice_by_the_same_metric(found) -> None:
    arm, path, band = found
    assert lattice_cost(path, arm) == pytest.approx(path.cost, rel=1e-9)
    assert band_cost(FRAME, arm, band) < 0.9 * path.cost


def test_it_stays_clear(found: tuple[ArmInScene, LatticePath, Band]) -> None:
    arm, _, band = found
    assert min(clearance_at(q, arm, 1.0) for q in band.configurations) >= MARGIN


def test_ends_stay_and_all_of_it_is_reached(found: tuple[ArmInScene, LatticePath, Band]) -> None:
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
    assert not isinstance(beside, Refusal)
    band = draw_tight(FRAME, arm, beside, REACH, MARGIN)
    assert band is not None
    # The base path costs its length; of what the detour adds to that less than half is left.
    shortest = FRAME.step * (len(FRAME) - 1)
    assert band_cost(FRAME, arm, band) - shortest < 0.5 * (lattice_cost(beside, arm) - shortest)
