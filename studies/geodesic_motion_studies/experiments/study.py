"""What a study is: settings in; figures, a table and a picture out. `registry.STUDIES` lists them all.

A study is a frozen dataclass. Its fields are its settings; those made by `option` are the command's options as well, so
that a setting, its default and its help stand in one place. `measure` returns a `Report`.
"""

from __future__ import annotations

import argparse
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from geodesic_motion_ros.cli.arguments import add_recording, indices
from geodesic_motion_ros.cli.recorded import read_joint_recording, read_recording
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.readers import is_of_joints
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.folds import Fold, default_folds, parse_folds

Recording = Demonstrations | JointDemonstrations
Own = TypeVar("Own", bound="Study")
Training = TypeVar("Training", TrainingSettings, JointTrainingSettings)


class Report(ABC):
    """What a study has found."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """The figures, as `figures.json` and `--json` hold them."""

    @abstractmethod
    def table(self) -> str:
        """The table as plain text."""

    @abstractmethod
    def draw(self, path: Path) -> None:
        """The picture as a file."""


def setting(default: Any, least: float | None = None) -> Any:
    """A setting without an option; `least` : the least value that it may have."""
    return field(default=default, metadata={"least": least})


def option(default: Any, text: str, least: float | None = None, **keywords: Any) -> Any:
    """A setting that is an option, too: its default, its help, and other keywords of `add_argument`.

    Without `type` its values are read as one of the default's kind.
    """
    read = {"type": type(default), "help": text, **keywords}
    return field(default=default, metadata={"least": least, "option": read})


def seeds(text: str = "of the trainings, one skill each", default: tuple[int, ...] = (0, 1, 2)) -> Any:
    """--seeds."""
    return option(default, text, type=indices, metavar="SEEDS")


def steps() -> Any:
    """--steps: None is as many as the training has by default."""
    return option(None, "of the training; without it as many as it has by default", type=int)


def far_sigma(of: str = "the training") -> Any:
    """--far-sigma: None is that of the training."""
    return option(None, f"of {of}, its inverse is the floor of 1 / sigma: the height of walls", type=float)


def bandwidth_factor(of: str = "the training") -> Any:
    """--bandwidth-factor: None is that of the training."""
    return option(None, f"of {of}: the kernels' width over the distance between neighbours", type=float)


def changed(training: Training, **settings: Any) -> Training:
    """A training with those settings that are not None."""
    return replace(training, **{name: value for name, value in settings.items() if value is not None})


@dataclass(frozen=True)
class Study(ABC):
    """Settings, and what is measured with them; ParameterError names one that is out of range."""

    def __post_init__(self) -> None:
        for each in fields(self):
            name, value, least = each.name, getattr(self, each.name), each.metadata.get("least")
            if least is not None and not value >= least:
                raise ParameterError(f"{name} is {value}; at least {least} is needed")
            if name == "seeds" and (not value or min(value) < 0):
                raise ParameterError(f"seeds {value}: give at least one, none negative")

    @abstractmethod
    def measure(self, out: Path) -> Report:
        """Measure; trained models are kept in the folder `out`, and taken from there."""

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """Those of the settings, in their order."""
        for each in options(cls):
            flag = f"--{each.name.replace('_', '-')}"
            parser.add_argument(flag, **each.metadata["option"], default=_typed(each.default))

    @classmethod
    def of(cls: type[Own], arguments: argparse.Namespace, **others: Any) -> Own:
        """With the settings of a command line, and others."""
        return cls(**others, **{each.name: getattr(arguments, each.name) for each in options(cls)})


def options(study: type[Study] | Study) -> list[Field]:
    """The settings of a study that are options."""
    return [each for each in fields(study) if "option" in each.metadata]


def _typed(default: Any) -> Any:
    """A default as it is typed."""
    if not isinstance(default, tuple):
        return default
    return ",".join(f"{value:g}" if isinstance(value, float) else str(value) for value in default)


@dataclass(frozen=True)
class OfSkill(Study):
    """A study of one skill, given by its folder or its shipped name."""

    skill: str = option("panda_pouring", "its folder, or a shipped name", metavar="SKILL")

    def measure(self, out: Path) -> Report:
        return self.measured(Skill.load(self.skill))

    @abstractmethod
    def measured(self, skill: Skill) -> Report:
        """The same of a skill that is loaded."""


@dataclass(frozen=True)
class OfRecordings(Study):
    """A study of recordings, by the names of their files."""

    recordings: Mapping[str, Recording] = field(default_factory=dict)
    folds: str | None = option(
        None, "to hold out, 0,3,6/1,4,7; without it three folds", type=str, metavar="FOLDS"
    )  # fmt: skip
    #: Whether recordings may be of joints as well.
    joints: ClassVar[bool] = False

    def split(self) -> list[tuple[str, Recording, tuple[Fold, ...]]]:
        """Every recording, with its name and its folds; ParameterError names a part of them that does not fit."""
        return [
            (name, each, parse_folds(self.folds, len(each)) if self.folds else default_folds(len(each)))
            for name, each in self.recordings.items()
        ]

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        super().add_options(parser)
        add_recording(parser, several=True, joints=cls.joints)

    @classmethod
    def of(cls: type[Own], arguments: argparse.Namespace, **others: Any) -> Own:
        recordings: dict[str, Recording] = {}
        for path in arguments.demos:
            space = (arguments.space or ("joint" if is_of_joints(path) else "task")) if cls.joints else "task"
            read = read_joint_recording if space == "joint" else read_recording
            recordings[path.stem] = read(arguments, path)
        if len(recordings) < len(arguments.demos):
            raise ParameterError("two recordings have the same file name; the table calls tasks by it: rename one")
        return super().of(arguments, recordings=recordings, **others)


@dataclass(frozen=True)
class OfOwnData(Study):
    """A study of demonstrations that it makes; `--save` writes those of its first seed and measures nothing."""

    @abstractmethod
    def saved(self) -> tuple[Demonstrations, str]:
        """These demonstrations, and what they are."""

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        super().add_options(parser)
        parser.add_argument(
            "--save", type=Path, metavar="FILE.npz",
            help="write the demonstrations of the first seed to a file to train on (units m) and measure nothing",
        )  # fmt: skip
