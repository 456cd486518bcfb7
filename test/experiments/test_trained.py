from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.errors import DemonstrationError, ParameterError
from geodesic_motion_ros.experiments.trained import trained_on_folds
from geodesic_motion_ros.manifold.training import TrainingSettings

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
