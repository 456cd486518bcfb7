"""Refined curves: never longer, between the same ends, where nodes are and obstacles are not, close to the shortest."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from geodesic_motion_ros.manifold.geodesic_refinement import _assemble, _judged, _newton_step, _smooth, refined
from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.metric_field import MetricField, curve_length, evenly, packed_tensors, piecewise
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import cost_field, shortest_path
from geodesic_motion_ros.obstacles.obstacles import Obstacles

MARGIN = 0.005
SHAPES = [((31, 31), 8), ((15, 15, 15), 26)]


class Scene:
    """A grid that is laid smoothly into the workspace of one body point, with a mean path and without some nodes."""

    def __init__(
        self, shape: tuple[int, ...], neighbours: int, seed: int = 0, kept: float = 1.0, drawn: bool = True
    ) -> None:
        self.random = np.random.default_rng(seed)
        d = len(shape)
        self.grid = LatentGrid(-np.ones(d), np.ones(d), shape)
        mask = self.random.random(math.prod(shape)) < kept
        self.latent = self.grid.nodes()[mask]
        place = self.random.normal(size=(d, 3))
        self.points = (np.tanh(0.6 * self.latent @ place) + 0.3 * self.latent[:, :1])[:, None]
        slopes = 0.6 * (1.0 - np.tanh(0.6 * self.latent @ place) ** 2)[:, :, None] * place.T
        slopes[:, :, 0] += 0.3
        unit = self.grid.spacing[:, None] * self.grid.spacing
        rest = 0.05 * np.eye(d)
        shares = slopes.swapaxes(1, 2) @ slopes
        along = np.linspace(-0.9, 0.9, 80)[:, None]
        centres = (along * np.ones(d) + 0.4 * np.cos(1.7 * along) * (np.arange(d) - 0.5 * (d - 1)))[None]
        precisions = np.broadcast_to(np.eye(d) / 0.4**2, (1, 80, d, d))
        mean_paths = MeanPaths(centres, precisions, np.zeros(1)) if drawn else None
        number = self.grid.numbering(mask)
        tensors = packed_tensors((shares * unit)[:, None], np.broadcast_to(rest * unit, shares.shape))
        self.field = MetricField.of(self.grid, number, tensors, mean_paths)
        self.edges = self.grid.edges(number, neighbours)
        self.adjacency = Adjacency.from_edges(self.edges, len(self.latent))
        conformal = mean_paths.conformal_factors(self.latent, 1.0) if mean_paths else np.ones(len(self.latent))
        first, second = self.edges.T
        factor, step = 0.5 * (conformal[first] + conformal[second]), self.latent[second] - self.latent[first]
        self.shares = factor[:, None] * np.sum((self.points[second] - self.points[first]) ** 2, axis=-1)
        self.fixed = factor * 0.05 * np.sum(step**2, axis=1)

    def among(self, centres: np.ndarray, radius: float) -> NodeEvaluation:
        body = NodeBody.of_tool(self.points, np.array([0.05]))
        obstacles = Obstacles.of_spheres(centres, np.full(len(centres), radius))
        return NodeEvaluation.of(body, obstacles, 1e3, 0.5, 4.0 * MARGIN)

    def free(self) -> NodeEvaluation:
        return self.among(np.empty((0, 3)), 0.1)

    def path(self, evaluation: NodeEvaluation) -> np.ndarray:
        """Between two random nodes that are far from each other and from obstacles; empty where there is none."""
        evaluate_nodes(np.arange(len(self.latent)), evaluation)
        free = np.flatnonzero(evaluation.clearance >= MARGIN)
        while True:
            source, target = self.random.choice(free, 2)
            if np.linalg.norm(self.latent[source] - self.latent[target]) > 1.0:
                break
        base = np.sqrt(self.fixed + self.shares.sum(axis=1))
        nodes, _, _ = shortest_path(
            self.adjacency, base, self.fixed, self.shares, evaluation, MARGIN,
            cost_field(self.adjacency, base, target), source, target,
        )  # fmt: skip
        return self.latent[nodes]


def _faults(scene: Scene, evaluation: NodeEvaluation, curve: np.ndarray) -> int:
    """Of places along a curve, one a step of the grid."""
    coordinates = scene.field.coordinates(curve)
    cells = math.ceil(np.linalg.norm(np.diff(coordinates, axis=0), axis=1).sum())
    _, support, clearance = piecewise(scene.field, evaluation, evenly(coordinates, cells))
    return int(np.count_nonzero((support < 0.5) | (clearance < MARGIN)))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
@pytest.mark.parametrize("kept", [1.0, 0.93])
def test_refined_is_between_the_same_ends_and_never_longer_whatever_obstacles_there_are(shape, neighbours, kept, seed):
    scene = Scene(shape, neighbours, seed, kept)
    for count in (0, 3):
        evaluation = scene.among(scene.points[scene.random.integers(len(scene.points), size=count), 0], 0.12)
        path = scene.path(evaluation)
        if len(path) < 2:
            continue
        curve = refined(scene.field, evaluation, MARGIN, path)
        np.testing.assert_allclose(curve[[0, -1]], path[[0, -1]], rtol=0.0, atol=1e-12)
        # Judged by other pieces than those that the refinement went by.
        lengths = [curve_length(scene.field, evaluation, one, 3000) for one in (curve, path)]
        assert lengths[0] <= 1.02 * lengths[1]
        if kept == 1.0:
            assert _faults(scene, evaluation, curve) <= _faults(scene, evaluation, path) + 1
        assert np.array_equal(curve, refined(scene.field, evaluation, MARGIN, path))


def test_where_the_metric_changes_within_a_piece_it_is_no_longer_than_what_was_begun_from():
    """Newton's steps go by the middles of pieces, which then tell too little."""
    compared = 0
    for seed in range(40):
        scene = Scene((15, 15, 15), 26, seed, drawn=False)
        rough = np.exp(scene.random.normal(scale=2.5, size=(len(scene.field.tensors), 1, 1)))
        field = scene.field._replace(tensors=scene.field.tensors * rough)
        path, free = scene.path(scene.free()), scene.free()
        coordinates = field.coordinates(path)
        cells = float(np.linalg.norm(np.diff(coordinates, axis=0), axis=1).sum())
        begun = evenly(coordinates, max(8, math.ceil(cells)))
        smoothed = begun.copy()
        _smooth(begun, smoothed)
        pieces = [np.sum(np.sqrt(piecewise(field, free, one)[0])) for one in (begun, smoothed)]
        if pieces[1] >= pieces[0]:
            continue
        curve = field.coordinates(refined(field, free, MARGIN, path))
        lengths = [_judged(field, free, MARGIN, one, cells)[1] for one in (curve, smoothed)]
        assert lengths[0] <= lengths[1] * (1.0 + 1e-9)
        compared += 1
    assert compared > 10


def test_in_a_flat_space_it_is_straight():
    scene = Scene((15, 15, 15), 26, drawn=False)
    flat = np.broadcast_to(scene.field.tensors[:1], scene.field.tensors.shape)
    field = scene.field._replace(tensors=np.ascontiguousarray(flat))
    corner = scene.latent[[0, -30]]
    around = np.stack([corner[0], [-0.5, 0.5, 0.0], corner[1]])
    curve = refined(field, scene.free(), MARGIN, around)
    straight = curve_length(field, scene.free(), corner)
    assert curve_length(field, scene.free(), around) > 1.05 * straight
    assert curve_length(field, scene.free(), curve) == pytest.approx(straight, rel=1e-6)


def test_among_obstacles_it_keeps_off_them_where_straightening_alone_would_not():
    scene = Scene((31, 31), 8, drawn=False)
    middle = len(scene.latent) // 2
    evaluation = scene.among(scene.points[middle], 0.2)
    ends = np.array([[-0.9, 0.0], [0.9, 0.0]])
    source, target = (int(np.argmin(np.sum((scene.latent - end) ** 2, axis=1))) for end in ends)
    base = np.sqrt(scene.fixed + scene.shares.sum(axis=1))
    nodes, _, _ = shortest_path(
        scene.adjacency, base, scene.fixed, scene.shares, evaluation, MARGIN,
        cost_field(scene.adjacency, base, target), source, target,
    )  # fmt: skip
    path = scene.latent[nodes]
    curve = refined(scene.field, evaluation, MARGIN, path)
    straight = scene.latent[[source, target]]
    assert _faults(scene, evaluation, straight) > 0
    assert _faults(scene, evaluation, curve) == 0
    lengths = [curve_length(scene.field, evaluation, one) for one in (curve, path, straight)]
    assert lengths[0] < lengths[1] < lengths[2]


@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
def test_the_gradient_is_that_of_the_energy_and_the_hessian_is_positive(shape, neighbours):
    scene = Scene(shape, neighbours, seed=3)
    evaluation = scene.among(scene.points[[len(scene.points) // 2], 0], 0.15)
    field, d, count = scene.field, len(shape), 9
    curve = field.coordinates(np.linspace(-0.7, 0.63, count + 1)[:, None] * np.ones(d))
    curve += 0.2 * scene.random.normal(size=curve.shape)
    weights, nearest = scene.random.uniform(0.5, 2.0, count), np.full((count, 1), 40)
    nodes = np.full(count, -1)
    rest = [np.empty(count) for _ in range(3)]
    blocks = np.empty((count + 1, d)), np.empty((count + 1, d, d)), np.empty((count, d, d))

    def energy(points: np.ndarray) -> float:
        return _assemble(field, evaluation, points, weights, nearest, nodes, *rest, *blocks)

    energy(curve)
    gradient, diagonal, beside = (block.copy() for block in blocks)
    for i in range(count + 1):
        for a in range(d):
            ahead, behind = curve.copy(), curve.copy()
            ahead[i, a] += 1e-6
            behind[i, a] -= 1e-6
            change = (energy(ahead) - energy(behind)) / 2e-6
            assert change == pytest.approx(gradient[i, a], rel=1e-4, abs=1e-5 * np.abs(gradient).max())
    whole = np.zeros((count + 1, d, count + 1, d))
    for i in range(count + 1):
        whole[i, :, i] = diagonal[i]
    for i in range(count):
        whole[i, :, i + 1], whole[i + 1, :, i] = beside[i], beside[i].T
    inner = whole[1:-1, :, 1:-1].reshape((count - 1) * d, -1)
    assert np.allclose(inner, inner.T)
    assert np.linalg.eigvalsh(inner).min() > 0.0
    expected = np.linalg.solve(inner, -gradient[1:-1].reshape(-1))
    fixed = np.zeros(count + 1, dtype=bool)
    step = _newton_step(gradient, diagonal, beside, fixed)
    np.testing.assert_allclose(step[1:-1].reshape(-1), expected, rtol=1e-6, atol=1e-9)
    assert not np.any(step[[0, -1]])
    fixed[4] = True
    apart = np.delete(np.arange(inner.shape[0]), 3 * d + np.arange(d))
    expected = np.linalg.solve(inner[np.ix_(apart, apart)], -gradient[1:-1].reshape(-1)[apart])
    step = _newton_step(gradient, diagonal, beside, fixed)
    np.testing.assert_allclose(step[1:-1].reshape(-1)[apart], expected, rtol=1e-6, atol=1e-9)
    assert not np.any(step[[0, 4, -1]])


@pytest.mark.parametrize("seed", range(3))
def test_it_comes_close_to_what_a_slow_descent_finds_and_the_graphs_path_does_not(seed):
    scene = Scene((15, 15, 15), 26, seed)
    evaluation = scene.free()
    path = scene.path(evaluation)
    curve = refined(scene.field, evaluation, MARGIN, path)
    lengths = [curve_length(scene.field, evaluation, one) for one in (path, curve)]
    best = min(lengths[1], curve_length(scene.field, evaluation, _descended(scene, evaluation, path)))
    assert lengths[1] <= 1.02 * best
    assert lengths[0] > 1.02 * best


def _descended(scene: Scene, evaluation: NodeEvaluation, path: np.ndarray) -> np.ndarray:
    """L-BFGS on the energy of many pieces, with differences for derivatives."""
    points = evenly(scene.field.coordinates(path), 60)
    shape = points[1:-1].shape

    def placed(inner: np.ndarray) -> np.ndarray:
        return np.concatenate([points[:1], inner.reshape(shape), points[-1:]])

    def energy(inner: np.ndarray) -> tuple[float, np.ndarray]:
        curve, slopes = placed(inner), np.zeros_like(points)
        for axis in range(shape[1]):
            for first in (1, 2):
                moved = np.arange(first, 60, 2)
                ahead, behind = curve.copy(), curve.copy()
                ahead[moved, axis] += 1e-5
                behind[moved, axis] -= 1e-5
                change = piecewise(scene.field, evaluation, ahead)[0] - piecewise(scene.field, evaluation, behind)[0]
                slopes[moved, axis] = (change[moved - 1] + change[moved]) / 2e-5
        return float(piecewise(scene.field, evaluation, curve)[0].sum()), slopes[1:-1].reshape(-1)

    found = minimize(energy, points[1:-1].reshape(-1), jac=True, method="L-BFGS-B", options={"maxiter": 300})
    return scene.field.latent(placed(found.x))
