"""Detours in the stream: what blocks all that was demonstrated is passed, certified, after a wait."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.detours.detour_frame import DetourFrame
from geodesic_motion_ros.motion.detour import DetourPlanner
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.motion.worker import Worker
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.mission import PreparedGoal
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.posture import null_vectors
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import PlanningError

TICK, PATIENCE, REACH = 0.02, 1.0, 0.25
SKILLS = ("panda_pouring", "panda_reach_to_grasp")
#: So far from the tool a chasing sphere begins [m]: outside of the arm.
BEGINS = {"panda_pouring": 0.2, "panda_reach_to_grasp": 0.3}


@cache
def planner_of(name: str) -> ReactivePlanner:
    """The one of all tests with a skill: `Played` begins anew with it."""
    return ReactivePlanner(Skill.load(name), PlannerSettings(patience=PATIENCE), scene=DeclaredScene.empty())


@pytest.fixture(params=SKILLS)
def planner(request: pytest.FixtureRequest) -> ReactivePlanner:
    return planner_of(request.param)


class Played:
    """A planner that is ticked from rest at its skill's start towards the skill's goal, and where the arm was."""

    def __init__(self, planner: ReactivePlanner, reach: float = REACH) -> None:
        self.planner, self.now = planner, 0.0
        self.postures: list[np.ndarray] = []
        self.plans: list[Plan] = []
        planner.clear_goal()
        planner.take_obstacles(Obstacles.none())
        assert planner.set_detour(reach).ok
        start, goal = planner.skill.start_pose, planner.skill.goal_pose
        nominal = planner.plan(start[:3], start[3:], goal[:3], goal[3:])
        assert nominal.reference is not None
        self.nominal = nominal.reference
        planner.stand_at(self.nominal.positions[0], 0.0)
        self.goal = goal

    def ask(self) -> None:
        assert self.planner.set_goal(self.goal[:3], self.goal[3:]).ok

    def run(self, seconds: float) -> list[Plan]:
        first = len(self.plans)
        for _ in range(round(seconds / TICK)):
            self.plans.append(self.planner.tick(self.now))
            self.now += TICK
            commanded = self.planner.commanded_state(self.now)
            assert commanded is not None
            self.postures.append(commanded[0])
        return self.plans[first:]

    def arrive(self, seconds: float) -> list[Plan]:
        """Run until the tool is at the goal, for at most so many seconds."""
        first, end = len(self.plans), self.now + seconds
        while self.now < end and not (self.postures and self.at_goal):
            self.run(0.1)
        return self.plans[first:]

    def least_clearance(self, obstacles: Obstacles) -> float:
        planner = self.planner
        return min(
            obstacle_clearance(planner.collision, planner.robot, posture, obstacles)[0] for posture in self.postures
        )

    @property
    def at_goal(self) -> bool:
        return float(np.linalg.norm(self.planner.robot.forward(self.postures[-1])[0] - self.goal[:3])) < 1e-3


def on_the_hand(planner: ReactivePlanner, posture: np.ndarray, radius: float = 0.06) -> Obstacles:
    """A sphere where the hand is."""
    return Obstacles.of_spheres(planner.robot.forward(posture)[0][None], np.array([radius]))


def halfway(played: Played) -> np.ndarray:
    return played.nominal.sample(0.5 * played.nominal.duration)[0]


@pytest.mark.parametrize("reach", [0.0, REACH])
def test_what_blocks_every_demonstrated_path_is_passed_by_a_detour_where_allowed(planner, reach: float) -> None:
    played = Played(planner, reach)
    blocker = on_the_hand(planner, halfway(played))
    planner.take_obstacles(blocker)
    played.ask()
    plans = played.run(PATIENCE - TICK)
    # It waits first: the obstacle may go by itself.
    assert not any(plan.verdict.ok for plan in plans)
    assert {plan.verdict.code for plan in plans} <= {VerdictCode.NO_FEASIBLE_PATH, VerdictCode.DEADLINE_MISSED}
    plans = played.arrive(3.0 if reach == 0.0 else 12.0)
    if reach == 0.0:
        assert not any(plan.verdict.ok for plan in plans)
        np.testing.assert_allclose(played.postures[-1], played.nominal.positions[0])
        return
    assert played.at_goal
    begun = next(plan for plan in plans if plan.trajectory is not None)
    assert 0.0 < begun.verdict.figures.displacement <= REACH
    assert begun.verdict.figures.deviation > 0.0
    assert "a detour" in begun.verdict.reason
    assert 0.0 < begun.verdict.figures.clearance <= played.least_clearance(blocker) + 1e-4


def test_what_goes_while_the_arm_waits_needs_no_detour(planner) -> None:
    played = Played(planner)
    planner.take_obstacles(on_the_hand(planner, halfway(played)))
    played.ask()
    played.run(0.5 * PATIENCE)
    planner.take_obstacles(Obstacles.none())
    plans = played.run(played.nominal.duration + 0.5)
    assert played.at_goal
    assert {plan.verdict.figures.displacement for plan in plans} == {0.0}


def test_what_has_stood_for_long_is_passed_by_a_detour_at_once(planner) -> None:
    played = Played(planner)
    planner.take_obstacles(on_the_hand(planner, halfway(played)))
    played.run(PATIENCE)
    played.ask()
    plans = played.run(0.4)
    assert plans[-1].verdict.ok
    assert plans[-1].verdict.figures.displacement > 0.0


def least_clearance_of_chased(planner: ReactivePlanner, reach: float) -> float:
    """Of an arm to whose tool a sphere turns in every tick, from above [m]."""
    return chased(Played(planner, reach), round(3.6 / TICK))


def chased(played: Played, ticks: int, new_goals: int = 0) -> float:
    """The least clearance [m] of an arm that is chased for so many ticks.

    new_goals : after each so many ticks its goal moves by 4 mm, or back; 0: never.
    """
    planner, least, centre = played.planner, np.inf, np.empty(0)
    played.ask()
    played.run(1.0)
    direction, speed = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0), 0.1
    for tick in range(ticks):
        if new_goals and tick % new_goals == 0:
            offset = [0.004 * (tick // new_goals % 2), 0.0, 0.0]
            assert planner.set_goal(played.goal[:3] + offset, played.goal[3:]).ok
        tool = planner.robot.forward(played.postures[-1])[0]
        centre = centre if len(centre) else tool + BEGINS[planner.skill.name] * direction
        velocity = speed * (tool - centre) / np.linalg.norm(tool - centre)
        centre = centre + TICK * velocity
        sphere = Obstacles.of_spheres(centre[None], np.array([0.05]), velocity[None], played.now)
        planner.take_obstacles(sphere)
        least = min(least, obstacle_clearance(planner.collision, planner.robot, played.postures[-1], sphere)[0])
        played.run(TICK)
    return least


@pytest.mark.parametrize("reach", [0.0, REACH])
def test_an_arm_that_is_chased_off_the_graph_goes_beside_it_where_that_is_allowed(planner, reach: float) -> None:
    """Without that it is touched."""
    assert (least_clearance_of_chased(planner, reach) > 0.0) is (reach > 0.0)


def test_a_chased_arm_whose_goal_moves_goes_no_farther_from_what_was_demonstrated_than_it_may(planner) -> None:
    """Every new goal begins a query where the arm is; what it was displaced by before counts on."""
    reach = 0.1
    played = Played(planner, reach)
    on_path = [planner.robot.forward(configuration)[0] for configuration in played.nominal.positions]
    chased(played, round(5.0 / TICK), new_goals=round(0.5 / TICK))
    tool = np.array([planner.robot.forward(posture)[0] for posture in played.postures])
    apart = np.min(np.linalg.norm(tool[:, None] - np.array(on_path)[None], axis=2), axis=1)
    assert np.max(apart) < reach + 0.02


@pytest.mark.parametrize("size", [0.0, 1.5])
def test_an_arm_that_is_chased_goes_nowhere_that_is_not_seen(planner, size: float) -> None:
    seen = [{"name": "around", "centre": [0.3, 0.0, 0.4], "size": [size] * 3}] if size > 0.0 else []
    scene = DeclaredScene.of({"seen": seen})
    blocked = ReactivePlanner(planner.skill, replace(planner.settings, unseen="blocked"), scene=scene)
    assert (least_clearance_of_chased(blocked, REACH) > 0.0) is (size > 0.0)


def test_the_same_inputs_give_the_same_bytes(planner) -> None:
    def bytes_of() -> list[bytes]:
        played = Played(planner)
        planner.take_obstacles(on_the_hand(planner, halfway(played)))
        played.ask()
        plans = played.run(PATIENCE + 1.0)
        return [plan.reference.positions.tobytes() for plan in plans if plan.reference is not None]

    first = bytes_of()
    assert first
    assert first == bytes_of()


def test_a_detour_stays_where_something_else_changes_and_a_blocked_one_is_left_without_contact(planner) -> None:
    played = Played(planner)
    blocker = on_the_hand(planner, halfway(played))
    planner.take_obstacles(blocker)
    played.ask()
    played.run(PATIENCE + 1.0)
    reference, begin = planner.motion_to_goal()
    elsewhere = np.array([[-0.8, 0.0, 0.2]])
    both = replace(
        blocker, centres=np.concatenate([blocker.centres, elsewhere]), radii=np.array([0.06, 0.05]),
        velocities=np.zeros((2, 3)), ages=np.zeros(2), velocity_errors=np.zeros(2),
    )  # fmt: skip
    planner.take_obstacles(both)
    plans = played.run(0.3)
    assert all(plan.verdict.ok for plan in plans)
    np.testing.assert_array_equal(planner.motion_to_goal()[0].positions[-1], reference.positions[-1])
    # Halfway on what is left another sphere falls onto the detour.
    ahead = reference.sample(played.now - begin + 0.5 * (begin + reference.duration - played.now))[0]
    centres = np.concatenate([blocker.centres, planner.robot.forward(ahead)[0][None]])
    more = replace(both, centres=centres, radii=np.array([0.06, 0.03]))
    planner.take_obstacles(more)
    played.postures.clear()
    plans = played.arrive(10.0)
    assert not plans[2].verdict.ok
    assert played.least_clearance(more) > 0.0


def test_it_says_why_there_is_no_detour(planner) -> None:
    played = Played(planner, 0.05)
    planner.take_obstacles(on_the_hand(planner, halfway(played), 0.08))
    played.ask()
    verdict = played.run(PATIENCE + 1.0)[-1].verdict
    assert verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "no detour of up to 5 cm: the hand cannot pass" in verdict.reason


def test_a_goal_that_is_covered_is_no_reason_to_search_for_ever(planner) -> None:
    played = Played(planner)
    planner.take_obstacles(on_the_hand(planner, played.nominal.positions[-1], 0.1))
    played.ask()
    verdict = played.run(played.nominal.duration + PATIENCE)[-1].verdict
    assert verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "an obstacle covers where it would begin or end" in verdict.reason


def test_a_plan_that_is_requested_makes_a_detour_at_once(planner) -> None:
    played = Played(planner)
    blocker = on_the_hand(planner, halfway(played))
    planner.take_obstacles(blocker)
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    plan = planner.plan(start[:3], start[3:], goal[:3], goal[3:])
    assert plan.verdict.ok
    assert plan.verdict.figures.displacement > 0.0
    assert planner.set_detour(0.0).ok
    assert not planner.plan(start[:3], start[3:], goal[:3], goal[3:]).verdict.ok


def test_nothing_leaves_what_was_demonstrated_before_a_scene_is_declared() -> None:
    planner = ReactivePlanner(Skill.load(SKILLS[0]), PlannerSettings(patience=0.0))
    verdict = planner.set_detour(0.1)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert "it is not known what stands around the arm" in verdict.reason
    assert planner.set_detour(0.0).ok
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    nominal = planner.plan(start[:3], start[3:], goal[:3], goal[3:])
    planner.take_obstacles(on_the_hand(planner, nominal.reference.sample(0.5 * nominal.reference.duration)[0]))
    assert planner.plan(start[:3], start[3:], goal[:3], goal[3:]).verdict.code is VerdictCode.NO_FEASIBLE_PATH


@pytest.mark.parametrize("reach", [-0.01, 0.31, np.nan, np.inf])
def test_reaches_that_make_no_sense_are_refused(planner, reach: float) -> None:
    assert planner.set_detour(0.1).ok
    assert planner.set_detour(reach).code is VerdictCode.BAD_INPUT
    with pytest.raises(PlanningError, match="detour"):
        PlannerSettings(detour=reach)


def test_what_covers_the_arm_at_the_goal_in_one_posture_is_avoided_in_another_one() -> None:
    """A sphere beside the elbow: the tool's goal is free, and so is a posture that holds it."""
    planner = planner_of("panda_pouring")
    played = Played(planner)
    posture = played.nominal.positions[-1]
    elbow = elbow_position(planner.robot, posture)
    beside = elbow_position(planner.robot, posture + 0.05 * null_vectors(posture[None], planner.robot.chain)[0]) - elbow
    centre = elbow + 0.15 * beside / np.linalg.norm(beside)
    blocker = Obstacles.of_spheres(centre[None], np.array([0.04]))
    assert obstacle_clearance(planner.collision, planner.robot, posture, blocker)[0] < -0.01
    planner.take_obstacles(blocker)
    played.ask()
    played.arrive(PATIENCE + 15.0)
    assert played.at_goal
    assert played.least_clearance(blocker) > 0.0


def test_what_cannot_be_drawn_tight_is_passed_along_the_lattice() -> None:
    """Near the goal the elbow has to swing back past a sphere within a few centimetres of the path."""
    planner = ReactivePlanner(Skill.load("panda_pouring"), scene=DeclaredScene.empty())
    start = np.array([0.48657, 0.18517, 0.32135, -2.17672, -0.90834, 1.01772, 0.19634])
    goal = np.array([0.36036, -0.41456, 0.25392]), np.array([0.07047, -0.77006, -0.61731, -0.14483])
    blocker = Obstacles.of_spheres(np.array([[0.23131, -0.1581, 0.50692]]), np.array([0.03208]))
    planner.stand_at(start, 0.0)
    planner.take_obstacles(blocker)
    plan = planner.plan(*planner.robot.forward(start), *goal)
    assert plan.verdict.ok
    assert plan.verdict.figures.displacement > 0.0
    assert plan.reference is not None
    instants = np.linspace(0.0, plan.reference.duration, 500)
    postures = plan.reference.samples(instants)[0]
    assert min(obstacle_clearance(planner.collision, planner.robot, one, blocker)[0] for one in postures) > 0.0


def test_the_first_base_is_of_the_mode_that_obstacles_bar_least() -> None:
    """The skill was demonstrated with the elbow on one side and on the other; a sphere bars its geodesic's side."""
    planner = planner_of("panda_reach_to_grasp")
    solver = Solver(
        planner.skill, planner.graph, planner.settings, planner.robot, planner.collision, planner.limits, planner.scene
    )
    played, detours = Played(planner), DetourPlanner(solver)
    prepared = planner.prepare_goal(played.goal[:3], played.goal[3:])
    assert isinstance(prepared, PreparedGoal)
    (geodesic,) = detours.frames(prepared.query, Obstacles.none())
    middle = geodesic.configurations[len(geodesic) // 2]
    barred = Obstacles.of_spheres(elbow_position(planner.robot, middle)[None], np.array([0.06]))
    first, second = detours.frames(prepared.query, barred)
    np.testing.assert_allclose(second.configurations, geodesic.configurations)

    def least_clearance(frame: DetourFrame) -> float:
        return min(obstacle_clearance(planner.collision, planner.robot, q, barred)[0] for q in frame.configurations)

    assert least_clearance(first) > least_clearance(second) + 0.05


def test_where_one_mode_was_demonstrated_there_is_one_base() -> None:
    planner = planner_of("panda_pouring")
    solver = Solver(
        planner.skill, planner.graph, planner.settings, planner.robot, planner.collision, planner.limits, planner.scene
    )
    played = Played(planner)
    prepared = planner.prepare_goal(played.goal[:3], played.goal[3:])
    assert isinstance(prepared, PreparedGoal)
    assert len(DetourPlanner(solver).frames(prepared.query, on_the_hand(planner, halfway(played)))) == 1


def test_a_reach_that_is_changed_is_searched_with(planner) -> None:
    played = Played(planner, 0.05)
    planner.take_obstacles(on_the_hand(planner, halfway(played)))
    played.ask()
    assert "no detour of up to 5 cm" in played.run(PATIENCE + 1.0)[-1].verdict.reason
    assert planner.set_detour(REACH).ok
    assert played.run(1.0)[-1].verdict.ok


def test_a_detour_that_was_found_is_not_followed_where_it_has_become_too_long(planner) -> None:
    played = Played(planner)
    planner.take_obstacles(on_the_hand(planner, halfway(played)))
    played.ask()
    played.run(PATIENCE + 2.0 * TICK)
    assert planner.set_detour(0.02).ok
    assert not any(plan.verdict.ok for plan in played.run(1.0))


def test_an_error_in_a_search_is_why_there_is_no_detour() -> None:
    worker = Worker(0.0)

    def search() -> Refusal:
        raise ValueError("no such thing")

    assert "no such thing" in worker.start(search, 0.0).result.reason
    worker.close()
