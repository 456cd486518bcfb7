"""What the benchmark of the search engine found: figures of scenes and graphs, the tables, and what `--json` writes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.benchmarks.bias import BiasFigures, bias_table
from geodesic_motion_studies.benchmarks.hurried import DEADLINE_MS, HurriedTicks
from geodesic_motion_studies.benchmarks.stopwatch import Stopwatch, percentiles_ms


@dataclass(frozen=True)
class PeerFigures:
    """A peer's ticks: wall and processor time [s], and that share of the wall time that was not weighing edges."""

    wall: list[float]
    cpu: list[float]
    search: list[float]


@dataclass(frozen=True)
class SceneFigures:
    """One scene on one graph.

    Attributes
    ----------
    spheres : how many. wall, cpu : [s] of every tick. looked : nodes looked at in every tick.
    no_path : share of the ticks in which there is none below the limit.
    cost_error : largest relative difference of the cost from scipy's.
    hurried : the same ticks with a deadline.
    """

    spheres: int
    wall: list[float]
    cpu: list[float]
    looked: list[int]
    no_path: float
    cost_error: float
    hurried: HurriedTicks
    peers: dict[str, PeerFigures]

    def ratio(self, peer: str) -> float:
        return float(np.median(self.peers[peer].cpu) / np.median(self.cpu))

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            "spheres": self.spheres,
            "tick_ms": percentiles_ms(self.wall),
            "cpu_ms": percentiles_ms(self.cpu),
            "expanded_p50": int(np.median(self.looked)),
            "cost_error_max": self.cost_error,
            "deadline": {
                "cpu_ms": percentiles_ms(self.hurried.cpu), "in_time": self.hurried.in_time,
                "found": self.hurried.found, "refused": self.hurried.refused, "undecided": self.hurried.undecided,
                "gap_max": None if math.isnan(self.hurried.gap) else self.hurried.gap,
            },
            "no_path": self.no_path,
            "ticks": len(self.wall),
            "peers": {
                name: {
                    "tick_ms_p50": percentiles_ms(peer.wall)["p50"],
                    "cpu_ms_p50": percentiles_ms(peer.cpu)["p50"],
                    "search_ms_p50": percentiles_ms(peer.search)["p50"],
                    "ratio": self.ratio(name),
                    "ticks": len(peer.wall),
                }
                for name, peer in self.peers.items()
            },
        }


@dataclass(frozen=True)
class GraphFigures:
    """Every scene on one graph."""

    name: str
    nodes: int
    edges: int
    points: int
    scenes: dict[str, SceneFigures]

    def as_dict(self) -> dict[str, Any]:
        return {
            "graph": {"name": self.name, "nodes": self.nodes, "edges": self.edges, "body_points": self.points},
            "scenes": {name: figures.as_dict() for name, figures in self.scenes.items()},
        }

    def table(self) -> str:
        """One row for every scene."""
        peers = list(next(iter(self.scenes.values())).peers)
        head = ["scene", "p50", "p99", "cpu", "cpu99", "looked", "none", "error", *peers]
        rows = []
        for name, scene in self.scenes.items():
            times = [percentiles_ms(of)[share] for of in (scene.wall, scene.cpu) for share in ("p50", "p99")]
            rows.append([
                name, *map(_short, times), int(np.median(scene.looked)), f"{scene.no_path:.0%}",
                f"{scene.cost_error:.0e}",
                *(_short(scene.ratio(peer)) for peer in peers),
            ])  # fmt: skip
        title = f"{self.name}: {self.nodes} nodes, {self.edges} edges, {self.points} body points; a tick in ms"
        first = next(iter(self.scenes.values()))
        ticks = ", ".join(f"{name} {len(peer.wall)}" for name, peer in first.peers.items())
        note = f"exact to {peers[-1]}: processor time over ours\nticks: {len(first.wall)}, {ticks}"
        return "\n".join([title, text_table(head, rows), note, "", self._hurried()])

    def _hurried(self) -> str:
        head = ["scene", "cpu", "cpu99", f"<{DEADLINE_MS:.0f}ms", "found", "none", "open", "gap"]
        rows = []
        for name, scene in self.scenes.items():
            ticks, times = scene.hurried, percentiles_ms(scene.hurried.cpu)
            shares = (ticks.in_time, ticks.found, ticks.refused, ticks.undecided)
            rows.append([
                name, _short(times["p50"]), _short(times["p99"]), *(f"{share:.0%}" for share in shares),
                "" if math.isnan(ticks.gap) else f"{ticks.gap:.0%}",
            ])  # fmt: skip
        title = f"{self.name}: the same ticks with a deadline of {DEADLINE_MS:.0f} ms of processor time"
        return "\n".join([title, text_table(head, rows)])


@dataclass(frozen=True)
class ScalingRow:
    """Ticks of one scene on one graph: wall and processor time [s], and nodes looked at."""

    varied: str
    value: str
    nodes: int
    points: int
    spheres: int
    wall: list[float]
    cpu: list[float]
    looked: list[int]

    def as_dict(self) -> dict[str, Any]:
        return {
            "value": self.value, "nodes": self.nodes, "body_points": self.points, "spheres": self.spheres,
            "tick_ms": percentiles_ms(self.wall), "cpu_ms": percentiles_ms(self.cpu),
            "expanded_p50": int(np.median(self.looked)),
        }  # fmt: skip


@dataclass(frozen=True)
class BenchReport:
    """All that was measured.

    Attributes
    ----------
    synthetic, skill : every scene on the large graph and on the skill's.
    stages : of the planner's tick on the skill, and the tick itself.
    missing : peers that are not installed. machine : what it was measured on.
    """

    synthetic: GraphFigures
    skill: GraphFigures
    stages: dict[str, Stopwatch]
    bias: list[BiasFigures]
    scaling: list[ScalingRow]
    missing: list[str]
    machine: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes: `scenes` are those on the large graph, `skill` holds those on the skill's."""
        scaling: dict[str, list[dict[str, Any]]] = {}
        for row in self.scaling:
            scaling.setdefault(row.varied, []).append(row.as_dict())
        stages = {
            name: {"ms": percentiles_ms(watch.wall), "cpu_ms": percentiles_ms(watch.cpu), "runs": len(watch.wall)}
            for name, watch in self.stages.items()
        }
        return {
            **self.synthetic.as_dict(), "skill": self.skill.as_dict(), "stages": stages, "scaling": scaling,
            "bias": {row.name: row.as_dict() for row in self.bias},
            "missing_peers": self.missing, "machine": self.machine,
        }  # fmt: skip

    def table(self) -> str:
        """All tables as plain text."""
        parts = [self._machine_line(), self.synthetic.table(), self.skill.table(), self._stages()]
        parts += [bias_table(self.bias), self._scaling()]
        if self.missing:
            parts.append(f"not installed: {', '.join(self.missing)}; the extra `timing` brings them")
        return "\n\n".join(parts)

    def _machine_line(self) -> str:
        load, versions = self.machine["load"], self.machine["versions"]
        named = ", ".join(f"{name} {number}" for name, number in versions.items())
        return f"{named}\n{self.machine['cores']} cores, load {load[0]:.1f} before, {load[1]:.1f} after"

    def _stages(self) -> str:
        rows = []
        for name, watch in self.stages.items():
            if watch.wall:
                wall, cpu = percentiles_ms(watch.wall), percentiles_ms(watch.cpu)
                rows.append([name, len(watch.wall), *(f"{value:.3f}" for value in (*wall.values(), *cpu.values()))])
        head = ["stage", "runs", "p50", "p99", "max", "cpu p50", "cpu p99", "cpu max"]
        title = f"{self.skill.name}: stages of the planner's tick among a sphere of 5 cm that moves on the path, in ms"
        return "\n".join([title, text_table(head, rows)])

    def _scaling(self) -> str:
        head = ["varied", "", "nodes", "points", "spheres", "p50", "p99", "max", "cpu p50", "looked at"]
        rows = []
        for row in self.scaling:
            wall = [_short(value) for value in percentiles_ms(row.wall).values()]
            cpu, looked = _short(percentiles_ms(row.cpu)["p50"]), int(np.median(row.looked))
            rows.append([row.varied, row.value, row.nodes, row.points, row.spheres, *wall, cpu, looked])
        title = "scaling: a tick in ms; one sphere of 5 cm in the middle of the path, or so many along it"
        return "\n".join([title, text_table(head, rows)])


def _short(value: float) -> str:
    """Three figures, or whole numbers."""
    return f"{value:.2f}" if value < 10.0 else f"{value:.1f}" if value < 100.0 else f"{value:.0f}"
