"""Spheres that the planner is told to move: they cross, come, pass and stop; scenes come with a control."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner import Plan
from geodesic_motion_ros.pose_stream import PoseStream
from geodesic_motion_ros.reference import ReferenceFollower
from geodesic_motion_ros.verdict import Verdict, VerdictCode

PERIOD = 0.01
NOTHING = (np.empty((0, 3)), np.empty(0))


def crossing_contact(planner, told: bool, speed: float, side: float) -> tuple[float, float]:
    """A sphere crosses the way where the tool would be; its least distance [m] while the tool moves, and at the end
    the tool's from the goal. `told`: whether the planner is told that it moves.
    """
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    direct = planner.nominal().reference
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
def test_a_sphere_that_crosses_is_met_where_its_motion_is_not_known_and_not_where_it_is(planner, speed, side):
    blind, _ = crossing_contact(planner, False, speed, side)
    assert blind < -0.01
    least, left = crossing_contact(planner, True, speed, side)
    assert least > 0.01
    # It has passed, and the tool goes on by itself.
    assert left < 1e-6


def played(planner, start: np.ndarray, obstacles, seconds: float):
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
    start, goal, direct = planner.skill.start_pose, planner.skill.goal_pose, planner.nominal().reference
    velocity, meeting = np.array([0.0, 0.2, 0.0]), 0.5 * direct.duration

    def passing(now: float) -> Obstacles:
        return moving(goal[:3] + (now - meeting) * velocity, velocity, now)

    for now, follower, plan, gap in played(planner, start, passing, direct.duration + 0.1):  # noqa: B007
        assert plan.verdict.ok, f"after {now} s: {plan.verdict}"
        assert gap > 0.0
    np.testing.assert_allclose(follower.position, goal[:3], atol=1e-6)
    solve = planner._solver.solve
    refused = Plan(None, Verdict(VerdictCode.NO_FEASIBLE_PATH))
    monkeypatch.setattr(planner._solver, "solve", lambda *given, trusting=False: refused if trusting else solve(*given))
    stopped = [not plan.verdict.ok for *_, plan, _ in played(planner, start, passing, direct.duration + 0.1)]
    assert any(stopped)


def come_to(planner, above: float = 0.0):
    """A pose (7,) on the way, and spheres of which the first comes there, or so much above it [m], after 3 s.

    Another one is on the goal for 5 s.
    """
    direct = planner.nominal().reference
    place, quaternion = direct.sample(0.4 * direct.duration)
    along = direct.velocity(0.4 * direct.duration)[:3]
    across = np.cross(along, [0.0, 0.0, 1.0])
    velocity = 0.15 * across / np.linalg.norm(across)
    wall = [planner.skill.goal_pose[:3]], [0.05]

    def coming(now: float) -> Obstacles:
        met = place + [0.0, 0.0, above]
        return moving(met + (now - 3.0) * velocity, velocity, now, wall if now < 5.0 else NOTHING)

    return np.append(place, quaternion), coming


def test_a_tool_without_a_way_gives_way_to_what_comes_to_it_and_goes_on_later(planner, monkeypatch):
    """The control stays, and is touched."""
    start, coming = come_to(planner)
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


def test_a_tool_without_a_refuge_steps_aside_where_it_stands_and_goes_on_later(planner, monkeypatch):
    """The control stays, and is touched."""
    start, coming = come_to(planner, above=0.035)
    monkeypatch.setattr(planner._solver, "aside", lambda *_: None)
    gaps, off = [], 0.0
    for now, follower, _, gap in played(planner, start, coming, 12.0):
        gaps.append(gap)
        if now < 5.0:
            off = max(off, float(np.linalg.norm(follower.position - start[:3])))
    assert min(gaps) > 0.0
    assert 0.01 < off <= planner.settings.maximum_offset + 0.002
    np.testing.assert_allclose(follower.position, planner.skill.goal_pose[:3], atol=1e-6)
    monkeypatch.setattr(planner._solver, "sidestep", lambda *_: None)
    assert min(gap for *_, gap in played(planner, start, coming, 4.0)) < -0.03


def chased_to_the_goal(planner, place: float) -> tuple[float, float]:
    """A sphere comes to wherever the tool is, from beside the way at a share `place` of its duration, and is gone as
    soon as the tool is at the goal. Its least clearance [m], and what the tool is off the goal then [m].
    """
    direct, goal = planner.nominal().reference, planner.skill.goal_pose[:3]
    side = np.cross(direct.velocity(place * direct.duration)[:3], [0.0, 0.0, 1.0])
    sphere = direct.sample(place * direct.duration)[0] + 0.2 * side / np.linalg.norm(side)
    tool = planner.skill.start_pose[:3].copy()

    def chasing(now: float) -> Obstacles:
        if np.linalg.norm(tool - goal) < 1e-6:
            return Obstacles.of_spheres(np.array([[0.0, 0.0, -9.0]]), np.array([0.03]), None, now)
        velocity = 0.13 * (tool - sphere) / np.linalg.norm(tool - sphere)
        sphere[:] += PERIOD * velocity
        return moving(sphere, velocity, now)

    least = np.inf
    for _, follower, _, gap in played(planner, planner.skill.start_pose, chasing, 4.0):
        tool[:] = follower.position
        least = min(least, gap)
        if least <= 0.0:
            break
    return least, float(np.linalg.norm(tool - goal))


@pytest.mark.parametrize("place", [0.4, 0.6])
def test_a_tool_goes_past_what_chases_it_to_where_it_would_stop(planner, monkeypatch, place):
    """The control stops for it, and is touched as it stands."""
    least, left = chased_to_the_goal(planner, place)
    assert least > 0.0
    assert left < 1e-6
    monkeypatch.setattr(PoseStream, "_passes", lambda *_: False)
    least, left = chased_to_the_goal(planner, place)
    assert least <= 0.0
    assert left > 0.2


@pytest.mark.parametrize("off", [0.0, 0.04])
def test_where_a_tool_has_stepped_to_any_goal_can_be_asked_for(planner, monkeypatch, off):
    """Also where it started off what was shown: `off` [m], of 50 mm that are allowed."""
    start, coming = come_to(planner, above=0.035)
    start[2] -= off
    monkeypatch.setattr(planner._solver, "aside", lambda *_: None)

    def meeting(now: float) -> Obstacles:
        spheres = coming(now)
        spheres.centres[0, 2] -= off
        return spheres

    for now, follower, _, _ in played(planner, start, meeting, 4.0):  # noqa: B007
        if planner._stream.gives_way and follower.speed == 0.0:
            goal = np.split(planner.skill.goal_pose, [3])
            verdict = planner.plan(follower.position, follower.quaternion, *goal).verdict
            assert verdict.code is not VerdictCode.START_OUT_OF_SUPPORT
    assert np.linalg.norm(follower.position - start[:3]) > 0.02
    # Ways are looked for on the sheet as it is carried there.
    np.testing.assert_allclose(planner._query.start.position, follower.position, atol=1e-6)


def test_a_tool_that_gives_way_goes_on_doing_so_where_there_is_no_time(planner, monkeypatch):
    """As soon as it does, every tick is out of time. The control stops where it is, and is touched."""
    start, coming = come_to(planner)
    late = Plan(None, Verdict(VerdictCode.DEADLINE_MISSED, "out of time"))

    def least() -> float:
        gaps = []
        with monkeypatch.context() as patch:
            for *_, plan, gap in played(planner, start, coming, 4.5):
                gaps.append(gap)
                if plan.verdict.reason.endswith("; giving way to what is coming"):
                    patch.setattr(planner._solver, "solve", lambda *_, **__: late)
        return min(gaps)

    assert least() > 0.0
    monkeypatch.setattr(planner._giving_way, "gone_on", lambda *_: None)
    assert least() < 0.0


def test_a_tool_that_nothing_comes_to_stays_where_it_has_no_way(planner):
    direct = planner.nominal().reference
    place, quaternion = direct.sample(0.4 * direct.duration)
    velocity, wall = np.array([0.0, 0.15, 0.0]), ([planner.skill.goal_pose[:3]], [0.05])

    def passing(now: float) -> Obstacles:
        return moving(place + [0.0, 0.0, 0.2] + (now - 1.0) * velocity, velocity, now, wall)

    for *_, plan, _ in played(planner, np.append(place, quaternion), passing, 2.0):
        assert plan.reference is None
        assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH


def stopping_sphere(planner, meeting: float) -> float:
    """Least clearance [m] from a sphere that comes across at 0.8 m/s and stops on the path, before the tool gets there.

    That it stands is told 50 ms late, as its track does. meeting : when it stops, as a share of the motion.
    """
    direct = planner.nominal().reference
    place, _ = direct.sample(0.5 * direct.duration)
    across = np.cross(direct.velocity(0.5 * direct.duration)[:3], [0.0, 0.0, 1.0])
    velocity, stops = 0.8 * across / np.linalg.norm(across), meeting * direct.duration

    def coming(now: float) -> Obstacles:
        told = velocity if now < stops + 0.05 else np.zeros(3)
        return moving(place + min(now - stops, 0.0) * velocity, told, now)

    return min(gap for *_, gap in played(planner, planner.skill.start_pose, coming, stops + 1.0))


#: When it stops.
MEETINGS = [0.38, 0.42, 0.46]


@pytest.mark.parametrize("meeting", MEETINGS)
def test_what_stops_before_it_has_passed_is_kept_off(planner, meeting):
    assert stopping_sphere(planner, meeting) > 0.01


def test_a_tool_that_counts_on_what_moves_to_move_on_runs_into_what_stops(another, monkeypatch):
    """Not whenever it stops, but at some time."""
    monkeypatch.setattr(PoseStream, "objection", lambda *_: "")
    assert min(stopping_sphere(another(), meeting) for meeting in MEETINGS) < -0.01
