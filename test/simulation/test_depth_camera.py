"""A depth camera: points lie on what is seen, noise grows with the square of the depth, what is hidden is not seen."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.depth_camera import DepthCamera, DepthCameraSettings
from geodesic_motion_ros.utils.errors import ParameterError

ROBOTS = "panda", "ur5", "iiwa14"
#: Beside all arms, in view.
BALL = {"ball": (np.array([0.5, -0.45, 0.6]), 0.05)}
EXACT = DepthCameraSettings(noise=0.0)
#: A ball is drawn as facets, which lie within it by so much [m].
FACETS = 0.001


def seen(settings: DepthCameraSettings, spheres: dict, robot: str = "panda") -> np.ndarray:
    camera = DepthCamera(robot, settings)
    points = camera.points(Robot.named(robot).ready, spheres, np.random.default_rng(0))
    camera.close()
    place, turn = np.array(settings.place), settings.turn
    carried = camera.to_base(points)
    np.testing.assert_allclose(carried, place + points @ turn.T, atol=1e-9)
    return carried


def heights(points: np.ndarray) -> np.ndarray:
    """How far points are outside of the ball [m]."""
    centre, radius = BALL["ball"]
    return np.linalg.norm(points - centre, axis=1) - radius


def of_arm(points: np.ndarray, robot: str) -> np.ndarray:
    """How far points are outside of the arm's spheres [m]."""
    model = CollisionModel.named(robot)
    centres = model.positions(Robot.named(robot), Robot.named(robot).ready[None])[0]
    return np.min(np.linalg.norm(points[:, None] - centres, axis=2) - model.radii, axis=1)


@pytest.mark.parametrize("robot", ROBOTS)
def test_points_lie_on_the_ball_and_in_the_spheres_of_the_arm(robot):
    points = seen(EXACT, BALL, robot)
    on_ball = np.abs(heights(points)) < FACETS
    assert 50 < np.sum(on_ball) < 300
    assert np.sum(~on_ball) > 300
    assert np.max(of_arm(points[~on_ball], robot)) <= FACETS
    # The camera sees the front alone.
    assert np.all((points[on_ball] - BALL["ball"][0]) @ (np.array(EXACT.place) - points[on_ball]).T.mean(axis=1) > 0.0)


def test_noise_grows_with_the_square_of_the_depth():
    settings = DepthCameraSettings(noise=0.01)
    depths, errors = [], []
    camera, exact = DepthCamera("panda", settings), DepthCamera("panda", EXACT)
    random = np.random.default_rng(0)
    for _ in range(20):
        truth = exact.points(Robot.named("panda").ready, BALL, random)[:, 2]
        depths.append(truth)
        errors.append(camera.points(Robot.named("panda").ready, BALL, random)[:, 2] - truth)
    camera.close()
    exact.close()
    scaled = np.concatenate(errors) / np.concatenate(depths) ** 2
    # Of n draws the standard deviation is off by less than five of 1 / sqrt(2 n).
    assert np.std(scaled) == pytest.approx(0.01, rel=5.0 / np.sqrt(2.0 * len(scaled)))


def test_a_ball_behind_the_arm_is_not_seen_nor_one_that_has_vanished():
    robot, model = Robot.named("panda"), CollisionModel.named("panda")
    elbow = model.positions(robot, robot.ready[None])[0][np.array(model.points.names) == "panda_link4"][0]
    away = elbow - np.array(EXACT.place)
    behind = elbow + 0.15 * away / np.linalg.norm(away)
    spheres = {"ball": (behind, 0.02)}
    alone = seen(EXACT, {})
    assert len(seen(EXACT, spheres)) == len(alone)
    camera = DepthCamera("panda", EXACT)
    random = np.random.default_rng(0)
    before = len(camera.points(robot.ready, BALL, random))
    assert before > len(alone)
    assert len(camera.points(robot.ready, {}, random)) == len(alone)
    camera.close()


def test_a_camera_that_looks_upright_is_refused():
    with pytest.raises(ParameterError, match="must not be upright"):
        DepthCameraSettings(place=(0.3, 0.0, 1.5), target=(0.3, 0.0, 0.0))
