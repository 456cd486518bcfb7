"""`experiment all`: a failing one does not stop the others, the exit status tells of it, times are not disturbed."""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import asdict, dataclass, make_dataclass
from pathlib import Path
from typing import Any

import pytest

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.cli import experiment
from geodesic_motion_studies.experiments.registry import Entry
from geodesic_motion_studies.experiments.study import Report, Study, option, seeds


@dataclass(frozen=True, kw_only=True)
class Loaded(Entry):
    """An entry whose study stands in no file."""

    study: type[Study]

    def load(self) -> type[Study]:
        return self.study


@dataclass(frozen=True)
class Settings(Report):
    """A report of the settings that a study was run with, and of when."""

    content: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        return self.content

    def table(self) -> str:
        return "nothing"

    def draw(self, path: Path) -> None:
        path.touch()


#: Processor time that a study takes at least [s].
SPENT = 0.1


@pytest.fixture(autouse=True)
def studied(monkeypatch) -> None:
    """Five studies that measure nothing: one is requested wrongly, one is killed, and two state times."""

    def entry(name: str, fault: Exception | int | None, timed: bool = False, **settings: Any) -> Entry:
        def measure(study: Study, out: Path) -> Settings:
            print(f"this is {name}")
            content = asdict(study) | {"began": time.monotonic()}
            while time.process_time() < SPENT:
                pass
            if isinstance(fault, int):
                os.kill(os.getpid(), fault)
            if fault is not None:
                raise fault
            return Settings(content | {"ended": time.monotonic()})

        kinds = [(each, Any, default) for each, default in settings.items()]
        study = make_dataclass("Played", kinds, bases=(Study,), frozen=True, namespace={"measure": measure})
        return Loaded("", about=name, timed=timed, study=study)

    found = {
        "alone": entry("alone", None, True),
        "several": entry("several", None, seeds=seeds(), kept=3),
        "wrong": entry("wrong", ParameterError("not today")),
        "recorded": Entry("", "", "", of_recordings=True),
        "killed": entry("killed", signal.SIGKILL),
        "single": entry("single", None, True, seed=option(5, "of it")),
    }
    monkeypatch.setattr(experiment, "STUDIES", found)


def figures(path: Path) -> dict[str, Any]:
    return json.loads((path / "figures.json").read_text())


def test_all_go_on_after_failures_and_tell_of_them(tmp_path: Path, capsys) -> None:
    assert main(["experiment", "all", "--out", str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert printed.err == "geodesic-motion: 2 of 5 experiments failed: wrong, killed\n"
    assert "[5/5] single done" in printed.out
    content = figures(tmp_path / "all")["experiments"]
    assert [row["experiment"] for row in content] == ["alone", "several", "wrong", "killed", "single"]
    assert all(row["processor_seconds"] > 0.5 * SPENT for row in content)
    errors = ["", "", "ParameterError: not today", f"ended by signal {signal.SIGKILL:d}", ""]
    assert [row["error"] for row in content] == errors
    assert (tmp_path / "all" / "table.txt").read_text().count("failed") == 2
    assert (tmp_path / "several" / "several.png").is_file()
    assert "this is several" in (tmp_path / "several" / "log.txt").read_text()
    assert "Traceback" in (tmp_path / "wrong" / "log.txt").read_text()


def test_what_states_times_runs_when_nothing_else_does(tmp_path: Path) -> None:
    assert main(["experiment", "all", "--out", str(tmp_path)]) == 2
    beside, *alone = (figures(tmp_path / name) for name in ("several", "alone", "single"))
    assert beside["ended"] <= alone[0]["began"]
    assert alone[0]["ended"] <= alone[1]["began"]


def test_seeds_of_all_begin_where_one_asks(tmp_path: Path) -> None:
    assert main(["experiment", "all", "--out", str(tmp_path), "--seeds-from", "10000"]) == 2
    several, single = (figures(tmp_path / name) for name in ("several", "single"))
    assert several["seeds"] == [10_000, 10_001, 10_002]
    assert several["kept"] == 3
    assert single["seed"] == 10_005
