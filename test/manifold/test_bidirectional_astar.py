"""From both ends the cost is Dijkstra's, whatever is among the obstacles; stopped early, what is said is true."""

import itertools
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from geodesic_motion_ros.manifold import bidirectional_astar as searches
from geodesic_motion_ros.manifold.bidirectional_astar import shortest_path_from_both_ends
from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.obstacle_weights import evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import cost_field
from geodesic_motion_ros.utils.deadline import Deadline

NO_SPHERES = np.empty((0, 3)), np.empty(0)
SHAPES = [((25, 25), 8), ((25, 25), 16), ((9, 9, 9), 26), ((5, 5, 5, 5), 80)]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
def test_from_both_ends_the_cost_is_the_same(Scene, seed, shape, neighbours):
    scene = Scene(seed, shape, neighbours)
    for obstacles in (0, 1, 5):
        evaluation = scene.reshaped(obstacles)
        source, target, landmark = scene.random.choice(len(scene.points), 3, replace=False)
        to_target = cost_field(scene.adjacency, scene.base, target)
        for margin in (0.0, 0.05):
            expected = scene.oracle(evaluation, margin, source, target)
            for near in (source, landmark):
                unseen = scene.among(evaluation.centres, evaluation.radii)
                graph = scene.adjacency, scene.base, scene.fixed, scene.shares, unseen, margin
                ends = to_target, cost_field(scene.adjacency, scene.base, near), source, target
                found = shortest_path_from_both_ends(*graph, *ends)
                cost = found.cost
                assert cost == pytest.approx(expected, rel=1e-9)
                if not np.isfinite(cost):
                    continue
                scene.check(found, unseen, margin, source, target)
                assert np.isinf(shortest_path_from_both_ends(*graph, *ends, cap=cost * (1.0 - 1e-9))[2])
                again = shortest_path_from_both_ends(*graph, *ends, cap=cost * (1.0 + 1e-9))[2]
                assert again == pytest.approx(cost, rel=1e-12)


@pytest.mark.parametrize(("shape", "neighbours"), [((25, 25), 16), ((9, 9, 9), 26), ((5, 5, 5, 5), 80)])
def test_among_obstacles_of_all_kinds_the_cost_is_that_of_dijkstra(Scene, shape, neighbours):
    lengthened = 0
    for seed in range(10):
        scene = Scene(seed, shape, neighbours)
        source, target = scene.random.choice(len(scene.points), 2, replace=False)
        free = scene.oracle(scene.reshaped(0), 0.0, source, target)
        for _ in range(10):
            obstacles = scene.obstacles(*scene.random.integers(0, 4, size=3))
            margin = float(scene.random.choice([0.0, 0.02]))
            found = scene.from_both_ends(scene.among_all(obstacles), margin, source, target)
            expected = scene.oracle(scene.among_all(obstacles), margin, source, target)
            assert found.cost == pytest.approx(expected, rel=1e-9)
            lengthened += free < expected < np.inf
    assert lengthened > 20


def test_when_all_obstacles_have_vanished_the_path_is_what_it_was_to_the_last_bit(Scene):
    scene = Scene(1, (30, 30), 16)
    source, target = 3, len(scene.points) - 3
    before = scene.from_both_ends(scene.reshaped(0), 0.0, source, target)
    for _ in range(40):
        obstacles = scene.obstacles(*scene.random.integers(0, 3, size=3))
        scene.from_both_ends(scene.among_all(obstacles), 0.01, *scene.random.choice(len(scene.points), 2))
    evaluation = scene.reshaped(0)
    after = scene.from_both_ends(evaluation, 0.0, source, target)
    np.testing.assert_array_equal(after.nodes, before.nodes)
    np.testing.assert_array_equal(after.edges, before.edges)
    assert after.cost == before.cost
    evaluate_nodes(np.arange(len(scene.points)), evaluation)
    np.testing.assert_array_equal(evaluation.factors, 1.0)
    assert not np.any(evaluation.affected)


def test_the_order_of_obstacles_does_not_matter_and_one_far_away_changes_nothing(Scene):
    scene = Scene(4, (30, 30), 16)
    source, target = 3, len(scene.points) - 3
    centres = scene.points[scene.random.integers(len(scene.points), size=5), 0]
    radii = scene.random.uniform(0.05, 0.15, 5)
    one = scene.from_both_ends(scene.among(centres, radii), 0.0, source, target)
    other = scene.from_both_ends(scene.among(centres[::-1], radii[::-1]), 0.0, source, target)
    far = np.concatenate([centres, [[9.0, 9.0, 9.0]]]), np.append(radii, 0.1)
    same = scene.from_both_ends(scene.among(*far), 0.0, source, target)
    assert other.cost == pytest.approx(one.cost, rel=1e-12)
    assert same.cost == one.cost
    np.testing.assert_array_equal(same.nodes, one.nodes)


def test_with_its_axes_exchanged_a_graph_has_the_exchanged_path(Scene):
    scene = Scene(6, (25, 25), 8)
    evaluation = scene.reshaped(3)
    source, target = 3, len(scene.points) - 3
    found = scene.from_both_ends(evaluation, 0.0, source, target)
    order = scene.random.permutation(len(scene.points))
    number = np.argsort(order)
    exchanged = Scene(6, (25, 25), 8)
    exchanged.points, exchanged.edges = scene.points[order], number[scene.edges]
    exchanged.adjacency = Adjacency.from_edges(exchanged.edges, len(order))
    among = exchanged.among(evaluation.centres, evaluation.radii)
    again = exchanged.from_both_ends(among, 0.0, number[source], number[target])
    assert again.cost == pytest.approx(found.cost, rel=1e-12)
    np.testing.assert_array_equal(order[again.nodes], found.nodes)


def test_searches_at_the_same_time_do_not_disturb_each_other(Scene):
    scene = Scene(2, (60, 60), 16)
    ends = [tuple(scene.random.choice(len(scene.points), 2, replace=False)) for _ in range(60)]
    alone = [scene.from_both_ends(scene.reshaped(0), 0.0, *pair).cost for pair in ends]
    with ThreadPoolExecutor(4) as pool:
        costs = list(pool.map(lambda pair: scene.from_both_ends(scene.among(*NO_SPHERES), 0.0, *pair).cost, ends))
    assert costs == alone


def test_from_both_ends_an_enclosed_goal_is_found_out_soon(Scene):
    scene = Scene(0, (60, 60), 8)
    target = len(scene.points) // 2
    around = scene.adjacency.node[scene.adjacency.first[target] : scene.adjacency.first[target + 1]]
    fields = (cost_field(scene.adjacency, scene.base, end) for end in (target, 0))
    wall = scene.among(scene.points[around, 0], np.full(len(around), 1e-3))
    graph = scene.adjacency, scene.base, scene.fixed, scene.shares, wall, 0.0
    assert np.isinf(shortest_path_from_both_ends(*graph, *fields, 0, target)[2])
    assert np.count_nonzero(wall.evaluated) < 0.1 * len(wall.evaluated)


class Countdown(Deadline):
    """Has passed when it was asked so many times."""

    def __init__(self, times: int) -> None:
        super().__init__(0.0)
        object.__setattr__(self, "left", times)

    @property
    def passed(self) -> bool:
        object.__setattr__(self, "left", self.left - 1)
        return self.left <= 0

    @property
    def halfway(self) -> Deadline:
        return self


@pytest.mark.parametrize(("shape", "neighbours"), [((60, 60), 16), ((14, 14, 14), 26)])
def test_stopped_at_any_time_the_answer_is_a_path_with_a_true_gap_or_none_with_a_true_bound(
    Scene, shape, neighbours, monkeypatch
):
    monkeypatch.setattr(searches, "_BATCHES", 1)
    stops = 0
    for seed in range(6):
        scene = Scene(seed, shape, neighbours)
        ends = 3, len(scene.points) - 3
        evaluation = scene.reshaped(8)
        whole = scene.from_both_ends(evaluation, 0.0, *ends)
        assert whole.bound == whole.cost
        assert whole.gap == 0.0
        bound, cost = 0.0, np.inf
        for times in itertools.count(1):
            found = scene.from_both_ends(evaluation, 0.0, *ends, deadline=Countdown(times))
            assert bound <= found.bound <= whole.cost * (1.0 + 1e-12)
            assert whole.cost * (1.0 - 1e-12) <= found.cost <= cost
            bound, cost = found.bound, found.cost
            if np.isfinite(cost):
                scene.check(found, evaluation, 0.0, *ends)
                assert cost <= (1.0 + found.gap) * whole.cost * (1.0 + 1e-12)
            else:
                assert len(found.nodes) == 0
            if bound == cost:
                break
            stops += 1
        assert cost == whole.cost
        np.testing.assert_array_equal(found.nodes, whole.nodes)
    assert stops > 10


def test_a_search_in_a_hurry_finds_some_path_long_before_the_cheapest(Scene, monkeypatch):
    monkeypatch.setattr(searches, "_BATCHES", 1)
    patience = searches._PATIENCE
    scene = Scene(0, (30, 30, 30), 26)
    ends = 3, len(scene.points) - 3
    path = scene.points[scene.from_both_ends(scene.reshaped(0), 0.0, *ends).nodes, 0]
    middle = path[len(path) // 2]
    for radius in (0.2, 0.4):
        evaluation = scene.among(middle[None], np.array([radius]))
        whole = scene.from_both_ends(evaluation, 0.0, *ends)
        answers = []
        for looks in (1 << 30, patience):
            monkeypatch.setattr(searches, "_PATIENCE", looks)
            answers.append(scene.from_both_ends(evaluation, 0.0, *ends, deadline=Countdown(patience + 6)))
        slow, hurried = answers
        assert math.isinf(slow.cost)
        assert whole.cost < hurried.cost < 5.0 * whole.cost
        assert hurried.bound < whole.cost
        scene.check(hurried, evaluation, 0.0, *ends)


def test_a_search_in_a_hurry_that_has_reached_every_node_it_can_knows_that_there_is_no_path(Scene, monkeypatch):
    monkeypatch.setattr(searches, "_BATCHES", 1)
    monkeypatch.setattr(searches, "_PATIENCE", 1)
    scene = Scene(0, (30, 30, 30), 26)
    ends = 3, len(scene.points) - 3
    from_start = np.linalg.norm(scene.points[:, 0] - scene.points[ends[0], 0], axis=1)
    shell = scene.points[np.abs(from_start - 0.8) < 0.1, 0]
    evaluation = scene.among(shell, np.full(len(shell), 0.1))
    # All that is left of the search is the look at the time at its begin: what is proved is proved by the other one.
    monkeypatch.setattr(searches, "_go_on", lambda *arguments: (np.inf, -1, 0.0))
    found = scene.from_both_ends(evaluation, 0.0, *ends, deadline=Countdown(100))
    assert (len(found.nodes), found.cost, found.bound) == (0, np.inf, np.inf)
