"""Playing scenes with methods: in processes of their own, each result kept on disk as soon as it is there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from tqdm import tqdm

from geodesic_motion_ros.comparison.arena import Arena
from geodesic_motion_ros.comparison.catalogue import ROWS
from geodesic_motion_ros.comparison.execution import Stage
from geodesic_motion_ros.comparison.families import FAMILIES, Family, check_families
from geodesic_motion_ros.comparison.method import Method
from geodesic_motion_ros.comparison.results import Played, Results
from geodesic_motion_ros.comparison.scene import draw_scene
from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.skill import Skill


@dataclass(frozen=True)
class BenchmarkSettings:
    """What is compared: scenes of each family, rows, and the seed of the scenes.

    `processes` play scenes at once, which does not change them.
    """

    methods: tuple[str, ...]
    families: tuple[Family, ...] = FAMILIES
    scenes: int = 6
    seed: int = 0
    processes: int = 1

    def __post_init__(self) -> None:
        unknown = [family for family in self.families if family not in FAMILIES]
        if unknown or not self.families:
            raise ParameterError(f"families are {', '.join(self.families)}: choose from {', '.join(FAMILIES)}")
        for name in ("scenes", "processes"):
            if getattr(self, name) < 1:
                raise ParameterError(f"{name} is {getattr(self, name)}; at least 1 is needed")
        if not self.methods:
            raise ParameterError(f"no method is given: choose from {'; '.join(ROWS)}")


class Bench:
    """What one process plays scenes with. Methods are made when they are first needed."""

    def __init__(self, skill: Skill, settings: BenchmarkSettings, folder: Path) -> None:
        self._settings = settings
        self.arena = Arena.of(skill)
        self._results = Results(folder, skill.name, settings.seed)
        self._stage: Stage | None = None
        self._methods: dict[str, Method] = {}

    @property
    def stage(self) -> Stage:
        if self._stage is None:
            self._stage = Stage(self.arena)
        return self._stage

    def method(self, row: str) -> Method:
        """The method of a row."""
        if row not in self._methods:
            self._methods[row] = ROWS[row].make(self.arena)
        return self._methods[row]

    def scene(self, family: Family, number: int) -> list[Played]:
        """One scene with every row, played where it has not been."""
        played, scene = [], None
        for row in self._settings.methods:
            method = self.method(row)
            outcome = self._results.outcome(row, family, number, method.settings)
            if outcome is None:
                if scene is None:
                    scene = draw_scene(self.arena, family, number, self._settings.seed)
                outcome, _ = self.stage.play(scene, method)
                self._results.keep(row, family, number, method.settings, outcome)
            played.append(Played(row, family, number, method.settings, outcome))
        return played


_bench: Bench | None = None


def _prepare(skill: Skill, settings: BenchmarkSettings, folder: Path) -> None:
    global _bench
    _bench = Bench(skill, settings, folder)


def _scene(which: tuple[Family, int]) -> list[Played]:
    assert _bench is not None
    return _bench.scene(*which)


def play_benchmark(
    skill: Skill, settings: BenchmarkSettings, folder: Path, show_progress: bool = True
) -> Iterator[Played]:
    """Draw, play and judge; families take turns, so that a run that is ended early knows all of them.

    Raises
    ------
    ParameterError : there are no scenes with this skill.
    """
    check_families(skill, settings.families)
    Arena.of(skill)
    # As the planner node does: threads of the linear algebra would only wait for each other.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    todo = [(family, number) for number in range(settings.scenes) for family in settings.families]
    with get_context("spawn").Pool(settings.processes, _prepare, (skill, settings, folder)) as pool:
        made = pool.imap_unordered(_scene, todo)
        for played in tqdm(made, desc="benchmark", unit="scene", total=len(todo), disable=not show_progress):
            yield from played
