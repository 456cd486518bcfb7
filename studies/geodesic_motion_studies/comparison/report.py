"""The tables of the comparison: what every row did in which scenes, with confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.comparison.execution import Outcome
from geodesic_motion_studies.comparison.families import FAMILIES, Family
from geodesic_motion_studies.comparison.guard import Guard
from geodesic_motion_studies.comparison.results import Played, SceneId

#: Of all intervals; of the normal distribution; draws of the bootstrap.
LEVEL, _QUANTILE, _DRAWS = 0.95, 1.959964, 1000
#: An arm stops in less time than this [s]: of what had been in view for less it could not keep clear.
IN_VIEW = 0.5
#: The row that avoids nothing: where it fails there was something to avoid.
BLIND = "replay"

_GUARDED: dict[Guard, str] = {"arm": "the whole arm", "tool": "the hand"}

Figures = dict[str, Any]


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


def figures(played: Sequence[Played], blind_fails: Set[SceneId] | None = None) -> Figures:
    """The columns of one row, of scenes that it played.

    Clearance, similarity, jerk and time are those of successes; clearance where there are spheres, and dtw_avoiding in
    the scenes `blind_fails`: None without these. What processor time is said of is None of motions without ticks.
    """
    outcomes = [item.outcome for item in played]
    won = [item for item in played if item.outcome.success]
    good = [item.outcome for item in won]
    low, high = wilson(len(good), len(outcomes))
    clearances = [1e3 * item.outcome.clearance for item in won if item.family != "none"]
    dtw = [1e3 * outcome.dtw for outcome in good]
    dtw_low, dtw_high = bootstrap_median(dtw)
    replans = 1e3 * np.concatenate([outcome.replans for outcome in outcomes]) if outcomes else np.empty(0)
    ticks = sum(outcome.ticks for outcome in outcomes)
    return {
        "scenes": len(outcomes),
        "success_percent": 100.0 * len(good) / max(len(outcomes), 1),
        "success_low": 100.0 * low,
        "success_high": 100.0 * high,
        "contacts_moving": sum(outcome.touched_moving for outcome in outcomes),
        "contacts_standing": sum(outcome.contact == "standing" for outcome in outcomes),
        "contacts_standing_where_waiting_avoids": sum(outcome.waiting_avoids is True for outcome in outcomes),
        "contacts_scene": sum(outcome.contact == "scene" for outcome in outcomes),
        "arm_touched": sum(outcome.arm_touched for outcome in outcomes),
        "refused": sum(outcome.refused for outcome in outcomes),
        "lost": sum(not (outcome.success or outcome.refused or outcome.contact) for outcome in outcomes),
        "least_clearance_mm": min(clearances, default=None),
        "median_clearance_mm": _median(clearances),
        "dtw_mm": _median(dtw),
        "dtw_low": dtw_low,
        "dtw_high": dtw_high,
        "dtw_avoiding_mm": _median([1e3 * item.outcome.dtw for item in won if item.scene_id in (blind_fails or ())]),
        "orientation_deg": _median([np.degrees(outcome.orientation) for outcome in good]),
        "jerk": _median([outcome.jerk for outcome in good]),
        "time_s": _median([outcome.duration for outcome in good]),
        "replan_p50_ms": float(np.percentile(replans, 50)) if len(replans) else None,
        "replan_p99_ms": float(np.percentile(replans, 99)) if len(replans) else None,
        "in_time_percent": 100.0 * sum(outcome.in_time for outcome in outcomes) / ticks if ticks else None,
    }


@dataclass(frozen=True)
class _Column:
    """A column: its head, in plain text and in Markdown, and the text of its cells."""

    head: str
    in_full: str
    cell: Callable[[Figures], str]


def _count(name: str) -> Callable[[Figures], str]:
    return lambda own: str(own[name])


def _value(name: str) -> Callable[[Figures], str]:
    return lambda own: _digits(own[name])


def _percent(name: str) -> Callable[[Figures], str]:
    return lambda own: "-" if own[name] is None else f"{own[name]:.1f}"


#: Of the tables by what stays free.
_COLUMNS = (
    _Column("success %", "success %", _percent("success_percent")),
    _Column("95 %", "95 %", lambda own: f"{own['success_low']:.1f}..{own['success_high']:.1f}"),
    _Column("moving", "touched, moving", _count("contacts_moving")),
    _Column("standing", "touched, standing", _count("contacts_standing")),
    _Column("refused", "refused", _count("refused")),
    _Column("lost", "lost", _count("lost")),
    _Column("least mm", "least clearance mm", _value("least_clearance_mm")),
    _Column("clear mm", "median clearance mm", _value("median_clearance_mm")),
    _Column("dtw mm", "DTW mm", _value("dtw_mm")),
    _Column("95 %", "95 %", lambda own: _interval(own["dtw_low"], own["dtw_high"])),
    _Column("avoiding", "DTW, avoiding mm", _value("dtw_avoiding_mm")),
    _Column("orient deg", "orientation deg", _value("orientation_deg")),
    _Column("jerk", "jerk rad/s^3", _value("jerk")),
    _Column("time s", "time s", _value("time_s")),
    _Column("p50 ms", "p50 ms", _value("replan_p50_ms")),
    _Column("p99 ms", "p99 ms", _value("replan_p99_ms")),
    _Column("in time %", "in 10 ms %", _percent("in_time_percent")),
)
#: Of contacts with what is declared, where something is; of the rest of the arm, where it touched something.
_SCENE, _ARM = (
    _Column("scene", "touched, scene", _count("contacts_scene")), _Column("arm", "arm", _count("arm_touched")),
)  # fmt: skip


@dataclass(frozen=True)
class _Table:
    """A table: what its rows are of, its columns' heads, plain and in full, and texts, a row's name first."""

    title: str
    heads: Sequence[str]
    in_full: Sequence[str]
    rows: Sequence[Sequence[str]]

    def plain(self) -> str:
        return text_table([self.title, *self.heads], self.rows)

    def markdown(self) -> str:
        lines = [[self.title, *self.in_full], ["---"] * (1 + len(self.in_full)), *self.rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)


@dataclass(frozen=True)
class Report:
    """All that was played with one skill.

    Attributes
    ----------
    descriptions : what each row is, in a line. held_out : whether similarity is to a demonstration that was held out.
    guard : what was guarded; None where that is not said. lag : of the arm [s].
    camera, cloud : whether methods were handed what a camera and a tracker know of the spheres, or what clouds show.
    """

    skill: str
    seed: int
    played: Sequence[Played]
    descriptions: dict[str, str]
    held_out: bool = False
    guard: Guard | None = None
    lag: float = 0.0
    camera: bool = False
    cloud: bool = False

    @property
    def similar_to(self) -> str:
        """What similarity is measured to."""
        return "the demonstration held out" if self.held_out else "the closest demonstration"

    def of(self, row: str, wanted: Callable[[Played], bool]) -> list[Played]:
        """Of one row, what is wanted."""
        return [item for item in self.played if item.row == row and wanted(item)]

    def figures(self, row: str, wanted: Callable[[Played], bool]) -> Figures:
        """Of one row, those of what is wanted."""
        return figures(self.of(row, wanted), self._blind_fails)

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            "skill": self.skill,
            "seed": self.seed,
            "held_out": self.held_out,
            "guard": self.guard,
            "lag": self.lag,
            "largest_lag_mm": self._largest_lag,
            "camera": self.camera,
            "cloud": self.cloud,
            "level": LEVEL,
            "rows": {
                row: {
                    "description": description,
                    "settings": next((item.settings for item in self.played if item.row == row), None),
                    "all": self.figures(row, every),
                    "half_or_more_stay_free": self.figures(row, mostly_free),
                    "fewer_stay_free": self.figures(row, hardly_free),
                    "families": {
                        family: {
                            "half_or_more_stay_free": self.figures(row, _of(family, mostly_free)),
                            "fewer_stay_free": self.figures(row, _of(family, hardly_free)),
                        }
                        for family in self._families()
                    },
                }
                for row, description in self.descriptions.items()
            },
            "scenes": [
                {"row": item.row, "family": item.family, "number": item.number}
                | {name: value for name, value in item.outcome.as_dict().items() if name != "replans"}
                for item in sorted(self.played, key=lambda item: (item.family, item.number, item.row))
            ],
        }

    def plain(self) -> str:
        """The tables as plain text."""
        return "\n\n".join([self._title(), *(table.plain() for table in self._tables())])

    def markdown(self) -> str:
        """The same tables in Markdown."""
        return "\n\n".join([self._title(), *(table.markdown() for table in self._tables())])

    @cached_property
    def _blind_fails(self) -> frozenset[SceneId] | None:
        """The scenes in which the blind replay of a demonstration fails; None where it was not played."""
        if BLIND not in self.descriptions:
            return None
        return frozenset(item.scene_id for item in self.of(BLIND, lambda item: not item.outcome.success))

    @property
    def _largest_lag(self) -> float:
        """Of an arm from where it was to be [mm]."""
        return 1e3 * max((item.outcome.lag for item in self.played), default=0.0)

    def _families(self) -> list[Family]:
        known = {item.family for item in self.played}
        return [family for family in FAMILIES if family in known]

    def _title(self) -> str:
        guarded = "" if self.guard is None else f", {_GUARDED[self.guard]} guarded"
        lag = f", the arm {self.lag:g} s late, up to {self._largest_lag:.0f} mm behind" if self.lag else ""
        camera = ", spheres seen by a camera" if self.camera else ", seen in clouds" if self.cloud else ""
        return f"{self.skill}, seed {self.seed}{guarded}{lag}{camera}; DTW and orientation from {self.similar_to}"

    def _tables(self) -> list[_Table]:
        standing = any(item.outcome.waiting_avoids is not None for item in self.played)
        seen = any(item.outcome.in_view is not None for item in self.played)
        return [
            self._by_row("all", every), self._by_row("half or more stay free", mostly_free),
            self._by_row("fewer stay free", hardly_free), self._by_family(), *([self._standing()] if standing else []),
            *([self._touched_in_view()] if seen else []),
        ]  # fmt: skip

    def _by_row(self, title: str, wanted: Callable[[Played], bool]) -> _Table:
        declared = any(item.family == "table" for item in self.played)
        arm = any(item.outcome.arm_touched for item in self.played)
        columns = [*_COLUMNS, *([_SCENE] if declared else []), *([_ARM] if arm else [])]
        own = {row: self.figures(row, wanted) for row in self.descriptions}
        scenes = max(one["scenes"] for one in own.values())
        rows = [[row, *(column.cell(one) for column in columns)] for row, one in own.items()]
        heads, in_full = [column.head for column in columns], [column.in_full for column in columns]
        return _Table(f"{title}: {scenes} scenes", heads, in_full, rows)

    def _by_family(self) -> _Table:
        """Successes of scenes, by family: where half or more of the demonstrations stay free, elsewhere."""
        families = self._families()
        rows = [
            [row, *(", ".join(self._successes(row, _of(family, free)) for free in _PARTS) for family in families)]
            for row in self.descriptions
        ]
        return _Table("successes: half or more free, fewer", families, families, rows)

    def _standing(self) -> _Table:
        """The scenes with a contact of an arm that stood, by whether waiting at the start avoids it."""
        wanted = {
            "waiting at the start avoids it": lambda outcome: outcome.waiting_avoids is True,
            "does not": lambda outcome: outcome.waiting_avoids is False,
        }
        return self._listed("touched, standing", wanted)

    def _touched_in_view(self) -> _Table:
        """The scenes with a contact where clouds are handed over, by whether they had shown the sphere that touched."""
        wanted = {
            f"in view for {IN_VIEW:g} s before": lambda outcome: (outcome.in_view or 0.0) >= IN_VIEW,
            "for less": lambda outcome: outcome.in_view is not None and outcome.in_view < IN_VIEW,
        }
        return self._listed("touched, by a sphere", wanted)

    def _listed(self, title: str, wanted: Mapping[str, Callable[[Outcome], bool]]) -> _Table:
        """The scenes of each row that are wanted, a column for each reason."""
        heads = list(wanted)
        rows = [[row, *(self._scenes(row, one) for one in wanted.values())] for row in self.descriptions]
        return _Table(title, heads, heads, rows)

    def _scenes(self, row: str, wanted: Callable[[Outcome], bool]) -> str:
        found = self.of(row, lambda item: wanted(item.outcome))
        names = [f"{item.family} {item.number}" for item in sorted(found, key=lambda item: item.scene_id)]
        return ", ".join(names) or "-"

    def _successes(self, row: str, wanted: Callable[[Played], bool]) -> str:
        outcomes = [item.outcome for item in self.of(row, wanted)]
        return f"{sum(outcome.success for outcome in outcomes)}/{len(outcomes)}" if outcomes else "-"


def every(item: Played) -> bool:
    """Any scene."""
    return True


def mostly_free(item: Played) -> bool:
    """Whether at least half of the demonstrations stayed free."""
    return item.outcome.mostly_free


def hardly_free(item: Played) -> bool:
    """Whether fewer did."""
    return not item.outcome.mostly_free


_PARTS = (mostly_free, hardly_free)


def _of(family: Family, part: Callable[[Played], bool]) -> Callable[[Played], bool]:
    return lambda item: item.family == family and part(item)


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _digits(value: float | None) -> str:
    """A number with one decimal where it is small; a dash for none."""
    if value is None:
        return "-"
    return f"{value:.1f}" if abs(value) < 9.95 else f"{value:.0f}"


def _interval(low: float, high: float) -> str:
    return "-" if np.isnan(low) else f"{_digits(low)}..{_digits(high)}"
