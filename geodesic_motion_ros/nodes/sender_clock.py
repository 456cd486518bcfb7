"""The clock of a topic's sender beside the node's own: how old a message is though the two may differ."""

from __future__ import annotations

from geodesic_motion_ros.nodes.node_time import Moment

#: Differences from this on [s] are named: more than messages take on a machine that keeps up.
NAMED = 0.1
#: What was found in the last one or two spans of this [s] counts.
_SPAN = 1.0
#: Clocks that differ by more [s] are not both of this world.
_SIMULATED = 1e6


class SenderClock:
    """Ages of the messages of one sender.

    A stamp of the past says how old its message is. One of the future says that the clocks differ: such a message is as
    old as its arrival, and older by as much as it was in transit for longer than the fastest of the last second.
    """

    def __init__(self) -> None:
        # The least that messages were in transit for [s] by their stamps, in this span and in the one before.
        self._least = [float("inf"), float("inf")]
        self._begun = self._newest = -float("inf")

    def age(self, stamp: float, arrival: Moment) -> float:
        """Return how old a message with a stamp [s] was at its arrival [s]; 0 without a stamp."""
        if stamp == 0.0:
            return 0.0
        self._newest = arrival.running
        if arrival.running - self._begun > _SPAN:
            self._least = [float("inf"), self._least[0]]
            self._begun = arrival.running
        transit = arrival.transit(stamp)
        self._least[0] = min(self._least[0], transit)
        return transit if transit >= 0.0 else transit - self.least

    @property
    def least(self) -> float:
        """The least that messages of the last second or two were in transit for by their stamps [s]; inf without any.
        """
        return min(self._least)

    def remark(self, now: float) -> str:
        """Return the difference of the clocks, where there seems to be one; "" where there is none, or no message
        comes.

        now : [s, running].
        """
        least = self.least
        if abs(least) < NAMED or least == float("inf") or now - self._newest > 2.0 * _SPAN:
            return ""
        where, cause = ("ahead of", "") if least < 0.0 else ("behind", ", or its messages are late")
        remedy = "synchronise them"
        if abs(least) > _SIMULATED:
            remedy = "one of them is of a simulation: set use_sim_time alike"
        return f"the stamps are {abs(least):.2f} s {where} the clock of this node: the clocks differ{cause}; {remedy}"
