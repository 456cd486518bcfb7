"""Trainings in processes of their own: what is measured of them, with whichever code, and what the report holds."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from geodesic_motion_ros.demonstrations.readers import read_demonstrations, read_joint_demonstrations
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.benchmarks.trainings import (
    BRIEFLY,
    KINDS,
    ROBOT,
    SAMPLES,
    TrainingRow,
    TrainingsReport,
    measure_trainings,
    write_files,
)

COUNTS = (3, 5)


@pytest.fixture(scope="module")
def report() -> TrainingsReport:
    return measure_trainings(COUNTS, settings=BRIEFLY, show_progress=False)


def test_each_training_has_its_time_its_memory_and_what_it_said(report: TrainingsReport) -> None:
    assert [(row.kind, row.demonstrations) for row in report.rows] == [(kind, n) for kind in KINDS for n in COUNTS]
    for row in report.rows:
        assert row.code == "this"
        assert row.cpu_seconds > 0.0
        assert row.seconds > 0.0
        assert row.said_seconds is not None
        # More than the arrays that are stated, and in the right unit: a Python with torch has a part of a GB.
        assert row.said_memory < row.memory < 20.0


def test_a_training_that_fails_is_said() -> None:
    with pytest.raises(ParameterError, match=r"the training on poses_3\.npz fails"):
        measure_trainings([3], settings={"steps": 0}, kinds=("poses",), show_progress=False)


def test_fewer_demonstrations_are_the_first_ones_of_more(tmp_path: Path) -> None:
    poses, joints = (write_files(kind, COUNTS, tmp_path) for kind in KINDS)
    few, many = (read_demonstrations(poses[count], units="m").positions_array() for count in COUNTS)
    assert few.shape == (COUNTS[0], SAMPLES, 3)
    assert (few == many[: COUNTS[0]]).all()
    few, many = (read_joint_demonstrations(joints[count], ROBOT).configurations_array() for count in COUNTS)
    assert few.shape == (COUNTS[0], SAMPLES, 7)
    assert (few == many[: COUNTS[0]]).all()


def test_a_row_is_compared_with_the_next_fewer_of_its_kind_and_code(tmp_path: Path) -> None:
    rows = [
        TrainingRow(kind, count, code, seconds, 1.0, 1.0, None, 0.5)
        for kind, count, code, seconds in [
            ("poses", 4, "this", 2.0), ("poses", 8, "this", 3.0), ("poses", 16, "this", 6.0), ("poses", 4, "old", 9.0),
            ("joints", 8, "this", 5.0),
        ]
    ]  # fmt: skip
    report = TrainingsReport(tuple(rows), (0.0, 0.0))
    assert [report.over_before(row) for row in rows] == [None, 1.5, 2.0, None, None]
    written = json.loads(json.dumps(report.as_dict()))
    assert [row["over_before"] for row in written["rows"]] == [None, 1.5, 2.0, None, None]
    lines = report.table().splitlines()
    assert len(lines) == 3 + len(rows)
    assert max(map(len, lines)) <= 120
