"""Pictures: what they are asked to show is to be seen on them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import PlanningError
from geodesic_motion_ros.visualization import plots


@pytest.fixture(scope="module")
def drawn(fan_skill: Skill) -> plots.DrawnPath:
    start, goal = fan_skill.start_pose, fan_skill.goal_pose
    path = PosePathPlanner(fan_skill).plan(start[:3], start[3:], goal[:3], goal[3:])
    assert isinstance(path, PosePath)
    return plots.DrawnPath(path.latent, path.positions, "path", plots.VERMILION)


@pytest.fixture
def obstacle(drawn: plots.DrawnPath) -> plots.Sphere:
    middle = drawn.positions[len(drawn.positions) // 2]
    return plots.Sphere(middle, 0.03, np.array([middle - [0.1, 0.0, 0.0], middle]))


def pixels_of(path: Path, colour: str, tolerance: int = 45) -> int:
    """Number of pixels that have about a colour."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return int(np.sum(np.max(np.abs(picture - wanted), axis=2) < tolerance))


def test_latent_picture_shows_the_path_and_the_footprint(
    tmp_path: Path, fan_skill: Skill, drawn: plots.DrawnPath, obstacle: plots.Sphere
) -> None:
    plots.draw_latent(tmp_path / "without.png", fan_skill, PlannerSettings(), [drawn])
    plots.draw_latent(tmp_path / "with.png", fan_skill, PlannerSettings(), [drawn], obstacle)
    assert pixels_of(tmp_path / "without.png", plots.VERMILION) > 500
    # the rim of the footprint is drawn in full colour; smoothed edges of the path come close to it in places
    assert pixels_of(tmp_path / "with.png", plots.ORANGE) > 500 + pixels_of(tmp_path / "without.png", plots.ORANGE)


def test_paths_picture_shows_the_path_and_the_obstacle(
    tmp_path: Path, fan_skill: Skill, drawn: plots.DrawnPath, obstacle: plots.Sphere
) -> None:
    plots.draw_paths(tmp_path / "new" / "without.png", fan_skill, [drawn])
    plots.draw_paths(tmp_path / "with.png", fan_skill, [drawn], obstacle)
    assert pixels_of(tmp_path / "new" / "without.png", plots.VERMILION) > 500
    assert pixels_of(tmp_path / "with.png", plots.ORANGE) > pixels_of(tmp_path / "new" / "without.png", plots.ORANGE)


def test_training_report_shows_geodesics_and_the_straight_line(tmp_path: Path, fan_skill: Skill) -> None:
    plots.training_report(fan_skill, tmp_path / "report.png")
    assert pixels_of(tmp_path / "report.png", plots.BLUE) > 500
    assert pixels_of(tmp_path / "report.png", plots.VERMILION) > 200


def test_a_deeper_latent_space_is_refused(tmp_path: Path, fan_skill: Skill, drawn: plots.DrawnPath) -> None:
    deep = replace(fan_skill, latent_lower=np.zeros(3), latent_upper=np.ones(3))
    with pytest.raises(PlanningError, match="two dimensions, fan has 3"):
        plots.draw_latent(tmp_path / "no.png", deep, PlannerSettings(), [drawn])


def test_codes_of_the_demonstrations_leave_out_antipodal_copies(fan_skill: Skill) -> None:
    assert len(fan_skill.codes) == 14
    assert np.array_equal(plots.demonstrations_of(fan_skill), fan_skill.codes[:7])


def test_a_single_axis_has_the_share_of_the_curve_beside_it() -> None:
    curve = np.array([[0.5], [0.0], [2.0]])
    np.testing.assert_array_equal(plots.seen_curve(curve, np.array([0])), [[0.5, 0.0], [0.0, 0.5], [2.0, 1.0]])
    wide = np.arange(12.0).reshape(3, 4)
    np.testing.assert_array_equal(plots.seen_curve(wide, np.array([1, 3])), wide[:, [1, 3]])


@pytest.mark.parametrize("shown", [np.array([0]), np.array([0, 1])], ids=["one axis", "two axes"])
def test_nodes_are_drawn_by_their_values(shown: np.ndarray) -> None:
    latent, values = np.random.default_rng(0).normal(size=(20, len(shown))), np.linspace(1.0, 2.0, 20)
    drawn = plots.draw_nodes(Figure().subplots(), latent, shown, values)
    np.testing.assert_array_equal(drawn.get_array(), values)
