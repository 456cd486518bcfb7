"""The largest sphere on a motion that is passed: what is larger is not, what is smaller is."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization.largest_sphere import INTERIOR, LARGEST, STEP, SpherePlaces, find_largest_passed


@pytest.fixture(scope="module")
def planner(canonical_fan_skill: Skill) -> ReactivePlanner:
    return ReactivePlanner(canonical_fan_skill, scene=DeclaredScene.empty())


@pytest.fixture(scope="module")
def places(planner: ReactivePlanner) -> SpherePlaces:
    motion = planned(planner).reference
    assert motion is not None
    return SpherePlaces.of_motion(planner, motion, 3)


def planned(planner: ReactivePlanner, centre: np.ndarray | None = None, radius: float = 0.0) -> Plan:
    """The planner's answer between the ends of its skill, with one sphere or without."""
    spheres = (np.empty((0, 3)), np.empty(0)) if centre is None else (centre[None], np.array([radius]))
    planner.set_obstacles(*spheres)
    return planner.plan(*np.split(planner.skill.start_pose, [3]), *np.split(planner.skill.goal_pose, [3]))


@pytest.mark.parametrize("detour", [0.0, 0.05])
def test_what_is_smaller_is_passed_and_what_is_larger_is_not(planner, places, detour) -> None:
    planner.set_detour(detour)
    centre, free = places.centres[1], float(places.free[1])
    radius, reason = find_largest_passed(planner, centre, free)
    assert 0.0 < radius < LARGEST
    assert planned(planner, centre, radius).verdict.ok
    assert planned(planner, centre, 0.5 * radius).verdict.ok
    larger = planned(planner, centre, radius + STEP)
    assert larger.reference is None
    assert larger.verdict.reason == reason
    assert planned(planner, centre, 1.5 * radius + STEP).reference is None


def test_a_sphere_far_from_the_arm_is_passed_at_any_size(planner) -> None:
    """The control."""
    assert find_largest_passed(planner, np.array([0.0, 0.0, 2.5]), 1.0) == (pytest.approx(LARGEST), "")


def test_places_lie_on_the_motion_and_a_sphere_there_that_leaves_the_ends_free_touches_neither(planner, places) -> None:
    np.testing.assert_allclose(places.shares, [INTERIOR[0], 0.5, INTERIOR[1]])
    motion = planned(planner)
    positions, _ = motion.tool_poses
    nearest = np.linalg.norm(positions[:, None] - places.centres[None], axis=2).min(axis=0)
    assert np.all(nearest < 0.005)
    assert np.all(places.free >= 0.0)
    assert places.free[1] > places.free[0]
    planner.set_detour(0.0)
    touching = planned(planner, places.centres[1], places.free[1] + 0.002)
    assert "overlaps the sphere at" in touching.verdict.reason
    free = planned(planner, places.centres[1], places.free[1] - 0.002)
    assert "overlaps the sphere" not in free.verdict.reason
