"""Bodies on the table stand where they should, and the arm's distance to them is that of the real geometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import rotate_by
from geodesic_motion_ros.simulation.tabletop import Cylinder, Region, TabletopWorld, fixed_to, standing
from geodesic_motion_ros.utils.errors import ParameterError

GREY = (0.5, 0.5, 0.5)


@pytest.fixture(scope="module")
def world() -> Iterator[TabletopWorld]:
    with TabletopWorld() as world:
        yield world


def test_a_region_holds_what_lies_between_its_corners() -> None:
    region = Region((0.4, -0.2), (0.6, 0.1))
    np.testing.assert_allclose(region.at(np.array([[0.0, 0.0], [0.5, 1.0]])), [[0.4, -0.2], [0.5, 0.1]])
    np.testing.assert_array_equal(region.contains([[0.5, 0.0, 9.0], [0.5, 0.2, 0.0]]), [True, False])


def test_an_empty_region_is_refused() -> None:
    with pytest.raises(ParameterError, match="empty"):
        Region((0.4, 0.1), (0.6, 0.1))


def test_only_solid_bodies_count_and_furnishing_anew_removes_them(world: TabletopWorld) -> None:
    tool, _ = world.tool_pose()
    post = standing(tool[:2], 0.02, tool[2] - 0.1, GREY)
    world.furnish([post])
    near = world.furniture_clearance()
    assert 0.02 < near < 0.12
    world.furnish([standing(tool[:2], 0.02, tool[2] - 0.05, GREY)])
    assert world.furniture_clearance() == pytest.approx(near - 0.05, abs=2e-3)
    world.furnish([], seen=[post])
    assert world.furniture_clearance() == np.inf


def test_what_is_fixed_to_a_frame_moves_with_it() -> None:
    quarter = rotate_by(np.array([0.5 * np.pi, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    moved = fixed_to(np.array([0.1, 0.2, 0.3]), quarter, Cylinder((0.0, 0.0, 0.05), 0.01, 0.1, GREY))
    np.testing.assert_allclose(moved.centre, [0.1, 0.15, 0.3], atol=1e-12)
    np.testing.assert_allclose(moved.quaternion, quarter, atol=1e-12)
