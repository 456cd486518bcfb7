"""`experiment` with demonstrations that it makes itself: to be saved and trained on, or refused in one line."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.cli import build_parser, main
from geodesic_motion_ros.demonstrations.readers import read_demonstrations
from geodesic_motion_ros.simulation.teacher import two_mode_demonstrations
from geodesic_motion_studies.experiments.registry import STUDIES
from geodesic_motion_studies.experiments.study import OfRecordings, options


def test_simulated_demonstrations_are_saved_to_train_on(tmp_path, capsys) -> None:
    file = tmp_path / "goals.npz"
    assert main(["experiment", "goals", "--shown", "2", "--held-out", "1", "--seeds", "4", "--save", str(file)]) == 0
    assert "the last 1 are those held out" in capsys.readouterr().out
    demonstrations = read_demonstrations(file, "m")
    assert len(demonstrations) == 3
    assert len({len(item) for item in demonstrations}) == 1
    file = tmp_path / "two_modes.npz"
    assert main(["experiment", "modes", "--shown", "2", "--seeds", "4", "--save", str(file)]) == 0
    for read, made in zip(read_demonstrations(file, "m"), two_mode_demonstrations(2, 4), strict=True):
        np.testing.assert_allclose(read.positions[[0, -1]], made.positions[[0, -1]], atol=1e-12)
        np.testing.assert_allclose(read.times[-1], made.times[-1])
    assert [entry.name for entry in tmp_path.iterdir() if entry.is_dir()] == []


def test_modes_leave_table_figures_and_picture(tmp_path, capsys, monkeypatch) -> None:
    from geodesic_motion_studies.experiments import modes

    thoroughly = modes.trained_once

    def briefly(task, shown, settings, folder):
        small = {"hidden": (48, 32), "samples": 80, "kernels": 80, "precision_samples": 2, "precision_iterations": 40}
        return thoroughly(task, shown, replace(settings, **small), folder)

    monkeypatch.setattr(modes, "trained_once", briefly)
    written = tmp_path / "figures.json"
    made = ["experiment", "modes", "--shown", "2", "--cases", "1", "--seeds", "1", "--steps", "150"]
    assert main([*made, "--out", str(tmp_path), "--json", str(written)]) == 0
    folder = tmp_path / "modes"
    assert (folder / "table.txt").read_text() in capsys.readouterr().out
    content = json.loads((folder / "figures.json").read_text())
    assert content == json.loads(written.read_text())
    assert len(content["cases"]) == 1
    assert (folder / "modes.png").read_bytes().startswith(b"\x89PNG")
    assert len(list((tmp_path / "skills").iterdir())) == 1


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["goals", "--shown", "1"], "at least 2"),
        (["modes", "--cases", "0"], "at least 1"),
        (["goals", "--seeds", "-1"], "none negative"),
        (["modes", "--shown", "2", "--save", "{tmp}/two_modes.npy"], "written to .npz files"),
    ],
)
def test_what_cannot_be_done_is_reported_in_one_line(arguments, reported, tmp_path, capsys) -> None:
    words = ["experiment", *(argument.format(tmp=tmp_path) for argument in arguments)]
    assert main([*words, "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("geodesic-motion: ")
    assert reported in line


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_is_measured_with_the_options_that_its_help_names(name, capsys) -> None:
    study = STUDIES[name].load()
    with pytest.raises(SystemExit):
        main(["experiment", name, "--help"])
    described = capsys.readouterr().out
    assert all(f"--{each.name.replace('_', '-')}" in described for each in options(study))
    needed = ["--demos", "none.npy", "--units", "m"] if STUDIES[name].of_recordings else []
    arguments = build_parser().parse_args(["experiment", name, *needed])
    defaults = study()
    assert {each.name: getattr(arguments, each.name) for each in options(study)} == {
        each.name: getattr(defaults, each.name) for each in options(study)
    }
    assert issubclass(study, OfRecordings) == STUDIES[name].of_recordings


def test_an_option_without_a_study_is_refused(capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main(["experiment", "toy-task", "--targets", "3"])
    assert left.value.code == 2
    assert "--targets" in capsys.readouterr().err
