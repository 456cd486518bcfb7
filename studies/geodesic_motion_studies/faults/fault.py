"""What a fault is, and what a run of one has shown; knows nothing of ROS."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from geodesic_motion_ros.utils.errors import GeodesicMotionError

if TYPE_CHECKING:
    from geodesic_motion_studies.faults.bench import Bench

#: When a fault is injected: before the arm has a goal, halfway, and just before it arrives.
START, MOTION, GOAL = "start", "motion", "goal"
PHASES = (START, MOTION, GOAL)
#: Whose faults they are: of the node `planner`, whose goals are those of a skill, or of `filter`, to which the same
#: motions are offered.
SUBJECTS = PLANNER, FILTER = "planner", "filter"
PLANNER_ALONE, FILTER_ALONE = (PLANNER,), (FILTER,)


#: The planner under test stops the arm when joint states are older than this [s]: less than by default, which leaves an
#: ordinary desktop its pauses.
STATE_TIMEOUT = 0.1


class FaultSkipped(GeodesicMotionError):
    """A fault cannot be injected on this machine, or means nothing for this skill; says why."""


class NotSeenError(GeodesicMotionError):
    """What was waited for has not happened."""


class Figure(NamedTuple):
    """Something that was measured, and what it may be at most."""

    name: str
    value: float
    limit: float
    unit: str


@dataclass
class Findings:
    """What was measured in one run, and what of it is not as it must be: sentences both; and the figures among it."""

    measured: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Say what was seen."""
        self.measured.append(text)

    def require(self, condition: object, failure: str) -> None:
        """Say what is wrong where a condition does not hold."""
        if not condition:
            self.failures.append(failure)

    def figure(self, name: str, value: float, limit: float, unit: str) -> None:
        """Note a figure whose limit is looked after elsewhere."""
        self.note(f"{name} {value:.3g} {unit}".rstrip())
        self.figures.append(Figure(name, value, limit, unit))

    def at_most(self, name: str, value: float, limit: float, unit: str = "s") -> None:
        """Note a figure, which must not be larger than a limit, or nan."""
        self.figure(name, value, limit, unit)
        self.require(value <= limit, f"{name} {value:.3g} {unit}, allowed are {limit:g}")


@dataclass(frozen=True)
class Row:
    """The result of one fault: one line of the table of `geodesic-motion faults`.

    passed : None where the fault was skipped; `measured` says why.
    """

    name: str
    phase: str
    seed: int
    criterion: str
    measured: str
    passed: bool | None
    figures: tuple[Figure, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """As the JSON file has it."""
        return {
            "name": self.name, "phase": self.phase, "seed": self.seed, "criterion": self.criterion,
            "measured": self.measured, "pass": self.passed, "figures": [figure._asdict() for figure in self.figures],
        }  # fmt: skip


class Fault(ABC):
    """One fault.

    Attributes
    ----------
    name : as the command line knows it. criterion : when it passes, one sentence.
    phases : in which it makes sense. subjects : of which it makes sense.
    in_motion : how much of its time a motion still needs in that phase, share of the whole. near_goal : likewise [s].
    long : whether it takes minutes. fresh : whether it needs nodes that have just started, and
        leaves none that another could use.
    planner, twin : parameters that the nodes are started with, besides those of the bench.
    """

    name: str
    criterion: str
    phases: tuple[str, ...] = PHASES
    subjects: tuple[str, ...] = SUBJECTS
    in_motion: tuple[float, float] = (0.4, 0.7)
    near_goal: tuple[float, float] = (0.3, 0.8)
    long: bool = False
    fresh: bool = False
    planner: Mapping[str, Any] = MappingProxyType({})
    twin: Mapping[str, Any] = MappingProxyType({})

    @abstractmethod
    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        """Inject the fault into nodes that have reached a phase, and say what came of it.

        The bench judges every command besides, when this has returned.
        """
