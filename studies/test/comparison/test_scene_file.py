"""Scenes as files of numbers: read to the bit as they were written, and refused in a line where they make no sense."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import FileError, GeodesicMotionError, ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Outcome
from geodesic_motion_studies.comparison.families import FAMILIES
from geodesic_motion_studies.comparison.run import Bench, BenchmarkSettings, kept_benchmark
from geodesic_motion_studies.comparison.scene import draw_scene
from geodesic_motion_studies.comparison.scene_file import SceneFile

SEED = 3


@pytest.fixture(scope="module")
def arena(reach_skill: Skill) -> Arena:
    return Arena.of(reach_skill)


@pytest.fixture(scope="module")
def drawn(arena: Arena) -> SceneFile:
    """A scene of each family, and two with the same demonstrations."""
    scenes = [draw_scene(arena, family, 1, SEED) for family in FAMILIES]
    return SceneFile.of(arena.skill, arena.guard, SEED, [*scenes, replace(scenes[0], number=2)])


@pytest.fixture(scope="module")
def path(drawn: SceneFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenes") / "scenes.npz"
    drawn.write(path)
    return path


def same(one: object, other: object) -> bool:
    """Whether numbers, arrays and what holds them are equal to the bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    return type(one) is type(other) and one == other


def test_what_is_read_is_what_was_written_to_the_bit(drawn, path) -> None:
    read = SceneFile.read(path)
    keys = ("skill", "skill_digest", "robot", "guard", "seed", "families")
    one, other = ([getattr(item, key) for key in keys] for item in (drawn, read))
    assert one == other
    for one, other in zip(drawn.scenes, read.scenes, strict=True):
        assert same(asdict(replace(one, demonstrations=())), asdict(other))
    # Control: the last bit of one number.
    sphere = read.scenes[1].spheres[0]
    moved = replace(sphere, begin=np.nextafter(sphere.begin, 9.0))
    assert not same(asdict(sphere), asdict(moved))


def test_older_files_declare_nothing_and_are_of_a_panda(path, tmp_path) -> None:
    with np.load(path) as archive:
        older = {name: array for name, array in archive.items() if name not in ("declared", "robot")}
    np.savez(tmp_path / "older.npz", **older)
    assert {scene.declared.names for scene in SceneFile.read(path).scenes} == {(), ("table",)}
    read = SceneFile.read(tmp_path / "older.npz")
    assert {scene.declared.names for scene in read.scenes} == {()}
    assert read.robot == "panda"


def test_scenes_of_a_file_are_played_as_those_that_are_drawn(reach_skill, drawn, path, tmp_path) -> None:
    known = SceneFile.read(path)
    from_file = BenchmarkSettings(("replay",), known.families, seed=known.seed, scenes_from=path)
    benches = [
        Bench(reach_skill, settings, tmp_path)
        for settings in (BenchmarkSettings(("replay",), FAMILIES, seed=SEED), from_file)
    ]
    assert benches[1].scene_ids() == [(scene.family, scene.number) for scene in drawn.scenes]
    for family in ("static", "chasing"):
        outcomes = [lasting(bench.scene(family, 1)[0].outcome) for bench in benches]
        assert outcomes[0] == outcomes[1]
    # Results are apart from those of scenes that are drawn, and from those of another file.
    (kept,) = {item.family for item in kept_benchmark(reach_skill, replace(from_file, families=("static",)), tmp_path)}
    assert kept == "static"
    assert from_file.results_folder(tmp_path, reach_skill).parent == tmp_path / reach_skill.name
    with pytest.raises(ParameterError, match="no scene static-7"):
        benches[1].draw("static", 7)
    with pytest.raises(ParameterError, match="held out"):
        replace(from_file, held_out=True)


def lasting(outcome: Outcome) -> dict[str, object]:
    """What does not depend on how fast the machine is."""
    return {name: value for name, value in asdict(outcome).items() if name not in ("replans", "in_time")}


def test_scenes_of_another_skill_or_guard_are_refused(reach_skill, drawn) -> None:
    drawn.check(reach_skill, "arm")
    with pytest.raises(ParameterError, match="not of 'other'"):
        drawn.check(replace(reach_skill, name="other"), "arm")
    with pytest.raises(ParameterError, match="had learned differs"):
        drawn.check(replace(reach_skill, codes=reach_skill.codes + 1e-9), "arm")
    with pytest.raises(ParameterError, match="guard 'arm', not of 'tool'"):
        drawn.check(reach_skill, "tool")


def first_is(value: float) -> object:
    """What changes the first number of an array."""

    def change(array: np.ndarray) -> np.ndarray:
        changed = array.copy()
        changed.reshape(-1)[0] = value
        return changed

    return change


@pytest.mark.parametrize(
    ("key", "change", "said"),
    [
        ("start", first_is(np.nan), "start holds nan"),
        ("start", lambda array: array[:, :6], "start has shape"),
        ("begin", first_is(np.inf), "begin holds inf"),
        ("vanishes", first_is(np.nan), "vanishes must have .* no NaN"),
        ("radius", first_is(-0.1), "radius holds -0.1"),
        ("spheres", first_is(99), "radius has shape"),
        ("goal_quaternion", lambda array: 2.0 * array, "quaternion of length 2"),
        ("curve_position", lambda array: array[:-1], "curve_position has shape"),
        ("compared", first_is(99), "compared must have"),
        ("free", lambda array: array.astype(float), "free must"),
        ("number", lambda array: np.ones_like(array), "the scene none-1 more than once"),
        ("family", lambda array: np.array(["wall", *array[1:]]), "no 'wall'"),
        ("guard", lambda array: np.array("leg"), "guard is 'leg'"),
        ("format", lambda array: np.array(2), "another format"),
        ("seed", lambda array: np.array(0.5), "seed must"),
        ("skill", lambda array: np.array("two\nlines"), "skill must be one line"),
        ("rests", None, "lacks rests: it is no file"),
        ("declared", lambda array: array[1:], "declared must be a row of"),
        ("declared", lambda array: np.array(["boxes: 1"] * len(array)), "declared: boxes must be a list"),
        ("declared", lambda array: np.array(["!!binary x"] * len(array)), "declared: .* tag"),
    ],
)
def test_a_bad_number_is_named_in_a_line(path, tmp_path, key, change, said) -> None:
    with np.load(path) as archive:
        arrays = dict(archive)
    changed = arrays | ({} if change is None else {key: change(arrays[key])})
    if change is None:
        del changed[key]
    bad = tmp_path / "bad.npz"
    np.savez(bad, **changed)
    with pytest.raises(FileError, match=said) as error:
        SceneFile.read(bad)
    assert str(error.value).startswith(str(bad))
    assert "\n" not in str(error.value)


def test_what_is_no_such_file_is_refused(path, tmp_path) -> None:
    text, cut = tmp_path / "text.npz", tmp_path / "cut.npz"
    text.write_text("scenes")
    cut.write_bytes(path.read_bytes()[:-100])
    for bad in (text, cut, tmp_path / "none.npz", tmp_path):
        with pytest.raises(GeodesicMotionError, match=str(bad)):
            SceneFile.read(bad)
