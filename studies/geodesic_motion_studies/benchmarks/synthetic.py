"""A large graph that no training made: a random smooth decoder into a Panda's joints, and three tubes to run through.

Every node of the grid is kept. Latent points are decoded by a network d-100-200-7 with random weights; edges weigh what
the body points and the joints move between their ends, times a conformal factor that grows with the distance from the
tubes: around them lengths are up to `WALL` times longer.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.metric_field import MetricField, packed_tensors
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.perceptron import Perceptron
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.robot.body_points import BodyPoints, place_body_points, points_along_links
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.benchmarks.engine import SearchProblem

#: Lengths far from the tubes over those inside; and a tube's width in the latent box [-1, 1]^d.
WALL, WIDTH = 1e4, 0.15
TUBES = 3
#: Share of the joints' ranges that is used, and the radius of the body's points [m].
RANGE, BODY_RADIUS = 0.6, 0.04
#: Neighbours of a node, by the number of latent dimensions.
NEIGHBOURS = {2: 8, 3: 26, 4: 80}


class _RandomDecoder(Perceptron):
    network = "random decoder"


def synthetic_problem(shape: tuple[int, ...], points: int = 8, seed: int = 0) -> SearchProblem:
    """The graph of a grid of 2, 3 or 4 dimensions with a number of body points, from one end of the tubes to the other.

    The same for the same seed.
    """
    robot, dimension = Robot.named("panda"), len(shape)
    grid = synthetic_grid(shape)
    latent = grid.nodes()
    tubes, configurations = _decoded(latent, robot, seed)
    chosen = _along_arm(robot, points)
    placed = place_body_points(configurations, chosen.frames, chosen.offsets, robot.chain)
    edges = grid.edges(np.arange(len(latent)).reshape(shape), NEIGHBOURS[dimension])
    adjacency = Adjacency.from_edges(edges, len(latent))
    graph = _weighted(edges, configurations, placed, _conformal(latent, tubes))
    body = NodeBody.of_tool(placed, np.full(points, BODY_RADIUS))
    source, target = (int(np.argmin(np.sum((latent - tubes[0][end]) ** 2, axis=1))) for end in (0, -1))
    name = "x".join(map(str, shape))
    return SearchProblem.between(name, adjacency, graph, body, points - 1, source, target, PlannerSettings())


def synthetic_field(shape: tuple[int, ...], points: int = 8, seed: int = 0) -> MetricField:
    """The metric of `synthetic_problem` between its nodes; the tubes are its mean paths."""
    robot, grid = Robot.named("panda"), synthetic_grid(shape)
    tubes, configurations = _decoded(grid.nodes(), robot, seed)
    chosen = _along_arm(robot, points)
    placed = place_body_points(configurations, chosen.frames, chosen.offsets, robot.chain)
    moved = _slopes(placed, shape) / math.sqrt(points)
    turned = JointMetricSettings.joint_weight * _slopes(configurations, shape)
    tensors = packed_tensors(moved.swapaxes(-1, -2) @ moved, turned.swapaxes(-1, -2) @ turned)
    centres = np.stack(tubes)
    precisions = np.broadcast_to(np.eye(len(shape)) / WIDTH**2, (*centres.shape, len(shape)))
    mean_paths = MeanPaths(centres, precisions, np.zeros(TUBES))
    number = np.arange(math.prod(shape)).reshape(shape)
    return MetricField.of(grid, number, tensors, mean_paths, 1.0, 2.0 * math.log(WALL))


def _slopes(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Central differences per step of the grid, (n, ..., d), of values (n, ...) at its nodes."""
    differences = np.gradient(values.reshape(*shape, *values.shape[1:]), axis=tuple(range(len(shape))))
    return np.stack(differences, axis=-1).reshape(*values.shape, len(shape))


def synthetic_grid(shape: tuple[int, ...]) -> LatentGrid:
    """The box [-1, 1]^d."""
    return LatentGrid(-np.ones(len(shape)), np.ones(len(shape)), shape)


def _decoded(latent: np.ndarray, robot: Robot, seed: int) -> tuple[list[np.ndarray], np.ndarray]:
    """The tubes' centre lines, and configurations (n, eta) [rad] of latent points (n, d)."""
    random, dimension = np.random.default_rng(seed), latent.shape[1]
    tubes = _tubes(dimension, random)
    outputs = _decoder(dimension, len(robot.ready), random).outputs(latent)
    middle, half = 0.5 * (robot.upper + robot.lower), 0.5 * (robot.upper - robot.lower)
    return tubes, middle + RANGE * half * np.tanh(outputs)


def _decoder(dimension: int, joints: int, random: np.random.Generator) -> _RandomDecoder:
    sizes = (dimension, 100, 200, joints)
    weights = [random.normal(scale=1.0 / math.sqrt(size), size=(after, size)) for size, after in pairwise(sizes)]
    biases = [random.normal(scale=0.3, size=size) for size in sizes[1:]]
    return _RandomDecoder(weights[0], biases[0], weights[1], biases[1], weights[2], biases[2])


def _tubes(dimension: int, random: np.random.Generator) -> list[np.ndarray]:
    """Centre lines (200, d) that share their ends and bulge away from each other between them."""
    along = np.linspace(-0.8, 0.8, 200)[:, None] * np.ones(dimension)
    lines = []
    for _ in range(TUBES):
        bulge = random.normal(size=dimension)
        bulge -= bulge.mean()
        bulge *= random.uniform(0.4, 0.7) / np.linalg.norm(bulge)
        lines.append(along + np.cos(0.5 * np.pi * along[:, :1] / 0.8) * bulge)
    return lines


def _conformal(latent: np.ndarray, tubes: list[np.ndarray]) -> np.ndarray:
    """Factor of the squared lengths at latent points, (n,): 1 in the middle of a tube, WALL^2 far away."""
    distance, _ = cKDTree(np.concatenate(tubes)).query(latent)
    return np.exp(np.minimum((distance / WIDTH) ** 2, 2.0 * math.log(WALL)))


def _along_arm(robot: Robot, points: int) -> BodyPoints:
    """So many points evenly chosen from the base to the tool, the tool the last."""
    every = BodyPoints.of(robot, points_along_links(robot, 0.03))
    order = np.argsort(every.frames, kind="stable")
    chosen = order[np.linspace(len(order) - 1, 0, points, endpoint=False).astype(int)[::-1]]
    return BodyPoints(tuple(every.names[i] for i in chosen), every.frames[chosen], every.offsets[chosen])


def _weighted(
    edges: np.ndarray, configurations: np.ndarray, placed: np.ndarray, conformal: np.ndarray
) -> WeightedGraph:
    """As `ConfigurationGraph.transported` makes them, of means alone."""
    first, second = edges.T
    factor = 0.5 * (conformal[first] + conformal[second])
    turned = np.sum((configurations[second] - configurations[first]) ** 2, axis=1)
    fixed = factor * JointMetricSettings.joint_weight**2 * turned
    shares = np.empty((len(edges), placed.shape[1]))
    for k in range(placed.shape[1]):
        moved = np.sum((placed[second, k] - placed[first, k]) ** 2, axis=1)
        shares[:, k] = factor * moved / placed.shape[1]
    return WeightedGraph(edges, placed, factor, fixed, shares, np.sqrt(fixed + shares.sum(axis=1)))
