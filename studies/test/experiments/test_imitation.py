from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.utils.errors import DemonstrationError, ParameterError
from geodesic_motion_studies.experiments.imitation import evaluate
from geodesic_motion_studies.experiments.imitation_report import COLUMNS, ROWS, ImitationReport

HELD_OUT = (1, 4)


@pytest.fixture(scope="module")
def train_briefly(stored):
    """How `evaluate` gets small skills."""

    def train(demonstrations, seed, sheet, progress):
        settings = TrainingSettings(
            seed=seed, sheet=sheet, steps=600, hidden=(64, 32), samples=100, kernels=150, precision_iterations=60
        )
        kind = "poses" if demonstrations.has_orientation else "positions"
        name = f"cup_{kind}_{sheet}_of_{len(demonstrations)}"
        return stored(name, lambda: train_skill(demonstrations, settings, name=name, progress=progress))

    return train


@pytest.fixture(scope="module")
def report(demonstrations, train_briefly) -> ImitationReport:
    pytest.importorskip("movement_primitives")
    return evaluate(demonstrations, [HELD_OUT], [0], train_briefly, task="cup", show_progress=False)


def test_every_row_has_every_column(report):
    assert tuple(report.rows) == ROWS
    for values in report.rows.values():
        assert set(COLUMNS) < set(values)


def test_every_prediction_of_every_held_out_demonstration_is_measured(report):
    for row in ROWS:
        measured = [item.demonstration for item in report.measurements if item.row == row]
        assert sorted(measured) == sorted(HELD_OUT)


def test_the_geodesic_answers_meets_its_ends_and_follows_the_skill(report):
    geodesic, line = report.rows["geodesic"], report.rows["task_line"]
    assert geodesic["unanswered"] == 0
    assert geodesic["endpoint_after_mm"] < 1e-6
    assert geodesic["endpoint_after_deg"] < 1e-4
    assert geodesic["endpoint_before_mm"] < 2.0
    assert report.rows["geodesic_raw"]["endpoint_before_mm"] > 0.1
    assert geodesic["dtw_mm"] < 0.5 * line["dtw_mm"]
    assert geodesic["to_closest_mm"] < 0.5 * line["to_closest_mm"]


def test_cells_without_meaning_are_null(report):
    assert report.rows["people"]["endpoint_before_mm"] is None
    assert report.rows["reconstruction"]["endpoint_after_mm"] is None
    assert report.rows["mean_demonstration"]["off_manifold"] is None
    for row in ("geodesic", "geodesic_ridge", "geodesic_raw", "latent_line", "reconstruction"):
        assert 0.0 <= report.rows[row]["off_manifold"] <= 1.0


def test_refused_geodesics_are_counted_with_the_reason_and_in_no_mean(demonstrations, train_briefly):
    pytest.importorskip("movement_primitives")

    def train_timidly(*arguments):
        return replace(train_briefly(*arguments), energy_per_edge=1e-12)

    report = evaluate(demonstrations, [HELD_OUT], [0], train_timidly, show_progress=False)
    for row in ("geodesic", "geodesic_raw", "latent_line"):
        assert report.rows[row]["unanswered"] == len(HELD_OUT)
        assert report.rows[row]["dtw_mm"] is None
    refused = [item["refusal"] for item in report.as_dict()["held_out"] if item["row"] == "geodesic"]
    assert len(refused) == len(HELD_OUT)
    assert all(reason.startswith("GOAL_OUT_OF_SUPPORT: ") for reason in refused)
    assert "geodesic: 2 prediction(s) without an answer" in report.table()
    assert report.rows["reconstruction"]["dtw_mm"] > 0.0


def test_positions_alone_have_no_orientation_figures(demonstrations, train_briefly):
    pytest.importorskip("movement_primitives")
    flat = Demonstrations(
        tuple(
            type(item)(item.positions, np.tile([1.0, 0.0, 0.0, 0.0], (len(item), 1)), item.times, item.name)
            for item in demonstrations
        ),
        has_orientation=False,
    )
    report = evaluate(flat, [(2,)], [0], train_briefly, show_progress=False)
    assert all(values["orientation_deg"] is None for values in report.rows.values())
    assert report.rows["geodesic"]["dtw_mm"] < report.rows["task_line"]["dtw_mm"]


def test_no_path_is_nearer_than_the_sheets_own_nearest_poses(report):
    rows = report.rows
    for row in ("geodesic", "geodesic_ridge", "geodesic_canonical"):
        assert rows["sheet_oracle"]["dtw_mm"] < rows[row]["dtw_mm"]


def test_the_first_sheet_gives_the_geodesic_and_rows_of_other_sheets_are_empty(demonstrations, train_briefly):
    pytest.importorskip("movement_primitives")
    report = evaluate(demonstrations, [HELD_OUT], [0], train_briefly, show_progress=False, sheets=["raw"])
    assert report.rows["geodesic"]["dtw_mm"] == report.rows["geodesic_raw"]["dtw_mm"] > 0.0
    for row in ("geodesic_ridge", "geodesic_canonical", "conditional_mean", "sheet_oracle"):
        assert report.rows[row]["dtw_mm"] is None


@pytest.mark.parametrize(("folds", "seeds"), [([], [0]), ([(0,)], [])])
def test_nothing_to_evaluate_is_refused(demonstrations, train_briefly, folds, seeds):
    pytest.importorskip("movement_primitives")
    with pytest.raises(ParameterError, match="at least one fold and one seed"):
        evaluate(demonstrations, folds, seeds, train_briefly, show_progress=False)


def test_bad_folds_are_refused_before_anything_is_trained(demonstrations):
    pytest.importorskip("movement_primitives")

    def never(*arguments):
        raise AssertionError("trained before the folds were checked")

    with pytest.raises(DemonstrationError, match="cannot hold out demonstration 7"):
        evaluate(demonstrations, [(0,), (7,)], [0], never, show_progress=False)
