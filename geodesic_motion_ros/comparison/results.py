"""Results on disk: one file an outcome, so that a run that was interrupted goes on, and rows can be added later."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from geodesic_motion_ros.comparison.execution import Outcome
from geodesic_motion_ros.comparison.families import Family
from geodesic_motion_ros.tables import write_json

#: Of the scenes and of how they are judged: results of another one are not counted.
PROTOCOL = 1


class Results:
    """Outcomes by row, family and number, of one skill and one seed.

    An outcome is valid for the settings that its method had.
    """

    def __init__(self, folder: Path, skill: str, seed: int) -> None:
        self._folder = folder / skill / f"seed_{seed}"

    def outcome(self, row: str, family: Family, number: int, settings: dict[str, Any]) -> Outcome | None:
        """What is known; None where it has to be played."""
        path = self._path(row, family, number)
        if not path.is_file():
            return None
        content = json.loads(path.read_text())
        if content["protocol"] != PROTOCOL or content["settings"] != json.loads(json.dumps(settings)):
            return None
        told = content["outcome"]
        return Outcome(**(told | {"replans": tuple(told["replans"])}))

    def keep(self, row: str, family: Family, number: int, settings: dict[str, Any], outcome: Outcome) -> None:
        """Write one down."""
        path = self._path(row, family, number)
        content = {"protocol": PROTOCOL, "settings": settings, "outcome": outcome.as_dict()}
        # A file is whole or not there, whenever the run is interrupted.
        write_json(path.with_suffix(".part"), content).replace(path)

    def _path(self, row: str, family: Family, number: int) -> Path:
        return self._folder / row.replace(", ", "_").replace(" ", "_") / f"{family}_{number:04d}.json"
