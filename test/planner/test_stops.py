"""How the tool comes to rest: on request, before a way back, where the way is blocked."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.planner import PlannerSettings
from geodesic_motion_ros.quaternions import normalise
from geodesic_motion_ros.verdict import VerdictCode

PERIOD = 0.01
NOTHING = (np.empty((0, 3)), np.empty(0))


def test_a_stop_before_a_way_back_is_gone_to_its_end_without_looking_again_while_nothing_changes(planner, monkeypatch):
    """Obstacles that move meanwhile are looked at in the same tick."""
    looks, solve = [], planner._solver.solve

    def recorded(*arguments):
        looks.append(arguments)
        return solve(*arguments)

    start = planner.skill.start_pose
    *_, (_, follower, _) = planner.stream(seconds=1.0)
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
    assert len(stopping) > 0.95 * planner.settings.speed / planner.settings.acceleration / PERIOD
    assert stopping[0][0] == 1
    assert all(count == 1 for count, moved in stopping if moved)
    assert sum(count for count, _ in stopping) <= 1 + 3 + 1
    for _ in range(600):
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        follower.accept(plan.reference)
        follower.advance(PERIOD)
    np.testing.assert_allclose(follower.position, start[:3], atol=1e-6)


def test_a_stream_blocked_in_motion_comes_to_rest_along_its_path_without_overlap(planner):
    direct = planner.nominal().reference
    limit = planner.settings.acceleration * PERIOD * 1.01
    half, quarter = (direct.positions[len(direct.positions) // part] for part in (2, 4))
    wall = half + normalise(half - quarter) * 0.16
    speeds, offset = [], []
    for time, follower, plan in planner.stream(lambda t: NOTHING if t < 1.0 else ([wall], [0.17]), seconds=2.5):
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
    ticks = planner.stream()
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
    ticks = planner.stream()
    for _ in range(100):
        _, follower, _ = next(ticks)
    assert planner.stop(np.full(3, np.nan), follower.quaternion, follower.speed) is None
    halt = planner.stop(follower.position, follower.quaternion, follower.speed)
    np.testing.assert_allclose(halt.positions[0], follower.position, atol=1e-12)
    # A little of the acceleration is needed for the bend.
    assert halt.duration == pytest.approx(planner.settings.speed / planner.settings.acceleration, rel=0.05)
    assert halt.rate(halt.duration) == 0.0
    assert planner.stop(follower.position, follower.quaternion, 0.0) is None


def test_a_long_stop_goes_forward_all_the_way(another):
    """More than a second and 0.1 m of braking: more than the stream needs to find its pose on a reference."""
    planner = another(PlannerSettings(acceleration=0.1))
    ticks = planner.stream()
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
    ticks = planner.stream()
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
