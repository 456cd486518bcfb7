"""Pictures of joint-space skills: what they are asked to show is to be seen on them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings, build_configuration_graph
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.visualization import joint_plots
from geodesic_motion_ros.visualization.plots import BLUE, ORANGE, VERMILION, DrawnPath, Sphere


@pytest.fixture(scope="module")
def planner(reach_skill) -> ReactivePlanner:
    return ReactivePlanner(reach_skill)


@pytest.fixture(scope="module")
def shown(planner) -> tuple[list[DrawnPath], Sphere | None]:
    return joint_plots.example_paths(planner)


def pixels_of(path: Path, colour: str, tolerance: int = 30) -> int:
    """Number of pixels that have about a colour."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return int(np.count_nonzero(np.abs(picture - wanted).max(axis=-1) < tolerance))


def test_a_report_shows_the_geodesic_the_obstacle_and_the_path_around(reach_skill, tmp_path) -> None:
    joint_plots.joint_report(reach_skill, tmp_path / "deep" / "report.png")
    for colour in (BLUE, VERMILION, ORANGE):
        assert pixels_of(tmp_path / "deep" / "report.png", colour) > 300


def test_the_path_around_goes_elsewhere_and_the_obstacle_is_on_the_other(planner, shown) -> None:
    (straight, around), obstacle = shown
    assert obstacle is not None
    middles = [drawn.latent[len(drawn.latent) // 2] for drawn in (straight, around)]
    assert np.linalg.norm(middles[0] - middles[1]) > 1.0
    colliding = joint_plots.colliding_nodes(planner, obstacle)
    near = [colliding[np.argmin(np.linalg.norm(planner.graph.latent - middle, axis=1))] for middle in middles]
    assert near == [True, False]


def test_nothing_is_drawn_that_was_not_asked_for(planner, shown, tmp_path) -> None:
    joint_plots.draw_tubes(tmp_path / "bare.png", planner)
    joint_plots.draw_tubes(tmp_path / "full.png", planner, *shown, title="both paths")
    for colour in (BLUE, VERMILION):
        assert pixels_of(tmp_path / "bare.png", colour) == 0
        assert pixels_of(tmp_path / "full.png", colour) > 300


@pytest.mark.parametrize("sigma_weight", [0.0, 10.0])
def test_magnification_is_the_volume_of_the_metric_that_edges_are_measured_with(reach_skill, sigma_weight) -> None:
    metric, robot = JointMetricSettings(sigma_weight=sigma_weight), Robot.named("panda")
    code, reach = reach_skill.codes[1, 40] + 0.08, 0.01
    graph = build_configuration_graph(
        reach_skill.decoder, reach_skill.codes, code - reach, code + reach, metric, robot, metric.body_points(robot),
        sigma_limit=math.inf, shape=(3, 3, 3),
    )  # fmt: skip
    centre = int(np.argmin(np.linalg.norm(graph.latent - code, axis=1)))
    own = np.flatnonzero(np.any(graph.edges == centre, axis=1))
    steps = np.diff(graph.latent[graph.edges[own]], axis=1)[:, 0]
    rows, columns = np.triu_indices(3)
    terms = steps[:, rows] * steps[:, columns] * np.where(rows == columns, 1.0, 2.0)
    energies = graph.transported(JointOffsets.none(robot)).energies(own)
    tensor = np.zeros((3, 3))
    tensor[rows, columns] = tensor[columns, rows] = np.linalg.lstsq(terms, energies, rcond=None)[0]
    expected = 0.5 * np.linalg.slogdet(tensor)[1]
    assert joint_plots.joint_magnification_factor(graph)[centre] == pytest.approx(expected, abs=0.05)
