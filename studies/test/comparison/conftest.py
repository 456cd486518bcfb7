"""Scenes that several files of tests play."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Stage
from geodesic_motion_studies.comparison.scene import Scene, draw_scene


@pytest.fixture(scope="module")
def arena(reach_skill: Skill) -> Arena:
    return Arena.of(reach_skill)


@pytest.fixture(scope="module")
def stage(arena: Arena) -> Stage:
    return Stage(arena)


@pytest.fixture(scope="session")
def blocked_elbow() -> Callable[[Arena], Scene]:
    """Of an arena: a scene whose sphere the nearest demonstration hits with the arm, while its hand passes."""

    def drawn(arena: Arena) -> Scene:
        scenes = (draw_scene(arena, "elbow", number, 0) for number in range(0, 40, 2))
        return next(scene for scene in scenes if not scene.free[arena.nearest(scene.start, scene.goal)])

    return drawn
