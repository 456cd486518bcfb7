"""Tables of joint positions, judged as the motions of a method are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import DemonstrationError, GeodesicMotionError, ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Outcome, Stage
from geodesic_motion_studies.comparison.methods.replay import Replay
from geodesic_motion_studies.comparison.motions import judged
from geodesic_motion_studies.comparison.scene import Scene, draw_scene
from geodesic_motion_studies.comparison.scene_file import SceneFile
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

#: Postures a second that the judge gives, and how far a clearance read off them may be off [m].
RATE, TOLERANCE = 50.0, 1e-3


@pytest.fixture(scope="module")
def arena() -> Arena:
    return Arena.of(Skill.load("panda_pouring"), "arm")


@pytest.fixture(scope="module")
def played(arena: Arena) -> dict[str, tuple[Scene, Outcome, np.ndarray]]:
    """By the motion's name: scenes with standing, crossing and chasing spheres, as the control plays them."""
    stage, replay = Stage(arena), Replay(arena)
    scenes = [draw_scene(arena, family, number, 0) for family in ("static", "chasing") for number in range(2)]
    scenes += [draw_scene(arena, "crossing", 1, 0), draw_scene(arena, "none", 0, 0)]
    return {f"{scene.family}-{scene.number}": (scene, *stage.play(scene, replay)) for scene in scenes}


def scene_file(arena: Arena, *scenes: Scene) -> SceneFile:
    return SceneFile.of(arena.skill, arena.guard, 0, scenes)


def written(path: Path, arena: Arena, tables: dict[str, tuple[np.ndarray, np.ndarray]]) -> Path:
    """Motions by their names, times (T,) [s] and configurations (T, eta) [rad], in a file."""
    lines = [",".join(["demonstration", "t", *arena.robot.joint_names])]
    for name, (times, configurations) in tables.items():
        lines += [",".join([name, *map(repr, map(float, (t, *q)))]) for t, q in zip(times, configurations, strict=True)]
    path.write_text("\n".join(lines))
    return path


def recorded(scene: Scene, outcome: Outcome, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A motion as it was measured, from its start on to its end."""
    times = np.append(np.arange(len(postures)) / RATE, outcome.duration)
    times, kept = np.unique(times, return_index=True)
    return times, np.concatenate([scene.start[None], postures])[kept]


def test_a_motion_that_was_recorded_is_judged_as_it_was(arena, played, tmp_path) -> None:
    file = scene_file(arena, *(scene for scene, _, _ in played.values()))
    file.write(tmp_path / "scenes.npz")
    tables = {name: recorded(*item) for name, item in played.items()}
    again = judged(SceneFile.read(tmp_path / "scenes.npz"), written(tmp_path / "a.csv", arena, tables), "again")
    verdicts = {f"{item.family}-{item.number}": item.outcome for item in again}
    assert verdicts.keys() == played.keys()
    for name, (_, before, _) in played.items():
        after = verdicts[name]
        assert (after.reached, after.contact, after.mostly_free) == (before.reached, before.contact, before.mostly_free)
        assert abs(after.clearance - before.clearance) <= TOLERANCE
        assert abs(after.dtw - before.dtw) <= TOLERANCE
        assert after.orientation == pytest.approx(before.orientation, abs=1e-2)
    # Controls: there is one of both among them.
    assert {item.contact for item in verdicts.values()} >= {"", "moving"}
    assert {item.success for item in verdicts.values()} == {True, False}


def test_a_table_that_passes_through_a_sphere_is_a_contact(arena, played, tmp_path) -> None:
    scene, before, postures = played["none-0"]
    assert before.success
    middle = arena.robot.forward(postures[len(postures) // 2])[0]
    blocked = replace(scene, spheres=(MovingSphere(0.05, 0.0, np.inf, middle, np.zeros(3), False),))
    motions = written(tmp_path / "motions.csv", arena, {"none-0": recorded(scene, before, postures)})
    (through,) = judged(scene_file(arena, blocked), motions, "mine")
    assert (through.outcome.contact, through.outcome.success) == ("moving", False)
    (free,) = judged(scene_file(arena, scene), motions, "mine")
    assert free.outcome.success


def test_spheres_chase_the_arm_of_the_table(arena, played, tmp_path) -> None:
    """One that begins beside the start, off any line to an arm that stays, comes to the tool only if it chases."""
    scene, _, _ = played["none-0"]
    tool = arena.robot.forward(scene.start)[0]
    coming = MovingSphere(0.04, 0.0, 20.0, tool + [0.0, 0.4, 0.3], np.array([0.15, 0.0, 0.0]), True)
    stays = {"none-0": (np.array([0.0, 0.1]), np.tile(scene.start, (2, 1)))}
    motions = written(tmp_path / "motions.csv", arena, stays)
    (item,) = judged(scene_file(arena, replace(scene, spheres=(coming,), tool_chased=True)), motions, "mine")
    assert item.outcome.contact == "standing"
    passing = replace(coming, chases=False)
    (item,) = judged(scene_file(arena, replace(scene, spheres=(passing,))), motions, "mine")
    assert item.outcome.contact == ""


def test_a_method_that_refuses_hands_in_its_start(arena, played, tmp_path) -> None:
    scene, _, _ = played["none-0"]
    stays = {"none-0": (np.array([0.0, 0.1]), np.tile(scene.start, (2, 1)))}
    (item,) = judged(scene_file(arena, scene), written(tmp_path / "motions.csv", arena, stays), "mine")
    assert not item.outcome.reached
    assert item.outcome.contact == ""


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda name, times, table: {}, "holds no demonstrations"),
        (lambda name, times, table: {"gate-0": (times, table)}, "lacks a motion for none-0"),
        (lambda name, times, table: {name: (times, table), "gate-9": (times, table)}, "no scene: gate-9"),
        (lambda name, times, table: {name: (times + 1.0, table)}, "none-0 begins at 1 s"),
        (lambda name, times, table: {name: (times, table + 0.02)}, "0.02 rad from the scene's start"),
        (lambda name, times, table: {name: (0.01 * times, table)}, "the arm's limit is 2"),
        (lambda name, times, table: {name: (times, np.where(table == table[5, 2], np.nan, table))}, "nan"),
    ],
)
def test_what_is_no_motion_of_the_scene_is_refused(arena, played, tmp_path, change, said) -> None:
    scene, outcome, postures = played["none-0"]
    motions = written(tmp_path / "m.csv", arena, change("none-0", *recorded(scene, outcome, postures)))
    with pytest.raises(GeodesicMotionError, match=said) as error:
        next(judged(scene_file(arena, scene), motions, "mine"))
    assert isinstance(error.value, DemonstrationError | ParameterError)
