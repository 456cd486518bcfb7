"""One bottle over all cups: each geodesic begins where the one before ends, and the arm pours into every cup."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from geodesic_motion_ros.planning.pose_path import PosePathPlanner
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.studies.experiments.held_bottle import bottle_settings
from geodesic_motion_ros.studies.experiments.pouring_chain import pour_all_cups


def test_the_chain_pours_every_cup(pouring_pose_skill: Skill) -> None:
    chain = pour_all_cups(PosePathPlanner(pouring_pose_skill, bottle_settings()), 0)
    assert chain.reason == ""
    assert len(chain.parts) == len(chain.mouth_off) == 3
    assert max(chain.mouth_off) < 1e-3
    assert chain.behind < 0.005
    assert chain.clearance > 0.0
    for before, after in pairwise(chain.parts):
        np.testing.assert_allclose(before.positions[-1], after.positions[0], atol=1e-6)


def test_a_part_that_is_refused_ends_the_chain_and_is_named(pouring_pose_skill: Skill) -> None:
    strict = PlannerSettings(maximum_offset=1e-4)
    chain = pour_all_cups(PosePathPlanner(pouring_pose_skill, strict), 0)
    assert chain.parts == ()
    assert chain.reason.startswith("part 0: ")
    assert len(chain.joints) == 0
