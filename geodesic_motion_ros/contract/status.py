"""The answers to a tick, a request or a search: `Verdict`, and `Refusal` where what was asked for is not done."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, TypeVar

_AnyVerdict = TypeVar("_AnyVerdict", bound="Verdict")


class VerdictCode(IntEnum):
    """The reason why there is, or is not, a path to the goal. OK alone comes with one; a stop, an evasion or an
    approach that is handed out has the code of why there is none.
    """

    OK = 0
    HOLD_REQUESTED = 1
    NO_GOAL = 2
    STALE_STATE = 3
    STALE_OBSTACLES = 4
    NO_FEASIBLE_PATH = 5
    IN_COLLISION = 6
    GOAL_OUT_OF_SUPPORT = 7
    START_OUT_OF_SUPPORT = 8
    DEADLINE_MISSED = 9
    BAD_INPUT = 10
    CONFLICT = 11


_OF_PLANNING = frozenset({
    VerdictCode.OK, VerdictCode.NO_FEASIBLE_PATH, VerdictCode.IN_COLLISION, VerdictCode.GOAL_OUT_OF_SUPPORT,
    VerdictCode.START_OUT_OF_SUPPORT, VerdictCode.DEADLINE_MISSED,
})  # fmt: skip


@dataclass(frozen=True)
class Figures:
    """The figures of a path, or of the attempt to find one.

    Attributes
    ----------
    clearance : smallest distance [m] from the arm's spheres to any obstacle along the reference, already reduced
        by the certificate's allowance between samples; inf without obstacles, nan without a path.
    energy_per_edge : largest squared Riemannian length of one edge of the path; nan without a path.
    cost_gap : how much more than the cheapest path through the graph this one costs at most, as a share of that; 0 but
        where the deadline ended the search.
    in_support : whether the whole path stays where the decoder can be trusted.
    start_offset, goal_offset : endpoint errors: how far the learned start and goal are moved to meet the requested
        poses [m].
    start_offset_angle, goal_offset_angle : how far they are rotated for that [rad].
    end_correction : how far the path's ends still had to be moved after that, the farther of the two: over all joints
        [rad], or [m] with the paper's planner.
    start_beyond, goal_beyond : the part of the endpoint errors that no demonstration shows [m]: all of it with raw
        demonstrations, the distance from the convex hull of the demonstrated offsets with endpoint-normalised ones.
    start_beyond_angle, goal_beyond_angle : that part of the rotations [rad].
    displacement, swivel : how far the tool [m] and the arm beside it [rad] leave what was demonstrated, where the path
        is a detour; 0 elsewhere. deviation : the largest Mahalanobis distance of that, by the demonstrations' variance.
    goal_covered : whether an obstacle, or the declared scene, overlaps the arm at the goal. It is a case of
        NO_FEASIBLE_PATH and has no code of its own: the arm may move nearer, but nothing must take that for OK.
    goal_distance : how far the tool is from such a goal [m]; nan elsewhere.
    """

    clearance: float = math.nan
    energy_per_edge: float = math.nan
    cost_gap: float = 0.0
    in_support: bool = False
    start_offset: float = math.nan
    goal_offset: float = math.nan
    start_offset_angle: float = math.nan
    goal_offset_angle: float = math.nan
    end_correction: float = math.nan
    start_beyond: float = math.nan
    goal_beyond: float = math.nan
    start_beyond_angle: float = math.nan
    goal_beyond_angle: float = math.nan
    displacement: float = 0.0
    swivel: float = 0.0
    deviation: float = 0.0
    goal_covered: bool = False
    goal_distance: float = math.nan


@dataclass(frozen=True)
class Verdict:
    """The answer to a tick or a request: OK, or a `Refusal`.

    Attributes
    ----------
    code, reason : the outcome, and a text for a person.
    figures : of the path.
    """

    code: VerdictCode = VerdictCode.OK
    reason: str = ""
    figures: Figures = Figures()

    def __post_init__(self) -> None:
        if self.ok == isinstance(self, Refusal):
            raise ValueError(f"a {type(self).__name__} with the code {self.code!r}: a Refusal has every code but OK")

    @property
    def ok(self) -> bool:
        """Whether what was asked for is done."""
        return self.code is VerdictCode.OK

    @property
    def is_of_planning(self) -> bool:
        """Whether planning came to this verdict; False where nothing could be planned, as an input is missing."""
        return self.code in _OF_PLANNING

    @property
    def sentence(self) -> str:
        """Code and reason, for a person."""
        return f"{self.code.name}: {self.reason}" if self.reason else self.code.name

    def with_remark(self: _AnyVerdict, remark: str) -> _AnyVerdict:
        """Return the same verdict with a remark after its reason."""
        return replace(self, reason=f"{self.reason}; {remark}" if self.reason else remark)

    def with_figures(self: _AnyVerdict, **changes: Any) -> _AnyVerdict:
        """Return the same verdict with some figures changed, by their names."""
        return replace(self, figures=replace(self.figures, **changes))


@dataclass(frozen=True)
class Refusal(Verdict):
    """A verdict on something that is not done, and why; its code is never OK.

    What may fail for a reason returns its result or a refusal. None is returned where there is nothing to explain.
    """
