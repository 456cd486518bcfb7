"""`experiment all`: each one in turn, a failing one does not stop the others, and the exit status tells of it."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, make_dataclass
from pathlib import Path
from typing import Any

import pytest

from geodesic_motion_ros.studies.cli import experiment, main
from geodesic_motion_ros.studies.experiments.registry import Entry
from geodesic_motion_ros.studies.experiments.study import Report, Study, option, seeds
from geodesic_motion_ros.utils.errors import ParameterError

#: Processor time [s] that is spent in user mode, in system mode, and so by processes that were waited for.
SHARES = (1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True, kw_only=True)
class Loaded(Entry):
    """An entry whose study stands in no file."""

    study: type[Study]

    def load(self) -> type[Study]:
        return self.study


@dataclass(frozen=True)
class Nothing(Report):
    """A report of nothing."""

    def as_dict(self) -> dict[str, Any]:
        return {}

    def table(self) -> str:
        return "nothing"

    def draw(self, path: Path) -> None:
        path.touch()


@pytest.fixture
def ran(monkeypatch) -> list[tuple[str, Study]]:
    """What ran, by its name: four studies that measure nothing, of which one is requested wrongly and one has a fault.

    Number n of them, from 1, takes n times SHARES of the processor's time. One that needs recordings stands among them.
    """
    names: list[tuple[str, Study]] = []
    spent = [0.0] * 4

    def studied(name: str, fault: Exception | None, **settings: Any) -> Entry:
        def measure(study: Study, out: Path) -> Nothing:
            names.append((name, study))
            spent[:] = [time + len(names) * share for time, share in zip(spent, SHARES, strict=True)]
            if fault is not None:
                raise fault
            return Nothing()

        kinds = [(each, Any, default) for each, default in settings.items()]
        study = make_dataclass("Played", kinds, bases=(Study,), frozen=True, namespace={"measure": measure})
        return Loaded("", about=name, study=study)

    monkeypatch.setattr(os, "times", lambda: os.times_result((*spent, 0.0)))
    found = {
        "several": studied("several", None, seeds=seeds(), kept=3),
        "wrong": studied("wrong", ParameterError("not today")),
        "recorded": Entry("", "", "", of_recordings=True),
        "single": studied("single", None, seed=option(5, "of it"), processes=option(1, "that play")),
        "faulty": studied("faulty", ZeroDivisionError("a fault")),
    }
    monkeypatch.setattr(experiment, "STUDIES", found)
    return names


def test_all_go_on_after_failures_and_tell_of_them(ran, tmp_path: Path, capsys) -> None:
    assert main(["experiment", "all", "--out", str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert printed.err == "geodesic-motion: 2 of 4 experiments failed: wrong, faulty\n"
    assert "[4/4] faulty" in printed.out
    content = json.loads((tmp_path / "all" / "figures.json").read_text())["experiments"]
    assert [row["experiment"] for row in content] == [name for name, _ in ran]
    assert [name for name, _ in ran] == ["several", "wrong", "single", "faulty"]
    assert [row["processor_seconds"] for row in content] == [sum(SHARES) * (n + 1) for n in range(len(ran))]
    assert [row["error"] for row in content] == ["", "ParameterError: not today", "", "ZeroDivisionError: a fault"]
    assert (tmp_path / "all" / "table.txt").read_text().count("failed") == 2
    assert (tmp_path / "several" / "several.png").is_file()


def test_seeds_of_all_begin_where_one_asks(ran, tmp_path: Path) -> None:
    assert main(["experiment", "all", "--out", str(tmp_path), "--seeds-from", "10000"]) == 2
    studies = dict(ran)
    assert studies["several"].seeds == (10_000, 10_001, 10_002)
    assert studies["several"].kept == 3
    assert studies["single"].seed == 10_005
    assert studies["single"].processes == len(os.sched_getaffinity(0))
