"""A skill of four latent dimensions, whose nodes are sampled: it is saved, read, asked, and finds its path around."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.manifold import sampled_nodes
from geodesic_motion_ros.manifold.geodesic_refinement import refined
from geodesic_motion_ros.manifold.mean_path import LARGEST_EXPONENT
from geodesic_motion_ros.manifold.metric_field import curve_length
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation
from geodesic_motion_ros.manifold.shortest_path import cost_field, shortest_free_path
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.skill.skill import Skill

#: A brief training.
BRIEF = {
    "steps": 800, "samples": 60, "batch": 128, "hidden": (48, 32), "kernels": 100, "precision_iterations": 40,
    "precision_samples": 2,
}  # fmt: skip


@pytest.fixture(scope="module")
def skill(varying_fan, tmp_path_factory):
    """As it is read again."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampled_nodes, "MOST_NODES", 2000)
        trained = train_skill(varying_fan, TrainingSettings(latent_dimension=4, **BRIEF), name="four")
        yield Skill.load(trained.save(tmp_path_factory.mktemp("skills") / "four"))


@pytest.fixture(scope="module")
def planner(skill):
    return PosePathPlanner(skill)


def test_its_graph_is_the_same_every_time(skill, planner):
    again = skill.graph()
    np.testing.assert_array_equal(again.latent, planner.graph.latent)
    np.testing.assert_array_equal(again.edges, planner.graph.edges)
    assert planner.graph.grid.shape == again.grid.shape


def test_edges_are_as_long_as_the_metric_says_between_their_ends(skill, planner):
    """Short ones: the tensors of both ends say the same as what is integrated along the edge."""
    graph = planner.graph
    lengths = graph.transported(Offsets.none(graph.mean_path_count), np.zeros((1, 3))).base
    tensors = graph.tensors(np.zeros((1, 3)))[:, 0]
    rows, columns = np.triu_indices(4)
    step = np.diff(graph.latent[graph.edges], axis=1)[:, 0] / graph.grid.spacing
    twice = np.where(rows == columns, 1.0, 2.0)
    by_ends = [np.sqrt((twice * tensors[end] * step[:, rows] * step[:, columns]).sum(axis=1)) for end in graph.edges.T]
    alike = np.abs(np.log(by_ends[0] / by_ends[1])) < 0.2
    assert alike.sum() > 100
    np.testing.assert_allclose(np.median(lengths[alike] / by_ends[0][alike]), 1.0, atol=0.05)


def test_every_code_that_is_supported_has_a_node_within_steps(skill, planner):
    for code in skill.codes[:, ::20].reshape(-1, 4):
        near = planner.graph.nodes_near(code, 3)
        assert len(near) > 0
        assert near[0] == planner.graph.nearest_node_to(code)


def test_a_path_is_refined_to_a_shorter_one(planner):
    graph = planner.graph
    base = graph.transported(Offsets.none(graph.mean_path_count), np.zeros((1, 3))).base
    source, target = (graph.nearest_node_to(code) for code in (planner.skill.codes[0, 0], planner.skill.codes[1, -1]))
    nodes, _, _ = shortest_free_path(graph.adjacency, base, cost_field(graph.adjacency, base, target), source, target)
    field = graph.field(graph.tensors(np.zeros((1, 3))), planner.skill.mean_paths, 0.0)
    assert field.cap == LARGEST_EXPONENT
    body = NodeBody.of_tool(graph.decoded.positions[:, None], np.zeros(1))
    free = NodeEvaluation.of(body, Obstacles.none(), 1.0, 1.0, 0.0)
    path = graph.latent[nodes]
    curve = refined(field, free, 0.0, path)
    np.testing.assert_allclose(curve[[0, -1]], path[[0, -1]], atol=1e-12)
    assert curve_length(field, free, curve) < curve_length(field, free, path)


def test_it_answers_and_finds_a_path_around_a_sphere(skill, planner):
    ends = *np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3])
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    free = planner.plan(*ends)
    assert isinstance(free, PosePath)
    middle = free.positions[len(free.positions) // 2]
    planner.set_obstacles(middle[None], np.array([0.01]))
    around = planner.plan(*ends)
    assert isinstance(around, PosePath)
    assert np.linalg.norm(around.positions - middle, axis=1).min() > 0.01
