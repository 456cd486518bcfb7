"""Retry: when a search that found nothing is made again, and with what it has worked out until then.

One rule serves every search (`is_due`): it is made at once where it was not made for this query yet; never again while
all that its answer depends on is as it was; and else a period later. The attempts of an arm without a path have turns
besides, one in each tick (`AttemptMemory.choose_attempts`). What a search that was out of time has evaluated of the
graph's nodes serves the next one among the same obstacles (`Workings`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geodesic_motion_ros.contract.requirement import Requirement
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.motion.path_timer import JointCurve, PathTimer, TimedPath
from geodesic_motion_ros.motion.plan import MotionState
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.queries.search import BegunSearch, LatentPath

#: Two times [s] that differ by less are the same.
TIME_ROUNDING = 1e-6
#: Motions from one state that are remembered, at most.
_MOST_REMEMBERED = 32


@dataclass(frozen=True, eq=False)
class Question:
    """All that the answer of a search depends on.

    Attributes
    ----------
    about : the query, or the goal, that is searched for: another object is another question.
    obstacles : among which it is searched.
    position : (eta,) where the arm stands [rad]; None: it moves, and each place has the same answer.
    extent : how far the search looks: the reach of a detour [m].
    """

    about: object
    obstacles: Obstacles
    position: np.ndarray | None = None
    extent: float = 0.0

    def holds_there(self, other: Question) -> bool:
        """Whether another question is about the same, from the same place."""
        if self.about is not other.about:
            return False
        return other.position is None or (self.position is not None and np.array_equal(self.position, other.position))

    def holds_for(self, other: Question) -> bool:
        """Whether the answer to this question holds for another one: nothing has changed, and no obstacle moves."""
        unchanged = self.holds_there(other) and self.obstacles.is_static_and_unchanged(other.obstacles)
        return unchanged and self.extent == other.extent


@dataclass(frozen=True, eq=False)
class PastSearch:
    """A search that was made: its question, when it was made [s], and whether that has its answer: not where it was out
    of time, or what is followed has to be replaced.
    """

    question: Question
    time: float
    is_answered: bool = True


def is_due(last: PastSearch | None, question: Question, now: float, period: float) -> bool:
    """Whether a search is made at `now` [s] with a question.

    last : the last time that it was made; None: never. period : how often its answer is worth another search, where
        what it depends on changes [s].
    """
    if last is None or last.question.about is not question.about:
        return True
    answered = last.is_answered and last.question.holds_for(question)
    return not answered and now >= last.time + period - TIME_ROUNDING


@dataclass(eq=False)
class Workings:
    """The results of searches that the next ones need not repeat. A tick works on a copy, and remembers that.

    Attributes
    ----------
    begun : what a search has evaluated that was out of time; None: none was.
    evasions : how many targets a search of an evasion of a requirement has tried that was out of time.
    timed_from : the query and the state of motion of `curves` and `motions`: the configurations of each path, and the
        motion along it, that were worked out.
    """

    begun: BegunSearch | None = None
    evasions: dict[Requirement, int] = field(default_factory=dict)
    timed_from: tuple[ArmQuery, MotionState] | None = None
    curves: dict[tuple[bytes, bool], JointCurve | Refusal] = field(default_factory=dict)
    motions: dict[tuple[bytes, bool, float, bool], TimedPath | Refusal] = field(default_factory=dict)

    def copy(self) -> Workings:
        """Return the same, for one tick to go on with."""
        begun = None if self.begun is None else self.begun.copy()
        return Workings(begun, dict(self.evasions), self.timed_from, dict(self.curves), dict(self.motions))

    def take_begun(self, body: NodeBody, obstacles: Obstacles) -> BegunSearch | None:
        """Take the search of a body among obstacles that was out of time; None where there is none."""
        begun, self.begun = self.begun, None
        return begun if begun is not None and begun.is_of(body, obstacles) else None

    def time_path(
        self,
        timer: PathTimer,
        query: ArmQuery,
        state: MotionState,
        path: LatentPath,
        to_goal: bool,
        longest: float,
        paced: bool = True,
    ) -> TimedPath | Refusal:
        """Return the motion along a path, or why there is none, once for a query and a state of motion: an arm that
        waits finds the same paths each time.

        to_goal : the path leads to the goal of the query. longest : as of `PathTimer.time_curve`. paced : to a goal it
        is no faster than was shown.
        """
        if not self._are_from(query, state) or len(self.motions) >= _MOST_REMEMBERED:
            self.timed_from, self.curves, self.motions = (query, state), {}, {}
        name = path.polyline.tobytes(), to_goal
        if name not in self.curves:
            self.curves[name] = timer.joint_curve(query, state.position, path, to_goal)
        curve, key = self.curves[name], (*name, longest, paced)
        if isinstance(curve, Refusal):
            return curve
        if key not in self.motions:
            self.motions[key] = timer.time_curve(state, curve, longest, to_goal and paced)
        return self.motions[key]

    def _are_from(self, query: ArmQuery, state: MotionState) -> bool:
        """Whether the motions are for a query and begin in a state."""
        if self.timed_from is None or self.timed_from[0] is not query:
            return False
        before = self.timed_from[1]
        names = ("position", "velocity", "acceleration")
        return all(np.array_equal(getattr(before, name), getattr(state, name)) for name in names)
