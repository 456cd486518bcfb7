"""Two versions of the planner in the same scenes, scene by scene: what the later one wins and loses, by family.

    geodesic-motion benchmark --scenes-from out/scenes.npz --methods ours --json out/after.json
    python -m geodesic_motion_studies.comparison.at_revision baseline-10 out/scenes.npz --json out/before.json
    python -m geodesic_motion_studies.comparison.paired out/before.json out/after.json --json out/pairs.json

A *net loss* is a scene in which only the earlier one succeeds, less one in which only the later one does. With several
files of each, in the same order, the table is of all of them.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geodesic_motion_ros.utils.errors import FileError, GeodesicMotionError, ParameterError
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_studies.comparison.families import FAMILIES

_HEAD = ("family", "scenes", "before", "after", "won", "lost", "moving", "moving after", "standing", "standing after")
#: What becomes of a scene without a contact.
_OTHERWISE = {True: "reached", False: "not reached"}


@dataclass(frozen=True)
class Pair:
    """What became of a scene before and after: reached, not reached, or the contact that ended it."""

    skill: str
    seed: int
    family: str
    number: int
    before: str
    after: str


def pairs_of(before: dict[str, Any], after: dict[str, Any]) -> list[Pair]:
    """The scenes of two files of `benchmark --json`, of one row each.

    Raises
    ------
    ParameterError : they are not of the same scenes, or of several rows.
    """
    for name in ("skill", "guard", "seed"):
        if before[name] != after[name]:
            raise ParameterError(f"{name} is {before[name]} before and {after[name]} after: play the same scenes")
    first, second = map(_outcomes, (before, after))
    if first.keys() != second.keys():
        raise ParameterError(f"{len(first.keys() ^ second.keys())} scenes are in one of both files alone")
    return [Pair(before["skill"], before["seed"], *scene, first[scene], second[scene]) for scene in sorted(first)]


def _outcomes(report: dict[str, Any]) -> dict[tuple[str, int], str]:
    scenes = report["scenes"]
    rows = {scene["row"] for scene in scenes}
    if len(rows) != 1:
        raise ParameterError(f"rows are {', '.join(sorted(rows)) or 'none'}: one is needed, give --methods")
    return {
        (scene["family"], scene["number"]): scene["contact"] or _OTHERWISE[scene["reached"]] for scene in scenes
    }


def table(pairs: Iterable[Pair]) -> str:
    """Successes and contacts by family, and in all."""
    pairs = list(pairs)
    families = [family for family in FAMILIES if any(pair.family == family for pair in pairs)]
    rows = [_row(family, [pair for pair in pairs if pair.family == family]) for family in families]
    return text_table(_HEAD, [*rows, _row("all", pairs)])


def _row(name: str, pairs: Sequence[Pair]) -> list[Cell]:
    before, after = [pair.before for pair in pairs], [pair.after for pair in pairs]
    reached = [(pair.before == "reached", pair.after == "reached") for pair in pairs]
    moving = [sum(end in ("moving", "no room") for end in ends) for ends in (before, after)]
    standing = [ends.count("standing") for ends in (before, after)]
    return [
        name, len(pairs), before.count("reached"), after.count("reached"), reached.count((False, True)),
        reached.count((True, False)), *moving, *standing,
    ]  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, nargs="+", help="files of benchmark --json, all before, then all after")
    parser.add_argument("after", type=Path, help="the last of those after")
    parser.add_argument("--json", type=Path, metavar="FILE", help="for the scenes, a line each")
    arguments = parser.parse_args(argv)
    files = [*arguments.before, arguments.after]
    try:
        if len(files) % 2:
            raise ParameterError(f"{len(files)} files: as many after as before are needed")
        reports = [_read(path) for path in files]
        half = len(files) // 2
        pairs = [pair for two in zip(reports[:half], reports[half:], strict=True) for pair in pairs_of(*two)]
        print(table(pairs))
        if arguments.json is not None:
            lines = ",\n".join(json.dumps(list(vars(pair).values())) for pair in pairs)
            arguments.json.write_text(f"[\n{lines}\n]\n")
    except GeodesicMotionError as error:
        print(f"paired: {error}", file=sys.stderr)
        return 2
    return 0


def _read(path: Path) -> dict[str, Any]:
    try:
        report = json.loads(path.read_text())
        if not {"skill", "guard", "seed", "scenes"} <= report.keys():
            raise FileError(f"{path} is not of benchmark --json: skill, guard, seed or scenes are missing")
    except (OSError, ValueError, AttributeError) as error:
        raise FileError(f"cannot read {path}: {error}") from None
    return report


if __name__ == "__main__":
    raise SystemExit(main())
