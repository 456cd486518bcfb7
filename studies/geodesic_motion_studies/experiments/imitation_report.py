"""The held-out table of `imitation`: its rows and columns, and the measurements it is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.experiments.crossing import Crossing
from geodesic_motion_studies.experiments.folds import Fold
from geodesic_motion_studies.tools.averages import mean

Values = dict[str, float]
"""Column -> value of one prediction, NaN where it has no meaning."""

ROWS = (
    "geodesic",
    "geodesic_ridge",
    "geodesic_canonical",
    "geodesic_raw",
    "latent_line",
    "conditional_mean",
    "sheet_oracle",
    "task_line",
    "nearest_demonstration",
    "mean_demonstration",
    "dmp_nearest",
    "promp",
    "reconstruction",
    "people",
)
COLUMNS = (
    "dtw_mm",
    "frechet_mm",
    "orientation_deg",
    "to_closest_mm",
    "endpoint_before_mm",
    "endpoint_after_mm",
    "off_manifold",
)
ANGLE_COLUMNS = ("endpoint_before_deg", "endpoint_after_deg")


@dataclass(frozen=True)
class Measurement:
    """Values of one row for held-out demonstration number `demonstration`; `seed` where one was trained.

    `refusal` is the planner's reason where it found no path, empty where there is an answer.
    """

    row: str
    demonstration: int
    seed: int | None
    values: Values
    refusal: str = ""


@dataclass(frozen=True)
class ImitationReport:
    """The held-out table of one task, with every single measurement it is made of."""

    task: str
    folds: tuple[Fold, ...]
    seeds: tuple[int, ...]
    people: Values
    measurements: tuple[Measurement, ...] = field(repr=False)
    crossings: tuple[Crossing, ...] = ()

    @property
    def rows(self) -> dict[str, dict[str, float | None]]:
        """Row -> column -> mean, None where there is no value."""
        return {row: self._row(row) for row in ROWS}

    def _row(self, row: str) -> dict[str, float | None]:
        of_row = [item for item in self.measurements if item.row == row]
        columns = (*COLUMNS, *ANGLE_COLUMNS)
        means = {column: mean([item.values.get(column, math.nan) for item in of_row]) for column in columns}
        if row == "people":
            means |= {column: _finite(value) for column, value in self.people.items()}
        return means | {"unanswered": sum(bool(item.refusal) for item in of_row)}

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes; valid JSON, nothing in it is NaN."""
        return {
            "task": self.task,
            "seeds": list(self.seeds),
            "folds": [list(fold) for fold in self.folds],
            "rows": self.rows,
            "crossing": {
                "median_energy_ratio": float(np.median([item.ratio for item in self.crossings])),
                "refused_for_energy": float(np.mean([item.refused for item in self.crossings])),
            }
            if self.crossings
            else None,
            "held_out": [
                {
                    "row": item.row,
                    "demonstration": item.demonstration,
                    "seed": item.seed,
                    "refusal": item.refusal or None,
                    **{column: _finite(value) for column, value in item.values.items()},
                }
                for item in self.measurements
            ],
        }

    def table(self) -> str:
        """The table as plain text, a dash where a value has no meaning."""
        head = ["row", *(column.replace("_", " ") for column in COLUMNS)]
        body = [[row, *(self.rows[row][column] for column in COLUMNS)] for row in ROWS]
        folds = "/".join(",".join(map(str, fold)) for fold in self.folds)
        notes = [
            f"{row}: {values['unanswered']} prediction(s) without an answer, not in the means"
            for row, values in self.rows.items()
            if values["unanswered"]
        ]
        notes += self._in_words()
        if self.crossings:
            ratio = np.median([item.ratio for item in self.crossings])
            refused = sum(item.refused for item in self.crossings)
            notes.append(
                f"crossing to the cluster of -q: {ratio:.3g} times the energy within (median), refused for "
                f"its energy {refused} of {len(self.crossings)}"
            )
        title = f"{self.task}: held out {folds}, seeds {', '.join(map(str, self.seeds))}"
        return "\n".join([title, text_table(head, body), *notes])

    def _in_words(self) -> list[str]:
        """Where the geodesic's distance from what people did comes from."""
        rows = self.rows
        geodesic, mean, oracle = (rows[row]["dtw_mm"] for row in ("geodesic", "conditional_mean", "sheet_oracle"))
        if geodesic is None or mean is None or oracle is None:
            return []
        return [
            f"where the geodesic's {geodesic:.1f} mm come from: {oracle:.1f} mm no path on the sheet could avoid "
            f"(representation); {mean:.1f} mm the demonstrations' mean misses too, which start and goal do not tell "
            f"(unpredictable); {geodesic - mean:+.1f} mm is the shortest path's own (path choice)"
        ]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
