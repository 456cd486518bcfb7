"""The picture of a whole arm's latent space: what is drawn is where it belongs, seen along the dimension left out."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.nodes.planner_node import latent_view
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization.arm_view import ArmView

NOTHING, MODEL, SIZE = Obstacles.none(), CollisionModel.named("panda"), 200


@pytest.fixture(scope="module")
def graph(reach_skill: Skill) -> ConfigurationGraph:
    return reach_skill.graph((20, 20, 20))


@pytest.fixture(scope="module")
def view(reach_skill: Skill, graph: ConfigurationGraph) -> ArmView:
    return ArmView(reach_skill, graph, MODEL, SIZE)


def pixels(skill: Skill, graph: ConfigurationGraph, latent: np.ndarray) -> np.ndarray:
    """Row and column (n, 2) of latent points (n, 3): of the two dimensions in which the demonstrations spread most."""
    spread = np.ptp(skill.codes.reshape(-1, 3), axis=0)
    across, up = np.delete(np.arange(3), np.argmin(spread))
    share = (latent - graph.grid.lower) / (graph.grid.upper - graph.grid.lower)
    return np.rint((SIZE - 1) * np.stack([1.0 - share[:, up], share[:, across]], axis=1)).astype(int)


def test_columns_are_as_red_as_the_share_of_their_nodes_that_an_obstacle_covers(reach_skill, graph, view):
    centre = Robot.named("panda").forward(graph.configurations[0])[0]
    spheres = MODEL.positions(Robot.named("panda"), graph.configurations)[:, MODEL.moving]
    apart = np.linalg.norm(spheres - centre, axis=2) - MODEL.radii[MODEL.moving]
    covered = np.min(apart, axis=1) <= 0.05
    places = [tuple(place) for place in pixels(reach_skill, graph, graph.latent).tolist()]
    nodes = {place: covered[[other == place for other in places]] for place in set(places)}
    before, after = (
        view.render(obstacles).astype(int)
        for obstacles in (NOTHING, Obstacles.of_spheres(centre[None], np.array([0.05])))
    )
    seen = {place: after[place] - before[place] for place in nodes}
    assert all(not np.any(seen[place]) for place in nodes if not np.any(nodes[place]))
    whole = [place for place in nodes if np.all(nodes[place])]
    assert whole
    for place in whole:
        np.testing.assert_allclose(after[place], 0.25 * before[place] + 0.75 * np.array([224, 72, 62]), atol=1.5)


def test_a_path_is_drawn_where_its_points_are(reach_skill, graph, view):
    path = reach_skill.codes[0]
    picture = view.render(NOTHING, path, "OK")
    rows, columns = pixels(reach_skill, graph, path).T
    inside = rows < SIZE - 20
    assert np.mean(np.all(picture[rows[inside], columns[inside]] == 255, axis=1)) > 0.8
    assert tuple(picture[rows[-1], columns[-1]]) == (255, 196, 0)


def test_where_the_decoder_is_sure_it_is_dark_and_where_there_are_no_nodes_bright(reach_skill, graph):
    view = ArmView(SimpleNamespace(codes=reach_skill.codes[:, :1]), graph, MODEL, SIZE)
    brightness = view.render(NOTHING).mean(axis=2)
    sure = pixels(reach_skill, graph, graph.latent[graph.sigma < np.percentile(graph.sigma, 20.0)])
    assert np.median(brightness[tuple(sure.T)]) + 60.0 < np.percentile(brightness, 90.0)


def test_the_node_draws_a_latent_space_of_three_dimensions(reach_skill, graph):
    planner = SimpleNamespace(graph=graph, collision=MODEL)
    assert isinstance(latent_view(planner, reach_skill, 128), ArmView)
