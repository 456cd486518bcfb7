"""First detours of several skills: measured, as a table, as `--json` has it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.benchmarks.detours import DetourBench, DetourTimes
from geodesic_motion_studies.benchmarks.stopwatch import percentiles_ms


@dataclass(frozen=True)
class DetourBenchSettings:
    """How much is measured.

    Attributes
    ----------
    motions : of each skill. scenes : on each of them, for each number of spheres. plays : of each scene, which counts
        by its fastest. seed : of motions and spheres.
    """

    motions: int = 8
    scenes: int = 5
    plays: int = 3
    seed: int = 0

    @classmethod
    def quick(cls) -> DetourBenchSettings:
        """A tenth of the time."""
        return cls(motions=2, scenes=2, plays=1)


@dataclass(frozen=True)
class DetourReport:
    """By skill and number of spheres."""

    times: dict[str, dict[int, DetourTimes]]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            name: {
                str(count): {
                    "found": times.found, "refusals": dict(times.refusals),
                    "first_certified": len(times.first.cpu), "band_certified": len(times.band.cpu),
                    "first_cpu_ms": percentiles_ms(times.first.cpu), "first_ms": percentiles_ms(times.first.wall),
                    "band_cpu_ms": percentiles_ms(times.band.cpu), "band_ms": percentiles_ms(times.band.wall),
                    "band_cost": {"p50": _percentile(times.gains, 50.0), "p99": _percentile(times.gains, 99.0)},
                }
                for count, times in counts.items()
            }
            for name, counts in self.times.items()
        }  # fmt: skip

    def table(self) -> str:
        """As plain text."""
        rows: list[list[str | int | float | None]] = []
        for name, counts in self.times.items():
            for count, times in counts.items():
                first, band = percentiles_ms(times.first.cpu), percentiles_ms(times.band.cpu)
                rows.append([
                    name, count, times.found + times.refusals.total(), times.found, len(times.first.cpu), first["p50"],
                    first["p99"], len(times.band.cpu), band["p50"], band["p99"],
                    _percentile(times.gains, 50.0), _percentile(times.gains, 99.0),
                ])  # fmt: skip
        head = ["skill", "spheres", "scenes", "found", "certified", "p50", "p99", "of bands", "p50", "p99", "cost",
                "p99"]  # fmt: skip
        return "\n".join([
            "detours where spheres block every demonstrated path: processor time in ms of the first, before the band;",
            "of the band; and the band's cost over that of the lattice's path",
            text_table(head, rows),
        ])  # fmt: skip


def measure_detours(
    skills: Sequence[Skill], counts: Sequence[int], settings: DetourBenchSettings, show_progress: bool = True
) -> DetourReport:
    """Measure skills of either kind among so many spheres each.

    Raises
    ------
    ParameterError : no scenes are drawn for a skill, it has no path between its demonstrations, or no such spheres.
    """
    report = DetourReport({})
    with tqdm(total=len(skills) * len(counts) * settings.motions, unit="motion", disable=not show_progress) as bar:
        for skill in skills:
            bar.set_description(skill.name)
            bench = DetourBench(skill, settings.motions, settings.plays, settings.seed)
            report.times[skill.name] = {}
            for count in counts:
                random, times = np.random.default_rng((settings.seed, count)), DetourTimes()
                for motion in bench.motions:
                    for _ in range(settings.scenes):
                        bench.measure(motion, bench.spheres(motion, count, random), times)
                    bar.update()
                report.times[skill.name][count] = times
    return report


def _percentile(values: list[float], share: float) -> float:
    return float(np.percentile(values, share)) if values else math.nan
