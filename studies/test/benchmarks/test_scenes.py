"""The scenes are what their names say, and no obstacle is in the arm at the start or at the goal."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.obstacle_weights import evaluate_nodes
from geodesic_motion_studies.benchmarks.engine import SearchProblem, free_path, mark, search
from geodesic_motion_studies.benchmarks.scenes import NAMES, PERIOD, Scene, scenes_of, spheres_on_path

TICKS = range(0, PERIOD, PERIOD // 10)


@pytest.fixture(scope="module")
def scenes(problem: SearchProblem) -> dict[str, Scene]:
    return {scene.name: scene for scene in scenes_of(problem)}


def felt_on_path(problem: SearchProblem, scene: Scene, tick: int) -> bool:
    path, evaluation = free_path(problem), mark(problem, scene.at(tick))
    evaluate_nodes(path, evaluation)
    return bool(np.any(evaluation.affected[path]))


def test_there_are_all_of_them_with_the_spheres_they_promise(scenes: dict[str, Scene]) -> None:
    assert tuple(scenes) == NAMES
    counts = {name: len(scene.radii) for name, scene in scenes.items()}
    assert [counts[name] for name in ("none_near", "one_r005", "one_r010", "ten_on_path")] == [10, 1, 1, 10]
    assert 20 < counts["wall_gap"] < 64
    assert counts["cloud_10k"] > 5000
    assert len(scenes["cloud_10k"].at(0).cloud.occupied) > 500
    assert scenes["one_r010"].radii == [0.10]


def test_what_is_not_near_is_not_felt_and_what_is_on_the_path_is(
    problem: SearchProblem, scenes: dict[str, Scene]
) -> None:
    for tick in TICKS:
        assert not felt_on_path(problem, scenes["none_near"], tick)
        on_path = ("one_r005", "one_r010", "ten_on_path", "wall_gap")
        assert all(felt_on_path(problem, scenes[name], tick) for name in on_path)


@pytest.mark.parametrize(("name", "end"), [("goal_enclosed", "target"), ("start_enclosed", "source")])
def test_an_enclosure_has_no_hole_but_where_the_arm_is(
    name: str, end: str, problem: SearchProblem, scenes: dict[str, Scene]
) -> None:
    centres = scenes[name].at(0).centres
    node = getattr(problem, end)
    around = np.random.default_rng(0).normal(size=(2000, 3))
    around *= 0.22 / np.linalg.norm(around, axis=1, keepdims=True)
    places = problem.body.points[node, problem.tool] + around
    to_arm = np.min(np.linalg.norm(places[:, None] - problem.body.spheres[node], axis=2) - 0.04, axis=1)
    to_spheres = np.min(np.linalg.norm(places[:, None] - centres, axis=2), axis=1) - 0.05
    assert np.all(to_spheres[to_arm > 0.16] < 0.02)
    assert np.mean(to_arm > 0.16) > 0.5


def test_the_path_through_the_gap_is_a_detour(problem: SearchProblem, scenes: dict[str, Scene]) -> None:
    free = problem.to_goal[problem.source]
    for tick in TICKS:
        answer = search(problem, mark(problem, scenes["wall_gap"].at(tick)), limited=False)
        assert 1.05 * free < answer.cost < np.inf


@pytest.mark.parametrize("name", NAMES)
def test_the_arm_is_free_at_both_ends(name: str, problem: SearchProblem, scenes: dict[str, Scene]) -> None:
    ends = np.array([problem.source, problem.target])
    for tick in TICKS:
        evaluation = mark(problem, scenes[name].at(tick))
        evaluate_nodes(ends, evaluation)
        assert np.all(evaluation.clearance[ends] >= problem.settings.obstacle_margin)


@pytest.mark.parametrize("name", NAMES)
def test_spheres_swing_as_fast_as_it_is_said(name: str, scenes: dict[str, Scene]) -> None:
    before, now, after = (scenes[name].at(tick) for tick in (19, 20, 21))
    swung = (after.centres - before.centres) / (after.time - before.time)
    np.testing.assert_allclose(now.velocities, swung, rtol=2e-3, atol=1e-6)
    assert np.all(np.linalg.norm(now.velocities, axis=1) > 0.0)
    np.testing.assert_allclose(scenes[name].at(20 + PERIOD).centres, now.centres)


@pytest.mark.parametrize("count", [0, 1, 7])
def test_any_number_of_spheres_can_be_on_the_path(count: int, problem: SearchProblem) -> None:
    obstacles = spheres_on_path(problem, count).at(3)
    assert (obstacles.centres.shape, obstacles.radii.shape) == ((count, 3), (count,))
