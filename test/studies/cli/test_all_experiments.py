"""`experiment all`: each one in turn, a failing one does not stop the others, and the exit status tells of it."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

import pytest

from geodesic_motion_ros.studies.cli import main
from geodesic_motion_ros.utils.errors import ParameterError

#: Processor time [s] that is spent in user mode, in system mode, and so by processes that were waited for.
SHARES = (1.0, 2.0, 4.0, 8.0)


@pytest.fixture
def seeds() -> dict[str, tuple[int, ...]]:
    """Those that each experiment which has some was run with."""
    return {}


@pytest.fixture
def ran(monkeypatch, seeds) -> list[str]:
    """Names of what ran where nothing is measured, `circle` was requested wrongly and `modes` has a fault.

    Experiment number n, from 1, takes n times SHARES of the processor's time.
    """
    names: list[str] = []
    spent = [0.0] * 4

    def played(arguments: argparse.Namespace) -> None:
        names.append(arguments.experiment)
        if "seeds" in arguments:
            seeds[arguments.experiment] = arguments.seeds
        if "processes" in arguments:
            assert arguments.processes == len(os.sched_getaffinity(0))
        if "seed" in arguments:
            seeds[arguments.experiment] = (arguments.seed,)
        spent[:] = [time + len(names) * share for time, share in zip(spent, SHARES, strict=True)]
        if arguments.experiment == "circle":
            raise ParameterError("no circle today")
        if arguments.experiment == "modes":
            raise ZeroDivisionError("a fault")

    def every_experiment_played(parser: argparse.ArgumentParser, **defaults) -> None:
        plainly(parser, **(defaults | {"run": played} if parser.prog.split()[-1] != "all" else defaults))

    plainly = argparse.ArgumentParser.set_defaults
    monkeypatch.setattr(os, "times", lambda: os.times_result((*spent, 0.0)))
    monkeypatch.setattr(argparse.ArgumentParser, "set_defaults", every_experiment_played)
    return names


def test_all_go_on_after_failures_and_tell_of_them(ran, tmp_path: Path, capsys) -> None:
    assert main(["experiment", "all", "--out", str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert printed.err == f"geodesic-motion: 2 of {len(ran)} experiments failed: circle, modes\n"
    assert f"[{len(ran)}/{len(ran)}] {ran[-1]}" in printed.out
    assert {"toy-task", "toy-joint", "geodesics", "volume", "obstacle-laws"} < set(ran)
    content = json.loads((tmp_path / "all" / "figures.json").read_text())["experiments"]
    assert [row["experiment"] for row in content] == ran
    assert [row["processor_seconds"] for row in content] == [sum(SHARES) * (n + 1) for n in range(len(ran))]
    assert {row["error"] for row in content} == {"", "ParameterError: no circle today", "ZeroDivisionError: a fault"}
    assert (tmp_path / "all" / "table.txt").read_text().count("failed") == 2


def test_seeds_of_all_begin_where_one_asks(ran, seeds, tmp_path: Path) -> None:
    assert main(["experiment", "all", "--out", str(tmp_path)]) == 2
    by_default = dict(seeds)
    assert main(["experiment", "all", "--out", str(tmp_path), "--seeds-from", "10000"]) == 2
    assert {"goals", "whole-arm"} < set(by_default)
    assert seeds == {name: tuple(seed + 10_000 for seed in own) for name, own in by_default.items()}
