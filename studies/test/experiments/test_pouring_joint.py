"""Three pairs shown, small: one that was not is poured by the arm, from its bottle's group to its cup's."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.joint_teacher import Guidance, configurations, pouring_guidances
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.arm_players import Families, LiteralArm, OurArm, settings_table
from geodesic_motion_studies.experiments.pouring_joint import (
    PouringJoint,
    PouringJointReport,
    pour_all,
)

SMALL = JointTrainingSettings(
    steps=600, hidden=(64, 32), samples=60, kernels=100, batch=128, precision_samples=2, precision_iterations=60
)
COARSE = PlannerSettings(grid_shape=(25, 25, 25))
ROBOT = Robot.named("panda")


def thinned(guidance: Guidance, every: int = 10) -> Guidance:
    motion = guidance.motion
    fewer = {name: getattr(motion, name)[::every] for name in ("times", "positions", "quaternions")}
    return Guidance(replace(motion, **fewer), guidance.swivels[::every])


@pytest.fixture(scope="module")
def report(stored) -> PouringJointReport:
    # As commanded to the arm, without physics.
    commanded = [thinned(guidance) for guidance in pouring_guidances(2, 0)]
    items = [JointDemonstration(configurations(ROBOT, g), g.motion.times, g.motion.name) for g in commanded]
    shown = JointDemonstrations(tuple(items), ROBOT.joint_names, "panda")
    skill = stored("pouring", lambda: train_skill(shown, SMALL, name="pouring"))
    planner = ReactivePlanner(skill, COARSE)
    families, tools = Families.of(shown, 3), shown.tool_demonstrations(ROBOT)
    players = OurArm(planner, families), LiteralArm(PaperPlanner(skill, shape=(20, 20, 20)), families)
    pourings = [item for player in players for item in pour_all(player, families, tools, 0, [(1, 1), (0, 2)])]
    made = settings_table([(player.name, player, SMALL) for player in players])
    return PouringJointReport(PouringJoint(2, (0,), COARSE), tuple(pourings), made, tools, planner)


def test_a_pair_that_was_not_shown_goes_from_its_bottles_group_to_its_cups(report) -> None:
    shown, other = report.pourings[:2]
    assert shown.shown
    assert not other.shown
    assert [shown.by_tool[0], shown.by_tool[-1]] == [1, 1]
    assert [other.by_tool[0], other.by_tool[-1]] == [0, 2]
    assert [other.turns[0][0], other.turns[0][-1]] == [0, 2]
    assert shown.off < 0.05
    assert other.off < 0.05


def test_the_arm_does_what_the_reference_says(report) -> None:
    for item in report.pourings:
        execution = item.execution
        assert execution.tracking_error < 0.02
        assert item.missed < 1e-3 or item.row == "literal"
        np.testing.assert_allclose(np.diff(execution.times), execution.times[1], atol=1e-9)
        assert len(execution.times) == len(item.by_skill) == len(item.by_tool)


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert [(item["bottle"], item["cup"]) for item in content["pourings"]] == 2 * [(1, 1), (0, 2)]
    assert [item["row"] for item in content["pourings"]] == ["ours", "ours", "literal", "literal"]
    assert content["pourings"][1]["clearance"] is not None
    for text in ("0 to 2", "canonical", "whole 20x20x20"):
        assert text in report.table()
    report.draw(tmp_path / "pouring_joint.png")
    assert (tmp_path / "pouring_joint.png").read_bytes().startswith(b"\x89PNG")


def test_settings_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ParameterError, match="at least 2"):
        PouringJoint(shown=1)
    with pytest.raises(ParameterError, match="seeds"):
        PouringJoint(seeds=(-1,))
