"""Goals that are covered: the arm goes as near as its certificate allows, stands, and goes on when they clear."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.mode import Mode
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.output_space import OutputSpace
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.deadline import Deadline

TICK, RADIUS = 0.02, 0.06
SKILLS = ("panda_pouring", "panda_reach_to_grasp")


@dataclass
class Played:
    """A planner that is ticked from rest at its skill's start towards the skill's goal, and where the arm was."""

    planner: ReactivePlanner
    now: float = 0.0
    begun: int = 0
    least: float = math.inf
    jump: float = 0.0
    plans: list[Plan] = field(default_factory=list)

    def __post_init__(self) -> None:
        planner, (start, goal) = self.planner, (self.planner.skill.start_pose, self.planner.skill.goal_pose)
        planner.clear_goal()
        planner.take_obstacles(Obstacles.none())
        nominal = planner.plan(start[:3], start[3:], goal[:3], goal[3:])
        assert nominal.reference is not None
        self.nominal = nominal.reference
        planner.stand_at(self.nominal.positions[0], 0.0)
        assert planner.set_goal(goal[:3], goal[3:]).ok

    @property
    def posture(self) -> np.ndarray:
        return self.planner.commanded_state(self.now)[0]

    @property
    def to_goal(self) -> float:
        """How far the tool is from the goal [m]."""
        return float(np.linalg.norm(self.planner.robot.forward(self.posture)[0] - self.planner.skill.goal_pose[:3]))

    def on_goal(self, radius: float = RADIUS) -> Obstacles:
        """A sphere where the tool is to go."""
        return Obstacles.of_spheres(self.planner.skill.goal_pose[None, :3].copy(), np.array([radius]))

    def run(self, seconds: float) -> list[Plan]:
        first = len(self.plans)
        for _ in range(round(seconds / TICK)):
            before = self.planner.commanded_state(self.now)
            self.plans.append(self.planner.tick(self.now))
            # What takes over begins later: until then nothing changes.
            self.jump = max(self.jump, float(np.max(np.abs(self.planner.commanded_state(self.now)[0] - before[0]))))
            self.now += TICK
            self.begun += self.plans[-1].trajectory is not None
            obstacles = self.planner.obstacles.at(self.now, 1.0)
            here = obstacle_clearance(self.planner.collision, self.planner.robot, self.posture, obstacles)[0]
            self.least = min(self.least, here)
        return self.plans[first:]

    def run_to_rest(self) -> Plan:
        """Until the arm stands, and the planner has tried everything that it can try from there."""
        began = moved = self.now
        while self.now < moved + 1.0:
            assert moved <= began + self.nominal.duration + 1.0
            self.run(0.1)
            moved = self.now if np.any(self.planner.commanded_state(self.now)[1]) else moved
        return self.plans[-1]


@pytest.fixture(scope="module", params=SKILLS)
def planner(request: pytest.FixtureRequest) -> ReactivePlanner:
    return ReactivePlanner(Skill.load(request.param))


def test_an_approach_that_there_was_no_time_for_is_made_later(planner: ReactivePlanner) -> None:
    played = Played(planner)
    planner.take_obstacles(played.on_goal())
    over = Deadline(-1.0, lambda: 0.0)
    for _ in range(20):
        assert planner.tick(played.now, over).mode is not Mode.APPROACHING
        played.now += TICK
    far = played.to_goal
    played.run_to_rest()
    assert played.to_goal < 0.5 * far


def test_what_moves_onto_the_goal_is_not_approached(planner: ReactivePlanner) -> None:
    """It leaves by itself, and would meet an arm that waits beside it."""
    played = Played(planner)
    moving = replace(played.on_goal(), velocities=np.array([[0.0, 0.0, 0.02]]))
    planner.take_obstacles(moving)
    assert Mode.APPROACHING not in {plan.mode for plan in played.run(0.5)}
    planner.take_obstacles(played.on_goal())
    assert Mode.APPROACHING in {plan.mode for plan in played.run(0.5)}


def test_the_arm_goes_as_near_to_a_covered_goal_as_it_can_and_on_when_it_clears(planner: ReactivePlanner) -> None:
    played = Played(planner)
    far = played.to_goal
    planner.take_obstacles(played.on_goal())
    first = played.run(TICK)[0]
    assert first.mode is Mode.APPROACHING
    assert first.trajectory is not None
    assert first.trajectory.nearest > 0.0
    assert first.verdict.figures.clearance == pytest.approx(first.trajectory.nearest)
    assert "as near as it can" in first.verdict.reason
    assert planner.motion_to_goal() is None
    stands = played.run_to_rest()
    assert stands.mode is Mode.WAITING
    # Nothing may take it for arrived.
    assert {plan.verdict.code for plan in played.plans} == {VerdictCode.NO_FEASIBLE_PATH}
    assert all(plan.verdict.figures.goal_covered for plan in played.plans)
    assert played.plans[0].verdict.figures.goal_distance == pytest.approx(far)
    assert stands.verdict.figures.goal_distance == pytest.approx(played.to_goal, abs=1e-9)
    assert RADIUS < played.to_goal < 0.25 * far
    # It keeps its margin, and uses what is there: the samples of a path lie no farther apart than this.
    here = obstacle_clearance(planner.collision, planner.robot, played.posture, planner.obstacles)[0]
    margin = constants.APPROACH_MARGIN_FACTOR * planner.settings.obstacle_margin
    assert margin <= here < margin + 0.01
    assert played.least > 0.0
    planner.take_obstacles(Obstacles.none())
    found = played.run(TICK)[0]
    assert found.verdict.ok
    assert not found.verdict.figures.goal_covered
    assert math.isnan(found.verdict.figures.goal_distance)
    played.run(played.nominal.duration)
    assert played.to_goal < 1e-3


def test_it_waits_where_it_is_where_that_is_asked_for(planner: ReactivePlanner) -> None:
    """The control."""
    settings = PlannerSettings(approach_covered_goal=False)
    played = Played(ReactivePlanner(planner.skill, settings))
    played.planner.take_obstacles(played.on_goal())
    stands = played.run_to_rest()
    assert played.begun == 0
    assert (stands.verdict.code, stands.verdict.figures.goal_covered) == (VerdictCode.NO_FEASIBLE_PATH, True)
    assert stands.verdict.figures.goal_distance == pytest.approx(played.to_goal)
    np.testing.assert_array_equal(played.posture, played.nominal.positions[0])


def test_an_arm_that_has_approached_stands_whatever_little_the_obstacle_moves(planner: ReactivePlanner) -> None:
    played = Played(planner)
    sphere = played.on_goal()
    planner.take_obstacles(sphere)
    played.run_to_rest()
    stood, begun = played.posture, played.begun
    assert begun == 1
    played.run(2.0)
    random = np.random.default_rng(3)
    for _ in range(50):
        planner.take_obstacles(replace(sphere, centres=sphere.centres + random.normal(scale=1e-3, size=(1, 3))))
        played.run(2 * TICK)
    assert played.begun == begun
    np.testing.assert_array_equal(played.posture, stood)
    # The control: what makes room by more than that is followed.
    near = played.to_goal
    planner.take_obstacles(played.on_goal(RADIUS - 2.0 * constants.APPROACH_GAIN))
    played.run_to_rest()
    assert played.begun == begun + 1
    assert played.to_goal < near - 0.5 * constants.APPROACH_GAIN
    assert played.least > 0.0


def test_what_covers_the_goal_and_comes_nearer_is_not_touched(planner: ReactivePlanner) -> None:
    """The sphere grows towards the arm, half in motion and where it then stands; the control: it would be met."""
    played = Played(planner)
    planner.take_obstacles(played.on_goal())
    first = played.run(TICK)[0].reference
    played.run(0.5 * first.duration)
    larger = played.on_goal(2.0 * RADIUS)
    planner.take_obstacles(larger)
    assert obstacle_clearance(planner.collision, planner.robot, first.positions[-1], larger)[0] < 0.0
    played.run_to_rest()
    assert played.least > 0.0
    planner.take_obstacles(played.on_goal())
    near = played.to_goal
    played.run_to_rest()
    assert played.to_goal < near
    planner.take_obstacles(Obstacles.none())
    played.run_to_rest()
    assert played.to_goal < 1e-3


def test_what_moves_towards_an_approaching_arm_is_not_met_in_motion(planner: ReactivePlanner) -> None:
    played = Played(planner)
    goal, start = planner.skill.goal_pose[:3], planner.robot.forward(played.posture)[0]
    velocity = 0.05 * (start - goal) / np.linalg.norm(start - goal)
    radius, moved = np.array([RADIUS]), []
    for number in range(round(4.0 / TICK)):
        centre = goal + number * TICK * velocity
        planner.take_obstacles(Obstacles.of_spheres(centre[None], radius, velocity[None], played.now))
        played.least = math.inf
        played.run(TICK)
        if np.max(np.abs(planner.commanded_state(played.now)[1])) > 1e-3:
            moved.append(played.least)
    assert min(moved, default=1.0) > 0.0


def test_a_goal_that_is_covered_while_the_arm_is_in_motion(planner: ReactivePlanner) -> None:
    played = Played(planner)
    played.run(0.3 * played.nominal.duration)
    planner.take_obstacles(played.on_goal())
    modes = [plan.mode for plan in played.run(played.nominal.duration)]
    assert Mode.APPROACHING in modes
    assert modes[-1] is Mode.WAITING
    assert played.to_goal < 0.2
    assert played.least > 0.0


def test_an_approaching_arm_stops_where_a_hold_is_requested_and_goes_on_after_it(planner: ReactivePlanner) -> None:
    played = Played(planner)
    planner.take_obstacles(played.on_goal())
    played.run(0.3 * played.nominal.duration)
    plan = planner.stop(played.now, Refusal(VerdictCode.HOLD_REQUESTED))
    assert plan.mode is Mode.STOPPING
    played.now = plan.begin + plan.reference.duration
    stopped = played.to_goal
    played.run(0.1)
    assert played.plans[-1].mode is Mode.APPROACHING
    played.run_to_rest()
    assert played.to_goal < stopped - 0.05


def test_what_else_stands_there_is_counted(planner: ReactivePlanner) -> None:
    """A goal that a cloud covers, and a sphere on the path before: the arm waits as it would without the cloud."""
    played = Played(planner)
    hand = planner.robot.forward(played.nominal.sample(0.5 * played.nominal.duration)[0])[0]
    goal = planner.skill.goal_pose[None, :3]
    cloud = DistanceField.of(goal + 0.02 * np.eye(3), 0.02, 0.02, 0.3)
    planner.take_obstacles(replace(Obstacles.none(), cloud=cloud))
    played.run_to_rest()
    assert played.plans[-1].verdict.figures.goal_covered
    assert played.to_goal < 0.25
    assert played.least > 0.0
    blocked = Played(planner)
    sphere = Obstacles.of_spheres(hand[None], np.array([0.08]))
    planner.take_obstacles(replace(sphere, cloud=cloud))
    blocked.run_to_rest()
    assert blocked.begun == 0


@pytest.mark.parametrize("name", SKILLS)
def test_a_goal_that_the_declared_scene_covers_is_approached(name: str) -> None:
    """A wall behind all that was demonstrated, and a goal so near to it that the hand would enter it."""
    skill = Skill.load(name)
    free = Played(ReactivePlanner(skill))
    robot, collision, goal = free.planner.robot, free.planner.collision, skill.goal_pose.copy()
    moving, radii = collision.moving, collision.radii[collision.moving]
    along = goal[:3] - skill.start_pose[:3]
    along /= np.linalg.norm(along)
    shown, shown_radii = OutputSpace.of(skill).demonstrated_spheres(skill, robot, collision)
    nominal = collision.positions(robot, np.array(free.nominal.positions))[:, moving]
    wall = max(float(np.max(shown @ along + shown_radii)), float(np.max(nominal @ along + radii))) + 1e-3
    goal[:3] += (wall - float(np.max(nominal[-1] @ along + radii)) + 0.01) * along
    scene = DeclaredScene.of({"planes": [{"name": "wall", "point": wall * along, "normal": -along}]})
    planner = ReactivePlanner(skill, PlannerSettings(detour=0.0), scene=scene)
    planner.stand_at(free.nominal.positions[0], 0.0)
    assert planner.set_goal(goal[:3], goal[3:]).ok
    now, verdicts, nearest = 0.0, [], math.inf
    for _ in range(round((free.nominal.duration + 2.0) / TICK)):
        verdicts.append(planner.tick(now).verdict)
        now += TICK
        spheres = collision.positions(robot, planner.commanded_state(now)[0][None])[:, moving]
        nearest = min(nearest, float(scene.clearances(spheres, radii)[0]))
    assert {verdict.code for verdict in verdicts} == {VerdictCode.NO_FEASIBLE_PATH}
    assert all(verdict.figures.goal_covered and "inside 'wall'" in verdict.reason for verdict in verdicts)
    assert verdicts[-1].figures.goal_distance < 0.06 < verdicts[0].figures.goal_distance
    assert 0.0 < nearest < 0.03
