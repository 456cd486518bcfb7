"""The newest goal that was requested of a planner, and what becomes of it. Knows nothing of ROS."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Generic

from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.nodes.cycle import CycleInputs
from geodesic_motion_ros.nodes.input_faults import Halt
from geodesic_motion_ros.nodes.preparation import Preparation, Prepared

#: What is reported of a goal while it is being prepared.
PREPARING = "the newest one is being prepared"


class NewestGoal(Generic[Prepared]):
    """The newest goal, prepared beside the cycles and handed to a planner.

    Attributes
    ----------
    number : of the newest goal that was received, counted from 1; 0 before the first.
    verdict : of that goal. When it is a refusal, the motion still serves the goal before.
    is_set : whether the planner has a goal.

    Parameters
    ----------
    take : has a prepared goal planned to, or says why it is refused. clear : has the planner forget its goal.
    background : prepares goals while cycles go on; None: a cycle does it, and takes longer.
    noun : what a person calls it.
    """

    def __init__(
        self,
        take: Callable[[Prepared | Refusal], Verdict],
        clear: Callable[[], None],
        background: Executor | None,
        noun: str = "goal",
    ) -> None:
        self._take, self._clear, self._noun = take, clear, noun
        self._preparation: Preparation[Prepared | Refusal] = Preparation(background)
        self.number = 0
        self.verdict: Verdict = Refusal(VerdictCode.NO_GOAL, f"no {noun} has been given")
        self.is_set = False
        # The number of the goal that was prepared last, and of that which the planner has.
        self._asked = self._taken = 0
        self._is_refused = False  # whether the message of the newest one was

    @property
    def served(self) -> int:
        """The number of the goal that the planner has; 0: none."""
        return self._taken if self.is_set else 0

    @property
    def is_prepared(self) -> bool:
        """Whether no goal is being prepared."""
        return not self._preparation.busy

    def hear(self, inputs: CycleInputs, preparing: Callable[[], Callable[[], Prepared | Refusal]]) -> None:
        """Have the goal of the inputs prepared where it is new.

        preparing : makes what prepares it, or finds why it is refused; any thread may run that.
        """
        if inputs.goal is None or inputs.goal_number == self.number:
            return
        self.number, self._is_refused = inputs.goal_number, False
        if isinstance(inputs.goal, Refusal):
            self.verdict, self._is_refused = inputs.goal, True
        else:
            self._asked = self.number
            self.prepare(preparing())
            self.verdict = Refusal(VerdictCode.NO_GOAL, PREPARING)

    def prepare(self, prepare: Callable[[], Prepared | Refusal]) -> None:
        """Have a goal prepared in the place of any other that is."""
        self._preparation.ask(prepare)

    def take_prepared(self) -> None:
        """Hand the goal that has been prepared to the planner, if any. Raises what its preparation raised."""
        try:
            prepared = self._preparation.take_settled()
        except Exception:
            self.verdict = Refusal(VerdictCode.BAD_INPUT, "internal error while it was prepared, see the log")
            raise
        if prepared is None:
            return
        verdict = self._take(prepared)
        if verdict.ok:
            self.is_set, self._taken = True, self._asked
        # What is reported is of the newest goal: of one before it nothing.
        if self.is_prepared and not self._is_refused:
            self.verdict = verdict

    def heed(self, halt: Halt | None) -> Refusal | None:
        """Return the refusal of a halt, if any, and drop the goal where the halt says so."""
        if halt is None:
            return None
        if halt.dropping:
            self.drop(halt.dropping)
        return halt.refusal

    def withdraw(self, number: int, why: str) -> None:
        """Drop a goal, by its number, where the planner has it or it is being prepared."""
        if number == (self.served if self.is_prepared else self._asked) != 0:
            self.drop(why)

    def drop(self, why: str) -> None:
        """Forget the goal: where something unexpected has happened, an arm must not set out again by itself."""
        if self.is_set or not self.is_prepared:
            self.is_set = False
            self.verdict = Refusal(VerdictCode.NO_GOAL, f"{self._noun} dropped: {why}; send the {self._noun} again")
            self._preparation.forget()
            self._clear()
