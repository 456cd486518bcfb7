"""What a planner that is not armed would begin, for people to look at. Knows nothing of ROS."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.nodes.deviation import have_joints_moved
from geodesic_motion_ros.planning.planner import ReactivePlanner

#: A plan that is shown is made anew so often [s].
SHOWN = 1.0


class ShownPlan:
    """The plan from where the arm stands, of which nothing is played."""

    def __init__(self, planner: ReactivePlanner) -> None:
        self._planner = planner
        self.forget()

    def forget(self) -> None:
        """Take note that nothing is shown."""
        # The plan, from which configuration, to the goal of which number, and until when it is shown [s].
        self._shown: tuple[Plan, np.ndarray, int, float] | None = None

    def make(self, configuration: np.ndarray, goal_number: int, now: float, heard: float) -> Plan:
        """Return the plan of an arm that stands in a configuration (eta,) [rad]: a new one every SHOWN, once the arm
        was moved, for another goal, and as long as there is none.

        now, heard : as of `CycleInputs`.
        """
        if self._shown is not None:
            plan, start, number, until = self._shown
            if number == goal_number and heard < until and not have_joints_moved(configuration, start):
                return plan
        standing = self._planner.commanded_state(now)
        if standing is None or have_joints_moved(configuration, standing[0]):
            self._planner.stand_at(configuration, now)
        plan = self._planner.tick(now)
        self.forget()
        if plan.reference is not None:
            self._planner.withdraw()
            self._shown = plan, configuration, goal_number, heard + SHOWN
        return plan
