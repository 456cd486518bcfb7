from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.utils.errors import DemonstrationError, ParameterError
from geodesic_motion_studies.experiments.trained import meaning, trained_on_folds, trained_once, training_code

IN_NO_TIME = TrainingSettings(steps=60, kernels=20, hidden=(32, 16))


def run(demonstrations, folder, settings=IN_NO_TIME, folds=((0, 3),), seeds=(2,)):
    return list(trained_on_folds("cup", demonstrations, folds, seeds, folder, settings, show_progress=False))


def test_the_same_training_is_taken_from_the_cache_unless_that_is_damaged(demonstrations, tmp_path) -> None:
    (first,) = run(demonstrations, tmp_path)
    (kept,) = tmp_path.iterdir()
    written = (kept / "skill.yaml").stat().st_mtime_ns
    (again,) = run(demonstrations, tmp_path)
    assert (kept / "skill.yaml").stat().st_mtime_ns == written
    np.testing.assert_array_equal(again.skill.codes, first.skill.codes)
    assert (again.fold, again.seed, len(again.shown), len(again.held_out)) == ((0, 3), 2, 4, 2)
    (kept / "latent.npz").write_bytes(b"")
    (anew,) = run(demonstrations, tmp_path)
    np.testing.assert_array_equal(anew.skill.codes, first.skill.codes)


def test_other_demonstrations_are_another_training(demonstrations, tmp_path) -> None:
    (first,), (second,) = run(demonstrations, tmp_path), run(demonstrations, tmp_path, folds=((1, 3),))
    assert not np.array_equal(first.skill.codes, second.skill.codes)
    assert len(list(tmp_path.iterdir())) == 2


def test_nothing_to_train_and_wrong_folds_are_refused(demonstrations, tmp_path) -> None:
    with pytest.raises(ParameterError, match="at least one fold"):
        run(demonstrations, tmp_path, seeds=())
    with pytest.raises(DemonstrationError, match="cannot hold out demonstration 9"):
        run(demonstrations, tmp_path, folds=((0,), (9,)))
    assert not list(tmp_path.iterdir())


def test_the_meaning_of_code_changes_with_what_it_does_and_not_with_what_it_says() -> None:
    source = (
        '"""Module."""\n\nLIMIT = 2.0\n\n\nclass A:\n    """A class."""\n\n    def f(self):\n        return LIMIT\n'
    )
    reworded = source.replace("A class.", "Something else.").replace('"""Module."""\n', "# a comment\n")
    assert meaning(reworded) == meaning(source)
    assert meaning(source.replace("2.0", "3.0")) != meaning(source)
    assert meaning(source.replace("return LIMIT", "return -LIMIT")) != meaning(source)


def test_code_that_the_training_imports_counts_as_training_code(monkeypatch) -> None:
    """The skill's threshold comes out of the graph, so a change of the graph is a change of the training."""
    read = Path.read_text
    changed = "pose_graph.py"

    def edited(path: Path, *arguments: object) -> str:
        return read(path, *arguments) + ("\nEDITED = True\n" if path.name == changed else "")

    before = training_code()
    monkeypatch.setattr(Path, "read_text", edited)
    assert training_code() != before
    changed = "shortest_path.py"
    assert training_code() == before


def test_demonstrations_of_joints_are_learned_in_joint_space_and_kept(reach_demonstrations, tmp_path) -> None:
    # In the plane: so little training leaves a wide support, whose graph in three dimensions takes far longer.
    settings = JointTrainingSettings(
        latent_dimension=2, steps=60, samples=40, kernels=20, hidden=(32, 16), precision_iterations=20
    )
    first = trained_once("reach", reach_demonstrations, settings, tmp_path)
    (kept,) = tmp_path.iterdir()
    written = (kept / "skill.yaml").stat().st_mtime_ns
    again = trained_once("reach", reach_demonstrations, settings, tmp_path)
    assert (kept / "skill.yaml").stat().st_mtime_ns == written
    assert again.space == "joint"
    np.testing.assert_array_equal(again.codes, first.codes)
    trained_once("reach", reach_demonstrations.split((0,))[0], settings, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
