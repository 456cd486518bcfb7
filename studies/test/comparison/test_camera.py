"""A camera: what it detects and when that is published, what the arm hides, and that nothing else is changed by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison import camera
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.camera import (
    DELAY,
    LOST,
    MISSED,
    NOISE,
    PLACE,
    RATE,
    Camera,
    CameraStage,
    SeenByCamera,
)
from geodesic_motion_studies.comparison.execution import Outcome, Stage
from geodesic_motion_studies.comparison.method import TICK, Answer
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.methods.replay import Replay
from geodesic_motion_studies.comparison.run import Bench, BenchmarkSettings
from geodesic_motion_studies.comparison.scene import Scene, draw_scene
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

#: Where nothing is between the camera and a sphere [m], how large spheres are [m], and how the first one moves [m/s].
IN_VIEW, RADIUS, VELOCITY = PLACE - [0.5, 0.0, 0.0], 0.04, np.array([0.0, 0.3, -0.1])
VANISHES = 1.5
#: Frames of statistics; of a figure that comes from so many draws so many standard deviations are allowed.
FRAMES, DEVIATIONS = 2000, 5.0
COARSE = PlannerSettings(grid_shape=(30, 30, 30))


class Standing:
    """Notes what it is handed, and lets the arm stand."""

    def reset(self, scene: Scene) -> None:
        self.handed: dict[int, Obstacles] = {}

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        self.handed[round(now / TICK)] = obstacles
        return Answer()


@pytest.fixture(scope="module")
def scene(arena: Arena) -> Scene:
    """One sphere that passes in view, and one that is never there."""
    passing = MovingSphere(RADIUS, 0.0, VANISHES, IN_VIEW, VELOCITY, False)
    never = replace(passing, appears=30.0, vanishes=31.0)
    return replace(draw_scene(arena, "none", 0, 0), spheres=(passing, never))


def watching(arena: Arena, scene: Scene) -> Camera:
    return Camera(arena, CollisionModel.named("panda"), scene)


def truth(tick: int) -> Obstacles:
    """Where the first sphere is, if it is there."""
    time = tick * TICK
    count = int(time < VANISHES)
    places, velocities = (np.tile(one, (count, 1)) for one in (IN_VIEW + time * VELOCITY, VELOCITY))
    return Obstacles.of_spheres(places, np.full(count, RADIUS), velocities, time)


def handed(stage: Stage, arena: Arena, scene: Scene) -> dict[int, Obstacles]:
    """What a method is handed in every tick, while the arm stands."""
    method = Standing()
    motion = SeenByCamera(stage.world, method, arena)
    motion.reset(scene)
    for tick in range(200):
        motion.tick(tick * TICK, truth(tick))
    return method.handed


def taken_ticks() -> list[int]:
    """The ticks of the frames in which the first sphere is there."""
    # The first of 100 ticks a second from k / 30 s on.
    return [-(-10 * k // 3) for k in range(int(VANISHES * RATE))]


def test_thirty_frames_a_second_are_published_80_ms_later(arena, stage, scene, monkeypatch) -> None:
    monkeypatch.setattr(camera, "LOST", 0.0)
    published, taken, late = handed(stage, arena, scene), taken_ticks(), round(DELAY / TICK)
    assert [len(published[tick].radii) for tick in (late - 1, late)] == [0, 1]
    # With two detections there is a velocity, and since when it goes on is said.
    for tick in range(taken[1] + late, taken[-1] + late + 1):
        newest = max(one for one in taken if one + late <= tick)
        assert published[tick].ages == pytest.approx([(tick - newest) * TICK])
    # The third frame without it is published as late.
    third = taken[-1] + round(MISSED * 100 / RATE)
    assert [len(published[tick].radii) for tick in (third + late - 1, third + late)] == [1, 0]


def test_the_tracker_moves_on_what_is_published_late(arena, stage, scene, monkeypatch) -> None:
    monkeypatch.setattr(camera, "NOISE", 0.0)
    published, late = handed(stage, arena, scene), round(DELAY / TICK)
    # Before there is a velocity it is where it was detected, and not where it is.
    np.testing.assert_allclose(published[late].centres, [IN_VIEW], atol=1e-9)
    for tick in (50, 75, 100):
        np.testing.assert_allclose(published[tick].centres, truth(tick).centres, atol=1e-9)
        np.testing.assert_allclose(published[tick].velocities, [VELOCITY], atol=1e-9)


def test_positions_are_noisy_and_detections_lost(arena, scene) -> None:
    watched = watching(arena, scene)
    frames = [watched.frame(k / RATE, scene.start, {0: IN_VIEW}) for k in range(FRAMES)]
    off = np.array([frame.detected[0] - IN_VIEW for frame in frames if 0 in frame.detected])
    lost = 1.0 - len(off) / FRAMES
    assert lost == pytest.approx(LOST, abs=DEVIATIONS * np.sqrt(LOST * (1.0 - LOST) / FRAMES))
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=DEVIATIONS * NOISE / np.sqrt(len(off)))
    np.testing.assert_allclose(off.std(axis=0), NOISE, atol=DEVIATIONS * NOISE / np.sqrt(2.0 * len(off)))
    # Axes and frames have nothing to do with each other: correlations of so many pairs are so small.
    for one, other in ((off[:, 0], off[:, 1]), (off[:-1, 0], off[1:, 0])):
        assert abs(np.corrcoef(one, other)[0, 1]) < DEVIATIONS / np.sqrt(len(off) - 1)
    assert not any(frame.deleted for frame in frames)


def behind(arena: Arena, posture: np.ndarray, link: str) -> np.ndarray:
    """A place (3,) [m] behind a link as the camera sees it."""
    centre = CollisionModel.named("panda").of_link(link).positions(arena.robot, posture[None])[0, 0]
    return centre + 0.3 * (centre - PLACE) / np.linalg.norm(centre - PLACE)


def times_detected(watched: Camera, posture: np.ndarray, place: np.ndarray, frames: int = 20) -> int:
    return sum(0 in watched.frame(0.0, posture, {0: place}).detected for _ in range(frames))


def turned(scene: Scene, by: float = 1.0) -> np.ndarray:
    """The start's posture (eta,) [rad], turned about the first joint."""
    return scene.start + by * np.eye(len(scene.start))[0]


@pytest.mark.parametrize(("link", "by"), [("panda_hand", 0.0), ("panda_link4", 0.0), ("panda_link0", 1.0)])
def test_the_arm_hides_what_is_behind_it(arena, scene, link, by) -> None:
    """All of it, the base too, which no obstacle has to be kept away from."""
    watched, posture = watching(arena, scene), turned(scene, by)
    place = behind(arena, posture, link)
    along = (place - PLACE) / np.linalg.norm(place - PLACE)
    beside, before = place + 0.5 * np.cross(along, [0.0, 0.0, 1.0]), PLACE + 0.3 * along
    assert times_detected(watched, posture, place) == 0
    assert times_detected(watched, posture, beside) > 0
    assert times_detected(watched, posture, before) > 0


def test_what_the_arm_hid_is_detected_when_it_has_moved(arena, scene) -> None:
    watched, place = watching(arena, scene), behind(arena, scene.start, "panda_hand")
    assert times_detected(watched, scene.start, place) == 0
    assert times_detected(watched, turned(scene), place) > 0


def test_what_has_vanished_is_deleted_only_where_its_place_is_in_view(arena, scene) -> None:
    watched, place = watching(arena, scene), behind(arena, scene.start, "panda_hand")
    assert times_detected(watched, turned(scene), place) > 0
    # What is hidden is there still, and what has vanished cannot be known to.
    hidden = [watched.frame(1.0, scene.start, {0: place}).deleted for _ in range(2 * MISSED)]
    hidden += [watched.frame(2.0, scene.start, {}).deleted for _ in range(2 * MISSED)]
    assert not any(hidden)
    deleted = [watched.frame(3.0, turned(scene), {}).deleted for _ in range(2 * MISSED)]
    assert deleted == [()] * (MISSED - 1) + [(0,)] + [()] * MISSED


def test_what_was_never_detected_is_not_deleted(arena, scene) -> None:
    watched = watching(arena, scene)
    assert not any(watched.frame(0.0, scene.start, {}).deleted for _ in range(2 * MISSED))


def test_noise_and_losses_depend_on_the_scene_alone(arena, scene) -> None:
    """Not on where the arm is, or on what else is detected."""
    place = behind(arena, scene.start, "panda_hand")
    postures, others = (scene.start, turned(scene)), ({}, {1: place})
    series = []
    for posture, other, one in [(*pair, scene) for pair in zip(postures, others, strict=True)] + [
        (scene.start, {}, replace(scene, number=1)), (scene.start, {}, replace(scene, seed=1)),
        (scene.start, {}, replace(scene, family="static")),
    ]:  # fmt: skip
        watched = watching(arena, one)
        frames = [watched.frame(0.0, posture, {0: IN_VIEW} | other) for _ in range(50)]
        series.append([tuple(frame.detected.get(0, ())) for frame in frames])
    assert series[0] == series[1]
    assert len({tuple(one) for one in series}) == 4


def test_the_same_is_handed_in_every_play(arena, stage, scene) -> None:
    first, again = handed(stage, arena, scene), handed(stage, arena, scene)
    assert first.keys() == again.keys()
    for tick, obstacles in first.items():
        np.testing.assert_array_equal(obstacles.centres, again[tick].centres)
        np.testing.assert_array_equal(obstacles.velocities, again[tick].velocities)


def without_times(outcome: Outcome) -> Outcome:
    return replace(outcome, replans=(), in_time=0)


def test_the_judge_goes_by_the_true_spheres(arena, stage, blocked_elbow) -> None:
    """A blind method is judged the same with a camera; one that sees is handed something else."""
    scene, replay = blocked_elbow(arena), Replay(arena)
    true, watched = stage.play(scene, replay)[0], CameraStage(arena).play(scene, replay)[0]
    assert true.contact == "moving"
    assert without_times(true) == without_times(watched)


def test_ours_goes_by_the_errors_of_the_tracker(arena, scene, monkeypatch) -> None:
    taken: list[Obstacles] = []
    monkeypatch.setattr(ReactivePlanner, "take_obstacles", lambda planner, obstacles: taken.append(obstacles))
    ours = Geodesics(arena, planner=COARSE)
    ours.reset(scene)
    true = Obstacles.of_spheres(IN_VIEW[None], np.array([RADIUS]), VELOCITY[None], time=0.0)
    true = replace(true, velocity_errors=np.array([0.2]))
    for obstacles in (true, replace(true, ages=np.array([DELAY]))):
        ours.tick(0.0, obstacles)
    # What moves straight on, and is known to, does not err.
    assert [one.velocity_errors.tolist() for one in taken[-2:]] == [[0.0], [0.2]]


def test_the_benchmark_plays_with_a_camera_where_it_is_requested(reach_skill, tmp_path) -> None:
    kinds = [
        type(Bench(reach_skill, BenchmarkSettings(("replay",), camera=watched), tmp_path).stage)
        for watched in (False, True)
    ]
    assert kinds == [Stage, CameraStage]


def test_a_camera_and_an_arm_that_lags_are_refused() -> None:
    with pytest.raises(ParameterError, match="choose one"):
        BenchmarkSettings(("ours",), camera=True, lag=0.1)
