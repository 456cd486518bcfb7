"""`experiment all`: each one in turn, a failing one does not stop the others, and the exit status tells of it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.errors import ParameterError


@pytest.fixture
def ran(monkeypatch) -> list[str]:
    """Names of what ran where nothing is measured, `circle` was asked for wrongly and `modes` has a fault."""
    names: list[str] = []

    def played(arguments: argparse.Namespace) -> None:
        names.append(arguments.experiment)
        if arguments.experiment == "circle":
            raise ParameterError("no circle today")
        if arguments.experiment == "modes":
            raise ZeroDivisionError("a fault")

    def every_experiment_played(parser: argparse.ArgumentParser, **defaults) -> None:
        plainly(parser, **(defaults | {"run": played} if parser.prog.split()[-1] != "all" else defaults))

    plainly = argparse.ArgumentParser.set_defaults
    monkeypatch.setattr(argparse.ArgumentParser, "set_defaults", every_experiment_played)
    return names


def test_all_go_on_after_failures_and_tell_of_them(ran, tmp_path: Path, capsys) -> None:
    assert main(["experiment", "all", "--out", str(tmp_path)]) == 2
    told = capsys.readouterr()
    assert told.err == f"geodesic-motion: 2 of {len(ran)} experiments failed: circle, modes\n"
    assert f"[{len(ran)}/{len(ran)}] {ran[-1]}" in told.out
    assert {"toy-task", "toy-joint", "geodesics", "volume", "obstacle-laws"} < set(ran)
    content = json.loads((tmp_path / "all" / "figures.json").read_text())["experiments"]
    assert [row["experiment"] for row in content] == ran
    assert all(0.0 <= row["processor_seconds"] < 60.0 for row in content)
    assert {row["error"] for row in content} == {"", "ParameterError: no circle today", "ZeroDivisionError: a fault"}
    assert (tmp_path / "all" / "table.txt").read_text().count("failed") == 2
