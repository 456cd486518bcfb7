"""The demo of a skill of the whole arm: the sphere is in the elbow's path alone, and there is time to turn back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import configuration_clearance
from geodesic_motion_ros.demo import demo_pictures
from geodesic_motion_ros.demo.demo_options import SKILL
from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.demo_scene import DEFAULTS
from geodesic_motion_ros.demo.elbow_scene import ElbowScene
from geodesic_motion_ros.skill.skill import Skill

#: The planner of these tests ticks this often [s], and sees the obstacle where it was a little before [s].
TICK, SEEN_AGO = 0.02, 0.04
HAND = ("panda_hand", "panda_leftfinger", "panda_rightfinger")


@pytest.fixture(scope="module")
def scene() -> ElbowScene:
    return ElbowScene(Skill.load(SKILL))


def clearance(scene: ElbowScene, configuration: np.ndarray, time: float) -> tuple[float, str]:
    """Between the arm's spheres and the obstacle at a time [m], and the link that is nearest."""
    planner, obstacle = scene.planner, scene.obstacle
    distance, sphere = configuration_clearance(
        planner.collision, planner.robot, configuration, obstacle.position(time)[None], np.array([obstacle.radius])
    )
    return distance, planner.collision.link_of(sphere)


def played(scene: ElbowScene, obstacle: bool) -> tuple[Recording, float]:
    """What the planner makes of the scene in a world without delays but that of its eyes; its least clearance [m]."""
    planner = scene.planner
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    planner.stand_at(scene.nominal.positions[0], 0.0)
    assert planner.set_goal(scene.goal[:3], scene.goal[3:]).ok
    recording, least, time = Recording(), np.inf, 0.0
    while time < 16.0:
        if obstacle:
            seen = scene.obstacle.position(time - SEEN_AGO)
            velocity = (seen - scene.obstacle.position(time - SEEN_AGO - TICK)) / TICK
            planner.set_obstacles(seen[None], np.array([scene.obstacle.radius]), velocity[None], time - SEEN_AGO)
        planner.tick(time)
        configuration = planner.commanded_state(time)[0]
        recording.joint_times.append(time)
        recording.joints.append(configuration)
        recording.pose_times.append(time)
        recording.positions.append(planner.robot.forward(configuration)[0])
        recording.obstacle_times.append(time)
        recording.obstacles.append(scene.obstacle.position(time))
        least = min(least, clearance(scene, configuration, time)[0])
        time += TICK
        motion = planner.motion_to_goal()
        if motion is not None and time > motion[1] + motion[0].duration:
            break
    return recording, least


@pytest.fixture(scope="module")
def undisturbed(scene: ElbowScene) -> tuple[Recording, float]:
    return played(scene, obstacle=False)


@pytest.fixture(scope="module")
def avoiding(scene: ElbowScene) -> tuple[Recording, float]:
    return played(scene, obstacle=True)


def test_the_undisturbed_arm_would_be_hit_near_its_elbow(scene: ElbowScene) -> None:
    times = np.linspace(0.0, scene.nominal.duration, 100)
    nearest, link = min(clearance(scene, scene.nominal.sample(time)[0], time) for time in times)
    assert nearest < -0.05
    assert link in ("panda_link2", "panda_link3", "panda_link4", "panda_link5")


def test_the_hand_is_never_in_its_path(scene: ElbowScene) -> None:
    planner, obstacle = scene.planner, scene.obstacle
    model = planner.collision
    hand = [sphere for sphere in range(len(model.radii)) if model.link_of(sphere) in HAND]
    assert hand
    times = np.linspace(0.0, scene.nominal.duration, 50)
    spheres = model.positions(planner.robot, np.ascontiguousarray(scene.nominal.samples(times)[0]))[:, hand]
    centres = np.array([obstacle.position(time) for time in times])
    distance = np.linalg.norm(spheres - centres[:, None], axis=2) - model.radii[hand] - obstacle.radius
    assert np.min(distance) > 0.2


def test_start_and_goal_are_clear_at_all_times(scene: ElbowScene) -> None:
    for configuration in scene.nominal.positions[[0, -1]]:
        assert min(clearance(scene, configuration, time)[0] for time in np.linspace(-5.0, 20.0, 200)) > 0.02


def test_it_comes_from_outside_while_the_arm_moves(scene: ElbowScene) -> None:
    obstacle = scene.obstacle
    assert clearance(scene, scene.nominal.positions[0], 0.0)[0] > 0.15
    assert not np.allclose(obstacle.position(0.5), obstacle.position(1.0))
    np.testing.assert_allclose(obstacle.position(scene.nominal.duration), obstacle.end)


def test_its_patience_is_of_parameters_that_the_planner_has(scene: ElbowScene) -> None:
    assert scene.patience.keys() <= DEFAULTS.keys()
    assert all(value > DEFAULTS[name] for name, value in scene.patience.items())


def test_the_elbow_sets_out_turns_back_and_takes_the_other_side(
    scene: ElbowScene, undisturbed: tuple[Recording, float], avoiding: tuple[Recording, float]
) -> None:
    """With the control: undisturbed it stays in its family, and would be hit."""
    alone, through = undisturbed
    recording, least = avoiding
    (first,) = scene.families(alone)
    assert through < 0.0
    assert scene.families(recording) == [first, 1 - first]
    assert least > 0.01
    np.testing.assert_allclose(recording.positions[-1], scene.goal[:3], atol=1e-3)


def test_pictures_are_drawn_of_recorded_runs(
    scene: ElbowScene,
    undisturbed: tuple[Recording, float],
    avoiding: tuple[Recording, float],
    tmp_path: Path,
    monkeypatch,
) -> None:
    monkeypatch.setattr(demo_pictures, "_STRIP_FRAMES", 2)
    monkeypatch.setattr(demo_pictures, "_GIF_FRAMES", 2)
    alone, around = undisturbed[0], avoiding[0]
    scene.draw({"no_obstacle": alone, "avoidance_off": alone, "avoidance_on": around}, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"latent.png", "paths.png", "strip.png", "arm.gif"}
