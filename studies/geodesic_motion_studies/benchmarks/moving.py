"""The planner's ticks among spheres that cross a demonstrated motion, and its answers to goals that are new in motion
and to starts, goals and spheres that are new from a stand.

A scene is a motion between the ends of a demonstration and spheres of 3 to 6 cm, each of which comes through a place of
the tool's obstacle-free path as the tool comes there, at a constant velocity of 0.05 to 0.5 m/s; with none, one sphere
moves where the arm cannot feel it. Every tick, a hundred a second, hands the planner new places; the arm is an ideal
follower. A motion ends as it comes to rest at its goal, or where it takes too long. The planner repeats itself to the
bit: every motion is played several times, and each tick counts by its fastest, the one that other work on the machine
disturbed least.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.geometry.quaternions import rotate_by
from geodesic_motion_ros.kernels.loading import load_kernels
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import shortest_path
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries import search as path_search
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.benchmarks.scenes import RATE
from geodesic_motion_studies.benchmarks.stopwatch import Stopwatch, no_garbage_collection

#: Speeds [m/s] and radii [m] of the spheres, and the shares of a motion in which they cross it.
_SPEEDS, _RADII, _SHARES = (0.05, 0.5), (0.03, 0.06), (0.2, 0.9)
#: What spheres leave between them and the arm as a motion begins [m].
_ROOM = 0.1
#: How much longer than undisturbed a motion may take [s].
_LONGER = 3.0
#: A sphere that no arm of ours reaches: where it is, and how fast [m], [m/s].
_FAR, _FAR_VELOCITY = np.array([0.0, 0.0, 4.0]), np.array([0.1, 0.0, 0.0])
#: How far a new start is from that of a motion, at most [rad], and how many spheres are new with it.
_NEW_START, _NEW_SPHERES = 0.03, 2
#: How far a new goal is from the old one [m], [rad], and in which shares of a motion it is requested.
_AWAY, _TURNED, _REDIRECTED = 0.02, 0.1, (0.2, 0.4, 0.6)
#: Ticks that a reference to a new goal may take: the planner may stop first.
_PATIENCE = 300


@dataclass(frozen=True)
class Motion:
    """A motion that was demonstrated.

    Attributes
    ----------
    start : (eta,) configuration [rad]. goal : (7,) pose [m], quaternion. duration : [s] undisturbed.
    tool : (m, 3) [m] places of the tool at evenly spaced times of it.
    """

    start: np.ndarray
    goal: np.ndarray
    duration: float
    tool: np.ndarray


@dataclass
class MovingTicks:
    """Durations of ticks, and of searches beside their alternatives.

    Attributes
    ----------
    every, searched : all ticks, and those that searched.
    searches : of this search alone. one_sided, plain : of the same by A* from one end, and by Dijkstra's algorithm on
        the graph with what obstacles do worked out at every node before; all three anew among the same obstacles.
    error : largest relative difference of their costs, where a path is cheaper than the planner's limit.
    """

    every: Stopwatch = field(default_factory=Stopwatch)
    searched: Stopwatch = field(default_factory=Stopwatch)
    searches: Stopwatch = field(default_factory=Stopwatch)
    one_sided: Stopwatch = field(default_factory=Stopwatch)
    plain: Stopwatch = field(default_factory=Stopwatch)
    error: float = 0.0


@dataclass
class NewGoals:
    """Durations from new goals to the first references that lead to them, or answers; and how many got none."""

    watch: Stopwatch = field(default_factory=Stopwatch)
    without: int = 0


@dataclass
class _Play:
    """A motion played once: durations of its ticks, numbers of those that searched, and one search of each of them."""

    watch: Stopwatch = field(default_factory=Stopwatch)
    searched: list[int] = field(default_factory=list)
    searches: list[tuple] = field(default_factory=list)


class MovingBench:
    """A planner on a skill of either kind, and motions between the ends of its demonstrations.

    Parameters
    ----------
    motions : so many, each of another demonstration, as long as there are others. plays : of each of them.
    """

    def __init__(self, skill: Skill, motions: int, plays: int) -> None:
        self._plays = plays
        self.planner = ReactivePlanner(skill)
        load_kernels(self.planner)
        self.motions = [
            motion for number in range(len(skill.codes)) if (motion := self._motion(skill.codes[number])) is not None
        ][:motions]  # fmt: skip
        if not self.motions:
            raise ParameterError(f"skill '{skill.name}' has no path along any of its demonstrations")

    def _motion(self, codes: np.ndarray) -> Motion | None:
        """Between the ends of a demonstration with codes (T, d); None where there is no path."""
        graph, robot = self.planner.graph, self.planner.robot
        if isinstance(graph, ConfigurationGraph):
            poses = [np.concatenate(robot.forward(q)) for q in graph.decoder.configurations(codes[[0, -1]])]
        else:
            decoded = graph.decoder.decode(codes[[0, -1]])
            poses = list(np.hstack([decoded.positions, decoded.quaternions]))
        reference = self.planner.plan(poses[0][:3], poses[0][3:], poses[1][:3], poses[1][3:]).reference
        if reference is None:
            return None
        along = reference.samples(np.linspace(0.0, reference.duration, 200))[0]
        tool = np.stack([robot.forward(configuration)[0] for configuration in along])
        return Motion(reference.positions[0], poses[1], reference.duration, tool)

    def spheres(self, motion: Motion, count: int, random: np.random.Generator) -> Obstacles:
        """So many spheres that cross a motion, as it begins at time 0."""
        if count == 0:
            return Obstacles.of_spheres(_FAR[None], np.array([_RADII[1]]), _FAR_VELOCITY[None], time=0.0)
        rows: list[np.ndarray] = []
        while len(rows) < count:
            share, speed, radius = (random.uniform(*limits) for limits in (_SHARES, _SPEEDS, _RADII))
            direction = random.normal(size=3)
            velocity = speed * direction / np.linalg.norm(direction)
            crossed = motion.tool[int(share * (len(motion.tool) - 1))] + random.uniform(-0.5, 0.5, 3) * radius
            centre = crossed - share * motion.duration * velocity
            sphere = Obstacles.of_spheres(centre[None], np.array([radius]), velocity[None], time=0.0)
            if obstacle_clearance(self.planner.collision, self.planner.robot, motion.start, sphere)[0] > _ROOM:
                rows.append(np.concatenate([centre, [radius], velocity]))
        table = np.stack(rows)
        return Obstacles.of_spheres(table[:, :3].copy(), table[:, 3].copy(), table[:, 4:].copy(), time=0.0)

    def ticks(self, motion: Motion, obstacles: Obstacles, into: MovingTicks, compared: int) -> None:
        """Play a motion among spheres; so many of its searches are made again beside their alternatives."""
        plays = [self._play(motion, obstacles) for _ in range(self._plays)]
        fastest = Stopwatch.fastest([play.watch for play in plays])
        into.every.add(fastest, range(len(fastest.cpu)))
        into.searched.add(fastest, plays[0].searched)
        searches = plays[0].searches
        with no_garbage_collection():
            for search in searches[:: max(1, len(searches) // compared)][:compared]:
                self._compare(search, into)

    def _play(self, motion: Motion, obstacles: Obstacles) -> _Play:
        planner, play, longest = self.planner, _Play(), motion.duration + _LONGER
        self._begin(motion)
        with no_garbage_collection(), recorded_searches() as searches:
            for tick in range(int(longest * RATE)):
                now = tick / RATE
                searches.clear()
                # Seen anew in every tick: nothing has had time to halt.
                seen = replace(obstacles.at(now, longest), ages=np.zeros_like(obstacles.ages))
                with play.watch:
                    planner.take_obstacles(seen)
                    planner.tick(now)
                if searches:
                    play.searched.append(tick)
                    play.searches.append(searches[0])
                followed = planner.motion_to_goal()
                if followed is not None and now >= followed[1] + followed[0].duration:
                    break
        return play

    def _begin(self, motion: Motion) -> None:
        """The arm stands at a motion's start, with its goal."""
        self.planner.clear_goal()
        self.planner.stand_at(motion.start, 0.0)
        self.planner.set_goal(motion.goal[:3], motion.goal[3:])

    @staticmethod
    def _compare(arguments: tuple, into: MovingTicks) -> None:
        """Make a search of the planner's again, and by both alternatives."""
        adjacency, base, fixed, shares, evaluation, margin, to_goal, from_start, source, target, limit, *_ = arguments
        fresh = [_unlooked(evaluation) for _ in range(3)]
        with into.searches:
            found = path_search.shortest_path_from_both_ends(
                adjacency, base, fixed, shares, fresh[0], margin, to_goal, from_start, source, target, limit
            )
        with into.one_sided:
            _, _, cost = shortest_path(adjacency, base, fixed, shares, fresh[1], margin, to_goal, source, target)
        with into.plain:
            evaluate_nodes(np.arange(len(to_goal)), fresh[2])
            shortest_path(adjacency, base, fixed, shares, fresh[2], margin, np.zeros_like(to_goal), source, target)
        if cost < limit or np.isfinite(found.cost):
            # Where a sampled node is start and goal at once both costs are 0.
            into.error = max(into.error, abs(found.cost - cost) / cost if cost > 0.0 else found.cost)

    def new_goals(self, motion: Motion, random: np.random.Generator, into: NewGoals) -> None:
        """Request new goals in motion, each in a motion of its own, and wait for the first reference to each."""
        far = self.spheres(motion, 0, random)
        for share in _REDIRECTED:
            goal = self._new_goal(motion, random)
            begin, plays, found = int(share * motion.duration * RATE), [], False
            for _ in range(self._plays):
                self._begin(motion)
                for tick in range(begin):
                    self.planner.take_obstacles(far.at(tick / RATE, motion.duration))
                    self.planner.tick(tick / RATE)
                plays.append(watch := Stopwatch())
                with no_garbage_collection(), watch:
                    found = self._first_reference(goal, begin)
            into.watch.add(Stopwatch.fastest(plays), [0])
            into.without += not found

    def from_a_stand(self, motion: Motion, count: int, random: np.random.Generator, into: NewGoals) -> None:
        """Request so many goals, each from another start among other spheres, and wait for the first answer to each."""
        limits = self.planner.limits
        for _ in range(count):
            moved = motion.start + random.uniform(-_NEW_START, _NEW_START, len(motion.start))
            start = np.clip(moved, limits.lower, limits.upper)
            goal = self._new_goal(motion, random)
            spheres = self.spheres(motion, _NEW_SPHERES, random).at(0.5 * motion.duration, motion.duration)
            plays, found = [], False
            for _ in range(self._plays):
                self.planner.clear_goal()
                self.planner.take_obstacles(Obstacles.none())
                self.planner.stand_at(start, 0.0)
                plays.append(watch := Stopwatch())
                with no_garbage_collection(), watch:
                    self.planner.take_goal(self.planner.prepare_goal(*goal))
                    self.planner.take_obstacles(spheres)
                    found = self.planner.tick(0.0).verdict.ok
            into.watch.add(Stopwatch.fastest(plays), [0])
            into.without += not found

    @staticmethod
    def _new_goal(motion: Motion, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """A pose near a motion's goal."""
        away, turned = (size * _direction(random) for size in (_AWAY, _TURNED))
        return motion.goal[:3] + away, rotate_by(turned, motion.goal[3:])

    def _first_reference(self, goal: tuple[np.ndarray, np.ndarray], begin: int) -> bool:
        """Request a goal before a tick, and go on until a reference leads to it; whether one does."""
        planner = self.planner
        if not planner.take_goal(planner.prepare_goal(*goal)).ok:
            return False
        for tick in range(begin, begin + _PATIENCE):
            plan = planner.tick(tick / RATE)
            if plan.reference is not None and plan.verdict.ok:
                return True
        return False


@contextmanager
def recorded_searches() -> Iterator[list[tuple]]:
    """The arguments of all searches that planners of this process make meanwhile, in a list that may be cleared."""
    search, found = path_search.shortest_path_from_both_ends, []

    def recorded(*arguments: Any) -> Any:
        found.append(arguments)
        return search(*arguments)

    path_search.shortest_path_from_both_ends = recorded
    try:
        yield found
    finally:
        path_search.shortest_path_from_both_ends = search


def _unlooked(evaluation: NodeEvaluation) -> NodeEvaluation:
    """The same before anything was worked out."""
    return evaluation._replace(
        evaluated=np.zeros_like(evaluation.evaluated), factors=np.empty_like(evaluation.factors),
        affected=np.empty_like(evaluation.affected), clearance=np.empty_like(evaluation.clearance),
    )  # fmt: skip


def _direction(random: np.random.Generator) -> np.ndarray:
    """A unit vector (3,)."""
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)
