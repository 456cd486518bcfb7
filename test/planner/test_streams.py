"""The stream of references, tick by tick: it arrives, avoids, waits and repeats itself."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.planner import PlannerSettings
from geodesic_motion_ros.quaternions import angle_between, normalise
from geodesic_motion_ros.verdict import VerdictCode

PERIOD = 0.01
NOTHING = (np.empty((0, 3)), np.empty(0))


def test_the_stream_arrives_without_a_jump(planner):
    limit = planner.settings.speed * PERIOD * 1.001
    before = None
    for _, follower, plan in planner.stream():
        assert plan.verdict.ok, plan.verdict
        if before is not None:
            assert np.linalg.norm(follower.position - before[0]) <= limit
            assert before[1] @ follower.quaternion > 0.9999
        before = follower.position.copy(), follower.quaternion.copy()
    np.testing.assert_allclose(follower.position, planner.skill.goal_pose[:3], atol=1e-6)
    assert angle_between(follower.quaternion, planner.skill.goal_pose[3:]) < 1e-5


def crossing_sphere(planner):
    """A sphere that comes slowly from the fan's outside onto the direct path and stays."""
    centre = planner.middle()
    away = normalise(np.array([0.8, 0.0, 0.6]))

    def obstacles(time: float):
        return (centre + max(0.0, 0.15 - 0.06 * time) * away)[None], np.array([0.025])

    return obstacles


def test_a_sphere_that_moves_onto_the_path_is_avoided_by_the_stream_but_hit_by_the_control(another, planner):
    obstacles = crossing_sphere(planner)

    def smallest_gap(subject) -> float:
        gaps = []
        for time, follower, _ in subject.stream(obstacles):
            centre, radius = obstacles(time)
            gaps.append(np.linalg.norm(follower.position - centre[0]) - radius[0] - 0.04)
        np.testing.assert_allclose(follower.position, subject.skill.goal_pose[:3], atol=1e-6)
        return min(gaps)

    assert smallest_gap(another(PlannerSettings(avoidance=False))) < 0.0
    assert smallest_gap(planner) > 0.0


def test_a_blocked_stream_holds_and_goes_on_when_the_way_is_free(planner):
    centre = planner.middle()
    held, moved = [], []
    for time, follower, plan in planner.stream(  # noqa: B007
        lambda time: ([centre], [0.17]) if time < 2.0 else NOTHING, seconds=10.0
    ):
        (held if time < 2.0 else moved).append(plan.verdict.code)
    assert set(held) == {VerdictCode.NO_FEASIBLE_PATH}
    assert set(moved) == {VerdictCode.OK}
    np.testing.assert_allclose(follower.position, planner.skill.goal_pose[:3], atol=1e-6)


def test_a_plan_on_request_does_not_disturb_the_stream(another, planner):
    other = another()
    disturbed = []
    for (_, follower, _), (_, undisturbed, _) in zip(planner.stream(), other.stream(), strict=True):
        planner.plan(*np.split(planner.skill.goal_pose, [3]), *np.split(planner.skill.start_pose, [3]))
        disturbed.append(np.array_equal(follower.position, undisturbed.position))
    assert all(disturbed)


def test_the_same_input_gives_the_same_bytes(another, planner):
    obstacles = crossing_sphere(planner)
    runs = [
        b"".join(follower.position.tobytes() for _, follower, _ in subject.stream(obstacles, seconds=3.0))
        for subject in (planner, another())
    ]
    assert runs[0] == runs[1]


def test_a_stream_that_was_pushed_aside_begins_a_new_query(planner):
    ticks = planner.stream()
    for _ in range(100):
        _, follower, _ = next(ticks)
    follower.reset(follower.position + [0.0, 0.0, 0.03], follower.quaternion)
    _, follower, plan = next(ticks)
    assert plan.verdict.ok
    assert np.linalg.norm(plan.reference.positions[0] - follower.position) < 0.005
