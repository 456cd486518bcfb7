"""Playing scenes with methods: in processes of their own, each result kept on disk as soon as it is there."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tqdm import tqdm

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.camera import CameraStage
from geodesic_motion_studies.comparison.catalogue import ROWS
from geodesic_motion_studies.comparison.cloud import CloudStage
from geodesic_motion_studies.comparison.execution import Stage
from geodesic_motion_studies.comparison.families import FAMILIES, Family, check_families
from geodesic_motion_studies.comparison.guard import Guard, guard_of, own_guard
from geodesic_motion_studies.comparison.held_out import HeldOut, digest
from geodesic_motion_studies.comparison.lag import LateStage, check_lag
from geodesic_motion_studies.comparison.method import Method
from geodesic_motion_studies.comparison.results import Played, Results, SceneId, results_folder
from geodesic_motion_studies.comparison.scene import Scene, draw_scene, moved_demonstrations
from geodesic_motion_studies.comparison.scene_file import SceneFile


@dataclass(frozen=True)
class BenchmarkSettings:
    """What is compared: scenes of each family, rows, and the seed of the scenes.

    `processes` play scenes at once, which does not change them. `held_out`: scenes of demonstrations that no method was
    given. `guard`: what is guarded; None: what the skill guards by itself. `scenes_from`: a file whose scenes are
    played, in the place of scenes that are drawn; `families` and `seed` are those of the file then. `lag`: of the arm
    [s] (`lag.py`). `camera`: methods are handed what a camera and a tracker know of the spheres (`camera.py`); `cloud`:
    what the clouds of a depth camera show (`cloud.py`).
    """

    methods: tuple[str, ...]
    families: tuple[Family, ...] = FAMILIES
    scenes: int = 6
    seed: int = 0
    processes: int = 1
    held_out: bool = False
    guard: Guard | None = None
    scenes_from: Path | None = None
    lag: float = 0.0
    camera: bool = False
    cloud: bool = False

    def __post_init__(self) -> None:
        unknown = [family for family in self.families if family not in FAMILIES]
        if unknown or not self.families:
            raise ParameterError(f"families are {', '.join(self.families)}: choose from {', '.join(FAMILIES)}")
        for name in ("scenes", "processes"):
            if getattr(self, name) < 1:
                raise ParameterError(f"{name} is {getattr(self, name)}; at least 1 is needed")
        if self.scenes_from is not None and self.held_out:
            raise ParameterError("scenes of a file are of no demonstrations that are held out")
        check_lag(self.lag)
        if sum(map(bool, (self.camera, self.cloud, self.lag))) > 1:
            raise ParameterError("a camera, clouds and an arm that lags are not played together: choose one of them")
        if not self.methods:
            raise ParameterError(f"no method is given: choose from {'; '.join(ROWS)}")

    def results_folder(self, folder: Path, skill: Skill) -> Path:
        """Where all of these scenes is in the folder for results."""
        return results_folder(folder, skill.name, self.held_out, self._apart(skill))

    def results(self, folder: Path, skill: Skill) -> Results:
        """What is kept of these scenes there."""
        return Results(folder, skill.name, self.seed, self.held_out, self._apart(skill))

    def _apart(self, skill: Skill) -> str:
        """The part of the folder's name without which other scenes or arms would mix with the skill's own."""
        guard = guard_of(skill, self.guard)
        other = [] if guard == own_guard(skill) else [f"guard_{guard}"]
        if self.scenes_from is not None:
            other.append(f"scenes_{hashlib.sha256(self.scenes_from.read_bytes()).hexdigest()[:16]}")
        if self.lag:
            other.append(f"lag_{self.lag:g}")
        if self.camera:
            other.append("camera")
        if self.cloud:
            other.append("cloud")
        return "/".join(other)


class Bench:
    """What one process plays scenes with. Methods are made when they are first needed.

    Where demonstrations are held out, skills that are not in the folder yet are trained first.
    """

    def __init__(self, skill: Skill, settings: BenchmarkSettings, folder: Path, show_progress: bool = False) -> None:
        self._settings = settings
        self._whole = Arena.of(skill, settings.guard)
        self._file: SceneFile | None = None
        if settings.scenes_from is not None:
            self._file = SceneFile.read(settings.scenes_from)
            self._file.check(skill, self._whole.guard)
        self._held_out: HeldOut | None = None
        if settings.held_out:
            # The same skills, whatever is guarded.
            kept = results_folder(folder, skill.name, held_out=True) / "skills"
            self._held_out = HeldOut.of(self._whole, settings.seed, kept, show_progress)
        self._results = settings.results(folder, skill)
        self._skill = digest(skill)
        self._stage: Stage | None = None
        self._methods: dict[tuple[str, Arena], Method] = {}

    @property
    def stage(self) -> Stage:
        """Of the arm and what is guarded of it: the same, whatever is held out."""
        if self._stage is None:
            lag = self._settings.lag
            if self._settings.camera:
                self._stage = CameraStage(self._whole)
            elif self._settings.cloud:
                self._stage = CloudStage(self._whole)
            else:
                self._stage = LateStage(self._whole, lag) if lag else Stage(self._whole)
        return self._stage

    def arena(self, family: Family, number: int) -> Arena:
        """That in which a scene is drawn and methods are made."""
        return self._whole if self._held_out is None else self._held_out.arena(family, number)

    def scene_ids(self) -> list[SceneId]:
        """The scenes to play: families take turns, so that a run that is ended early knows all of them."""
        if self._file is not None:
            return [(scene.family, scene.number) for scene in self._file.scenes]
        scenes = [(family, number) for number in range(self._settings.scenes) for family in self._settings.families]
        return [scene for scene in scenes if not self.repeats(*scene)]

    def repeats(self, family: Family, number: int) -> bool:
        """Whether a scene is one again that has a smaller number."""
        return self._held_out is not None and self._held_out.repeats(family, number)

    def draw(self, family: Family, number: int) -> Scene:
        """A scene; ParameterError where it is not in the file that scenes are played from."""
        if self._file is not None:
            scene = self._file.scene(family, number)
            return replace(scene, demonstrations=moved_demonstrations(self._whole, scene.start, scene.goal))
        if self._held_out is None:
            return draw_scene(self._whole, family, number, self._settings.seed)
        return self._held_out.draw(family, number)

    def method(self, row: str, arena: Arena) -> Method:
        """The method of a row in an arena."""
        if (row, arena) not in self._methods:
            self._methods[row, arena] = ROWS[row].make(arena)
        return self._methods[row, arena]

    def scene(self, family: Family, number: int) -> list[Played]:
        """One scene with every row, played where it has not been."""
        played, scene = [], None
        for row in self._settings.methods:
            known = self.known(row, family, number)
            if known is None:
                if scene is None:
                    scene = self.draw(family, number)
                method, settings = self._valid(row, family, number)
                outcome, _ = self.stage.play(scene, method)
                self._results.keep(row, family, number, settings, outcome)
                known = Played(row, family, number, settings, outcome)
            played.append(known)
        return played

    def known(self, row: str, family: Family, number: int) -> Played | None:
        """What is kept of a scene as a row would play it now; None where it has to be played."""
        _, settings = self._valid(row, family, number)
        outcome = self._results.outcome(row, family, number, settings)
        return None if outcome is None else Played(row, family, number, settings, outcome)

    def _valid(self, row: str, family: Family, number: int) -> tuple[Method, dict[str, Any]]:
        """The method of a scene, and what a result is valid for: its settings, and what was learned and held out."""
        method = self.method(row, self.arena(family, number))
        if self._held_out is None:
            return method, {**method.settings, "skill": self._skill}
        return method, {**method.settings, "held_out": self._held_out.digest(family, number)}


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
    """Draw or read, play and judge.

    Raises
    ------
    ParameterError : there are no such scenes with this skill.
    DemonstrationError : too few demonstrations to hold one out.
    """
    check_families(skill.name, guard_of(skill, settings.guard), settings.families)
    # Refuses what cannot be played, and trains before processes that would all do so.
    bench = Bench(skill, settings, folder, show_progress)
    # As the planner node does: threads of the linear algebra would only wait for each other.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    todo = bench.scene_ids()
    with get_context("spawn").Pool(settings.processes, _prepare, (skill, settings, folder)) as pool:
        made = pool.imap_unordered(_scene, todo)
        for played in tqdm(made, desc="benchmark", unit="scene", total=len(todo), disable=not show_progress):
            yield from played


def kept_benchmark(skill: Skill, settings: BenchmarkSettings, folder: Path, scenes: int | None = None) -> list[Played]:
    """What is kept of those scenes that every row has played as it would now, with the skill as it is.

    scenes : the first of each family; None: all that there are.

    Raises
    ------
    GeodesicMotionError : there is none.
    """
    check_families(skill.name, guard_of(skill, settings.guard), settings.families)
    results = settings.results(folder, skill)
    numbers = {
        (row, family): [number for number in results.numbers(row, family) if scenes is None or number < scenes]
        for row in settings.methods
        for family in settings.families
    }
    kept: dict[str, dict[SceneId, Played]] = {row: {} for row in settings.methods}
    # Without any result there is nothing that skills would have to be trained for.
    if any(numbers.values()):
        bench = Bench(skill, settings, folder)
        for (row, family), own in numbers.items():
            known = [bench.known(row, family, number) for number in own]
            kept[row] |= {item.scene_id: item for item in known if item is not None}
    shared = set.intersection(*map(set, kept.values()))
    if not shared:
        counts = ", ".join(f"{row} {len(own)}" for row, own in kept.items())
        raise GeodesicMotionError(
            f"no scene is kept in {settings.results_folder(folder, skill)} that every method has played as it is set "
            f"up now, with the skill as it is (scenes: {counts}): play them without --kept, or choose others with "
            "--methods"
        )
    return [own[scene] for scene in sorted(shared) for own in kept.values()]
