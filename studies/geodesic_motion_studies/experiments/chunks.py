"""Chunks that are drawn and offered to a motion filter, of arms whose surroundings are known to be empty.

Motions that an arm can make, as `feasible_chunks` draws them, a row for each kind; one half is offered whole, the other
in streams. Columns:

motions, chunks  how many were played, in how many chunks; points 2 to 64, 5 to 100 of them a second, streams of 5 to 50
                 chunks a second
refused    chunks that were
path [mm]  how far the tool, or the point of a link that is farthest, was from where it was to be, median and largest:
           of what was played from the motion, and the other direction
off        motions of which that was more than 1 mm
late [ms]  how much later than offered the arm arrived, median and largest
slow       motions that took longer by more than 2 %, and than a tick of the filter, 10 ms, which shows no less
stopped    motions in which a tick had another verdict than OK

A second table is of chunks full of nonsense, as `wild_chunks` draws them, offered in motion among moving spheres: how
many were taken and refused, refusals without a name, what was raised, limits that a motion broke and motions that did
not begin where the arm was, how many motions were handed out, and the largest share of a limit that one of them used.

Under the tables: the motions that count in one of these, as they repeat with `--seed`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.experiments.feasible_chunks import ARMS, TICK, DrawnMotions, Played, play
from geodesic_motion_studies.experiments.study import Report, Study, option
from geodesic_motion_studies.experiments.wild_chunks import Wild, offer_wild

#: What is off the path [m], and what takes longer by this share.
OFF, SLOW = 1e-3, 0.02


@dataclass(frozen=True, eq=False)
class ChunksReport(Report):
    """What became of all motions."""

    seed: int
    played: tuple[Played, ...]
    wild: Mapping[str, Wild]

    def as_dict(self) -> dict[str, Any]:
        return {
            "seed": self.seed,
            "rows": [dict(zip(_HEAD, row, strict=True)) for row in self._rows()],
            "wild": {arm: asdict(each) for arm, each in self.wild.items()},
            "conspicuous": [asdict(each) for each in self.played if is_conspicuous(each)],
        }

    def table(self) -> str:
        lines = [f"seed {self.seed}", text_table(_HEAD, self._rows(), left=(0, 1, 2))]
        head = ["nonsense", "taken", "refused", "unnamed", "raised", "broken", "motions", "of a limit"]
        counts = [
            [
                arm, each.taken, each.refused, len(each.unnamed), len(each.raised), len(each.broken), each.motions,
                each.share,
            ]
            for arm, each in self.wild.items()
        ]
        lines += ["", text_table(head, counts), ""]
        lines += [f"{arm}: {one}" for arm, each in self.wild.items() for one in _wrong(each)]
        for each in filter(is_conspicuous, self.played):
            drawn = each.drawn
            said = "; ".join(sorted({*each.refused, *each.stops}))
            lines.append(
                f"{drawn.arm}, {', '.join(drawn.kind)}, {drawn.duration:.2f} s, {drawn.points} points at "
                f"{drawn.rate:.0f} Hz, {drawn.hertz:.0f} chunks a second: {1e3 * each.path:.2f} mm, "
                f"{1e3 * each.late:.0f} ms" + (f", {said}" if said else "")
            )
        return "\n".join(lines)

    def draw(self, path: Path) -> None:
        """There is none."""

    def _rows(self) -> list[list[str | int | float]]:
        kinds = sorted({each.drawn.kind for each in self.played})
        groups = [[each for each in self.played if each.drawn.kind == kind] for kind in kinds]
        rows = [[*kind, *_counted(own)] for kind, own in zip(kinds, groups, strict=True)]
        return [*rows, ["all", "", "", *_counted(list(self.played))]]


_HEAD = (
    "offered", "of", "begins", "motions", "chunks", "refused", "path [mm]", "largest", "off", "late [ms]", "largest",
    "slow", "stopped",
)  # fmt: skip


def is_slow(each: Played) -> bool:
    """Whether a motion took longer by more than `SLOW`, and than a tick."""
    return each.late > max(SLOW * each.drawn.duration, TICK)


def is_conspicuous(each: Played) -> bool:
    """Whether a motion was not played as it was offered."""
    return bool(each.refused or each.stops or each.path > OFF or is_slow(each))


def _wrong(each: Wild) -> list[str]:
    return [*each.unnamed, *each.raised, *each.broken]


def _counted(own: list[Played]) -> list[int | float]:
    path, late = (1e3 * np.array([getattr(each, name) for each in own]) for name in ("path", "late"))
    return [
        len(own), sum(each.chunks for each in own), sum(len(each.refused) for each in own),
        float(np.median(path)), float(np.max(path)), sum(each.path > OFF for each in own),
        float(np.median(late)), float(np.max(late)), sum(map(is_slow, own)), sum(bool(each.stops) for each in own),
    ]  # fmt: skip


@dataclass(frozen=True)
class Chunks(Study):
    """So many drawn chunks, of several arms in turn."""

    chunks: int = option(1000, "at least, streams and whole motions together", least=1)
    wild: int = option(1000, "chunks full of nonsense", least=len(ARMS))
    seed: int = option(0, "of what is drawn", least=0)

    def measure(self, out: Path) -> ChunksReport:
        filters = {arm: MotionFilter(arm, DeclaredScene.empty()) for arm in ARMS}
        sources = {
            arm: iter(DrawnMotions(arm, np.random.default_rng([self.seed, place]))) for place, arm in enumerate(ARMS)
        }
        played: list[Played] = []
        with tqdm(total=self.chunks, unit="chunk") as bar:
            while sum(each.chunks for each in played) < self.chunks:
                arm = ARMS[len(played) % len(ARMS)]
                played.append(play(filters[arm], next(sources[arm])))
                bar.update(played[-1].chunks)
        wild = {
            arm: offer_wild(filters[arm], np.random.default_rng([self.seed, place, 1]), self.wild // len(ARMS))
            for place, arm in enumerate(tqdm(ARMS, desc="nonsense"))
        }
        return ChunksReport(self.seed, tuple(played), wild)
