"""JointSpacePlanner: the arm goes another way or stops, its stream stays smooth, and PyBullet finds it clear."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros import joint_solver
from geodesic_motion_ros.deadline import Deadline
from geodesic_motion_ros.distance_field import DistanceField
from geodesic_motion_ros.graph.metric_field import curve_length
from geodesic_motion_ros.graph.reshaping import Reshaping
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.joint_reference import JointReference
from geodesic_motion_ros.joint_solver import JointPlan
from geodesic_motion_ros.joint_stream import JointStream
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.simulation.collision_geometry import CollisionGeometry
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.solids import solid_distances, solid_rows
from geodesic_motion_ros.verdict import Verdict, VerdictCode

PERIOD = 0.01
#: A graph that stands sooner than the default one.
COARSE = JointPlannerSettings(grid_shape=(30, 30, 30))
NOTHING = np.empty((0, 3)), np.empty(0)


@dataclass
class Stream:
    """Ticks a planner at 100 Hz; what it answers is played from the next tick on, so late as a message may be."""

    planner: JointSpacePlanner
    now: float = 0.0
    played: tuple[JointReference, float] | None = None
    pending: tuple[JointReference, float] | None = None
    handed: list[JointReference] = field(default_factory=list)
    jumps: list[float] = field(default_factory=list)
    postures: list[np.ndarray] = field(default_factory=list)

    def state(self, played: tuple[JointReference, float] | None = None) -> np.ndarray:
        """Position, velocity and acceleration (3, eta) that are desired now."""
        reference, begin = played or self.played
        return np.stack(reference.sample(self.now - begin))

    def stand_at(self, configuration: np.ndarray) -> None:
        standing = self.planner.stand_at(configuration, self.now)
        assert standing.reference is not None
        self.played, self.pending = (standing.reference, standing.begin), None

    def run(self, seconds: float) -> list[JointPlan]:
        plans = []
        for _ in range(round(seconds / PERIOD)):
            if self.pending is not None:
                self.jumps.append(float(np.max(np.abs(self.state(self.pending) - self.state()))))
                self.played, self.pending = self.pending, None
            plans.append(self.planner.tick(self.now))
            if plans[-1].reference is not None:
                self.pending = plans[-1].reference, plans[-1].begin
                self.handed.append(plans[-1].reference)
            self.postures.append(self.state()[0])
            self.now += PERIOD
        return plans

    def off(self, goal: np.ndarray) -> float:
        """Largest distance of a joint from a goal, or speed of one: [rad], [rad/s]."""
        position, velocity, _ = self.state()
        return float(max(np.max(np.abs(position - goal)), np.max(np.abs(velocity))))


@pytest.fixture(scope="module")
def planner(reach_skill: Skill) -> JointSpacePlanner:
    return JointSpacePlanner(reach_skill, COARSE)


@pytest.fixture(scope="module")
def start(reach_skill: Skill) -> np.ndarray:
    return reach_skill.canonical.start_poles[0]


@pytest.fixture(scope="module")
def goal(reach_skill: Skill) -> np.ndarray:
    return reach_skill.canonical.goal_poles[0]


@pytest.fixture
def stream(planner: JointSpacePlanner, start: np.ndarray, goal: np.ndarray) -> Stream:
    planner.set_obstacles(*NOTHING)
    result = Stream(planner)
    result.stand_at(start)
    assert planner.set_goal_configuration(goal).ok
    return result


@pytest.fixture(scope="module")
def nominal(planner: JointSpacePlanner, start: np.ndarray, goal: np.ndarray) -> JointReference:
    """The way without obstacles."""
    planner.set_obstacles(*NOTHING)
    planner.stand_at(start, 0.0)
    planner.set_goal_configuration(goal)
    return planner.tick(0.0).reference


@pytest.fixture(scope="module")
def on_elbow(planner: JointSpacePlanner, nominal: JointReference) -> tuple[np.ndarray, np.ndarray]:
    """A sphere where the elbow is halfway on that way."""
    halfway = nominal.sample(0.5 * nominal.duration)[0]
    return elbow_position(planner.robot, halfway)[None], np.array([0.04])


@pytest.fixture(scope="module")
def geometry():
    with CollisionGeometry.panda() as meshes:
        yield meshes


def clearance(geometry: CollisionGeometry, postures: np.ndarray, sphere: tuple[np.ndarray, np.ndarray]) -> float:
    """Least distance [m] of the meshes from one sphere, by PyBullet."""
    least = np.inf
    for posture in postures:
        geometry.place(posture)
        least = min(least, geometry.clearance(sphere[0][0], float(sphere[1][0])))
    return least


def dense(reference: JointReference) -> np.ndarray:
    return reference.samples(np.arange(0.0, reference.duration, PERIOD))[0]


def test_the_goal_is_reached_at_rest_and_stays_reached(stream, nominal, goal) -> None:
    plans = stream.run(nominal.duration + 0.5)
    assert all(plan.verdict.ok for plan in plans)
    assert len(stream.handed) == 1
    assert stream.off(goal) < 1e-9
    assert nominal.keeps(stream.planner.limits)


def test_an_elbow_that_is_in_the_way_goes_on_the_other_side(stream, nominal, on_elbow, geometry) -> None:
    stream.planner.set_obstacles(*on_elbow)
    plan = stream.planner.tick(0.0)
    assert plan.verdict.ok
    assert clearance(geometry, dense(nominal), on_elbow) < -0.03
    measured = clearance(geometry, dense(plan.reference), on_elbow)
    assert 0.0 < plan.verdict.clearance <= measured + 1e-4


@pytest.mark.parametrize("kind", ["box", "capsule", "cloud"])
def test_obstacles_of_every_kind_are_hit_on_the_old_way_and_passed_on_the_new(stream, nominal, on_elbow, kind) -> None:
    planner, (centre, _) = stream.planner, on_elbow
    turn = Rotation.from_rotvec([0.4, 0.3, 0.9]).as_matrix()[None]
    extents, radius = ([[0.03, 0.02, 0.04]], [0.0]) if kind == "box" else ([[0.0, 0.0, 0.03]], [0.025])
    solids, seen = solid_rows(centre, turn, np.array(extents), np.array(radius)), centre
    obstacles = replace(Obstacles.none(), solids=solids, solid_velocities=np.zeros((1, 3)))
    if kind == "cloud":
        seen = centre + np.random.default_rng(0).uniform(-0.02, 0.02, (2000, 3))
        obstacles = replace(Obstacles.none(), cloud=DistanceField.of(seen, 0.01, 0.005, 0.04))

    def least(reference: JointReference) -> float:
        model = planner.collision
        centres = model.positions(planner.robot, dense(reference))[:, model.moving].reshape(-1, 3)
        gaps = cKDTree(seen).query(centres)[0] - 0.005 if kind == "cloud" else solid_distances(centres, solids)
        return float(np.min(gaps.reshape(-1, np.count_nonzero(model.moving)) - model.radii[model.moving]))

    assert planner.take_obstacles(obstacles).ok
    plan = planner.tick(0.0)
    assert plan.verdict.ok
    assert least(nominal) < -0.03
    assert 0.0 < plan.verdict.clearance <= least(plan.reference)
    # A field tells no more than its reach.
    assert least(plan.reference) < plan.verdict.clearance + 0.03 or kind == "cloud"


def test_a_refined_way_is_shorter_and_one_that_is_refused_gives_way_to_the_graphs(
    reach_skill, planner, start, goal, monkeypatch
) -> None:
    planner.take_obstacles(Obstacles.none())
    choice = planner._queries.goal_by_configuration(goal)
    query = planner._queries.build(start, choice)
    free = Reshaping.of(query.body, Obstacles.none(), 0.0, 0.5, 0.02)

    def length(plan: JointPlan) -> float:
        assert plan.verdict.ok, plan.verdict.reason
        return curve_length(query.field, free, plan.reference.latent)

    plain = JointSpacePlanner(reach_skill, replace(COARSE, refine=False)).plan_configurations(start, choice)
    assert length(planner.plan_configurations(start, choice)) < length(plain)

    def astray(field, reshaping, margin, path):
        return path + np.sin(np.linspace(0.0, np.pi, len(path)))[:, None]

    monkeypatch.setattr(joint_solver, "refined", astray)
    assert length(planner.plan_configurations(start, choice)) == length(plain)


def test_a_way_that_is_found_again_while_no_obstacle_is_near_gets_no_second_look(stream, on_elbow, monkeypatch) -> None:
    """An obstacle that comes from afar is felt by the search all along; the curve is drawn anew when it is near."""
    looks, certified = [], stream.planner._solver._certified

    def recorded(*arguments):
        looks.append(stream.now)
        return certified(*arguments)

    monkeypatch.setattr(stream.planner._solver, "_certified", recorded)
    (centre,), radius = on_elbow
    close = None
    for number in range(100):
        away = np.array([0.0, 0.0, 1.2 - 0.012 * number])
        stream.planner.set_obstacles((centre + away)[None], radius)
        now, (plan,) = stream.now, stream.run(PERIOD)
        if close is None and plan.verdict.clearance < 0.03:
            close = now
    assert close > 0.3
    assert sum(look < close for look in looks) == 1
    assert any(look >= close for look in looks)


def test_out_of_time_the_arm_stays_and_the_next_ticks_go_on_trying(stream, start, goal, monkeypatch) -> None:
    """Only the last attempt is let through: with time it is made at once, without it in a later tick."""
    planner, solver = stream.planner, stream.planner._solver
    certified = solver._certified
    monkeypatch.setattr(solver, "attempts", tuple(attempt for attempt in solver.attempts if not attempt.refine))

    def picky(query, state, way, obstacles, margin, width, trusting):
        plan = certified(query, state, way, obstacles, margin, width, trusting)
        return plan if width == 1.0 else JointPlan(None, state.time, Verdict(VerdictCode.NO_FEASIBLE_PATH, "not this"))

    monkeypatch.setattr(solver, "_certified", picky)
    missed, *later = (planner.tick(number * PERIOD, Deadline(-np.inf)) for number in range(4))
    assert missed.verdict.code is VerdictCode.DEADLINE_MISSED
    assert "out of time after 1 of 3 attempts: not this" in missed.verdict.reason
    assert missed.reference is None
    assert VerdictCode.OK in [plan.verdict.code for plan in later]

    stream.stand_at(start)
    planner.set_goal_configuration(goal)
    assert planner.tick(0.0, Deadline(np.inf)).verdict.ok


def test_without_avoidance_or_with_the_hand_alone_the_elbow_hits(
    reach_skill, planner, start, goal, on_elbow, geometry
) -> None:
    from geodesic_motion_ros.experiments.blocked_arm import hand_alone

    blind = JointSpacePlanner(reach_skill, replace(COARSE, avoidance=False))
    settings = replace(COARSE, ambient_strength=0.0)
    for other in (blind, JointSpacePlanner(reach_skill, settings, hand_alone(planner.collision))):
        other.set_obstacles(*on_elbow)
        other.stand_at(start, 0.0)
        other.set_goal_configuration(goal)
        assert clearance(geometry, dense(other.tick(0.0).reference), on_elbow) < -0.03


def test_what_comes_into_the_way_stops_the_arm_before_it_and_it_goes_on_when_it_is_gone(
    stream, nominal, goal, geometry
) -> None:
    stream.run(0.5 * nominal.duration)
    # On the way of the hand, which no family goes around.
    hand, _ = stream.planner.robot.forward(nominal.sample(0.8 * nominal.duration)[0])
    sphere = hand[None], np.array([0.05])
    stream.planner.set_obstacles(*sphere)
    before = len(stream.postures)
    plans = stream.run(1.5)
    assert plans[-1].verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert np.max(np.abs(stream.state()[1:])) == 0.0
    assert clearance(geometry, stream.postures[before:], sphere) > 0.0
    stream.planner.set_obstacles(*NOTHING)
    assert stream.run(nominal.duration)[-1].verdict.ok
    assert stream.off(goal) < 1e-9
    assert max(stream.jumps) < 1e-6


def test_the_stream_is_smooth_whatever_comes_and_goes(stream, reach_skill, nominal, goal) -> None:
    random = np.random.default_rng(4)
    planner = stream.planner
    elbows = np.array([elbow_position(planner.robot, posture) for posture in dense(nominal)])
    sheet = reach_skill.canonical
    for _ in range(25):
        count = random.integers(0, 4)
        centres = elbows[random.integers(len(elbows), size=count)] + random.normal(scale=0.15, size=(count, 3))
        velocities = random.normal(scale=0.15, size=(count, 3)) * random.integers(0, 2)
        planner.set_obstacles(centres, random.uniform(0.02, 0.05, count), velocities, stream.now)
        if random.uniform() < 0.2:
            chosen = sheet.goal_poles[0] + sheet.goal_offsets[random.integers(len(sheet.modes))]
            assert planner.set_goal_configuration(chosen).ok
        stream.run(random.uniform(0.02, 0.3))
    assert len(stream.jumps) > 10
    assert max(stream.jumps) < 1e-6
    assert all(reference.keeps(planner.limits) for reference in stream.handed)
    planner.set_obstacles(*NOTHING)
    planner.set_goal_configuration(goal)
    assert stream.run(1.5 * nominal.duration)[-1].verdict.ok
    assert stream.off(goal) < 1e-9


def test_spheres_that_come_nearer_are_certified_as_they_move(stream, nominal, geometry) -> None:
    """An arm that moves is never touched by what moves on as it was told."""
    elbow = elbow_position(stream.planner.robot, nominal.sample(0.5 * nominal.duration)[0])
    velocity = np.array([[0.0, -0.25, 0.0]])
    centre, radius = elbow[None] - 0.5 * nominal.duration * velocity, np.array([0.05])
    moved = [np.inf]
    for _ in range(round(0.8 * nominal.duration / PERIOD)):
        stream.planner.set_obstacles(centre, radius, velocity, stream.now)
        stream.run(PERIOD)
        if np.max(np.abs(stream.state()[1])) > 1e-3:
            moved.append(clearance(geometry, stream.postures[-1:], (centre, radius)))
        centre = centre + PERIOD * velocity
    assert len(moved) > 100
    assert 0.0 < min(moved) < 0.1


def test_an_arm_that_is_covered_stands_and_is_told_which_link(stream, start) -> None:
    sphere = elbow_position(stream.planner.robot, start)[None], np.array([0.05])
    stream.planner.set_obstacles(*sphere)
    plan = stream.run(0.1)[-1]
    assert plan.verdict.code is VerdictCode.IN_COLLISION
    assert "panda_link" in plan.verdict.reason
    assert plan.verdict.clearance < 0.0
    np.testing.assert_array_equal(stream.postures[-1], start)


def test_a_goal_that_is_covered_is_waited_for(stream, goal, nominal) -> None:
    hand, _ = stream.planner.robot.forward(goal)
    stream.planner.set_obstacles(hand[None], np.array([0.05]))
    plan = stream.run(0.1)[-1]
    assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "is to go" in plan.verdict.reason
    stream.planner.set_obstacles(*NOTHING)
    stream.run(nominal.duration + 0.1)
    assert stream.off(goal) < 1e-9


def test_what_was_tried_in_vain_is_not_tried_again_until_something_changes(stream, goal, nominal, monkeypatch) -> None:
    planner, searches = stream.planner, []
    solve = planner._solver.solve
    monkeypatch.setattr(planner._solver, "solve", lambda *arguments: searches.append(0) or solve(*arguments))
    stream.run(0.3 * nominal.duration)
    hand, _ = planner.robot.forward(goal)
    planner.set_obstacles(hand[None], np.array([0.05]))
    stream.run(0.8)
    tried = len(searches)
    plan = stream.run(0.5)[-1]
    assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "is to go" in plan.verdict.reason
    assert len(searches) == tried
    planner.set_obstacles(hand[None] + 1e-3, np.array([0.05]))
    assert not stream.run(PERIOD)[0].verdict.ok
    assert len(searches) == tried + 1
    planner.set_obstacles(*NOTHING)
    assert stream.run(PERIOD)[0].verdict.ok
    stream.run(nominal.duration)
    assert stream.off(goal) < 1e-9


def test_a_goal_that_is_about_to_be_passed_long_before_the_arm_is_there_is_gone_to(stream, goal, nominal) -> None:
    """The control: one that stands there is waited for."""
    planner = stream.planner
    hand, _ = planner.robot.forward(goal)
    velocity = np.array([0.0, 0.25, 0.0])
    begin, radius = hand - planner.settings.prediction * velocity, np.array([0.05])
    planner.set_obstacles(hand[None], radius)
    assert not stream.run(PERIOD)[0].verdict.ok
    planner.set_obstacles(begin[None], radius, velocity[None], stream.now)
    plan = stream.run(PERIOD)[0]
    assert plan.verdict.ok, plan.verdict.reason
    while stream.now < nominal.duration + 1.0:
        planner.set_obstacles((begin + stream.now * velocity)[None], radius, velocity[None], stream.now)
        plan = stream.run(PERIOD)[0]
        assert plan.verdict.ok, plan.verdict.reason
    assert stream.off(goal) < 1e-9


def test_an_arm_that_has_no_way_gives_way_to_what_comes_to_where_it_stands(stream, goal, nominal, geometry) -> None:
    """The control: the arm as it stands would be hit. Afterwards it goes on."""
    planner = stream.planner
    stream.run(0.5 * nominal.duration)
    hand, _ = planner.robot.forward(goal)
    wall = hand, 0.05
    planner.set_obstacles(wall[0][None], np.array([wall[1]]))
    stream.run(0.6)
    stood = stream.state()[0]
    hand, _ = planner.robot.forward(stood)
    velocity, met, radius = np.array([0.0, 0.0, -0.2]), stream.now + 3.0, 0.04

    def passing(time: float) -> np.ndarray:
        return hand + (time - met) * velocity

    least = hit = np.inf
    while stream.now < met + 1.5:
        centres = np.stack([wall[0], passing(stream.now)])
        velocities = np.stack([np.zeros(3), velocity])
        planner.set_obstacles(centres, np.array([wall[1], radius]), velocities, stream.now)
        plan = stream.run(PERIOD)[0]
        assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        sphere = passing(stream.now)[None], np.array([radius])
        least = min(least, clearance(geometry, stream.postures[-1:], sphere))
        hit = min(hit, clearance(geometry, [stood], sphere))
    assert hit < 0.0 < least
    assert max(stream.jumps) < 1e-6
    planner.set_obstacles(*NOTHING)
    plan = stream.run(2.0 * nominal.duration)[-1]
    assert plan.verdict.ok, plan.verdict.reason
    assert stream.off(goal) < 1e-9


def stopping_sphere(stream: Stream, shown: float) -> float:
    """Least clearance [m] of the arm's collision spheres from one of 4 cm that is shown at a time [s].

    It comes from outside at 0.25 m/s to 30 cm ahead of the tool on its way, and stops there. That it stands is told
    50 ms late, as its track does.
    """
    planner, speed, radius = stream.planner, 0.25, 0.04
    stream.run(shown)
    way = dense(stream.played[0].rest(stream.now - stream.played[1]))
    tool = np.array([planner.robot.forward(posture)[0] for posture in way])
    place = tool[np.argmax(np.cumsum(np.linalg.norm(np.diff(tool, axis=0), axis=1)) >= 0.30)]
    outside = place * [1.0, 1.0, 0.0] / np.linalg.norm(place[:2])
    least = np.inf
    for time in PERIOD * np.arange(300):
        arrives = 0.30 / speed
        velocity = -speed * outside if time < arrives + 0.05 else np.zeros(3)
        centre = place + max(0.30 - speed * time, 0.0) * outside
        planner.set_obstacles(centre[None], np.array([radius]), velocity[None], stream.now)
        stream.run(PERIOD)
        body = planner.collision.positions(planner.robot, stream.state()[0][None])[0] - centre
        apart = np.linalg.norm(body, axis=1) - planner.collision.radii - radius
        least = min(least, float(np.min(apart[planner.collision.moving])))
    return least


@pytest.mark.parametrize("shown", [1.1, 1.2, 1.3, 2.2])
def test_what_stops_before_it_has_passed_is_not_touched(stream, shown) -> None:
    assert stopping_sphere(stream, shown) > 0.005


def test_an_arm_that_counts_on_what_moves_to_move_on_touches_what_stops(stream, monkeypatch) -> None:
    monkeypatch.setattr(JointStream, "can_still_stop", lambda *_: True)
    assert stopping_sphere(stream, 1.2) < 0.0


def test_stopping_for_a_reason_ends_at_rest_and_the_next_tick_goes_on(stream, nominal, goal) -> None:
    from geodesic_motion_ros.verdict import Verdict

    stream.run(0.4 * nominal.duration)
    reason = Verdict(VerdictCode.HOLD_REQUESTED, "asked to hold")
    plan = stream.planner.stop(stream.now, reason)
    assert plan.verdict.code is VerdictCode.HOLD_REQUESTED
    assert plan.reference.duration < 1.0
    stopped = plan.reference.sample(plan.reference.duration)[0]
    assert np.max(np.abs(stopped - goal)) > 0.1
    assert stream.planner.stop(stream.now + PERIOD, reason).reference is None
    stream.pending = plan.reference, plan.begin
    stream.run(nominal.duration)
    assert stream.off(goal) < 1e-9
    assert max(stream.jumps) < 1e-6


def test_a_goal_prepared_before_the_arm_was_found_elsewhere_is_planned_from_there(stream, nominal, goal) -> None:
    elsewhere = nominal.sample(0.4 * nominal.duration)[0]
    stream.stand_at(elsewhere)
    stream.planner.set_goal_configuration(goal)
    expected = stream.run(PERIOD)[0].reference

    stream.stand_at(nominal.positions[0])
    prepared = stream.planner.prepared_configuration(goal)
    stream.stand_at(elsewhere)
    stream.planner.take_goal(prepared)
    reference = stream.run(PERIOD)[0].reference
    np.testing.assert_array_equal(reference.positions, expected.positions)


def test_nothing_is_planned_before_there_is_a_state_and_a_goal(reach_skill, start) -> None:
    fresh = JointSpacePlanner(reach_skill, COARSE)
    assert fresh.tick(0.0).verdict.code is VerdictCode.STALE_STATE
    assert fresh.commanded(0.0) is None
    fresh.stand_at(start, 0.0)
    assert fresh.tick(0.0).verdict.code is VerdictCode.NO_GOAL
    np.testing.assert_array_equal(fresh.commanded(0.0)[0], start)


@pytest.mark.parametrize(
    ("centres", "radii", "velocities", "said"),
    [
        ([[0.0, 0.0, np.nan]], [0.1], None, "finite"),
        ([[0.0, 0.0, 1.0]], [0.0], None, "positive"),
        ([[0.0, 0.0, 1.0]], [0.1], [[np.inf, 0.0, 0.0]], "finite"),
        ([[0.0, 0.0, 1.0]], [0.1, 0.2], None, "as many of each"),
    ],
)
def test_bad_obstacles_are_refused_and_the_old_ones_stay(stream, on_elbow, centres, radii, velocities, said) -> None:
    stream.planner.set_obstacles(*on_elbow)
    verdict = stream.planner.set_obstacles(np.array(centres), np.array(radii), velocities)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert said in verdict.reason
    assert np.isfinite(stream.planner.tick(0.0).verdict.clearance)
