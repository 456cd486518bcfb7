"""A planner of a small skill that fans out, and the motion that the skill shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest

from geodesic_motion_ros.planner import Plan, ReactivePlanner
from geodesic_motion_ros.reference import ReferenceFollower
from geodesic_motion_ros.skill import Skill

PERIOD = 0.01
NOTHING = (np.empty((0, 3)), np.empty(0))
#: Centres (o, 3) and radii (o,) of spheres [m].
Spheres = tuple[Sequence, Sequence]


class DrivenPlanner(ReactivePlanner):
    """A planner that plans the motion between its skill's mean start and mean goal, and is followed on it."""

    def nominal(self) -> Plan:
        """The plan from the mean start to the mean goal."""
        start, goal = self.skill.start_pose, self.skill.goal_pose
        return self.plan(start[:3], start[3:], goal[:3], goal[3:])

    def middle(self) -> np.ndarray:
        """Position (3,) [m] half way along that plan."""
        positions = self.nominal().reference.positions
        return positions[len(positions) // 2]

    def stream(
        self, obstacles: Callable[[float], Spheres] = lambda time: NOTHING, seconds: float = 8.0
    ) -> Iterator[tuple[float, ReferenceFollower, Plan]]:
        """Follow the planner from start to goal; yields time, follower and plan after every tick."""
        start, goal = self.skill.start_pose, self.skill.goal_pose
        follower = ReferenceFollower(self.settings.speed)
        follower.reset(start[:3], start[3:])
        assert self.set_goal(goal[:3], goal[3:]).ok
        for step in range(int(seconds / PERIOD)):
            self.set_obstacles(*obstacles(step * PERIOD))
            plan = self.tick(follower.position, follower.quaternion, follower.speed)
            if plan.reference is None:
                follower.hold()
            else:
                follower.accept(plan.reference)
            yield step * PERIOD, follower, plan
            follower.advance(PERIOD)


@pytest.fixture(scope="session")
def shared_planner(fan_skill: Skill) -> DrivenPlanner:
    return DrivenPlanner(fan_skill)


@pytest.fixture
def planner(shared_planner: DrivenPlanner) -> DrivenPlanner:
    shared_planner.set_obstacles(*NOTHING)
    shared_planner.clear_goal()
    shared_planner._stream.forget()
    return shared_planner


@pytest.fixture
def another(fan_skill: Skill) -> Callable[..., DrivenPlanner]:
    """another(*settings) is a planner of its own."""
    return lambda *settings: DrivenPlanner(fan_skill, *settings)
