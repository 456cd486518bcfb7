"""Results on disk: one file an outcome, so that a run that was interrupted goes on, and rows can be added later."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geodesic_motion_ros.comparison.execution import Outcome
from geodesic_motion_ros.comparison.families import Family
from geodesic_motion_ros.tables import write_json

#: Of the scenes and of how they are judged: results of another one are not counted.
PROTOCOL = 1


@dataclass(frozen=True)
class Played:
    """An outcome, whose it is, and how its method was set up."""

    row: str
    family: Family
    number: int
    settings: dict[str, Any]
    outcome: Outcome


def held_out_folder(folder: Path, skill: str) -> Path:
    """Where all of a skill is that has to do with demonstrations held out, in the folder for results."""
    return folder / skill / "held_out"


class Results:
    """Outcomes by row, family and number, of one skill and one seed, with demonstrations held out or without.

    An outcome is valid for the settings that its method had.
    """

    def __init__(self, folder: Path, skill: str, seed: int, held_out: bool = False) -> None:
        self._folder = (held_out_folder(folder, skill) if held_out else folder / skill) / f"seed_{seed}"

    def outcome(self, row: str, family: Family, number: int, settings: dict[str, Any]) -> Outcome | None:
        """What is known; None where it has to be played."""
        known = self._read(row, family, number)
        return None if known is None or known.settings != json.loads(json.dumps(settings)) else known.outcome

    def complete(self, rows: Sequence[str], families: Sequence[Family], scenes: int) -> list[Played]:
        """What is known of those scenes that every row has played, whatever its settings were."""
        found = []
        for family in families:
            for number in range(scenes):
                known = [self._read(row, family, number) for row in rows]
                if all(item is not None for item in known):
                    found += known
        return found

    def keep(self, row: str, family: Family, number: int, settings: dict[str, Any], outcome: Outcome) -> None:
        """Write one down."""
        path = self._path(row, family, number)
        content = {"protocol": PROTOCOL, "settings": settings, "outcome": outcome.as_dict()}
        # A file is whole or not there, whenever the run is interrupted.
        write_json(path.with_suffix(".part"), content).replace(path)

    def _read(self, row: str, family: Family, number: int) -> Played | None:
        path = self._path(row, family, number)
        if not path.is_file():
            return None
        content = json.loads(path.read_text())
        if content["protocol"] != PROTOCOL:
            return None
        told = content["outcome"]
        outcome = Outcome(**(told | {"replans": tuple(told["replans"])}))
        return Played(row, family, number, content["settings"], outcome)

    def _path(self, row: str, family: Family, number: int) -> Path:
        return self._folder / row.replace(", ", "_").replace(" ", "_") / f"{family}_{number:04d}.json"
