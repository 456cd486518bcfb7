"""Scenes for the laws: spheres as near the path as their kind says."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.experiments.arm_queries import body_spheres, distances
from geodesic_motion_studies.experiments.blocked_arm import every
from geodesic_motion_studies.experiments.obstacle_law_scenes import (
    BETWEEN,
    CHECK_PERIOD,
    FREE_END,
    FREE_PATH,
    draw_scene,
)

COARSE = PlannerSettings(grid_shape=(30, 30, 30))


def test_spheres_do_what_their_kind_says(reach_skill: Skill) -> None:
    planner = ReactivePlanner(reach_skill, COARSE)
    for number, kind in enumerate(BETWEEN):
        scene = draw_scene(planner, np.random.default_rng([0, number]), number)
        assert scene.sphere == kind

        def clearance(postures, scene=scene) -> float:
            return distances(planner, body_spheres(planner, postures), scene.centre, scene.radius).min()

        path = every(CHECK_PERIOD, scene.nominal)
        assert BETWEEN[kind][0] <= clearance(path) <= BETWEEN[kind][1]
        assert clearance(np.stack([scene.query.start, scene.query.goal])) >= FREE_END
        if kind == "one path":
            others = np.delete(scene.query.mean_paths, scene.query.family(path), axis=0)
            assert max(clearance(other) for other in others) >= FREE_PATH
