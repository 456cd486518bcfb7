from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.errors import DemonstrationError, ParameterError
from geodesic_motion_ros.experiments.trained import trained_on_folds
from geodesic_motion_ros.manifold.training import TrainingSettings

IN_NO_TIME = TrainingSettings(steps=100, kernels=40, hidden=(32, 16))


def run(demonstrations, folder, settings=IN_NO_TIME, folds=((0, 3),), seeds=(2,)):
    return list(trained_on_folds("cup", demonstrations, folds, seeds, folder, settings, show_progress=False))


def test_the_same_training_is_taken_from_the_cache_and_another_is_not(demonstrations, tmp_path) -> None:
    (first,) = run(demonstrations, tmp_path)
    (kept,) = tmp_path.iterdir()
    written = (kept / "skill.yaml").stat().st_mtime_ns
    (again,) = run(demonstrations, tmp_path)
    assert (kept / "skill.yaml").stat().st_mtime_ns == written
    np.testing.assert_array_equal(again.skill.codes, first.skill.codes)
    assert (again.fold, again.seed, len(again.shown), len(again.held_out)) == ((0, 3), 2, 4, 2)
    run(demonstrations, tmp_path, replace(IN_NO_TIME, kl_weight=0.2))
    assert len(list(tmp_path.iterdir())) == 2


def test_a_damaged_skill_of_the_cache_is_trained_again(demonstrations, tmp_path) -> None:
    (first,) = run(demonstrations, tmp_path)
    (kept,) = tmp_path.iterdir()
    (kept / "latent.npz").write_bytes(b"")
    (again,) = run(demonstrations, tmp_path)
    np.testing.assert_array_equal(again.skill.codes, first.skill.codes)


def test_nothing_to_train_and_wrong_folds_are_refused(demonstrations, tmp_path) -> None:
    with pytest.raises(ParameterError, match="at least one fold"):
        run(demonstrations, tmp_path, seeds=())
    with pytest.raises(DemonstrationError, match="cannot hold out demonstration 9"):
        run(demonstrations, tmp_path, folds=((0,), (9,)))
    assert not list(tmp_path.iterdir())
