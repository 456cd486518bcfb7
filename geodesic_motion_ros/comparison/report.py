"""The table of the comparison: what every row did in which scenes, with confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geodesic_motion_ros.comparison.execution import Outcome
from geodesic_motion_ros.comparison.families import FAMILIES
from geodesic_motion_ros.comparison.results import Played
from geodesic_motion_ros.tables import text_table

#: Of all intervals; of the normal distribution; draws of the bootstrap.
LEVEL, _QUANTILE, _DRAWS = 0.95, 1.959964, 1000


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Interval of a share at LEVEL (E. B. Wilson, "Probable inference, the law of succession", 1927); (0, 1) without
    trials.
    """
    if trials == 0:
        return 0.0, 1.0
    share, z = successes / trials, _QUANTILE**2 / trials
    middle, half = share + 0.5 * z, np.sqrt(z * (share * (1.0 - share) + 0.25 * z))
    return float(max(0.0, (middle - half) / (1.0 + z))), float(min(1.0, (middle + half) / (1.0 + z)))


def bootstrap_median(values: Sequence[float]) -> tuple[float, float]:
    """Interval of a median at LEVEL: percentiles of the medians of samples drawn with replacement; NaN of none."""
    if not len(values):
        return np.nan, np.nan
    drawn = np.random.default_rng(0).choice(np.asarray(values), (_DRAWS, len(values)))
    tails = 50.0 * (1.0 - LEVEL)
    low, high = np.percentile(np.median(drawn, axis=1), [tails, 100.0 - tails])
    return float(low), float(high)


def figures(outcomes: Sequence[Outcome]) -> dict[str, float | int | None]:
    """The columns of one row. Similarity, jerk and time are those of successes; clearances those of all scenes."""
    good = [outcome for outcome in outcomes if outcome.success]
    low, high = wilson(len(good), len(outcomes))
    replans = 1e3 * np.concatenate([outcome.replans for outcome in outcomes]) if outcomes else np.empty(0)
    dtw = [1e3 * outcome.dtw for outcome in good]
    dtw_low, dtw_high = bootstrap_median(dtw)
    ticks = sum(outcome.ticks for outcome in outcomes)
    return {
        "scenes": len(outcomes),
        "success_percent": 100.0 * len(good) / max(len(outcomes), 1),
        "success_low": 100.0 * low,
        "success_high": 100.0 * high,
        "contacts_moving": sum(outcome.contact == "moving" for outcome in outcomes),
        "contacts_standing": sum(outcome.contact in ("standing", "no room") for outcome in outcomes),
        "arm_touched": sum(outcome.arm_touched for outcome in outcomes),
        "refused": sum(outcome.refused for outcome in outcomes),
        "lost": sum(not (outcome.success or outcome.refused or outcome.contact) for outcome in outcomes),
        "least_clearance_mm": min((1e3 * outcome.clearance for outcome in good), default=None),
        "median_clearance_mm": _median([1e3 * outcome.clearance for outcome in good]),
        "dtw_mm": _median(dtw),
        "dtw_low": dtw_low,
        "dtw_high": dtw_high,
        "orientation_deg": _median([np.degrees(outcome.orientation) for outcome in good]),
        "jerk": _median([outcome.jerk for outcome in good]),
        "time_s": _median([outcome.duration for outcome in good]),
        "replan_p50_ms": float(np.percentile(replans, 50)) if len(replans) else None,
        "replan_p99_ms": float(np.percentile(replans, 99)) if len(replans) else None,
        "rate_held_percent": 100.0 * sum(outcome.in_time for outcome in outcomes) / max(ticks, 1),
    }


@dataclass(frozen=True)
class Report:
    """All that was played with one skill.

    Attributes
    ----------
    told : what each row is, in a line. held_out : whether similarity is to a demonstration that was held out.
    """

    skill: str
    seed: int
    played: Sequence[Played]
    told: dict[str, str]
    held_out: bool = False

    @property
    def similar_to(self) -> str:
        """What similarity is measured to."""
        return "the demonstration held out" if self.held_out else "the closest demonstration"

    def outcomes(self, row: str, wanted: Callable[[Played], bool]) -> list[Outcome]:
        """Of one row, those that are wanted."""
        return [item.outcome for item in self.played if item.row == row and wanted(item)]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            "skill": self.skill,
            "seed": self.seed,
            "held_out": self.held_out,
            "level": LEVEL,
            "rows": {
                row: {
                    "told": told,
                    "settings": next((item.settings for item in self.played if item.row == row), None),
                    "half_or_more_stay_free": figures(self.outcomes(row, _mostly_free)),
                    "fewer_stay_free": figures(self.outcomes(row, lambda item: not _mostly_free(item))),
                    "families": {
                        family: {
                            "half_or_more_stay_free": figures(self.outcomes(row, _of(family, True))),
                            "fewer_stay_free": figures(self.outcomes(row, _of(family, False))),
                        }
                        for family in self._families()
                    },
                }
                for row, told in self.told.items()
            },
            "scenes": [
                {"row": item.row, "family": item.family, "number": item.number}
                | {name: value for name, value in item.outcome.as_dict().items() if name != "replans"}
                for item in sorted(self.played, key=lambda item: (item.family, item.number, item.row))
            ],
        }

    def table(self) -> str:
        """The tables as plain text."""
        free = self._table("half or more stay free", _mostly_free)
        rest = self._table("fewer stay free", lambda item: not _mostly_free(item))
        title = f"{self.skill}, seed {self.seed}; dtw and orient from {self.similar_to}"
        return "\n\n".join([title, free, rest, self._by_family()])

    def _families(self) -> list[str]:
        known = {item.family for item in self.played}
        return [family for family in FAMILIES if family in known]

    def _table(self, title: str, wanted: Callable[[Played], bool]) -> str:
        head = [
            title, "scenes", "success %", "95 %", "hits", "hit", "refused", "lost", "least mm", "clear mm", "dtw mm",
            "95 %", "orient deg", "jerk", "time s", "p50 ms", "p99 ms", "held %",
        ]  # fmt: skip
        arm = any(item.outcome.arm_touched for item in self.played)
        rows = []
        for row in self.told:
            own = figures(self.outcomes(row, wanted))
            rows.append([
                row, own["scenes"], own["success_percent"], _interval(own["success_low"], own["success_high"]),
                own["contacts_moving"], own["contacts_standing"], own["refused"], own["lost"],
                own["least_clearance_mm"], own["median_clearance_mm"], own["dtw_mm"],
                _interval(own["dtw_low"], own["dtw_high"]), own["orientation_deg"], own["jerk"], own["time_s"],
                own["replan_p50_ms"], own["replan_p99_ms"], own["rate_held_percent"],
                *([own["arm_touched"]] if arm else []),
            ])  # fmt: skip
        return text_table([*head, "arm"] if arm else head, rows, 1)

    def _by_family(self) -> str:
        """Successes of scenes, by family: where half or more of the demonstrations stay free / elsewhere."""
        rows = []
        for row in self.told:
            cells = []
            for family in self._families():
                counts = []
                for free in (True, False):
                    outcomes = self.outcomes(row, _of(family, free))
                    counts.append(f"{sum(outcome.success for outcome in outcomes)}/{len(outcomes)}")
                cells.append("  ".join(counts))
            rows.append([row, *cells])
        return text_table(["successes: half or more free, fewer free", *self._families()], rows)


def _mostly_free(item: Played) -> bool:
    return item.outcome.mostly_free


def _of(family: str, mostly_free: bool) -> Callable[[Played], bool]:
    return lambda item: item.family == family and item.outcome.mostly_free == mostly_free


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _interval(low: float, high: float) -> str:
    return "-" if np.isnan(low) else f"{low:.0f}..{high:.0f}"
