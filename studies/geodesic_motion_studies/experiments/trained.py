"""Skills that experiments measure on: trained once per fold and seed, kept on disk, shared between experiments."""

from __future__ import annotations

import ast
import hashlib
import json
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from tqdm import tqdm

import geodesic_motion_ros
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError, SkillError
from geodesic_motion_studies.experiments.study import OfRecordings, Report, seeds, steps

if TYPE_CHECKING:
    from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings


@dataclass(frozen=True)
class Trained:
    """A skill with what it was trained on, and what was held out from it.

    Attributes
    ----------
    task : name of the recording; fold : indices of the held-out demonstrations in it; seed : of the training.
    shown, held_out : of the tool, or of joints.
    """

    task: str
    fold: tuple[int, ...]
    seed: int
    skill: Skill
    shown: Demonstrations | JointDemonstrations
    held_out: Demonstrations | JointDemonstrations


@dataclass(frozen=True)
class OfTrainings(OfRecordings):
    """A study of the skills of every recording, fold and seed."""

    seeds: tuple[int, ...] = seeds("one training each", (0,))
    steps: int | None = steps()
    sheet: Literal["canonical", "raw"] = "canonical"

    def measure(self, out: Path) -> Report:
        settings = task_training(self.steps, self.sheet)
        return self.measured(
            trained for task, recording, folds in self.split()
            for trained in trained_on_folds(task, recording, folds, self.seeds, out / "skills", settings)
        )  # fmt: skip

    @abstractmethod
    def measured(self, skills: Iterable[Trained]) -> Report:
        """The same of skills that are trained."""


def task_training(steps: int | None, sheet: Literal["canonical", "raw"] = "canonical") -> TrainingSettings:
    """The defaults, but for as many steps as are given."""
    from geodesic_motion_ros.learning.settings import TrainingSettings

    settings = TrainingSettings(sheet=sheet)
    return settings if steps is None else replace(settings, steps=steps)


#: For experiments that show what several skills do, one for each seed, not how exact one can be: less of everything.
BRIEFLY = {"samples": 120, "steps": 1500, "kernels": 300, "precision_samples": 2, "precision_iterations": 80}


def trained_on_folds(
    task: str,
    demonstrations: Demonstrations | JointDemonstrations,
    folds: Sequence[tuple[int, ...]],
    seeds: Sequence[int],
    folder: Path,
    settings: TrainingSettings | JointTrainingSettings | None = None,
    show_progress: bool = True,
) -> Iterator[Trained]:
    """One skill per fold and seed, from the cache where the very same training was done before.

    Parameters
    ----------
    folder : cache of skill folders, named by a digest of the poses, the settings and what the training code does.
    settings : whose seed is replaced, JointTrainingSettings for demonstrations of joints; None: the defaults, of
        demonstrations of the tool.

    Raises
    ------
    ParameterError : no folds or no seeds. DemonstrationError : folds that do not fit.
    """
    from geodesic_motion_ros.learning.settings import TrainingSettings

    if not folds or not seeds:
        raise ParameterError("nothing to train: give at least one fold and one seed")
    base = settings or TrainingSettings()
    splits = [(fold, *demonstrations.split(fold)) for fold in folds]
    with tqdm(total=len(splits) * len(seeds), desc=task, unit="skill", disable=not show_progress) as bar:
        for fold, shown, held_out in splits:
            for seed in seeds:
                bar.set_postfix_str(f"training, seed {seed}")
                skill = trained_once(task, shown, replace(base, seed=seed), folder)
                bar.set_postfix_str(f"without {','.join(map(str, fold))}, seed {seed}")
                yield Trained(task, tuple(fold), seed, skill, shown, held_out)
                bar.update()


def trained_once(
    task: str,
    shown: Demonstrations | JointDemonstrations,
    settings: TrainingSettings | JointTrainingSettings,
    folder: Path,
    progress: Callable[[str, int, int], None] | None = None,
) -> Skill:
    """A skill out of the cache, or trained, called progress(stage, step, steps), and put there.

    Demonstrations of joints are learned with JointTrainingSettings, in joint space.
    """
    kept = folder / f"{task}-{_digest(shown, settings)}"
    skill = _cached(kept)
    if skill is None:
        skill = train_anew(task, shown, settings, progress)
        skill.save(kept)
    return skill


def train_anew(
    task: str,
    shown: Demonstrations | JointDemonstrations,
    settings: TrainingSettings | JointTrainingSettings,
    progress: Callable[[str, int, int], None] | None,
) -> Skill:
    from geodesic_motion_ros.learning.training import train_skill

    return train_skill(shown, settings, name=task, progress=progress)


def _cached(folder: Path) -> Skill | None:
    """The skill in a folder of the cache; None where there is none, or one that cannot be read any more."""
    if not folder.is_dir():
        return None
    try:
        return Skill.load(folder)
    except SkillError:
        return None


def _digest(
    demonstrations: Demonstrations | JointDemonstrations, settings: TrainingSettings | JointTrainingSettings
) -> str:
    if isinstance(demonstrations, JointDemonstrations):
        return digest_of([item.configurations for item in demonstrations], settings)
    poses = [array for item in demonstrations for array in (item.positions, item.quaternions)]
    return digest_of(poses, settings)


def digest_of(arrays: Sequence[np.ndarray], settings: TrainingSettings | JointTrainingSettings) -> str:
    """Name of a training in a cache: of the arrays that are learned, the settings, and the code (`training_code`)."""
    digest = hashlib.sha256(json.dumps(asdict(settings), sort_keys=True).encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(training_code())
    return digest.hexdigest()[:16]


def training_code() -> bytes:
    """Digest of `learning.training` and of all of the package that it imports: another version learns otherwise."""
    package = Path(geodesic_motion_ros.__path__[0])
    trains = find_spec("geodesic_motion_ros.learning.training")
    assert trains is not None
    assert trains.origin is not None
    waiting, meanings = [Path(trains.origin)], {}
    while waiting:
        file = waiting.pop()
        if file in meanings:
            continue
        source = file.read_text()
        meanings[file] = meaning(source)
        modules = [node.module or "" for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
        own = [module.split(".")[1:] for module in modules if module.startswith(f"{package.name}.")]
        waiting += [package.joinpath(*parts).with_suffix(".py") for parts in own]
    return hashlib.sha256("".join(meanings[file] for file in sorted(meanings)).encode()).digest()


def meaning(source: str) -> str:
    """Python source as its syntax tree without docstrings: the same text whatever comments, docstrings and layout."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return ast.dump(tree)
