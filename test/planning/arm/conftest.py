"""A joint-space planner that is ticked, with its path without obstacles and a sphere on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry


@dataclass
class Stream:
    """Ticks a planner every `period` [s]; what it answers is played from the next on, so late as a message may be."""

    planner: ReactivePlanner
    period: float = 0.01
    now: float = 0.0
    played: tuple[JointReference, float] | None = None
    pending: tuple[JointReference, float] | None = None
    handed: list[JointReference] = field(default_factory=list)
    jumps: list[float] = field(default_factory=list)
    postures: list[np.ndarray] = field(default_factory=list)

    def state(self, played: tuple[JointReference, float] | None = None) -> np.ndarray:
        """Position, velocity and acceleration (3, eta) that are desired now."""
        reference, begin = played or self.played
        return np.stack(reference.sample(self.now - begin))

    def stand_at(self, configuration: np.ndarray) -> None:
        standing = self.planner.stand_at(configuration, self.now)
        assert standing.reference is not None
        self.played, self.pending = (standing.reference, standing.begin), None

    def run(self, seconds: float) -> list[Plan]:
        plans = []
        for _ in range(round(seconds / self.period)):
            if self.pending is not None:
                self.jumps.append(float(np.max(np.abs(self.state(self.pending) - self.state()))))
                self.played, self.pending = self.pending, None
            plans.append(self.planner.tick(self.now))
            if plans[-1].reference is not None:
                self.pending = plans[-1].reference, plans[-1].begin
                self.handed.append(plans[-1].reference)
            self.postures.append(self.state()[0])
            self.now += self.period
        return plans

    def dense(self, reference: JointReference) -> np.ndarray:
        """Configurations (n, eta) [rad] of a reference, a period apart."""
        return reference.samples(np.arange(0.0, reference.duration, self.period))[0]

    def off(self, goal: np.ndarray) -> float:
        """Largest distance of a joint from a goal, or speed of one: [rad], [rad/s]."""
        position, velocity, _ = self.state()
        return float(max(np.max(np.abs(position - goal)), np.max(np.abs(velocity))))


@pytest.fixture(scope="module")
def planner(reach_skill: Skill) -> ReactivePlanner:
    """On a graph that stands sooner than the default one."""
    return ReactivePlanner(reach_skill, PlannerSettings(grid_shape=(30, 30, 30)))


@pytest.fixture(scope="module")
def start(reach_skill: Skill) -> np.ndarray:
    return reach_skill.canonical.start_poles[0]


@pytest.fixture(scope="module")
def goal(reach_skill: Skill) -> np.ndarray:
    return reach_skill.canonical.goal_poles[0]


@pytest.fixture
def stream(planner: ReactivePlanner, start: np.ndarray, goal: np.ndarray) -> Stream:
    planner.take_obstacles(Obstacles.none())
    result = Stream(planner)
    result.stand_at(start)
    assert planner.set_goal_configuration(goal).ok
    return result


@pytest.fixture(scope="module")
def nominal(planner: ReactivePlanner, start: np.ndarray, goal: np.ndarray) -> JointReference:
    """The path without obstacles."""
    planner.take_obstacles(Obstacles.none())
    planner.stand_at(start, 0.0)
    planner.set_goal_configuration(goal)
    return planner.tick(0.0).reference


@pytest.fixture(scope="module")
def on_elbow(planner: ReactivePlanner, nominal: JointReference) -> tuple[np.ndarray, np.ndarray]:
    """A sphere where the elbow is halfway on that path."""
    halfway = nominal.sample(0.5 * nominal.duration)[0]
    return elbow_position(planner.robot, halfway)[None], np.array([0.04])


@pytest.fixture(scope="module")
def least_clearance() -> Iterator[Callable[[Sequence[np.ndarray], tuple[np.ndarray, np.ndarray]], float]]:
    """least_clearance(postures, sphere): least distance [m] of the meshes from one sphere, by PyBullet."""
    with CollisionGeometry("panda") as meshes:

        def measure(postures: Sequence[np.ndarray], sphere: tuple[np.ndarray, np.ndarray]) -> float:
            least = np.inf
            for posture in postures:
                meshes.place(posture)
                least = min(least, meshes.clearance(sphere[0][0], float(sphere[1][0])))
            return least

        yield measure
