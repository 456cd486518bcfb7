"""The study of the motion filter: the policy reaches goals by its chunks, and the filter is what keeps it off."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest

from geodesic_motion_ros.utils.errors import GeodesicMotionError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.catalogue import ROWS, STUDIES, chosen
from geodesic_motion_studies.comparison.cloned_policy import ACTIONS, RATE, RENEWED, ClonedPolicy, cloned_policy
from geodesic_motion_studies.comparison.execution import Outcome, Stage
from geodesic_motion_studies.comparison.families import Family
from geodesic_motion_studies.comparison.scene import Scene, draw_scene


def played(row: str, arena: Arena, stage: Stage, scene: Scene) -> Outcome:
    for library in ROWS[row].needs:
        pytest.importorskip(library)
    return stage.play(scene, ROWS[row].make(arena))[0]


def touched(family: Family, arena: Arena, stage: Stage) -> Scene:
    """The first scene of a family whose spheres the policy alone touches."""
    scenes = (draw_scene(arena, family, number, 0) for number in count(0))
    return next(scene for scene in scenes if played("policy", arena, stage, scene).touched_moving)


def test_chunks_continue_from_where_the_arm_is_and_their_replay_ends_at_the_goal(arena: Arena) -> None:
    policy = cloned_policy(arena)
    for start, goal in ((0, -1), (5, 5), (-1, 2)):
        position, end = arena.shown[start, 0], arena.shown[goal, -1]
        for _ in range(int(12.0 / RENEWED)):
            times, positions = policy.chunk(position, end)
            assert positions.shape == (ACTIONS + 1, len(position))
            np.testing.assert_allclose(times, np.arange(ACTIONS + 1) / RATE)
            np.testing.assert_array_equal(positions[0], position)
            assert np.max(np.abs(np.diff(positions, axis=0)) * RATE) < 2.0 * np.max(arena.limits.velocity)
            position = np.array([np.interp(RENEWED, times, joint) for joint in positions.T])
        apart = np.linalg.norm(arena.robot.forward(position)[0] - arena.robot.forward(end)[0])
        assert apart < 0.01, (start, goal)


def test_the_policy_is_the_same_with_the_same_seed_and_another_with_another(
    arena: Arena, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("geodesic_motion_studies.comparison.cloned_policy.STEPS", 20)
    start, goal = arena.shown[0, 0], arena.shown[3, -1]
    one, again, other = (ClonedPolicy(arena, seed).chunk(start, goal)[1] for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert np.max(np.abs(one - other)) > 1e-3


def test_a_study_is_named_as_one_and_is_played_by_name_only() -> None:
    rows = STUDIES["filter"]
    assert all(ROWS[row].by_name for row in rows)
    if any(ROWS[row].missing for row in rows):
        with pytest.raises(GeodesicMotionError, match="is not installed"):
            chosen(("filter",))
    else:
        assert chosen(("filter", "policy", "replay")) == (*rows, "replay")


@pytest.mark.parametrize("row", STUDIES["filter"])
def test_every_row_reaches_the_goal_where_nothing_is_in_the_path(row: str, arena: Arena, stage: Stage) -> None:
    assert played(row, arena, stage, draw_scene(arena, "none", 0, 0)).success


@pytest.mark.parametrize("row", ["policy + filter", "policy + filter + detour", "policy + braking"])
def test_what_the_policy_alone_touches_is_not_touched_in_motion_through_a_filter(
    row: str, arena: Arena, stage: Stage
) -> None:
    assert not played(row, arena, stage, touched("crossing", arena, stage)).touched_moving


def test_plans_go_around_what_stands_in_the_path(arena: Arena, stage: Stage) -> None:
    assert played("RRT-Connect, 10 Hz", arena, stage, touched("static", arena, stage)).success
