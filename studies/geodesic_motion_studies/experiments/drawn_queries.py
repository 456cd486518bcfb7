"""Queries of a skill that are drawn: starts and goals from the spread of the demonstrated ones, obstacles, odd starts.

Of the demonstrated starts, and of the goals, mean m and covariance C are taken in the coordinates in which the skill
judges them: joints for a skill of configurations, group by group, translation and rotation vector for one of tool
poses. Their Mahalanobis radius is r(x)^2 = (x - m)^T C^+ (x - m) (Mahalanobis 1936), R that of the farthest
demonstration. A drawn end has a random direction in the space that the demonstrations span, and a radius that is even
in [0, R] inside the spread, and in (R, 2 R] outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.quaternions import mean_rotation, rotate_by, rotation_vector_between
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import RobotError

DEMONSTRATED, INSIDE, OUTSIDE, OBSTACLES, ODD_STARTS = "demonstrated", "inside", "outside", "obstacles", "odd starts"
PARTS = (DEMONSTRATED, INSIDE, OUTSIDE, OBSTACLES, ODD_STARTS)
#: Of this many pairs of queries, one inside and one outside of the spread, so many have obstacles, and odd starts.
CYCLE, WITH_OBSTACLES, WITH_ODD_STARTS = 20, 5, 3
#: Radii of obstacles [m], and how far they are off the straight line between the tool's start and goal [m].
RADII, OFF_LINE = (0.03, 0.08), 0.08
#: How far a start is beyond a limit of a joint, at most [rad].
BEYOND = 0.1
#: Postures that are drawn for one in which the arm touches itself.
ATTEMPTS = 500
#: Postures on the line from a start to one of these that are looked at.
STEPS = 50
#: No obstacles (0, 3).
NONE = np.empty((0, 3))
#: Singular values below this share no direction of a spread [m, rad].
_NO_SPREAD = 1e-6


@dataclass(frozen=True, eq=False)
class Query:
    """A start, a goal and standing spheres.

    Attributes
    ----------
    part : one of PARTS. number : of the query in its part's run; with the seed it repeats the query.
    start : (eta,) [rad], in the limits or not; None where no configuration holds the start pose.
    start_pose, goal_pose : of the tool. goal : (eta,) [rad]; None with a skill of tool poses.
    centres, radii : (o, 3), (o,) [m] of the spheres.
    """

    part: str
    number: int
    start: np.ndarray | None
    start_pose: Pose
    goal: np.ndarray | None
    goal_pose: Pose
    centres: np.ndarray
    radii: np.ndarray


@dataclass(frozen=True, eq=False)
class Spread:
    """Of samples (N, D): their mean (D,), a root (D, r) of their covariance, and R, the farthest one's radius."""

    mean: np.ndarray
    root: np.ndarray
    farthest: float

    @classmethod
    def of(cls, samples: np.ndarray) -> Spread:
        mean, degrees = samples.mean(axis=0), max(len(samples) - 1, 1)
        left, sizes, axes = np.linalg.svd(samples - mean, full_matrices=False)
        spanned = sizes > _NO_SPREAD
        radii = np.sqrt(degrees) * np.linalg.norm(left[:, spanned], axis=1)
        return cls(mean, axes[spanned].T * sizes[spanned] / np.sqrt(degrees), float(radii.max(initial=0.0)))

    def draw(self, random: np.random.Generator, outside: bool) -> np.ndarray:
        """A sample (D,) inside the spread, or up to twice as far outside."""
        direction = random.normal(size=self.root.shape[1])
        radius = self.farthest * (random.uniform() + outside)
        return self.mean + self.root @ (radius * direction / max(float(np.linalg.norm(direction)), 1e-12))


@dataclass(frozen=True, eq=False)
class DemonstratedEnds:
    """The starts, or the goals, of N demonstrations, and their spread.

    Attributes
    ----------
    samples : (N, D) configurations [rad], or offsets (translation [m], rotation vector [rad]) from `origin`.
    groups : (N,) whose spreads are taken apart. origin : a pose; None for configurations.
    """

    samples: np.ndarray
    groups: np.ndarray
    origin: Pose | None

    @classmethod
    def of_configurations(cls, samples: np.ndarray, groups: np.ndarray) -> DemonstratedEnds:
        return cls(samples, groups, None)

    @classmethod
    def of_poses(cls, positions: np.ndarray, quaternions: np.ndarray) -> DemonstratedEnds:
        """From (N, 3) [m] and (N, 4)."""
        origin = Pose(positions.mean(axis=0), mean_rotation(quaternions[:, None])[0])
        turns = np.stack([rotation_vector_between(origin.quaternion, quaternion) for quaternion in quaternions])
        return cls(np.hstack([positions - origin.position, turns]), np.zeros(len(positions), dtype=int), origin)

    @cached_property
    def _spreads(self) -> list[Spread]:
        return [Spread.of(self.samples[self.groups == group]) for group in range(int(self.groups.max()) + 1)]

    def draw(self, random: np.random.Generator, like: int, outside: bool) -> np.ndarray:
        """A sample (D,) from the spread of the group of one demonstration."""
        return self._spreads[int(self.groups[like])].draw(random, outside)

    def pose(self, sample: np.ndarray, robot: Robot) -> Pose:
        """The tool's pose of a sample (D,)."""
        if self.origin is None:
            return Pose(*robot.forward(sample))
        turned = rotate_by(sample[3:], self.origin.quaternion)
        return Pose(self.origin.position + sample[:3], turned)


def demonstrated_ends(skill: Skill) -> tuple[DemonstratedEnds, DemonstratedEnds]:
    """The starts and the goals that a skill was learned from; those of the raw sheet as they are decoded."""
    sheet, found = skill.canonical, []
    for end, column in (("start", 0), ("goal", -1)):
        offsets = None if sheet is None else getattr(sheet, f"{end}_offsets")
        if skill.space == "joint":
            if offsets is None:
                samples = skill.decoder.configurations(skill.codes[:, column])
                groups = np.zeros(len(samples), dtype=int)
            else:
                groups = getattr(sheet, f"{end}_groups")
                samples = getattr(sheet, f"{end}_poles")[groups] + offsets
            found.append(DemonstratedEnds.of_configurations(samples, groups))
        elif offsets is None:
            found.append(DemonstratedEnds.of_poses(*skill.decoder.poses(skill.codes[:, column])))
        else:
            mean = getattr(skill, f"{end}_pose")
            turned = rotate_by(offsets[:, 3:], np.tile(mean[3:], (len(offsets), 1)))
            found.append(DemonstratedEnds.of_poses(mean[:3] + offsets[:, :3], turned))
    return found[0], found[1]


@dataclass(frozen=True, eq=False)
class QuerySource:
    """Draws the queries of one skill; the same seed and number give the same query."""

    robot: Robot
    collision: CollisionModel
    starts: DemonstratedEnds
    goals: DemonstratedEnds

    @classmethod
    def of(cls, skill: Skill) -> QuerySource:
        return cls(Robot.named(skill.robot), CollisionModel.named(skill.robot), *demonstrated_ends(skill))

    def demonstrated(self) -> list[Query]:
        """From every demonstration's own start to its own goal."""
        ends = zip(self.starts.samples, self.goals.samples, strict=True)
        return [self._query(DEMONSTRATED, number, start, goal) for number, (start, goal) in enumerate(ends)]

    def drawn(self, number: int, seed: int) -> Query:
        """The query of a number, from 0 on: every other one outside of the spread."""
        random, outside, place = np.random.default_rng((seed, number)), number % 2 == 1, number // 2 % CYCLE
        like = int(random.integers(len(self.starts.samples)))
        start, goal = (ends.draw(random, like, outside) for ends in (self.starts, self.goals))
        if place >= CYCLE - WITH_ODD_STARTS:
            return self._oddly_started(number, start, goal, random)
        if place < CYCLE - WITH_ODD_STARTS - WITH_OBSTACLES:
            return self._query(OUTSIDE if outside else INSIDE, number, start, goal)
        ends = [kind.pose(end, self.robot).position for kind, end in ((self.starts, start), (self.goals, goal))]
        count = int(random.integers(1, 3))
        centres = ends[0] + random.uniform(size=(count, 1)) * (ends[1] - ends[0])
        centres += random.normal(0.0, OFF_LINE, (count, 3))
        return self._query(OBSTACLES, number, start, goal, centres, random.uniform(*RADII, count))

    def _query(
        self, part: str, number: int, start: np.ndarray, goal: np.ndarray,
        centres: np.ndarray = NONE, radii: np.ndarray = NONE[:, 0],
    ) -> Query:  # fmt: skip
        start_pose, goal_pose = self.starts.pose(start, self.robot), self.goals.pose(goal, self.robot)
        if self.starts.origin is None:
            return Query(part, number, start, start_pose, goal, goal_pose, centres, radii)
        return Query(part, number, self._posture(start_pose), start_pose, None, goal_pose, centres, radii)

    def _posture(self, pose: Pose) -> np.ndarray | None:
        try:
            return solve(self.robot, pose.position, pose.quaternion)
        except RobotError:
            return None

    def _oddly_started(self, number: int, start: np.ndarray, goal: np.ndarray, random: np.random.Generator) -> Query:
        """The query with a start at the nearest limit of a joint, beyond it, or in contact of the arm with itself."""
        usual, robot = self._query(ODD_STARTS, number, start, goal), self.robot
        odd = np.array(robot.ready if usual.start is None else usual.start)
        if (kind := int(random.integers(3))) == 2:
            odd = self._touching(odd, random)
        else:
            ends = np.stack([robot.lower, robot.upper])
            end, joint = np.unravel_index(np.argmin(np.abs(ends - odd)), ends.shape)
            odd[joint] = ends[end, joint] + (2 * end - 1) * kind * random.uniform(0.0, BEYOND)
        start_pose = Pose(*robot.forward(odd))
        return Query(ODD_STARTS, number, odd, start_pose, usual.goal, usual.goal_pose, usual.centres, usual.radii)

    def _touching(self, start: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """A posture (eta,) in which the arm touches itself: the first on the line to a drawn one; the start itself
        where none of them does.
        """
        for drawn in self.robot.sample(ATTEMPTS, random):
            if self._overlap(drawn):
                line = start + np.linspace(0.0, 1.0, STEPS)[:, None] * (drawn - start)
                return next(posture for posture in line if self._overlap(posture))
        return start

    def _overlap(self, posture: np.ndarray) -> bool:
        return self_clearance(self.collision, self.robot, posture)[0] < 0.0
