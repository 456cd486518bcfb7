"""Whether a planner may command its arm. Knows nothing of ROS.

Of a planner that is to be armed by hand a person decides when the arm may move, and anew whenever something has
happened that the person may not have seen: nothing resumes by itself then.
"""

from __future__ import annotations

import threading

from geodesic_motion_ros.utils.errors import ParameterError

#: The word that says, in the place of topics, that nothing has to be heard before an arm moves.
NO_TOPIC = "none"


class Arming:
    """Whether a planner is armed; any thread may ask, arm and disarm."""

    def __init__(self, armed: bool, obstacle_topics: list[str], noun: str = "goal") -> None:
        """armed : from the start, and then always: it is not to be armed by hand. obstacle_topics : the parameter
        `required_obstacle_topics`: topics, "" for none that were named, or the word NO_TOPIC. noun : what a person
        calls that which sets the arm moving.
        """
        named = [topic for topic in obstacle_topics if topic]
        if NO_TOPIC in named and len(named) > 1:
            raise ParameterError(
                f"parameter required_obstacle_topics = {obstacle_topics}: name topics, or {NO_TOPIC} alone"
            )
        self.required = () if NO_TOPIC in named else tuple(named)
        self._by_hand, self._is_said = not armed, bool(named)
        self._lock, self._noun = threading.Lock(), noun
        self._unarmed = "" if armed else "not armed: nothing is commanded; call ~/arm with data: true"

    @property
    def unarmed(self) -> str:
        """Why nothing is commanded; "" where the planner is armed."""
        with self._lock:
            return self._unarmed

    def arm(self) -> str:
        """Let the planner command its arm; returns what a person should know.

        Raises
        ------
        ParameterError : it has not been said what is to be heard of obstacles before the arm moves.
        """
        if self._by_hand and not self._is_said:
            raise ParameterError(
                "required_obstacle_topics names nothing: start the planner with the topics that must be heard before "
                f"the arm moves, or with ['{NO_TOPIC}'] where nothing ever comes near"
            )
        with self._lock:
            was, self._unarmed = self._unarmed, ""
        return f"armed: the arm moves with the next {self._noun}" if was else "armed already"

    def disarm(self, why: str, by_itself: bool = True) -> bool:
        """Have the planner command nothing, for a reason; returns whether it was armed.

        by_itself : nobody has asked for it: a planner that is not armed by hand goes on.
        """
        if by_itself and not self._by_hand:
            return False
        with self._lock:
            was_armed = not self._unarmed
            if was_armed:
                self._unarmed = f"disarmed: {why}; call ~/arm with data: true, and send the {self._noun} again"
        return was_armed
