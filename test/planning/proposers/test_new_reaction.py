"""A new reaction is one file and one row: it has the form of a proposer, and a rank among the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.played import FollowedPlan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.arbiter import PROPOSERS, Arbiter, Decision
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.proposers.turn import Proposer, Turn
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.utils.deadline import NEVER

#: By how much the first joint turns [rad].
TURN = 0.05


class TurnedBase(Proposer):
    """Proposes to turn the base a little, where the arm rests without a path: the reaction that is new."""

    def propose(self, turn: Turn) -> Turn:
        situation, certifier = turn.situation, turn.arm.solver.certifier
        if not situation.at_rest:
            return turn
        share = np.linspace(0.0, 1.0, 20)[:, None]
        path = situation.state.position + share * TURN * np.eye(len(situation.state.position))[0]
        reference = timed_joint_reference(path, np.repeat(turn.query.start_latent[None], 20, axis=0), situation.limits)
        required = situation.requirements.approach
        certificate, objection = certifier.assess(certifier.sweep(reference), situation.expected_obstacles, required)
        if objection:
            return turn
        plan = Plan(certifier.judge(reference, certificate), situation.state.time, turn.verdict)
        begun = FollowedPlan.of(turn.query, plan, situation.obstacles, situation.now, Purpose.APPROACH)
        return replace(turn, step=situation.hand_out(plan, begun), decided=True)


@pytest.fixture(scope="module")
def planner(reach_skill: Skill) -> ReactivePlanner:
    """Of an arm that rests, and whose goal a sphere covers from where it would have to come near."""
    planner = ReactivePlanner(reach_skill)
    goal = reach_skill.canonical.goal_poles[0]
    planner.stand_at(reach_skill.canonical.start_poles[0], 0.0)
    assert planner.set_goal_configuration(goal).ok
    hand, _ = planner.robot.forward(goal)
    planner.set_obstacles(hand[None], np.array([0.05]))
    return planner


def decided(planner: ReactivePlanner, *proposers: Proposer) -> Decision:
    situation = planner._situation(1.0, NEVER)
    assert situation is not None
    return Arbiter(planner.arm, situation, planner._mission, planner._memory, proposers).decide()


def test_the_arm_does_what_a_new_proposer_has_and_the_rank_says(planner) -> None:
    """It is asked before the approach, or after it; the control: it is not asked."""
    names = [type(one).__name__ for one in PROPOSERS]
    before = names.index("Approach")
    first, last = planner._stream.commanded_state(0.0)[0][0], []
    for row in ((*PROPOSERS[:before], TurnedBase(), *PROPOSERS[before:]), (*PROPOSERS, TurnedBase()), PROPOSERS):
        reference = decided(planner, *row).step.plan.reference
        assert reference is not None
        last.append(reference.positions[-1])
    turned, approached, control = last
    assert turned[0] - first == pytest.approx(TURN)
    np.testing.assert_array_equal(approached, control)
    assert np.linalg.norm(turned - control) > TURN


def test_it_stays_still_where_its_motion_is_not_certified(planner) -> None:
    """A sphere stands where the base would turn the arm. The control: it does not; the goal is covered as before."""
    standing = planner._stream.commanded_state(0.0)[0]
    turned = standing + TURN * np.eye(len(standing))[0]
    links = planner.collision.positions(planner.robot, np.stack([standing, turned]))
    moved = np.argmax(np.linalg.norm(links[1] - links[0], axis=1))
    towards = links[1, moved] - links[0, moved]
    reach = planner.collision.radii[moved] + 0.02
    blocking = links[0, moved] + (reach + 0.25 * np.linalg.norm(towards)) * towards / np.linalg.norm(towards)
    goal, _ = planner.robot.forward(planner._mission.active.goal.configurations[0])
    for count in (1, 2):
        planner.take_obstacles(Obstacles.of_spheres(np.stack([goal, blocking])[:count], np.array([0.05, 0.02])[:count]))
        reference = decided(planner, PROPOSERS[1], TurnedBase()).step.plan.reference
        assert (reference is None) is (count == 2)
