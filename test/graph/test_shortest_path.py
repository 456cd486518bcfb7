"""A* with the obstacle-free field against scipy's Dijkstra on the fully reweighted graph."""

import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.distance_field import DistanceField
from geodesic_motion_ros.graph import shortest_path as searches
from geodesic_motion_ros.graph.ambient import LAWS, AmbientLaw
from geodesic_motion_ros.graph.grid import Adjacency, LatentGrid
from geodesic_motion_ros.graph.node_body import NodeBody
from geodesic_motion_ros.graph.reshaping import Reshaping, look_at
from geodesic_motion_ros.graph.shortest_path import (
    ShortestPath,
    cost_field,
    edge_weight,
    shortest_free_path,
    shortest_path,
    shortest_path_from_both_ends,
)
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.solids import solid_rows


class Scene:
    """A random smooth embedding of a grid into a workspace, with K body points and a fixed part."""

    def __init__(self, seed: int, shape: tuple[int, ...], neighbours: int, body_points: int = 2) -> None:
        self.random = np.random.default_rng(seed)
        grid = LatentGrid(np.zeros(len(shape)), np.ones(len(shape)), shape)
        kept = self.random.random(np.prod(shape)) < 0.9
        nodes = grid.nodes()[kept]
        self.edges = grid.edges(grid.numbering(kept), neighbours)
        self.adjacency = Adjacency.from_edges(self.edges, len(nodes))
        waves = self.random.normal(size=(len(shape), 3 * body_points))
        self.points = np.sin(2.0 * nodes @ waves).reshape(len(nodes), body_points, 3)
        steps = self.points[self.edges[:, 0]] - self.points[self.edges[:, 1]]
        self.shares = np.sum(steps**2, axis=-1)
        self.fixed = self.random.exponential(1e-3, len(self.edges))
        self.radii = np.full(body_points, 0.02)
        self.base = np.sqrt(self.fixed + self.shares.sum(axis=1))

    def reshaped(self, count: int) -> Reshaping:
        """Among random obstacles on the nodes, each with its reach into the whole."""
        centres = self.points[self.random.integers(len(self.points), size=count), 0]
        return self.among(centres, self.random.uniform(0.05, 0.3, count))

    def among(self, centres: np.ndarray, radii: np.ndarray) -> Reshaping:
        return self.among_all(Obstacles.of_spheres(centres, radii))

    def weights(self, reshaping: Reshaping) -> np.ndarray:
        """Of all edges (m,)."""
        look_at(np.arange(len(self.points)), reshaping)
        known = self.fixed, self.shares, reshaping.factors
        return np.array([edge_weight(*known, edge, *ends) for edge, ends in enumerate(self.edges)])

    def among_all(self, obstacles: Obstacles, law: AmbientLaw = "gaussian") -> Reshaping:
        return Reshaping.of(NodeBody.of_tool(self.points, self.radii), obstacles, 1e3, 0.5, 0.1, law)

    def obstacles(self, spheres: int, solids: int, cloud: int) -> Obstacles:
        """So many of each kind on random nodes; the cloud has so many points."""
        centres, boxes, points = (
            self.points[self.random.integers(len(self.points), size=count), 0] for count in (spheres, solids, cloud)
        )
        rows = solid_rows(
            boxes, Rotation.random(solids, random_state=self.random).as_matrix(),
            self.random.uniform(0.0, 0.2, (solids, 3)), self.random.uniform(0.02, 0.1, solids),
        )  # fmt: skip
        return replace(
            Obstacles.of_spheres(centres, self.random.uniform(0.02, 0.2, spheres)), solids=rows,
            solid_velocities=np.zeros((solids, 3)), cloud=DistanceField.of(points, 0.02, 0.02, 0.05),
        )  # fmt: skip

    def from_both_ends(
        self, reshaping: Reshaping, margin: float, source: int, target: int, deadline: Deadline = NEVER
    ) -> ShortestPath:
        fields = (cost_field(self.adjacency, self.base, end) for end in (target, source))
        graph = self.adjacency, self.base, self.fixed, self.shares, reshaping, margin
        return shortest_path_from_both_ends(*graph, *fields, source, target, deadline=deadline)

    def check(self, found: ShortestPath, reshaping: Reshaping, margin: float, source: int, target: int) -> None:
        """It leads from source to target, keeps the margin, and costs what it says."""
        assert (found.nodes[0], found.nodes[-1]) == (source, target)
        assert np.all(reshaping.clearance[found.nodes[1:-1]] >= margin)
        along = [
            edge_weight(self.fixed, self.shares, reshaping.factors, e, u, v)
            for e, u, v in zip(found.edges, found.nodes[:-1], found.nodes[1:], strict=True)
        ]
        assert sum(along) == pytest.approx(found.cost, rel=1e-12)

    def oracle(self, reshaping: Reshaping, margin: float, source: int, target: int) -> float:
        """Dijkstra's cost on the fully reweighted graph without the nodes that are too near."""
        look_at(np.arange(len(reshaping.looked)), reshaping)
        mean = 0.5 * (reshaping.factors[self.edges[:, 0]] + reshaping.factors[self.edges[:, 1]])
        weights = np.sqrt(self.fixed + np.sum(mean * self.shares, axis=1))
        entered = reshaping.clearance >= margin
        entered[[source, target]] = True
        free = entered[self.edges].all(axis=1)
        rows, columns = self.edges[free].T
        graph = coo_matrix((weights[free], (rows, columns)), shape=(len(entered), len(entered)))
        return dijkstra(graph.tocsr(), directed=False, indices=source)[target]

    def solve(self, reshaping: Reshaping, margin: float, source: int, target: int, heuristic: bool = True):
        field = cost_field(self.adjacency, self.base, target)
        return shortest_path(
            self.adjacency, self.base, self.fixed, self.shares, reshaping, margin,
            field if heuristic else np.zeros(len(field)), source, target,
        )  # fmt: skip


NO_SPHERES = np.empty((0, 3)), np.empty(0)
SHAPES = [((25, 25), 8), ((25, 25), 16), ((9, 9, 9), 26), ((5, 5, 5, 5), 80)]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
def test_the_cost_is_that_of_dijkstra(seed, shape, neighbours):
    scene = Scene(seed, shape, neighbours)
    for obstacles in (0, 1, 5):
        reshaping = scene.reshaped(obstacles)
        source, target = scene.random.choice(len(scene.points), 2, replace=False)
        for margin in (0.0, 0.05):
            costs = []
            for heuristic in (True, False):
                unseen = scene.among(reshaping.centres, reshaping.radii)
                nodes, edges, cost = scene.solve(unseen, margin, source, target, heuristic)
                costs.append(cost)
                if np.isfinite(cost):
                    assert (nodes[0], nodes[-1]) == (source, target)
                    assert np.all(unseen.clearance[nodes[1:-1]] >= margin)
                    along = [
                        edge_weight(scene.fixed, scene.shares, unseen.factors, e, u, v)
                        for e, u, v in zip(edges, nodes[:-1], nodes[1:], strict=True)
                    ]
                    assert sum(along) == pytest.approx(cost, rel=1e-12)
            assert costs == pytest.approx([scene.oracle(reshaping, margin, source, target)] * 2, rel=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
def test_the_heuristic_is_exact_under_every_law(shape, neighbours, seed, law):
    scene = Scene(seed, shape, neighbours)
    obstacles = scene.obstacles(3, 1, 20)
    source, target = scene.random.choice(len(scene.points), 2, replace=False)
    # Without the removal of nodes the law alone keeps ways off.
    for margin in (-np.inf, 0.05):
        costs = [
            scene.solve(scene.among_all(obstacles, law), margin, source, target, heuristic)[2]
            for heuristic in (True, False)
        ]
        expected = scene.oracle(scene.among_all(obstacles, law), margin, source, target)
        assert costs == pytest.approx([expected] * 2, rel=1e-9)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
def test_from_both_ends_the_cost_is_the_same(seed, shape, neighbours):
    scene = Scene(seed, shape, neighbours)
    for obstacles in (0, 1, 5):
        reshaping = scene.reshaped(obstacles)
        source, target, landmark = scene.random.choice(len(scene.points), 3, replace=False)
        to_target = cost_field(scene.adjacency, scene.base, target)
        for margin in (0.0, 0.05):
            expected = scene.oracle(reshaping, margin, source, target)
            for near in (source, landmark):
                unseen = scene.among(reshaping.centres, reshaping.radii)
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
def test_among_obstacles_of_all_kinds_the_cost_is_that_of_dijkstra(shape, neighbours):
    """A thousand scenes in all."""
    lengthened = 0
    for seed in range(34):
        scene = Scene(seed, shape, neighbours)
        source, target = scene.random.choice(len(scene.points), 2, replace=False)
        for _ in range(10):
            obstacles = scene.obstacles(*scene.random.integers(0, 4, size=3))
            margin = float(scene.random.choice([0.0, 0.02]))
            found = scene.from_both_ends(scene.among_all(obstacles), margin, source, target)
            expected = scene.oracle(scene.among_all(obstacles), margin, source, target)
            assert found.cost == pytest.approx(expected, rel=1e-9)
            free = scene.oracle(scene.reshaped(0), margin, source, target)
            lengthened += free < expected < np.inf
    assert lengthened > 50


def test_when_all_obstacles_have_gone_the_path_is_what_it_was_to_the_last_bit():
    scene = Scene(1, (30, 30), 16)
    source, target = 3, len(scene.points) - 3
    before = scene.from_both_ends(scene.reshaped(0), 0.0, source, target)
    for _ in range(40):
        obstacles = scene.obstacles(*scene.random.integers(0, 3, size=3))
        scene.from_both_ends(scene.among_all(obstacles), 0.01, *scene.random.choice(len(scene.points), 2))
    reshaping = scene.reshaped(0)
    after = scene.from_both_ends(reshaping, 0.0, source, target)
    np.testing.assert_array_equal(after.nodes, before.nodes)
    np.testing.assert_array_equal(after.edges, before.edges)
    assert after.cost == before.cost
    look_at(np.arange(len(scene.points)), reshaping)
    np.testing.assert_array_equal(reshaping.factors, 1.0)
    assert not np.any(reshaping.touched)


def test_when_all_obstacles_have_gone_every_weight_is_what_it_was():
    """To the last bit, after 1 to 50 obstacles; while they are there many weigh more."""
    scene = Scene(1, (30, 30), 16)
    before = scene.weights(scene.reshaped(0))
    for count in (1, 2, 5, 10, 20, 50):
        among = scene.weights(scene.reshaped(count))
        assert np.all(among >= before)
        assert np.sum(among > before) > 50
    assert scene.weights(scene.reshaped(0)).tobytes() == before.tobytes()


def test_the_order_of_obstacles_does_not_matter_and_one_far_away_changes_nothing():
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


def test_with_its_axes_exchanged_a_graph_has_the_exchanged_path():
    scene = Scene(6, (25, 25), 8)
    reshaping = scene.reshaped(3)
    source, target = 3, len(scene.points) - 3
    found = scene.from_both_ends(reshaping, 0.0, source, target)
    order = scene.random.permutation(len(scene.points))
    number = np.argsort(order)
    exchanged = Scene(6, (25, 25), 8)
    exchanged.points, exchanged.edges = scene.points[order], number[scene.edges]
    exchanged.adjacency = Adjacency.from_edges(exchanged.edges, len(order))
    among = exchanged.among(reshaping.centres, reshaping.radii)
    again = exchanged.from_both_ends(among, 0.0, number[source], number[target])
    assert again.cost == pytest.approx(found.cost, rel=1e-12)
    np.testing.assert_array_equal(order[again.nodes], found.nodes)


def test_searches_at_the_same_time_do_not_disturb_each_other():
    scene = Scene(2, (60, 60), 16)
    ends = [tuple(scene.random.choice(len(scene.points), 2, replace=False)) for _ in range(60)]
    alone = [scene.from_both_ends(scene.reshaped(0), 0.0, *pair).cost for pair in ends]
    with ThreadPoolExecutor(4) as pool:
        costs = list(pool.map(lambda pair: scene.from_both_ends(scene.among(*NO_SPHERES), 0.0, *pair).cost, ends))
    assert costs == alone


def test_from_both_ends_an_enclosed_goal_is_found_out_soon():
    scene = Scene(0, (60, 60), 8)
    target = len(scene.points) // 2
    around = scene.adjacency.node[scene.adjacency.first[target] : scene.adjacency.first[target + 1]]
    fields = (cost_field(scene.adjacency, scene.base, end) for end in (target, 0))
    wall = scene.among(scene.points[around, 0], np.full(len(around), 1e-3))
    graph = scene.adjacency, scene.base, scene.fixed, scene.shares, wall, 0.0
    assert np.isinf(shortest_path_from_both_ends(*graph, *fields, 0, target)[2])
    assert np.count_nonzero(wall.looked) < 0.1 * len(wall.looked)


class Countdown(Deadline):
    """Has passed when it was asked so many times."""

    def __init__(self, times: int) -> None:
        super().__init__(0.0)
        object.__setattr__(self, "left", times)

    @property
    def passed(self) -> bool:
        object.__setattr__(self, "left", self.left - 1)
        return self.left <= 0


@pytest.mark.parametrize(("shape", "neighbours"), [((60, 60), 16), ((14, 14, 14), 26)])
def test_stopped_at_any_time_the_answer_is_a_path_with_a_true_gap_or_none_with_a_true_bound(
    shape, neighbours, monkeypatch
):
    monkeypatch.setattr(searches, "_BATCHES", 1)
    stops = 0
    for seed in range(6):
        scene = Scene(seed, shape, neighbours)
        ends = 3, len(scene.points) - 3
        reshaping = scene.reshaped(8)
        whole = scene.from_both_ends(reshaping, 0.0, *ends)
        assert whole.bound == whole.cost
        assert whole.gap == 0.0
        bound, cost = 0.0, np.inf
        for times in itertools.count(1):
            found = scene.from_both_ends(reshaping, 0.0, *ends, deadline=Countdown(times))
            assert bound <= found.bound <= whole.cost * (1.0 + 1e-12)
            assert whole.cost * (1.0 - 1e-12) <= found.cost <= cost
            bound, cost = found.bound, found.cost
            if np.isfinite(cost):
                scene.check(found, reshaping, 0.0, *ends)
                assert cost <= (1.0 + found.gap) * whole.cost * (1.0 + 1e-12)
            else:
                assert len(found.nodes) == 0
            if bound == cost:
                break
            stops += 1
        assert cost == whole.cost
        np.testing.assert_array_equal(found.nodes, whole.nodes)
    assert stops > 10


def test_a_search_in_a_hurry_finds_some_way_long_before_the_cheapest(monkeypatch):
    monkeypatch.setattr(searches, "_BATCHES", 1)
    patience = searches._PATIENCE
    scene = Scene(0, (30, 30, 30), 26)
    ends = 3, len(scene.points) - 3
    way = scene.points[scene.from_both_ends(scene.reshaped(0), 0.0, *ends).nodes, 0]
    middle = way[len(way) // 2]
    for radius in (0.2, 0.4):
        reshaping = scene.among(middle[None], np.array([radius]))
        whole = scene.from_both_ends(reshaping, 0.0, *ends)
        answers = []
        for looks in (1 << 30, patience):
            monkeypatch.setattr(searches, "_PATIENCE", looks)
            answers.append(scene.from_both_ends(reshaping, 0.0, *ends, deadline=Countdown(patience + 6)))
        slow, hurried = answers
        assert math.isinf(slow.cost)
        assert whole.cost < hurried.cost < 5.0 * whole.cost
        assert hurried.bound < whole.cost
        scene.check(hurried, reshaping, 0.0, *ends)


def test_a_search_in_a_hurry_that_has_reached_every_node_it_can_knows_that_there_is_no_way(monkeypatch):
    monkeypatch.setattr(searches, "_BATCHES", 1)
    monkeypatch.setattr(searches, "_PATIENCE", 1)
    scene = Scene(0, (30, 30, 30), 26)
    ends = 3, len(scene.points) - 3
    from_start = np.linalg.norm(scene.points[:, 0] - scene.points[ends[0], 0], axis=1)
    shell = scene.points[np.abs(from_start - 0.8) < 0.1, 0]
    reshaping = scene.among(shell, np.full(len(shell), 0.1))
    # All that is left of the search is the look at the time at its begin: what is proved is proved by the other one.
    monkeypatch.setattr(searches, "_go_on", lambda *arguments: (np.inf, -1, 0.0))
    found = scene.from_both_ends(reshaping, 0.0, *ends, deadline=Countdown(100))
    assert (len(found.nodes), found.cost, found.bound) == (0, np.inf, np.inf)


def test_the_obstacle_free_field_is_a_consistent_heuristic_under_obstacles():
    scene = Scene(3, (20, 20), 16)
    field = cost_field(scene.adjacency, scene.base, 7)
    reshaping = scene.reshaped(6)
    look_at(np.arange(len(reshaping.looked)), reshaping)
    weights = [
        edge_weight(scene.fixed, scene.shares, reshaping.factors, e, u, v) for e, (u, v) in enumerate(scene.edges)
    ]
    reached = np.isfinite(field[scene.edges[:, 0]])
    jump = np.abs(field[scene.edges[reached, 0]] - field[scene.edges[reached, 1]])
    assert np.all(jump <= np.array(weights)[reached] * (1.0 + 1e-12))


@pytest.mark.parametrize("seed", range(20))
def test_more_obstacles_never_shorten_a_path(seed):
    scene = Scene(seed, (20, 20), 16)
    source, target = 3, len(scene.points) - 3
    centres = scene.points[scene.random.integers(len(scene.points), size=6), 0]
    radii = scene.random.uniform(0.05, 0.2, 6)
    cost = 0.0
    for count in range(7):
        _, _, longer = scene.solve(scene.among(centres[:count], radii[:count]), 0.0, source, target)
        assert longer >= cost
        cost = longer


def test_no_way_through_a_wall_is_said():
    scene = Scene(0, (20, 20), 8)
    around = scene.adjacency.node[scene.adjacency.first[0] : scene.adjacency.first[1]]
    wall = scene.among(scene.points[around, 0], np.full(len(around), 1e-3))
    nodes, edges, cost = scene.solve(wall, 0.0, 0, len(scene.points) - 1)
    assert cost == np.inf
    assert len(nodes) == len(edges) == 0


def test_a_path_from_a_node_to_itself_is_that_node():
    scene = Scene(0, (10, 10), 8)
    nodes, edges, cost = scene.solve(scene.reshaped(0), 0.0, 4, 4)
    assert (nodes.tolist(), len(edges), cost) == ([4], 0, 0.0)
    field = cost_field(scene.adjacency, scene.base, 4)
    graph = scene.adjacency, scene.base, scene.fixed, scene.shares, scene.reshaped(0), 0.0
    nodes, edges, cost, _ = shortest_path_from_both_ends(*graph, field, field, 4, 4)
    assert (nodes.tolist(), len(edges), cost) == ([4], 0, 0.0)


def test_without_obstacles_the_short_form_finds_the_same_path():
    scene = Scene(5, (20, 20), 16)
    target = 11
    field = cost_field(scene.adjacency, scene.base, target)
    long = scene.solve(scene.reshaped(0), 0.0, 200, target)
    short = shortest_free_path(scene.adjacency, scene.base, field, 200, target)
    np.testing.assert_array_equal(short[0], long[0])
    assert short[2] == long[2] == pytest.approx(field[200], rel=1e-12)


def test_only_what_the_search_reaches_is_looked_at():
    scene = Scene(2, (20, 20), 16)
    reshaping = scene.reshaped(3)
    scene.solve(reshaping, 0.0, 200, 11)
    assert 0 < np.count_nonzero(reshaping.looked) < len(reshaping.looked)


def test_shares_of_edges_that_no_obstacle_touches_are_never_read():
    scene = Scene(2, (20, 20), 16)
    reshaping = scene.reshaped(3)
    expected = scene.solve(reshaping, 0.0, 200, 11)
    look_at(np.arange(len(reshaping.looked)), reshaping)
    untouched = ~reshaping.touched[scene.edges].any(axis=1)
    assert 0 < np.count_nonzero(untouched) < len(untouched)
    scene.shares[untouched] = np.nan
    nodes, _, cost = scene.solve(scene.among(reshaping.centres, reshaping.radii), 0.0, 200, 11)
    np.testing.assert_array_equal(nodes, expected[0])
    assert cost == expected[2]
