"""A filter of an arm, a motion that is offered to it, and a stream of its ticks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

#: Where the offered motion begins, and how far it leads [rad]; how long it takes [s].
BEGIN = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.7])
MOVED = np.array([0.8, 0.5, -0.6, 0.4, 0.5, 0.3, -0.5])
DURATION = 2.5


def offered(times: np.ndarray, duration: float = DURATION) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (m, 7) of a motion of least jerk at times (m,) [s]; at rest before and after it."""
    share = np.clip(np.asarray(times) / duration, 0.0, 1.0)[:, None]
    passed = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    speed = 30.0 * share**2 * (1.0 - share) ** 2 / duration
    return BEGIN + passed * MOVED, speed * MOVED


@dataclass
class Filtering:
    """Ticks of a filter, a hundred a second, and what they command: position, velocity, acceleration."""

    filter: MotionFilter
    now: float = 0.0
    commanded: list[np.ndarray] = field(default_factory=list)
    plans: list[Plan] = field(default_factory=list)

    def run(self, seconds: float, each: Callable[[float], object] = lambda now: None) -> Plan:
        """Tick for a time; each(now) is called before every tick."""
        for _ in range(round(seconds / 0.01)):
            each(self.now)
            self.plans.append(self.filter.tick(self.now))
            self.commanded.append(np.stack(self.filter.commanded_state(self.now)))
            self.now += 0.01
        return self.plans[-1]

    @property
    def positions(self) -> np.ndarray:
        """All configurations (n, 7) that were commanded."""
        return np.array(self.commanded)[:, 0]

    @property
    def at_rest(self) -> bool:
        """Whether the arm stands."""
        return not np.any(self.commanded[-1][1])


@pytest.fixture(scope="session")
def motion_filter() -> MotionFilter:
    return MotionFilter("panda", DeclaredScene.empty())


@pytest.fixture
def filtering(motion_filter: MotionFilter) -> Filtering:
    motion_filter.observe(Obstacles.none())
    motion_filter.clear_goal()
    motion_filter.stand_at(BEGIN, 0.0)
    return Filtering(motion_filter)


@pytest.fixture(scope="session")
def least_clearance() -> Iterator[Callable[[np.ndarray, Callable[[int], np.ndarray], float], float]]:
    """least_clearance(positions, centre, radius): least distance [m] of the meshes from a sphere whose centre (3,) is
    centre(i) where the arm is at positions[i], by PyBullet.
    """
    with CollisionGeometry("panda") as meshes:

        def measure(positions: np.ndarray, centre: Callable[[int], np.ndarray], radius: float) -> float:
            least = np.inf
            for number, position in enumerate(positions):
                meshes.place(position)
                least = min(least, meshes.clearance(centre(number), radius))
            return least

        yield measure
