"""What a later version wins and loses in the same scenes is counted scene by scene."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.paired import main, pairs_of, table


def report(ends: dict[tuple[str, int], str], **others: Any) -> dict[str, Any]:
    """As of `benchmark --json`: scenes that end reached, not reached, or with a contact."""
    scenes = [
        {"row": "ours", "family": family, "number": number, "reached": end == "reached",
         "contact": "" if "reached" in end else end}
        for (family, number), end in ends.items()
    ]  # fmt: skip
    return {"skill": "panda_pouring", "guard": "arm", "seed": 3, "scenes": scenes} | others


BEFORE = {("static", 0): "reached", ("static", 1): "moving", ("gate", 0): "reached", ("gate", 1): "standing"}
AFTER = {("static", 0): "reached", ("static", 1): "reached", ("gate", 0): "not reached", ("gate", 1): "no room"}


def test_scenes_are_counted_by_family_and_in_all() -> None:
    lines = table(pairs_of(report(BEFORE), report(AFTER))).splitlines()
    counts = {line.split()[0]: line.split()[1:] for line in lines[2:]}
    # scenes, successes before and after, won, lost, contacts in motion before and after, standing before and after
    assert counts["static"] == ["2", "1", "2", "1", "0", "1", "0", "0", "0"]
    assert counts["gate"] == ["2", "1", "0", "0", "1", "0", "1", "1", "0"]
    assert counts["all"] == ["4", "2", "2", "1", "1", "1", "1", "1", "0"]


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (report(AFTER, seed=4), "seed is 3 before and 4 after"),
        (report({("static", 0): "reached"}), "3 scenes are in one of both files alone"),
        (report({}), "rows are none"),
    ],
)
def test_other_scenes_are_refused(after: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        pairs_of(report(BEFORE), after)


def test_the_command_prints_the_table_and_keeps_the_scenes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [tmp_path / "before.json", tmp_path / "after.json"]
    for file, ends in zip(files, (BEFORE, AFTER), strict=True):
        file.write_text(json.dumps(report(ends)))
    kept = tmp_path / "pairs.json"
    assert main([*map(str, files), "--json", str(kept)]) == 0
    assert "static" in capsys.readouterr().out
    assert json.loads(kept.read_text())[0] == ["panda_pouring", 3, "gate", 0, "reached", "not reached"]
    files[1].write_text("{}")
    assert main([*map(str, files)]) == 2
    assert "is not of benchmark --json" in capsys.readouterr().err
