"""Ticks among moving spheres and new goals in motion, of several skills: measured, as tables, as `--json` has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.benchmarks.moving import MovingBench, MovingTicks, NewGoals
from geodesic_motion_studies.benchmarks.stopwatch import percentiles_ms


@dataclass(frozen=True)
class MovingSettings:
    """How much is measured.

    Attributes
    ----------
    motions : of each skill and number of spheres. plays : of every motion; each tick counts by its fastest.
    compared : searches of a motion that are made again beside their alternatives. stands : new starts of each motion.
    seed : of spheres, new goals and starts.
    """

    motions: int = 6
    stands: int = 40
    plays: int = 3
    compared: int = 10
    seed: int = 0

    @classmethod
    def quick(cls) -> MovingSettings:
        """A tenth of the time."""
        return cls(motions=2, plays=1, compared=3, stands=5)


@dataclass(frozen=True)
class MovingReport:
    """By skill: ticks by number of spheres, new goals in motion, and first ticks from a stand."""

    ticks: dict[str, dict[int, MovingTicks]]
    goals: dict[str, NewGoals]
    stands: dict[str, NewGoals]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            name: {
                "moving": {
                    str(count): {
                        "ticks": len(ticks.every.cpu), "searched": len(ticks.searched.cpu),
                        "cpu_ms": percentiles_ms(ticks.every.cpu), "tick_ms": percentiles_ms(ticks.every.wall),
                        "searched_cpu_ms": percentiles_ms(ticks.searched.cpu), "cost_error_max": ticks.error,
                        "search_cpu_ms": {
                            "ours": percentiles_ms(ticks.searches.cpu), "A*": percentiles_ms(ticks.one_sided.cpu),
                            "dijkstra": percentiles_ms(ticks.plain.cpu),
                        },
                    }
                    for count, ticks in counts.items()
                },
                "new_goal": _figures(self.goals[name]),
                "from_a_stand": _figures(self.stands[name]),
            }
            for name, counts in self.ticks.items()
        }  # fmt: skip

    def table(self) -> str:
        """Both tables as plain text."""
        rows: list[list[str | int | float | None]] = []
        for name, counts in self.ticks.items():
            for count, ticks in counts.items():
                search = _median(ticks.searches.cpu)
                rows.append([
                    name, count, len(ticks.every.cpu), *percentiles_ms(ticks.every.cpu).values(),
                    f"{len(ticks.searched.cpu) / len(ticks.every.cpu):.0%}",
                    *percentiles_ms(ticks.searched.cpu).values(), search, _median(ticks.one_sided.cpu) / search,
                    _median(ticks.plain.cpu) / search,
                ])  # fmt: skip
        head = ["skill", "spheres", "ticks", "p50", "p99", "max", "searched", "p50", "p99", "max", "search", "A*",
                "dijkstra"]  # fmt: skip
        return "\n".join([
            "ticks of the planner among spheres that cross the motion: processor time in ms, of all and of those that",
            "searched; the median search, and how many times as long A* from one end and Dijkstra take for the same",
            text_table(head, rows), "",
            "new goal in motion to the first reference that leads to it, in ms", _table(self.goals), "",
            "from a stand: a new start, a new goal and two new spheres to the first answer, in ms", _table(self.stands),
        ])  # fmt: skip


def measure_moving(
    skills: Sequence[Skill], counts: Sequence[int], settings: MovingSettings, show_progress: bool = True
) -> MovingReport:
    """Measure skills of either kind among so many spheres each.

    Raises
    ------
    ParameterError : a skill has no path along any of its demonstrations.
    """
    report = MovingReport({}, {}, {})
    with tqdm(total=len(skills) * (len(counts) + 1), unit="row", disable=not show_progress) as bar:
        for skill in skills:
            bar.set_description(skill.name)
            bench = MovingBench(skill, settings.motions, settings.plays)
            # Nothing shall be loaded in the ticks that count.
            bench.new_goals(bench.motions[0], np.random.default_rng(settings.seed), NewGoals())
            report.ticks[skill.name] = {}
            for count in counts:
                random, ticks = np.random.default_rng((settings.seed, count)), MovingTicks()
                for motion in bench.motions:
                    bench.ticks(motion, bench.spheres(motion, count, random), ticks, settings.compared)
                report.ticks[skill.name][count] = ticks
                bar.update()
            random, report.goals[skill.name] = np.random.default_rng(settings.seed), NewGoals()
            report.stands[skill.name] = NewGoals()
            for motion in bench.motions:
                bench.new_goals(motion, random, report.goals[skill.name])
                bench.from_a_stand(motion, settings.stands, random, report.stands[skill.name])
            bar.update()
    return report


def _figures(new: NewGoals) -> dict[str, Any]:
    """What `--json` writes of new goals."""
    return {
        "goals": len(new.watch.cpu), "without_reference": new.without, "cpu_ms": percentiles_ms(new.watch.cpu),
        "ms": percentiles_ms(new.watch.wall),
    }  # fmt: skip


def _table(goals: dict[str, NewGoals]) -> str:
    """New goals of several skills as plain text."""
    rows = []
    for name, new in goals.items():
        cpu, wall = percentiles_ms(new.watch.cpu), percentiles_ms(new.watch.wall)
        rows.append([name, len(new.watch.cpu), new.without, cpu["p50"], cpu["p99"], wall["p50"], wall["p99"]])
    return text_table(["skill", "goals", "without", "cpu p50", "cpu p99", "wall p50", "wall p99"], rows)


def _median(seconds: list[float]) -> float:
    """[ms]; nan of none."""
    return 1e3 * float(np.median(seconds)) if seconds else float("nan")
