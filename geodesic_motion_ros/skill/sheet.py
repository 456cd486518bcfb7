"""Sheets: what a skill knows, beside codes, of the demonstrations that it was learned from, of poses or configurations.

These are canonical: endpoint-normalised, with start and goal offsets taken out (`demonstrations.canonical`). The
planner carries the decoded nodes to a query with the query's own offsets. Here stands how far offsets were
demonstrated, where the mean paths of the modes run, and what the demonstrations predict for a query.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from geodesic_motion_ros.geometry.convex_hull import beyond_hull
from geodesic_motion_ros.geometry.quaternions import continuous_signs, mean_rotation, rotate_by, rotation_vector_between
from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.skill.regression import regression_penalty, regression_weights
from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.checked_numbers import ARM_REACH, LARGEST_TURN, check_array, check_range, check_unit
from geodesic_motion_ros.utils.errors import SkillError

#: The sheet of rounds is unrolled over so many: a motion of one, or of one and a half that is joined in motion, begins
#: and ends inside of it, wherever on the round it begins.
UNROLLED_ROUNDS = 3
#: No two times of a recording are further apart [s].
LONGEST_DEMONSTRATION = 1e11
#: What a turn of one radian counts against a distance where offsets are compared [m].
METRES_PER_RADIAN = 0.1
#: The same for the six numbers of an offset: translation [m] and rotation vector [rad].
POSE_SCALE = np.repeat([1.0, METRES_PER_RADIAN], 3)


@dataclass(frozen=True)
class DemonstratedEnds(ABC):
    """The starts and goals of N demonstrations, as offsets from the common ones, and the mode of each.

    Attributes
    ----------
    start_offsets, goal_offsets : (N, D) what was taken out of each demonstration at its two ends.
    modes : (N,) number of each demonstration's mode, from 0.
    penalty : of the regression on start and goal offsets; inf: the mean.
    fade : exponent with which a start's offset was taken out along the motion, and is put in again, see
        `demonstrations.fade`.
    times : (N, S) [s] when each demonstration came to its samples, 0 at the first; None: not recorded.
    """

    start_offsets: np.ndarray
    goal_offsets: np.ndarray
    modes: np.ndarray
    penalty: float
    fade: float = field(default=1.0, kw_only=True)
    times: np.ndarray | None = field(default=None, kw_only=True)

    @property
    @abstractmethod
    def curves(self) -> tuple[np.ndarray, ...]:
        """The canonical demonstrations, arrays (N, S, ...): positions [m] and quaternions, or configurations [rad]."""

    @abstractmethod
    def check(self, count: int, samples: int) -> None:
        """Refuse arrays that do not belong to codes of `count` demonstrations with `samples` each (SkillError)."""

    @abstractmethod
    def mean_curves(self, weights: np.ndarray) -> tuple[np.ndarray, ...]:
        """Average the canonical demonstrations with weights (K, N): arrays (K, S, ...) like those of `curves`."""

    def with_regression(self) -> DemonstratedEnds:
        """Choose the regression that the demonstrations speak for; between modes, which no mean averages, none."""
        if np.any(self.modes):
            return self
        return replace(self, penalty=regression_penalty(self.features(), self.curves[0]))

    @abstractmethod
    def unrolled(self) -> DemonstratedEnds:
        """Follow rounds for `UNROLLED_ROUNDS`, curves (N, S, ...) as (N, UNROLLED_ROUNDS (S - 1) + 1, ...)."""

    def _unrolled_times(self) -> np.ndarray | None:
        return None if self.times is None else unrolled(self.times[..., None], self.times[:, -1:])[..., 0]

    def check_arrays(self, shapes: dict[str, tuple[int, ...]]) -> None:
        """Refuse arrays of other shapes, with values that are not finite or that no arm moves by (SkillError)."""
        for name, shape in shapes.items():
            check_array(f"canonical {name}", getattr(self, name), shape, -LARGEST_TURN, LARGEST_TURN)
        if not self.penalty > 0.0:
            raise SkillError(f"regression_penalty is {self.penalty}, must be positive, or .inf for no regression")

    def check_times(self, count: int, samples: int) -> None:
        """Refuse times that no demonstrations have (SkillError)."""
        if self.times is None:
            return
        check_array("canonical times", self.times, (count, samples), 0.0, LONGEST_DEMONSTRATION)
        if np.any(self.times[:, 0] != 0.0) or np.any(np.diff(self.times, axis=1) < 0.0):
            raise SkillError("canonical times must begin at 0 and not fall")

    @property
    def pace(self) -> np.ndarray | None:
        """The mean time (S,) [s] at which demonstrations had come so far along; None: not recorded."""
        return None if self.times is None else self.times.mean(axis=0)

    def check_numbers(self, name: str) -> None:
        """Refuse numbers (N,) of modes or groups that are not counted from 0 without gaps (SkillError)."""
        array = getattr(self, name)
        if array.dtype.kind not in "iu" or array.shape != (len(self.start_offsets),):
            raise SkillError(
                f"canonical {name} must be whole numbers of shape {(len(self.start_offsets),)}, are of type "
                f"{array.dtype} and shape {array.shape}"
            )
        numbers = set(array.tolist())
        if numbers != set(range(len(numbers))):
            raise SkillError(f"{name} must be numbered from 0 without gaps, are {brief(sorted(numbers))}")

    @property
    def has_mean_paths(self) -> bool:
        """Whether there are enough demonstrations to speak of a mean and a spread: two at least in some mode."""
        return len(self.modes) > np.max(self.modes) + 1

    @property
    def regresses(self) -> bool:
        """Whether start and goal choose between the demonstrations: in one mode, where that was found to help."""
        return math.isfinite(self.penalty) and not np.any(self.modes)

    @property
    def scale(self) -> np.ndarray:
        """Scale (D,) of an offset's numbers where offsets are compared."""
        return np.ones(self.start_offsets.shape[1])

    def features(self) -> np.ndarray:
        """Make the features (N, 2 D) of the regression: the two offsets of each demonstration, scaled."""
        return self.end_features(self.start_offsets, self.goal_offsets)

    def end_features(self, start_offsets: np.ndarray, goal_offsets: np.ndarray) -> np.ndarray:
        """Put both offsets (..., D) side by side, scaled, (..., 2 D)."""
        return np.concatenate([self.scale * start_offsets, self.scale * goal_offsets], axis=-1)

    def weights(self, start_offset: np.ndarray, goal_offset: np.ndarray, conditioned: bool) -> np.ndarray:
        """Weigh the demonstrations (K, N) in every mode for a query's offsets (D,), (D,); each row sums to 1.

        Unconditioned, or where the sheet does not regress, all demonstrations of a mode weigh the same.
        """
        if conditioned and self.regresses:
            query = self.end_features(start_offset, goal_offset)
            return regression_weights(self.features(), query, self.penalty)[None]
        own = (self.modes == np.arange(self.modes.max() + 1)[:, None]).astype(float)
        return own / own.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class CanonicalSheet(DemonstratedEnds):
    """The N endpoint-normalised demonstrations of a skill of tool poses, and how far each was moved for that.

    They are sampled at S equally spaced fractions of their arcs, as their codes are. Offsets are a translation [m] and
    a rotation vector [rad], D = 6.

    Attributes
    ----------
    positions, quaternions : (N, S, 3) [m], (N, S, 4) canonical poses.
    """

    positions: np.ndarray
    quaternions: np.ndarray

    def check(self, count: int, samples: int) -> None:
        self.check_arrays({
            "positions": (count, samples, 3), "quaternions": (count, samples, 4),
            "start_offsets": (count, 6), "goal_offsets": (count, 6),
        })  # fmt: skip
        for name in ("positions", "start_offsets", "goal_offsets"):
            lengths = getattr(self, name)[..., :3]
            check_range(f"canonical {name}", lengths, -2.0 * ARM_REACH, 2.0 * ARM_REACH)
        check_unit("canonical quaternions", self.quaternions)
        self.check_numbers("modes")
        self.check_times(count, samples)

    @property
    def scale(self) -> np.ndarray:
        """Scale (6,) by which rotations count in metres."""
        return POSE_SCALE

    @property
    def curves(self) -> tuple[np.ndarray, ...]:
        return self.positions, self.quaternions

    def mean_curves(self, weights: np.ndarray) -> tuple[np.ndarray, ...]:
        return np.einsum("kn,nsj->ksj", weights, self.positions), self._rotations.blend(weights)

    def unrolled(self) -> CanonicalSheet:
        positions, quaternions = unrolled(self.positions), unrolled(self.quaternions)
        return replace(self, positions=positions, quaternions=quaternions, times=self._unrolled_times())

    @cached_property
    def _rotations(self) -> RotationCurves:
        return RotationCurves.of(self.quaternions)

    def corrections(self, decoder: TaskSpaceDecoder, mean_paths: MeanPaths, weights: np.ndarray) -> np.ndarray:
        """Take what the decoder lacks on the mean paths to be the weighted means, (K, S, 6) [m], [rad]."""
        positions, quaternions = self.mean_curves(weights)
        count, samples, dimension = mean_paths.centres.shape
        decoded = decoder.decode(mean_paths.centres.reshape(-1, dimension))
        turns = rotation_vector_between(decoded.quaternions.reshape(count, samples, 4), quaternions)
        return np.concatenate([positions - decoded.positions.reshape(count, samples, 3), turns], axis=-1)


@dataclass(frozen=True)
class JointSheet(DemonstratedEnds):
    """The N endpoint-normalised demonstrations of a skill of configurations, and how far each was moved for that.

    They are sampled at S equally spaced fractions of their arcs, as their codes are. Offsets are displacements of the
    eta joints [rad]. Several families of configurations may start from, or end at, different configurations that hold
    the tool in the same pose, and no mean is taken over them: starts and goals are grouped, and offsets are counted
    from the mean of the demonstration's own group, its *pole*.

    Attributes
    ----------
    configurations : (N, S, eta) canonical configurations [rad].
    start_groups, goal_groups : (N,) number of the group that each demonstration starts from and ends in, from 0.
    start_poles, goal_poles : (G, eta) mean configurations of the groups [rad].
    """

    configurations: np.ndarray
    start_groups: np.ndarray
    goal_groups: np.ndarray
    start_poles: np.ndarray
    goal_poles: np.ndarray

    def check(self, count: int, samples: int) -> None:
        joints = (0, *self.configurations.shape)[-1]
        self.check_arrays({
            "configurations": (count, samples, joints),
            "start_offsets": (count, joints), "goal_offsets": (count, joints),
        })  # fmt: skip
        self.check_numbers("modes")
        self.check_times(count, samples)
        for end in ("start", "goal"):
            self.check_numbers(f"{end}_groups")
            groups = len(set(getattr(self, f"{end}_groups").tolist()))
            self.check_arrays({f"{end}_poles": (groups, joints)})

    @property
    def curves(self) -> tuple[np.ndarray, ...]:
        return (self.configurations,)

    def mean_curves(self, weights: np.ndarray) -> tuple[np.ndarray, ...]:
        return (np.einsum("kn,nsj->ksj", weights, self.configurations),)

    def corrections(self, decoder: JointSpaceDecoder, mean_paths: MeanPaths, weights: np.ndarray) -> np.ndarray:
        """Take what the decoder lacks on the mean paths to be the weighted means, (K, S, eta) [rad]."""
        (means,) = self.mean_curves(weights)
        count, samples, dimension = mean_paths.centres.shape
        return means - decoder.configurations(mean_paths.centres.reshape(-1, dimension)).reshape(count, samples, -1)

    def unrolled(self) -> JointSheet:
        return replace(self, configurations=unrolled(self.configurations), times=self._unrolled_times())


@dataclass(frozen=True)
class RotationCurves:
    """Curves of rotations (N, T) about their mean: middle (T, 4), and rotation vectors (N, T, 3) [rad] from it."""

    middle: np.ndarray
    turns: np.ndarray

    @classmethod
    def of(cls, quaternions: np.ndarray) -> RotationCurves:
        """Take curves about their mean from quaternions (N, T, 4), blind to their signs; the mean has the first's."""
        middle = continuous_signs(mean_rotation(quaternions))
        if np.sum(middle * quaternions[0]) < 0.0:
            middle = -middle
        return cls(middle, rotation_vector_between(np.broadcast_to(middle, quaternions.shape), quaternions))

    def blend(self, weights: np.ndarray) -> np.ndarray:
        """Average the rotation vectors with weights (B, N), rows sum to 1, into quaternions (B, T, 4)."""
        turns = np.einsum("bn,ntj->btj", weights, self.turns)
        return rotate_by(turns, np.broadcast_to(self.middle, (len(weights), *self.middle.shape)))


def unrolled(rounds: np.ndarray, step: np.ndarray | float = 0.0) -> np.ndarray:
    """Follow rounds (N, S, k) for `UNROLLED_ROUNDS`: (N, UNROLLED_ROUNDS (S - 1) + 1, k), each of which is a step
    (N, k) further than the one before. The last sample of a round is the first of the next.
    """
    each = [rounds + number * np.atleast_2d(step)[:, None] for number in range(UNROLLED_ROUNDS)]
    return np.concatenate([*(one[:, :-1] for one in each[:-1]), each[-1]], axis=1)


def beyond_demonstrated(offset: np.ndarray, demonstrated: np.ndarray, scale: np.ndarray = POSE_SCALE) -> np.ndarray:
    """Take from an offset (D,) the part outside the convex hull of demonstrated ones (N, D), as an offset (D,).

    `scale` (D,) tells what each number counts.
    """
    return beyond_hull(scale * offset, scale * demonstrated) / scale
