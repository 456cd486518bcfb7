"""Demonstrations held out: no method has them, and scenes and similarity are theirs."""

from __future__ import annotations

import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Outcome
from geodesic_motion_studies.comparison.held_out import HeldOut, digest, shown_demonstrations, training_settings
from geodesic_motion_studies.comparison.results import Results
from geodesic_motion_studies.comparison.run import Bench, BenchmarkSettings, kept_benchmark, play_benchmark
from geodesic_motion_studies.comparison.tool_demonstrations import shown_curves
from geodesic_motion_studies.tools.similarity import compare

#: Of skills of which only the demonstrations matter.
TINY = {"steps": 40, "kernels": 60, "samples": 60, "precision_samples": 1, "precision_iterations": 10}
SETTINGS = BenchmarkSettings(("replay",), ("none",), scenes=2, held_out=True)


@pytest.fixture(scope="module")
def skill(canonical_fan_skill: Skill) -> Skill:
    """Seven reaches whose starts and goals vary, and a skill that says that it was hardly trained."""
    provenance = canonical_fan_skill.provenance
    return replace(canonical_fan_skill, provenance=provenance | {"settings": provenance["settings"] | TINY})


@pytest.fixture(scope="module")
def folder(skill: Skill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For results, with the skills that are trained without a fold each."""
    folder = tmp_path_factory.mktemp("held_out")
    HeldOut.of(Arena.of(skill), 0, skills_in(folder, skill), show_progress=False)
    return folder


@pytest.fixture(scope="module")
def held_out(skill: Skill, folder: Path) -> HeldOut:
    return HeldOut.of(Arena.of(skill), 0, skills_in(folder, skill), show_progress=False)


@pytest.fixture
def no_training(monkeypatch) -> None:
    """Who trains fails."""

    def refuse(*_) -> Skill:
        raise AssertionError("trained")

    monkeypatch.setattr("geodesic_motion_studies.experiments.trained.train_anew", refuse)


def skills_in(folder: Path, skill: Skill) -> Path:
    return folder / skill.name / "held_out" / "skills"


def off(arena: Arena, shown: np.ndarray) -> float:
    """How far a demonstration (S, eta) [rad] is from the nearest that methods are given."""
    return float(np.min(np.max(np.abs(arena.shown - shown), axis=(1, 2))))


def lasting(outcome: Outcome) -> dict[str, object]:
    """What does not depend on how fast the machine is."""
    return {name: value for name, value in asdict(outcome).items() if name not in ("replans", "in_time")}


def test_methods_are_given_all_demonstrations_but_those_of_the_fold(held_out) -> None:
    assert sorted(index for fold in held_out.folds for index in fold) == list(range(7))
    for fold, arena in zip(held_out.folds, held_out.arenas, strict=True):
        assert len(arena.shown) == 7 - len(fold)
        for index, shown in enumerate(held_out.whole.shown):
            # Neighbours in the fan are 0.11 rad apart and more.
            assert off(arena, shown) > 0.1 if index in fold else off(arena, shown) < 1e-3


def test_a_scene_is_that_of_a_demonstration_that_methods_lack(held_out) -> None:
    curves = shown_curves(held_out.whole.skill.canonical)
    for number in range(7):
        index = held_out.demonstration("none", number)
        arena, scene = held_out.arena("none", number), held_out.draw("none", number)
        (compared,) = scene.compared
        np.testing.assert_allclose(compared.positions, curves[index].positions, atol=1e-4)
        assert off(arena, held_out.whole.shown[index]) > 0.1
        for configuration, (position, _) in ((scene.start, curves[index].start), (scene.goal, curves[index].goal)):
            np.testing.assert_allclose(arena.robot.forward(configuration)[0], position, atol=1e-4)
        # What methods are given is moved there.
        for reference in scene.demonstrations:
            np.testing.assert_allclose(reference.positions[[0, -1]], [scene.start, scene.goal], atol=1e-3)
        assert len(scene.demonstrations) == len(arena.shown)


def test_every_demonstration_has_a_scene_before_one_has_two(held_out) -> None:
    turns = [[held_out.demonstration("static", number) for number in range(first, first + 7)] for first in (0, 7, 14)]
    assert [sorted(turn) for turn in turns] == [list(range(7))] * 3
    assert turns[0] != turns[1]
    assert turns[0] != [held_out.demonstration("crossing", number) for number in range(7)]
    assert turns[0] != [replace(held_out, seed=1).demonstration("static", number) for number in range(7)]


def test_every_fold_has_scenes_with_and_without_spared_demonstrations(held_out) -> None:
    for parity in (0, 1):
        assert {held_out.arena("static", number) for number in range(parity, 40, 2)} == set(held_out.arenas)


def test_a_recording_is_no_distance_from_itself_but_from_one_that_was_held_out(skill, folder) -> None:
    shown, held = (
        [item.outcome for number in range(2) for item in Bench(skill, settings, folder).scene("none", number)]
        for settings in (replace(SETTINGS, held_out=False), SETTINGS)
    )
    assert all(outcome.success for outcome in (*shown, *held))
    assert max(outcome.dtw for outcome in shown) < 1e-3
    assert min(outcome.dtw for outcome in held) > 3e-3


def test_scenes_are_the_same_in_whichever_process_they_are_played(skill, folder, tmp_path) -> None:
    shutil.copytree(skills_in(folder, skill), skills_in(tmp_path, skill))
    with_processes = replace(SETTINGS, processes=2)
    played = sorted(play_benchmark(skill, with_processes, tmp_path, False), key=lambda item: item.number)
    bench = Bench(skill, SETTINGS, folder)
    alone = [item for number in range(2) for item in bench.scene("none", number)]
    assert [lasting(item.outcome) for item in played] == [lasting(item.outcome) for item in alone]
    assert len({item.outcome.duration for item in played}) > 1


def test_results_are_kept_apart_and_are_those_of_the_skills_that_were_trained(
    skill, folder, tmp_path, monkeypatch
) -> None:
    shutil.copytree(skills_in(folder, skill), skills_in(tmp_path, skill))
    bench = Bench(skill, SETTINGS, tmp_path)
    (played,) = bench.scene("none", 0)
    assert not (tmp_path / skill.name / "seed_0").exists()
    assert Results(tmp_path, skill.name, 0).numbers("replay", "none") == []
    assert kept_benchmark(skill, SETTINGS, tmp_path) == [played]
    results = Results(tmp_path, skill.name, 0, held_out=True)
    results.keep("replay", "none", 0, played.settings, replace(played.outcome, duration=99.0))
    (again,) = bench.scene("none", 0)
    assert again.outcome.duration == 99.0
    # As if the skills had been trained otherwise meanwhile.
    monkeypatch.setattr("geodesic_motion_studies.comparison.held_out.digest", lambda *_: "another")
    (anew,) = bench.scene("none", 0)
    assert lasting(anew.outcome) == lasting(played.outcome)


def test_a_digest_is_that_of_what_was_learned_and_of_what_was_held_out(held_out) -> None:
    first, second = (arena.skill for arena in held_out.arenas[:2])
    shown = held_out.whole.shown[0]
    assert digest(first, shown) == digest(replace(first, name="other"), shown)
    others = (second, shown), (replace(first, codes=first.codes + 1e-9), shown), (first, shown + 1e-9)
    assert len({digest(first, shown), *(digest(*other) for other in others)}) == 4


def test_scenes_without_spheres_are_not_played_twice(skill, folder, tmp_path) -> None:
    shutil.copytree(skills_in(folder, skill), skills_in(tmp_path, skill))
    played = list(play_benchmark(skill, replace(SETTINGS, scenes=9), tmp_path, False))
    assert sorted(item.number for item in played) == list(range(7))
    bench = Bench(skill, replace(SETTINGS, held_out=False), tmp_path)
    assert not bench.repeats("none", 8)
    assert not Bench(skill, SETTINGS, tmp_path).repeats("static", 8)


def test_what_was_trained_is_used_again(skill, folder, no_training) -> None:
    HeldOut.of(Arena.of(skill), 5, skills_in(folder, skill), show_progress=False)


@pytest.mark.parametrize("change", ["settings", "demonstrations", "file"])
def test_what_differs_is_trained_again(skill, folder, tmp_path, no_training, change) -> None:
    kept = tmp_path / "skills"
    shutil.copytree(skills_in(folder, skill), kept)
    settings, sheet = skill.provenance["settings"], skill.canonical
    if change == "settings":
        skill = replace(skill, provenance={"settings": settings | {"steps": 41}})
    elif change == "demonstrations":
        skill = replace(skill, canonical=replace(sheet, goal_offsets=1.01 * sheet.goal_offsets))
    else:
        weights = next(kept.glob("*/weights.safetensors"))
        weights.write_bytes(weights.read_bytes()[:-8])
    with pytest.raises(AssertionError, match="trained"):
        HeldOut.of(Arena.of(skill), 0, kept, show_progress=False)


def test_what_was_shown_comes_back_of_a_skill_of_the_tool(skill, varying_fan) -> None:
    for item, shown in zip(shown_demonstrations(Arena.of(skill)), varying_fan, strict=True):
        np.testing.assert_allclose(item.positions[[0, -1]], shown.positions[[0, -1]], atol=1e-6)
        found = compare(item.curve, shown.curve)
        assert found.dtw < 1e-3
        assert found.orientation < 1e-2


def test_what_was_shown_comes_back_of_a_skill_of_the_whole_arm(reach_skill, reach_demonstrations) -> None:
    again = shown_demonstrations(Arena.of(reach_skill))
    assert again.joint_names == reach_demonstrations.joint_names
    for item, shown in zip(again, reach_demonstrations, strict=True):
        np.testing.assert_allclose(item.configurations[[0, -1]], shown.configurations[[0, -1]], atol=1e-6)
        assert np.min(np.max(np.abs(shown.configurations - item.configurations[50]), axis=1)) < 0.02


def test_a_skill_is_trained_as_it_says_and_refused_where_it_does_not(canonical_fan_skill, reach_skill) -> None:
    for skill in (canonical_fan_skill, reach_skill):
        settings, recorded = asdict(training_settings(skill)), skill.provenance["settings"]
        # What was no setting yet when the skill was trained, of the metric too, has its default.
        assert settings | recorded | {"metric": settings["metric"] | recorded["metric"]} == settings
    with pytest.raises(ParameterError, match="does not say how it was trained"):
        training_settings(replace(reach_skill, provenance={}))
