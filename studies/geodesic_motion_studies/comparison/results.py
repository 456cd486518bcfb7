"""Results on disk: one file an outcome, so that a run that was interrupted goes on, and rows can be added later."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.comparison.execution import Outcome
from geodesic_motion_studies.comparison.families import Family

#: Of the scenes and of how they are judged: results of another one are not counted.
PROTOCOL = 2

SceneId = tuple[Family, int]


@dataclass(frozen=True)
class Played:
    """An outcome, whose it is, and what it is valid for."""

    row: str
    family: Family
    number: int
    settings: dict[str, Any]
    outcome: Outcome

    @property
    def scene_id(self) -> SceneId:
        """Which scene it is of, among those of a seed."""
        return self.family, self.number


def results_folder(folder: Path, skill: str, held_out: bool = False, apart: str = "") -> Path:
    """The folder of a skill in the folder for results. Demonstrations held out have one of their own in it, and so has
    `apart`: what else must not be mixed with the skill's scenes.
    """
    own = folder / skill / apart
    return own / "held_out" if held_out else own


class Results:
    """Outcomes by row, family and number, of one seed in one of the folders of a skill (`results_folder`).

    An outcome is valid for what it was played with: the method's settings, and what was learned; not for a version of
    the code.
    """

    def __init__(self, folder: Path, skill: str, seed: int, held_out: bool = False, apart: str = "") -> None:
        self._folder = results_folder(folder, skill, held_out, apart) / f"seed_{seed}"

    def outcome(self, row: str, family: Family, number: int, settings: dict[str, Any]) -> Outcome | None:
        """What is known; None where it has to be played."""
        path = self._path(row, family, number)
        if not path.is_file():
            return None
        content = json.loads(path.read_text())
        if content["protocol"] != PROTOCOL or content["settings"] != json.loads(json.dumps(settings)):
            return None
        outcome = content["outcome"]
        return Outcome(**(outcome | {"replans": tuple(outcome["replans"])}))

    def numbers(self, row: str, family: Family) -> list[int]:
        """The scenes of a family that a row has played, whatever it was played with."""
        files = self._path(row, family, 0).parent.glob(f"{family}_*.json")
        return sorted(int(file.stem.removeprefix(f"{family}_")) for file in files)

    def keep(self, row: str, family: Family, number: int, settings: dict[str, Any], outcome: Outcome) -> None:
        """Write one down."""
        path = self._path(row, family, number)
        content = {"protocol": PROTOCOL, "settings": settings, "outcome": outcome.as_dict()}
        write_json(path, content)

    def _path(self, row: str, family: Family, number: int) -> Path:
        return self._folder / row.replace(", ", "_").replace(" ", "_") / f"{family}_{number:04d}.json"
