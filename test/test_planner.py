"""The planner's promises, on a small skill that fans out: scenes come with a control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.deadline import Deadline
from geodesic_motion_ros.distance_field import DistanceField
from geodesic_motion_ros.errors import PlanningError
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner import Plan, PlannerSettings, ReactivePlanner
from geodesic_motion_ros.pose_stream import PoseStream
from geodesic_motion_ros.quaternions import angle_between, normalise
from geodesic_motion_ros.reference import ReferenceFollower
from geodesic_motion_ros.solids import solid_distances, solid_rows
from geodesic_motion_ros.verdict import Verdict, VerdictCode

PERIOD = 0.01
NOTHING = (np.empty((0, 3)), np.empty(0))


@pytest.fixture(scope="module")
def shared_planner(fan_skill) -> ReactivePlanner:
    return ReactivePlanner(fan_skill)


@pytest.fixture
def planner(shared_planner) -> ReactivePlanner:
    shared_planner.set_obstacles(*NOTHING)
    shared_planner.clear_goal()
    return shared_planner


def nominal(planner: ReactivePlanner) -> Plan:
    """The plan from the skill's mean start to its mean goal."""
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    return planner.plan(start[:3], start[3:], goal[:3], goal[3:])


def middle(planner: ReactivePlanner) -> np.ndarray:
    """Position (3,) [m] half way along the nominal plan."""
    positions = nominal(planner).reference.positions
    return positions[len(positions) // 2]


def stream(planner: ReactivePlanner, obstacles=lambda time: NOTHING, seconds: float = 8.0, offset: float = 0.0):
    """Follow the planner from start to goal; yields time, follower and plan after every tick."""
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(start[:3] + offset, start[3:])
    assert planner.set_goal(goal[:3], goal[3:]).ok
    for step in range(int(seconds / PERIOD)):
        planner.set_obstacles(*obstacles(step * PERIOD))
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        if plan.reference is None:
            follower.hold()
        else:
            follower.accept(plan.reference)
        yield step * PERIOD, follower, plan
        follower.advance(PERIOD)


def test_a_plan_meets_both_ends_and_the_skill(planner):
    plan = nominal(planner)
    assert plan.verdict.ok
    reference, start, goal = plan.reference, planner.skill.start_pose, planner.skill.goal_pose
    np.testing.assert_allclose(reference.positions[[0, -1]], [start[:3], goal[:3]], atol=1e-9)
    assert angle_between(reference.quaternions[[0, -1]], np.stack([start[3:], goal[3:]])).max() < 1e-6
    # The middle of the fan is a straight line, its rims bulge out by 120 mm.
    line = start[:3] + np.linspace(0, 1, 50)[:, None] * (goal[:3] - start[:3])
    gaps = np.linalg.norm(reference.positions[:, None] - line, axis=-1).min(axis=1)
    assert gaps.max() < 0.04


def test_unseen_ends_are_met_exactly(planner):
    start, goal = planner.skill.start_pose.copy(), planner.skill.goal_pose.copy()
    start[:3] += [0.02, -0.01, 0.015]
    goal[:3] += [-0.02, 0.02, 0.01]
    plan = planner.plan(start[:3], start[3:], goal[:3], -goal[3:])
    np.testing.assert_allclose(plan.reference.positions[[0, -1]], [start[:3], goal[:3]], atol=1e-9)
    assert np.all(np.sum(plan.reference.quaternions[1:] * plan.reference.quaternions[:-1], axis=1) > 0.9)


@pytest.mark.parametrize("seed", range(25))
def test_a_sphere_on_the_path_is_hit_without_avoidance_and_not_with_it(fan_skill, planner, seed):
    random = np.random.default_rng(seed)
    direct = nominal(planner).reference.positions
    centre = direct[random.integers(len(direct) // 4, 3 * len(direct) // 4)] + random.normal(scale=0.01, size=3)
    radius = random.uniform(0.01, 0.03)
    blind = ReactivePlanner(fan_skill, PlannerSettings(avoidance=False)) if seed == 0 else None
    planner.set_obstacles([centre], [radius])
    if blind is not None:
        blind.set_obstacles([centre], [radius])
        assert nominal(blind).verdict.clearance < 0.0
    assert np.linalg.norm(direct - centre, axis=1).min() < radius + 0.04
    plan = nominal(planner)
    assert plan.verdict.ok
    assert plan.verdict.clearance > 0.0
    dense = np.array([plan.reference.sample(t)[0] for t in np.linspace(0, plan.reference.duration, 3000)])
    assert np.linalg.norm(dense - centre, axis=1).min() - radius - 0.04 >= plan.verdict.clearance - 1e-9


@pytest.mark.parametrize("kind", ["box", "capsule", "cloud"])
def test_obstacles_of_every_kind_are_hit_without_avoidance_and_passed_with_it(fan_skill, planner, kind):
    direct = nominal(planner).reference.positions
    centre = direct[len(direct) // 2] + [0.0, 0.0, 0.01]
    turn = Rotation.from_rotvec([0.3, 0.2, 0.8]).as_matrix()
    extents, radius = {"box": ([0.03, 0.02, 0.01], 0.0), "capsule": ([0.0, 0.0, 0.03], 0.015)}.get(kind, (None, None))
    if kind == "cloud":
        seen = centre + np.random.default_rng(0).uniform(-0.015, 0.015, (200, 3))
        obstacles = replace(Obstacles.none(), cloud=DistanceField.of(seen, 0.005, 0.005, 0.02))
    else:
        row = solid_rows(centre[None], turn[None], np.array([extents]), np.array([radius]))
        obstacles = replace(Obstacles.none(), solids=row, solid_velocities=np.zeros((1, 3)))
    blind = ReactivePlanner(fan_skill, PlannerSettings(avoidance=False))
    assert blind.take_obstacles(obstacles).ok
    assert nominal(blind).verdict.clearance < 0.0
    assert planner.take_obstacles(obstacles).ok
    plan = nominal(planner)
    assert plan.verdict.ok
    assert plan.verdict.clearance > 0.0
    dense = np.array([plan.reference.sample(t)[0] for t in np.linspace(0, plan.reference.duration, 3000)])
    if kind == "cloud":
        gaps = cKDTree(seen).query(dense)[0] - 0.005 - 0.04
    else:
        gaps = solid_distances(dense, obstacles.solids) - 0.04
    assert gaps.min() >= plan.verdict.clearance - 1e-9


def test_a_bad_solid_is_refused_and_the_old_obstacles_stay(planner):
    planner.set_obstacles([middle(planner)], [0.17])
    flat = solid_rows(np.zeros((1, 3)), np.eye(3)[None], np.array([[0.1, 0.1, 0.0]]), np.zeros(1))
    verdict = planner.take_obstacles(replace(Obstacles.none(), solids=flat, solid_velocities=np.zeros((1, 3))))
    assert verdict.code is VerdictCode.BAD_INPUT
    assert "solid 0" in verdict.reason
    assert nominal(planner).reference is None


def test_the_plan_with_an_obstacle_is_never_cheaper_than_without(planner):
    direct = nominal(planner).reference
    planner.set_obstacles([direct.positions[len(direct.positions) // 2]], [0.03])
    detour = nominal(planner).reference
    assert detour.duration > direct.duration


def test_a_far_obstacle_changes_nothing_and_one_that_left_leaves_no_trace(planner):
    before = nominal(planner).reference
    planner.set_obstacles([[0.5, 0.0, 2.0]], [0.1])
    np.testing.assert_array_equal(nominal(planner).reference.positions, before.positions)
    planner.set_obstacles([before.positions[len(before.positions) // 2]], [0.03])
    assert not np.array_equal(nominal(planner).reference.positions, before.positions)
    planner.set_obstacles(*NOTHING)
    after = nominal(planner).reference
    np.testing.assert_array_equal(after.positions, before.positions)
    np.testing.assert_array_equal(after.times, before.times)


def test_a_wall_leaves_no_path_and_says_so(planner):
    centre = middle(planner)
    planner.set_obstacles([centre], [0.17])
    plan = nominal(planner)
    assert plan.reference is None
    assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "block" in plan.verdict.reason


@pytest.mark.parametrize(
    ("end", "code", "words"),
    [("start_pose", VerdictCode.IN_COLLISION, "overlaps"), ("goal_pose", VerdictCode.NO_FEASIBLE_PATH, "goal")],
)
def test_an_obstacle_on_an_end_is_named(planner, end, code, words):
    planner.set_obstacles([getattr(planner.skill, end)[:3]], [0.03])
    plan = nominal(planner)
    assert plan.reference is None
    assert plan.verdict.code is code
    assert words in plan.verdict.reason


def test_the_stream_arrives_without_a_jump(planner):
    limit = planner.settings.speed * PERIOD * 1.001
    before = None
    for _, follower, plan in stream(planner):
        assert plan.verdict.ok, plan.verdict
        if before is not None:
            assert np.linalg.norm(follower.position - before[0]) <= limit
            assert before[1] @ follower.quaternion > 0.9999
        before = follower.position.copy(), follower.quaternion.copy()
    np.testing.assert_allclose(follower.position, planner.skill.goal_pose[:3], atol=1e-6)
    assert angle_between(follower.quaternion, planner.skill.goal_pose[3:]) < 1e-5


def crossing_sphere(planner: ReactivePlanner):
    """A sphere that comes slowly from the fan's outside onto the direct path and stays."""
    centre = middle(planner)
    away = normalise(np.array([0.8, 0.0, 0.6]))

    def obstacles(time: float):
        return (centre + max(0.0, 0.15 - 0.06 * time) * away)[None], np.array([0.025])

    return obstacles


def test_a_sphere_that_moves_onto_the_path_is_avoided_by_the_stream_but_hit_by_the_control(fan_skill, planner):
    obstacles = crossing_sphere(planner)

    def smallest_gap(subject: ReactivePlanner) -> float:
        gaps = []
        for time, follower, _ in stream(subject, obstacles):
            centre, radius = obstacles(time)
            gaps.append(np.linalg.norm(follower.position - centre[0]) - radius[0] - 0.04)
        np.testing.assert_allclose(follower.position, subject.skill.goal_pose[:3], atol=1e-6)
        return min(gaps)

    assert smallest_gap(ReactivePlanner(fan_skill, PlannerSettings(avoidance=False))) < 0.0
    assert smallest_gap(planner) > 0.0


def test_a_blocked_stream_holds_and_goes_on_when_the_way_is_free(planner):
    centre = middle(planner)
    held, moved = [], []
    for time, follower, plan in stream(  # noqa: B007
        planner, lambda time: ([centre], [0.17]) if time < 2.0 else NOTHING, seconds=10.0
    ):
        (held if time < 2.0 else moved).append(plan.verdict.code)
    assert set(held) == {VerdictCode.NO_FEASIBLE_PATH}
    assert set(moved) == {VerdictCode.OK}
    np.testing.assert_allclose(follower.position, planner.skill.goal_pose[:3], atol=1e-6)


def test_a_stop_before_a_way_back_is_gone_to_its_end_without_looking_again_while_nothing_changes(planner, monkeypatch):
    """Obstacles that move meanwhile are looked at in the same tick."""
    looks, solve = [], planner._solver.solve

    def recorded(*arguments):
        looks.append(arguments)
        return solve(*arguments)

    start = planner.skill.start_pose
    *_, (_, follower, _) = stream(planner, seconds=1.0)
    assert planner.set_goal(start[:3], start[3:]).ok
    monkeypatch.setattr(planner._solver, "solve", recorded)
    stopping = []
    for step in range(300):
        moves = 10 <= len(stopping) < 13
        planner.set_obstacles(*(([[0.0, 0.0, 3.0 + 0.01 * step]], [0.05]) if moves else NOTHING))
        before = len(looks)
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert plan.reference is not None
        follower.accept(plan.reference)
        follower.advance(PERIOD)
        if plan.turning:
            stopping.append((len(looks) - before, moves))
        elif plan.verdict.ok and follower.speed > 0.0 and stopping:
            break
    assert len(stopping) > 15
    assert stopping[0][0] == 1
    assert all(count == 1 for count, moved in stopping if moved)
    assert sum(count for count, _ in stopping) <= 1 + 3 + 1
    for _ in range(600):
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        follower.accept(plan.reference)
        follower.advance(PERIOD)
    np.testing.assert_allclose(follower.position, start[:3], atol=1e-6)


def test_out_of_time_no_further_attempt_is_made(planner, monkeypatch):
    """A first attempt that fails is followed by another, but for the deadline."""
    certified, refused = planner._solver._certified, []

    def picky(*arguments):
        if not refused:
            refused.append(arguments)
            return Plan(None, Verdict(VerdictCode.NO_FEASIBLE_PATH, "not this one"))
        return certified(*arguments)

    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    monkeypatch.setattr(planner._solver, "_certified", picky)
    plan = planner.tick(start[:3], start[3:], 0.0, Deadline(-np.inf))
    assert plan.verdict.code is VerdictCode.DEADLINE_MISSED
    assert plan.verdict.reason == "out of time: not this one"
    assert plan.reference is None
    refused.clear()
    assert planner.tick(start[:3], start[3:], 0.0, Deadline(np.inf)).verdict.ok


def crossing_contact(planner: ReactivePlanner, told: bool, speed: float, side: float) -> tuple[float, float]:
    """A sphere crosses the way where the tool would be; its least distance [m] while the tool moves, and at the end
    the tool's from the goal. `told`: whether the planner is told that it moves.
    """
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    direct = nominal(planner).reference
    meet = 0.5 * direct.duration
    along = direct.velocity(meet)[:3]
    across = side * np.cross(along, [0.0, 0.0, 1.0])
    velocity = speed * across / np.linalg.norm(across)
    centre, radius, tool = direct.sample(meet)[0], 0.04, 0.04
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(start[:3], start[3:])
    assert planner.set_goal(goal[:3], goal[3:]).ok
    least = np.inf
    for step in range(800):
        now = step * PERIOD
        place = centre + (now - meet) * velocity
        if follower.speed > 0.0:
            least = min(least, float(np.linalg.norm(follower.position - place)) - radius - tool)
        moving = Obstacles.of_spheres(place[None], np.array([radius]), told * velocity[None], now)
        assert planner.take_obstacles(moving).ok
        plan = planner.tick(follower.position, follower.quaternion, follower.speed, now=now)
        follower.hold() if plan.reference is None else follower.accept(plan.reference)
        follower.advance(PERIOD)
    return least, float(np.linalg.norm(follower.position - goal[:3]))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("speed", [0.25, 0.6])
def test_a_sphere_that_crosses_is_grazed_where_its_motion_is_not_known_and_not_where_it_is(planner, speed, side):
    blind, _ = crossing_contact(planner, False, speed, side)
    assert blind < 0.002
    least, left = crossing_contact(planner, True, speed, side)
    assert least > 0.01
    # It has passed, and the tool goes on by itself.
    assert left < 1e-6


def played(planner: ReactivePlanner, start: np.ndarray, obstacles, seconds: float):
    """A stream from a pose (7,) to the skill's goal among `obstacles(now)`, spheres of which the first is looked at:
    yields time [s], follower, plan and the clearance [m] from that one.
    """
    goal = planner.skill.goal_pose
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(start[:3], start[3:])
    assert planner.set_goal(goal[:3], goal[3:]).ok
    for step in range(int(seconds / PERIOD)):
        now = step * PERIOD
        spheres = obstacles(now)
        assert planner.take_obstacles(spheres).ok
        plan = planner.tick(follower.position, follower.quaternion, follower.speed, now=now)
        follower.hold() if plan.reference is None else follower.accept(plan.reference)
        follower.advance(PERIOD)
        gap = np.linalg.norm(follower.position - spheres.centres[0]) - spheres.radii[0] - 0.04
        yield now, follower, plan, float(gap)


def moving(centre: np.ndarray, velocity: np.ndarray, time: float, standing=NOTHING) -> Obstacles:
    """A sphere of 3 cm that moves, after it others that stand."""
    centres, radii = np.vstack([centre[None], *standing[:1]]), np.append(0.03, standing[1])
    return Obstacles.of_spheres(centres, radii, np.vstack([velocity[None], 0.0 * centres[1:]]), time)


def test_a_sphere_that_passes_the_goal_before_the_tool_comes_there_does_not_stop_it(planner, monkeypatch):
    """The control, which counts what moves as standing where it will be after its prediction, stops."""
    start, goal, direct = planner.skill.start_pose, planner.skill.goal_pose, nominal(planner).reference
    velocity, meeting = np.array([0.0, 0.2, 0.0]), 0.5 * direct.duration

    def passing(now: float) -> Obstacles:
        return moving(goal[:3] + (now - meeting) * velocity, velocity, now)

    for now, follower, plan, gap in played(planner, start, passing, direct.duration + 0.1):  # noqa: B007
        assert plan.verdict.ok, f"after {now} s: {plan.verdict}"
        assert gap > 0.0
    np.testing.assert_allclose(follower.position, goal[:3], atol=1e-6)
    solve = planner._solver.solve
    refused = Plan(None, Verdict(VerdictCode.NO_FEASIBLE_PATH))
    monkeypatch.setattr(
        planner._solver, "solve", lambda *given, trusting=False: refused if trusting else solve(*given)
    )
    stopped = [not plan.verdict.ok for *_, plan, _ in played(planner, start, passing, direct.duration + 0.1)]
    assert any(stopped)


def test_a_tool_without_a_way_gives_way_to_what_comes_to_it_and_goes_on_later(planner, monkeypatch):
    """The control stays, and is touched."""
    direct = nominal(planner).reference
    place, quaternion = direct.sample(0.4 * direct.duration)
    along = direct.velocity(0.4 * direct.duration)[:3]
    across = np.cross(along, [0.0, 0.0, 1.0])
    velocity = 0.15 * across / np.linalg.norm(across)
    wall = [planner.skill.goal_pose[:3]], [0.05]

    def coming(now: float) -> Obstacles:
        return moving(place + (now - 3.0) * velocity, velocity, now, wall if now < 5.0 else NOTHING)

    start = np.append(place, quaternion)
    codes, reasons, gaps = [], [], []
    for now, follower, plan, gap in played(planner, start, coming, 12.0):  # noqa: B007
        gaps.append(gap)
        if now < 5.0:
            codes.append(plan.verdict.code)
            reasons.append(plan.verdict.reason)
    assert min(gaps) > 0.0
    assert set(codes) == {VerdictCode.NO_FEASIBLE_PATH}
    assert any(reason.endswith("; giving way to what is coming") for reason in reasons)
    np.testing.assert_allclose(follower.position, planner.skill.goal_pose[:3], atol=1e-6)
    monkeypatch.setattr(planner._giving_way, "plan", lambda *_: None)
    assert min(gap for *_, gap in played(planner, start, coming, 4.0)) < -0.03


def test_a_tool_that_nothing_comes_to_stays_where_it_has_no_way(planner):
    direct = nominal(planner).reference
    place, quaternion = direct.sample(0.4 * direct.duration)
    velocity, wall = np.array([0.0, 0.15, 0.0]), ([planner.skill.goal_pose[:3]], [0.05])

    def passing(now: float) -> Obstacles:
        return moving(place + [0.0, 0.0, 0.2] + (now - 1.0) * velocity, velocity, now, wall)

    for *_, plan, _ in played(planner, np.append(place, quaternion), passing, 2.0):
        assert plan.reference is None
        assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH


def stopping_sphere(planner: ReactivePlanner, meeting: float) -> float:
    """Least clearance [m] from a sphere that comes across at 0.6 m/s and stops on the way, before the tool gets there.

    That it stands is told 50 ms late, as its track does. meeting : when it stops, as a share of the motion.
    """
    direct = nominal(planner).reference
    place, _ = direct.sample(0.45 * direct.duration)
    across = np.cross(direct.velocity(0.45 * direct.duration)[:3], [0.0, 0.0, 1.0])
    velocity, stops = 0.6 * across / np.linalg.norm(across), meeting * direct.duration

    def coming(now: float) -> Obstacles:
        told = velocity if now < stops + 0.05 else np.zeros(3)
        return moving(place + min(now - stops, 0.0) * velocity, told, now)

    return min(gap for *_, gap in played(planner, planner.skill.start_pose, coming, stops + 1.0))


@pytest.mark.parametrize("meeting", [0.25, 0.35, 0.45])
def test_what_stops_before_it_has_passed_is_kept_off(planner, meeting):
    assert stopping_sphere(planner, meeting) > 0.01


def test_a_tool_that_counts_on_what_moves_to_move_on_all_but_touches_what_stops(planner, monkeypatch):
    monkeypatch.setattr(PoseStream, "can_still_stop", lambda *_: True)
    assert stopping_sphere(planner, 0.35) < 0.002


def test_a_stream_blocked_in_motion_comes_to_rest_along_its_path_without_overlap(planner):
    direct = nominal(planner).reference
    limit = planner.settings.acceleration * PERIOD * 1.01
    half, quarter = (direct.positions[len(direct.positions) // part] for part in (2, 4))
    wall = half + normalise(half - quarter) * 0.16
    speeds, offset = [], []
    for time, follower, plan in stream(planner, lambda t: NOTHING if t < 1.0 else ([wall], [0.17]), seconds=2.5):
        speeds.append(follower.speed)
        if time > 1.0:
            assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH, plan.verdict
            offset.append(np.linalg.norm(direct.positions - follower.position, axis=1).min())
    assert max(speeds) == pytest.approx(planner.settings.speed, rel=1e-3)
    assert np.min(np.diff(speeds)) >= -limit
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9)
    assert max(offset) < 0.005


def gap_to_curve(curve: np.ndarray, point: np.ndarray) -> float:
    """Distance [m] from a point (3,) to a polyline (n, 3)."""
    begin, step = curve[:-1], np.diff(curve, axis=0)
    share = np.sum((point - begin) * step, axis=1) / np.maximum(np.sum(step**2, axis=1), 1e-18)
    return float(np.linalg.norm(begin + np.clip(share, 0.0, 1.0)[:, None] * step - point, axis=1).min())


def test_a_new_goal_without_a_way_stops_the_moving_arm_along_the_old_reference(planner):
    ticks = stream(planner)
    for _ in range(100):
        _, follower, plan = next(ticks)
    follower.advance(PERIOD)
    old = plan.reference
    assert follower.speed == pytest.approx(planner.settings.speed, rel=1e-3)
    # The new goal is where the arm came from, now covered: accepted as a goal, but there is no way to it.
    start = planner.skill.start_pose
    assert planner.set_goal(start[:3], start[3:]).ok
    planner.set_obstacles(start[None, :3], [0.03])
    speeds, gaps = [follower.speed], []
    while follower.speed > 0.0:
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH, plan.verdict
        assert plan.reference is not None, f"no ramp at {follower.speed} m/s"
        follower.accept(plan.reference)
        follower.advance(PERIOD)
        # A ramp may leave out the sample nearest to where it begins: a corner cut by less than a tenth of a millimetre.
        gaps.append(gap_to_curve(old.positions, follower.position))
        speeds.append(follower.speed)
    assert np.min(np.diff(speeds)) >= -planner.settings.acceleration * PERIOD * 1.01
    assert max(gaps) < 1e-4
    resting = planner.tick(follower.position, follower.quaternion, follower.speed)
    assert resting.reference is None
    assert resting.verdict.code is VerdictCode.NO_FEASIBLE_PATH


def test_a_stop_on_request_brakes_as_hard_as_allowed_and_rests(planner):
    ticks = stream(planner)
    for _ in range(100):
        _, follower, _ = next(ticks)
    assert planner.stop(np.full(3, np.nan), follower.quaternion, follower.speed) is None
    halt = planner.stop(follower.position, follower.quaternion, follower.speed)
    np.testing.assert_allclose(halt.positions[0], follower.position, atol=1e-12)
    # A little of the acceleration is needed for the bend.
    assert halt.duration == pytest.approx(planner.settings.speed / planner.settings.acceleration, rel=0.05)
    assert halt.rate(halt.duration) == 0.0
    assert planner.stop(follower.position, follower.quaternion, 0.0) is None


def test_a_long_stop_goes_forward_all_the_way(fan_skill):
    """More than a second and 0.1 m of braking: more than the stream needs to find its pose on a reference."""
    planner = ReactivePlanner(fan_skill, PlannerSettings(acceleration=0.1))
    ticks = stream(planner)
    for _ in range(250):
        _, follower, _ = next(ticks)
    assert follower.speed > 0.7 * planner.settings.speed
    positions, speeds = [follower.position], [follower.speed]
    while follower.speed > 0.0:
        halt = planner.stop(follower.position, follower.quaternion, follower.speed)
        assert halt is not None, f"no ramp at {follower.speed} m/s"
        follower.accept(halt)
        follower.advance(PERIOD)
        positions.append(follower.position)
        speeds.append(follower.speed)
    assert np.min(np.diff(speeds)) >= -planner.settings.acceleration * PERIOD * 1.01
    steps = np.diff(positions, axis=0)
    assert np.all(np.sum(steps[1:] * steps[:-1], axis=1) >= 0.0)


def test_a_stop_that_touches_an_obstacle_keeps_its_acceleration_and_is_told(planner):
    """To hold in full motion would ask for a multiple of what the arm can do."""
    ticks = stream(planner)
    for _ in range(100):
        _, follower, _ = next(ticks)
    assert follower.speed == pytest.approx(planner.settings.speed, rel=1e-3)
    ahead = planner.tick(follower.position, follower.quaternion, follower.speed).reference.sample(0.1)[0]
    radius = np.linalg.norm(ahead - follower.position) - 0.042 + 0.17
    direction = normalise(ahead - follower.position)
    planner.set_obstacles([follower.position + direction * (radius + 0.041)], [radius])
    speeds = [follower.speed]
    while follower.speed > 0.0:
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        assert not plan.verdict.ok
        if len(speeds) == 1:
            assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
            assert "while stopping, the tool overlaps an obstacle by" in plan.verdict.reason
        follower.accept(plan.reference)
        follower.advance(PERIOD)
        speeds.append(follower.speed)
    assert np.min(np.diff(speeds)) >= -planner.settings.acceleration * PERIOD * 1.12


def test_a_plan_on_request_does_not_disturb_the_stream(fan_skill, planner):
    other = ReactivePlanner(fan_skill)
    disturbed = []
    for (_, follower, _), (_, undisturbed, _) in zip(stream(planner), stream(other), strict=True):
        planner.plan(*np.split(planner.skill.goal_pose, [3]), *np.split(planner.skill.start_pose, [3]))
        disturbed.append(np.array_equal(follower.position, undisturbed.position))
    assert all(disturbed)


def test_the_same_input_gives_the_same_bytes(fan_skill, planner):
    obstacles = crossing_sphere(planner)
    runs = [
        b"".join(follower.position.tobytes() for _, follower, _ in stream(subject, obstacles, seconds=3.0))
        for subject in (planner, ReactivePlanner(fan_skill))
    ]
    assert runs[0] == runs[1]


def test_a_stream_that_was_pushed_aside_begins_a_new_query(planner):
    ticks = stream(planner)
    for _ in range(100):
        _, follower, _ = next(ticks)
    follower.reset(follower.position + [0.0, 0.0, 0.03], follower.quaternion)
    _, follower, plan = next(ticks)
    assert plan.verdict.ok
    assert np.linalg.norm(plan.reference.positions[0] - follower.position) < 0.005


@pytest.mark.parametrize(
    ("position", "quaternion", "words"),
    [
        ([np.nan, 0, 0], [1, 0, 0, 0], "finite"),
        ([0.4, 0, np.inf], [1, 0, 0, 0], "finite"),
        ([0.4, 0, 0.3], [0, 0, 0, 0], "zero"),
        ([0.4, 0], [1, 0, 0, 0], "expected"),
    ],
)
def test_bad_poses_are_refused_with_the_reason_and_change_nothing(planner, position, quaternion, words):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    for verdict in (
        planner.set_goal(np.array(position), np.array(quaternion)),
        planner.tick(np.array(position), np.array(quaternion)).verdict,
        planner.plan(start[:3], start[3:], np.array(position), np.array(quaternion)).verdict,
    ):
        assert verdict.code is VerdictCode.BAD_INPUT
        assert words in verdict.reason
    assert planner.tick(start[:3], start[3:]).verdict.ok


def test_a_goal_far_from_the_demonstrations_is_refused_with_its_distance(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    verdict = planner.set_goal(goal[:3] + [0.0, 0.3, 0.0], goal[3:])
    assert verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert verdict.goal_offset > 0.2
    assert "maximum_offset" in verdict.reason
    np.testing.assert_allclose(planner.tick(start[:3], start[3:]).reference.positions[-1], goal[:3], atol=1e-9)


def test_a_start_far_from_the_demonstrations_is_refused(planner):
    goal = planner.skill.goal_pose
    planner.set_goal(goal[:3], goal[3:])
    plan = planner.tick(goal[:3] + [0.0, 0.0, 0.5], goal[3:])
    assert plan.verdict.code is VerdictCode.START_OUT_OF_SUPPORT


def test_without_a_goal_there_is_no_reference(planner):
    start = planner.skill.start_pose
    plan = planner.tick(start[:3], start[3:])
    assert plan.reference is None
    assert plan.verdict.code is VerdictCode.NO_GOAL


@pytest.mark.parametrize(
    ("centres", "radii", "words"),
    [
        ([[0, 0, 0], [np.nan, 0, 0]], [0.1, 0.1], "obstacle 1"),
        ([[0, 0, 0]], [0.0], "positive"),
        ([[0, 0, 0]], [-0.1], "positive"),
        ([[0, 0, 0]], [np.inf], "obstacle 0"),
        ([[0, 0, 0]], [0.1, 0.1], "expected (o, 3)"),
        ([[0, 0], [0, 0], [0, 0]], [0.1, 0.1], "expected (o, 3)"),
        ([0, 0, 0], [0.1], "expected (o, 3)"),
    ],
)
def test_bad_obstacles_are_refused_as_a_whole_and_named(planner, centres, radii, words):
    centre = middle(planner)
    planner.set_obstacles([centre], [0.17])
    verdict = planner.set_obstacles(centres, radii)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert words in verdict.reason
    assert nominal(planner).reference is None


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"tool_radii": (0.1, 0.1)}, "one radius per point"),
        ({"tool_radii": (-0.1,)}, "negative"),
        ({"tool_radii": (np.nan,)}, "finite"),
        ({"speed": 0.0}, "speed"),
        ({"speed": -1}, "speed"),
        ({"obstacle_margin": -1}, "finite and 0 or positive"),
        ({"ambient_strength": np.nan}, "ambient_strength"),
        ({"ambient_law": "soft"}, "one of gaussian, completed, hard"),
        ({"tool_points": ((0.0, 0.0),)}, "triples"),
    ],
)
def test_impossible_settings_are_named(settings, words):
    with pytest.raises(PlanningError, match=words):
        PlannerSettings(**settings)
