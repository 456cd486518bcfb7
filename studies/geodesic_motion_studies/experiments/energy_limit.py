"""Does energy tell that a path is infeasible, as the paper says? Literal reaches to grasp, a limit to the energy.

Demonstrations and scenes of `grasp_joint`, the paper's models of them (`JointTrainingSettings.paper`), `PaperPlanner`:
spheres are drawn in the arm on the families' mean motions, and the energy of every path among them, the square of its
length in the reshaped metric, is divided by that of the free path from the same start. Whether a path hits is judged by
PyBullet's meshes. Each skill plans with several floors of 1 / sigma, as `far_sigma`: what was learned stays, the floor
of the network is replaced.

Columns: energies without a sphere, the largest to the goal of the own family, the least to that of another one; paths
that hit and that stay clear; *area* under the curve of hits refused over clear paths refused (1: a
limit tells all, 0.5: none does better than chance); the dearest clear path and the cheapest hit; and under each limit
how many hits, and how many clear paths, cost more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION, write_figure
from geodesic_motion_studies.experiments.arm_players import Families, LiteralArm
from geodesic_motion_studies.experiments.grasp_joint import (
    LIMITS,
    SETS,
    all_scenes,
    answered,
    energy_of,
    energy_ratios,
    shown_sets,
    to_other_families,
)
from geodesic_motion_studies.experiments.grasp_joint_scenes import Stage
from geodesic_motion_studies.experiments.study import Report, Study, option, seeds, setting
from geodesic_motion_studies.experiments.trained import trained_once
from geodesic_motion_studies.tools.cost_limit import CostLimit, limit_columns

#: Floors of 1 / sigma, as far_sigma [rad].
FLOORS = (1.0, 1e2, 1e4)


@dataclass(frozen=True)
class Ratios:
    """Energies of one skill's paths.

    Attributes
    ----------
    far_sigma : of its floor. energies : among spheres, over the free path's.
    within, across : without a sphere, to the goal of the own family and to that of another one (f,); families that meet
        have no across.
    """

    kind: str
    seed: int
    far_sigma: float
    energies: CostLimit
    within: np.ndarray
    across: np.ndarray


@dataclass(frozen=True)
class EnergyLimitReport(Report):
    """Of every set, seed and floor."""

    ratios: tuple[Ratios, ...]

    def of_all(self, kind: str, far_sigma: float) -> CostLimit:
        """All seeds of a set together."""
        found = [item.energies for item in self.ratios if (item.kind, item.far_sigma) == (kind, far_sigma)]
        return CostLimit(np.concatenate([one.hits for one in found]), np.concatenate([one.clear for one in found]))

    @property
    def groups(self) -> list[tuple[str, float]]:
        """Sets and floors that there are."""
        return list(dict.fromkeys((item.kind, item.far_sigma) for item in self.ratios))

    def as_dict(self) -> dict[str, Any]:
        return {"ratios": [asdict(item) | {"area": item.energies.area} for item in self.ratios]}

    def table(self) -> str:
        """The table as plain text."""
        rows: list[list[Cell]] = [
            [item.kind, item.seed, f"{item.far_sigma:g}", *_free([item]), *item.energies.cells(LIMITS)]
            for item in self.ratios
        ]
        for kind, floor in self.groups:
            several = [item for item in self.ratios if (item.kind, item.far_sigma) == (kind, floor)]
            rows.append([kind, "all", f"{floor:g}", *_free(several), *self.of_all(kind, floor).cells(LIMITS)])
        head = ["energy over free", "seed", "far_sigma", "within, most", "across, least", *limit_columns(LIMITS)]
        return text_table(head, rows, 2)

    def draw(self, path: Path) -> None:
        """Energies over the free path's of all paths, by set and floor."""
        figure = Figure(figsize=(10.0, 0.6 + 0.55 * len(self.groups)), layout="constrained")
        axes = figure.subplots()
        for row, group in enumerate(self.groups):
            both = self.of_all(*group)
            kinds = (both.clear, BLUE, 0.15, "clear"), (both.hits, VERMILION, -0.15, "hits")
            for values, colour, side, name in kinds:
                axes.plot(values, np.full(len(values), row + side), "|", color=colour, label="" if row else name)
        axes.set_yticks(range(len(self.groups)), [f"{kind}, far_sigma {floor:g}" for kind, floor in self.groups])
        axes.set(xscale="log", xlabel="energy over that of the free path")
        axes.invert_yaxis()
        axes.grid(alpha=0.3, axis="x")
        axes.legend(frameon=False)
        write_figure(figure, path)


@dataclass(frozen=True)
class EnergyLimit(Study):
    """Plan the scenes of `grasp_joint` with the literal skills of each of the seeds, at each floor.

    shown, places : as of `GraspJoint`. side : nodes along each axis of the grid.
    """

    seeds: tuple[int, ...] = seeds()
    side: int = option(32, "nodes along each axis of the latent grid; the paper's planner has 50", least=4)
    shown: int = setting(3, least=2)
    places: int = setting(24, least=1)
    floors: tuple[float, ...] = FLOORS

    def measure(self, out: Path) -> EnergyLimitReport:
        found = []
        for kind, shown in shown_sets(self.shown).items():
            families = Families.of(shown, SETS[kind])
            stage = Stage(families, connected=kind == "meeting", seed=self.seeds[0])
            scenes = all_scenes(stage, self.places)
            for seed in tqdm(self.seeds, desc=f"energy-limit, {kind}", unit="skill"):
                skill = trained_once(f"reach_{kind}", shown, JointTrainingSettings.paper(seed=seed), out / "skills")
                for floor in self.floors:
                    player = LiteralArm(PaperPlanner(with_floor(skill, floor), shape=(self.side,) * 3), families)
                    answers = answered(player, stage, scenes)
                    within = [energy_of(answer) for answer in answers if not len(answer.scene.radii)]
                    across = [energy_of(stage.answer(player, scene)) for scene in to_other_families(stage)]
                    ratios = energy_ratios(answers)
                    found.append(Ratios(kind, seed, floor, ratios, np.array(within), np.array(across)))
        return EnergyLimitReport(tuple(found))


def _free(several: Sequence[Ratios]) -> list[Cell]:
    """The largest energy within, and the least across, of rows of one set."""
    within, across = (np.concatenate([getattr(item, name) for item in several]) for name in ("within", "across"))
    return [float(within.max()), f"{across.min():.3g}" if across.size else None]


def with_floor(skill: Skill, far_sigma: float) -> Skill:
    """A skill of joints whose sigma is at most so large [rad], far from all data; what was learned stays."""
    floor = np.full_like(skill.decoder.sigma_floor, 1.0 / far_sigma)
    return replace(skill, decoder=replace(skill.decoder, sigma_floor=floor))
