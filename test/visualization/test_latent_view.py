"""The picture of the latent space: what is drawn is where it belongs."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder
from geodesic_motion_ros.manifold.pose_graph import MetricSettings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import PlanningError
from geodesic_motion_ros.visualization.latent_view import LatentView, magnification_factor

NOTHING = Obstacles.none()
SIZE = 200


@pytest.fixture(scope="module")
def skill() -> Skill:
    """A sheet in the y-z plane: the first latent axis along y, the second along z, support everywhere."""
    out = np.zeros((7, 2))
    out[1, 0] = out[2, 1] = 20.0
    bias = np.eye(7)[4]
    decoder = TaskSpaceDecoder(
        W1=0.05 * np.eye(2), b1=np.zeros(2), W2=np.eye(2), b2=np.zeros(2), W3=out, b3=bias,
        position_offset=np.zeros(3), position_scale=np.array(0.25),
        rbf_centres=np.zeros((1, 2)), rbf_rate=np.array(0.5),
        sigma_weights=np.full((3, 1), 100.0), sigma_floor=np.full(3, 1.0),
        kappa_weights=np.full(1, 400.0), kappa_floor=np.array(1.0),
    )  # fmt: skip
    codes = np.stack([np.linspace(-0.8, 0.8, 100), np.zeros(100)], axis=1)[None]
    return Skill(
        name="sheet", decoder=decoder, codes=codes, latent_lower=np.full(2, -1.0), latent_upper=np.full(2, 1.0),
        sigma_support=1.0, energy_per_edge=1.0, start_pose=np.zeros(7), goal_pose=np.zeros(7),
        metric=MetricSettings(sigma_weight=1.0), base_frame="panda_link0", tool_frame="panda_grasptarget",
    )  # fmt: skip


@pytest.fixture(scope="module")
def view(skill) -> LatentView:
    return LatentView(skill, skill.graph((60, 60)), np.zeros((1, 3)), np.array([0.02]), SIZE)


def test_obstacle_footprint_is_where_the_tool_would_touch(view):
    empty = view.render(NOTHING).astype(int)
    # y = 0.25 * 0.5 belongs to latent (0.5, 0.5); touching distance 0.05 + 0.02 is 0.28 in latent units
    seen = view.render(Obstacles.of_spheres(np.array([[0.0, 0.125, 0.125]]), np.array([0.05]))).astype(int)
    changed = np.argwhere(np.any(seen != empty, axis=2))
    rows, columns = changed.mean(axis=0)
    assert columns == pytest.approx(0.75 * SIZE, abs=3)
    assert rows == pytest.approx(0.25 * SIZE, abs=3)
    assert len(changed) == pytest.approx(np.pi * (0.28 * SIZE / 2) ** 2, rel=0.15)


def test_a_free_obstacle_leaves_no_footprint(view):
    empty = view.render(NOTHING)
    far = Obstacles.of_spheres(np.array([[1.0, 0.0, 0.0]]), np.array([0.1]))
    np.testing.assert_array_equal(view.render(far), empty)


def test_path_is_drawn_upright(view):
    empty = view.render(NOTHING)
    path = np.array([[-0.5, -0.5], [-0.5, 0.5]])
    changed = np.argwhere(np.any(view.render(NOTHING, path) != empty, axis=2))
    assert abs(changed[:, 1].mean() - 0.25 * SIZE) < 3
    assert changed[:, 0].min() < 0.27 * SIZE
    assert changed[:, 0].max() > 0.73 * SIZE
    # the goal, a dot of another colour, is at the top: the second latent axis points up
    picture = view.render(NOTHING, path)
    assert tuple(picture[int(0.25 * SIZE), int(0.25 * SIZE)]) != tuple(picture[int(0.75 * SIZE), int(0.25 * SIZE)])


def test_rendering_does_not_change_the_background(view):
    first = view.render(NOTHING)
    obstacle = Obstacles.of_spheres(np.array([[0.0, 0.0, 0.0]]), np.array([0.1]))
    view.render(obstacle, np.array([[-0.5, 0.0], [0.5, 0.0]]), "OK")
    np.testing.assert_array_equal(view.render(NOTHING), first)


def test_magnification_factor_agrees_with_finite_differences(skill):
    """log sqrt det M at single points, by central differences with a step of their own."""
    size = 101
    picture = magnification_factor(skill, size)
    rng = np.random.default_rng(0)
    for row, column in rng.integers(10, size - 10, (5, 2)):
        z = np.array([-1.0 + 2.0 * column / (size - 1), 1.0 - 2.0 * row / (size - 1)])
        jacobian = np.stack([_derivative(skill, z, axis) for axis in np.eye(2)], axis=1)
        expected = 0.5 * np.log(np.linalg.det(jacobian.T @ jacobian))
        assert picture[row, column] == pytest.approx(expected, abs=5e-3)


def test_obstacles_stretch_the_magnification_factor_where_they_are_and_nowhere_else(skill):
    free = magnification_factor(skill, 61)
    np.testing.assert_array_equal(magnification_factor(skill, 61, lambda positions: np.ones(len(positions))), free)
    obstacle, elsewhere = skill.decoder.decode(np.array([[0.5, 0.0], [-0.5, 0.0]])).positions
    radius = 0.3 * np.linalg.norm(elsewhere - obstacle)

    def stretched_near(positions: np.ndarray) -> np.ndarray:
        return np.where(np.linalg.norm(positions - obstacle, axis=1) < radius, 100.0, 1.0)

    stretched = magnification_factor(skill, 61, stretched_near)
    assert np.all(stretched >= free - 1e-12)
    changed = stretched > free + 1e-9
    assert 0.0 < changed.mean() < 1.0


def _derivative(skill: Skill, z: np.ndarray, axis: np.ndarray, step: float = 1e-5) -> np.ndarray:
    decoded = skill.decoder.decode(np.stack([z + step * axis, z - step * axis]))
    features = np.concatenate([decoded.positions, decoded.sigma, decoded.quaternions, decoded.spread[:, None]], axis=1)
    return (features[0] - features[1]) / (2.0 * step)


def test_only_two_dimensions_can_be_seen(skill):
    import dataclasses

    deep = dataclasses.replace(skill, latent_lower=np.full(3, -1.0))
    with pytest.raises(PlanningError, match="two dimensions, this skill has 3"):
        LatentView(deep, skill.graph((10, 10)), np.zeros((1, 3)), np.array([0.02]))


def test_a_detour_is_drawn_in_another_colour(view):
    path = np.stack([np.linspace(-0.5, 0.5, 50), np.zeros(50)], axis=1)
    usual, detour = (view.render(NOTHING, path, is_detour=is_detour).astype(int) for is_detour in (False, True))
    middle = usual[SIZE // 2, SIZE // 2], detour[SIZE // 2, SIZE // 2]
    # White, and orange.
    assert np.min(middle[0]) > 240
    assert middle[1][0] > 240
    assert middle[1][2] < 100
