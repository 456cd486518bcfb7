"""Canonical, that is endpoint-normalised, form of demonstrations: where a task begins and ends is taken out.

With s in [0, 1] the fraction of a demonstration's arc, canonical curves y(s) are those that a transport carries onto
the demonstrations: x(s) = y(s) + D(s), where the displacement D fades from the demonstration's start offset to its goal
offset as `demonstrations.fade` says. Adding the offsets again gives the demonstration back, and adding the offsets of
another start and goal carries it there. Two output spaces have such a form:

R^3 x S^3, poses of the tool (`manifold.transport`). Offsets d0 = x(0) - m(0) and d1 = x(1) - m(1) are counted from the
    mean first and last pose, D(s) = (1 - tau) d0 + tau d1 with 1 - tau = (1 - s)^fade. Rotations likewise: d0 and d1
    are rotation vectors in the base frame, exp(d) m = x. Every canonical curve runs from m(0) to m(1). The arc counts
    sqrt(|dx|^2 + (rotation_length * angle)^2), see `curves.pose_arc_length`.

R^eta, configurations of an arm (`manifold.joint_transport`). Offsets are counted from the mean of all starts (ends),
    and where that is no configuration to count from, because some lie further from it than an offset may reach, from
    the mean of those alone that start (end) in the same family of configurations: two that hold the tool in one pose
    with the elbow on two sides are never averaged. D depends on y as well. The arc counts what the metric counts: the
    mean squared motion of the body points, and with a small weight that of the joints.

Rounds end where they began, and the place from which they are counted is no end: D is the same all along, the mean
displacement of a demonstration from the mean round.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.fade import FADE_SAMPLES, likeliest_fade, scatter_within
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.modes import cluster_modes
from geodesic_motion_ros.geometry.curves import interpolate, pose_arc_length
from geodesic_motion_ros.geometry.quaternions import mean_rotation, rotate_by, rotation_vector_between
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.manifold.transport import faded
from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.sheet import CanonicalSheet, JointSheet, RotationCurves
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Starts and goals may lie this share of the demonstrations' length from their mean; further apart there is no task
#: that they have in common, only straight lines between places.
LARGEST_SHARE = 0.5
#: The same for orientations [rad]: rotation vectors of half a turn have no direction.
LARGEST_TURN = 2.0
#: Starts and goals may lie this far [rad], over all joints, from the mean of their group.
LARGEST_OFFSET = 1.5
#: A demonstration sets out, and comes to rest, where it is this share of its arc from its ends: hands are never still.
STILL = 1e-3
#: A round that was shown alone sets out and comes to rest within this share of its arc; it rests where it is slower
#: there than beside by this factor.
SEAM, RESTS = 0.1, 3.0
#: y = theta - D(y, s) is solved by so many fixed-point iterations.
_ITERATIONS = 8


class CanonicalForm(ABC):
    """Demonstrations (N) in canonical form, at as many samples along their arcs as are asked for.

    Attributes
    ----------
    names : of the demonstrations.
    closed : whether the demonstrations are rounds.
    fade : exponent with which start offsets are taken out.
    modes : (N,) number of each demonstration's mode, from 0.
    """

    _demonstrations: Demonstrations | JointDemonstrations

    def __init__(self, names: Sequence[str], fade: float | None, closed: bool) -> None:
        """fade : None: the likeliest. closed : whether the demonstrations are rounds."""
        self.names, self.closed = names, closed
        few = self.curves(FADE_SAMPLES)
        self._count_offsets(few)
        if closed:
            fade = 1.0
        elif fade is None:
            modes = cluster_modes(self.remove_offsets(few, 1.0)[0])
            fade = likeliest_fade(
                lambda tried: scatter_within(self._compared(self.remove_offsets(few, tried)), modes), len(names)
            )
        self.fade = fade
        self.modes = cluster_modes(self.remove_offsets(few, fade)[0])

    @abstractmethod
    def sheet(self, samples: int) -> CanonicalSheet | JointSheet:
        """Make the canonical demonstrations at so many samples, with modes and offsets, without a regression."""

    @abstractmethod
    def curves(self, samples: int) -> tuple[np.ndarray, ...]:
        """Sample the demonstrations, equally spaced along their arcs: arrays (N, samples, ...) of positions [m] and
        quaternions, or of configurations [rad] alone.
        """

    @abstractmethod
    def times(self, samples: int) -> np.ndarray:
        """Read when the demonstrations came to so many places, equally spaced along their arcs: (N, samples) [s], from
        where they set out to where they came to rest.
        """

    @abstractmethod
    def remove_offsets(self, curves: tuple[np.ndarray, ...], fade: float) -> tuple[np.ndarray, ...]:
        """Solve for the canonical curves y of curves that are equally spaced along their arcs."""

    @abstractmethod
    def _count_offsets(self, curves: tuple[np.ndarray, ...]) -> None:
        """Keep the offsets of curves; DemonstrationError: one starts or ends where the others do not."""

    def _compared(self, curves: tuple[np.ndarray, ...]) -> np.ndarray:
        """Numbers (N, T, D) in one unit by which curves are compared."""
        return curves[0]

    def _known_times(self, samples: int) -> np.ndarray | None:
        """As of `times`, of rounds without the rests between which they were shown; None: the recordings have none."""
        if not self._demonstrations.has_times:
            return None
        return _running_times(self.times(samples)) if self.closed else self.times(samples)


class PoseForm(CanonicalForm):
    """The canonical form of poses of a tool.

    Attributes
    ----------
    start_offsets, goal_offsets : (N, 6) translation [m] and rotation vector [rad] from `start` and `goal`.
    start, goal : (7,) mean first and last pose: x, y, z [m], w, x, y, z.
    """

    def __init__(
        self, demonstrations: Demonstrations, rotation_length: float, fade: float | None = None, closed: bool = False
    ) -> None:
        """
        Parameters
        ----------
        demonstrations : signs of whole demonstrations do not matter.
        rotation_length : length that a turn of one radian counts in the arc [m].
        fade : exponent with which start offsets fade; None: the likeliest.
        closed : whether the demonstrations are rounds (`rounds.close_rounds`).

        Raises
        ------
        DemonstrationError : a demonstration starts or ends where the others do not, so that they have no form in
            common.
        """
        self._demonstrations, self._rotation_length = demonstrations.align_hemispheres(), rotation_length
        super().__init__([item.name for item in demonstrations], fade, closed)

    def sheet(self, samples: int) -> CanonicalSheet:
        positions, quaternions = self.remove_offsets(self.curves(samples), self.fade)
        ends, times = (self.start_offsets, self.goal_offsets), self._known_times(samples)
        return CanonicalSheet(*ends, self.modes, math.inf, positions, quaternions, fade=self.fade, times=times)

    def curves(self, samples: int) -> tuple[np.ndarray, ...]:
        return sample_poses(self._demonstrations, samples, self._rotation_length)

    def times(self, samples: int) -> np.ndarray:
        length, items = self._rotation_length, self._demonstrations
        arcs = [pose_arc_length(item.positions, item.quaternions, length) for item in items]
        return np.stack([_times_along(arc, item.times, samples) for arc, item in zip(arcs, items, strict=True)])

    def remove_offsets(self, curves: tuple[np.ndarray, ...], fade: float) -> tuple[np.ndarray, ...]:
        return remove_pose_offsets(*curves, self.start_offsets, self.goal_offsets, fade)

    def _count_offsets(self, curves: tuple[np.ndarray, ...]) -> None:
        (self.start, self.goal), lengths = mean_ends(*curves), [item.length for item in self._demonstrations]
        firsts, lasts = ([values[:, end] for values in curves] for end in (0, -1))
        self.start_offsets, self.goal_offsets = offsets_between(self.start, *firsts), offsets_between(self.goal, *lasts)
        if self.closed:
            moved = curves[0] - curves[0].mean(axis=0)
            moved = np.concatenate([moved, RotationCurves.of(curves[1]).turns], axis=-1)
            # The last sample is the first.
            both = moved[:, :-1].mean(axis=1)
            self.goal, self.start_offsets, self.goal_offsets = self.start, both, both
        _refuse_strange_poses(self.names, "starts", self.start_offsets, lengths)
        _refuse_strange_poses(self.names, "ends", self.goal_offsets, lengths)

    def _compared(self, curves: tuple[np.ndarray, ...]) -> np.ndarray:
        return np.concatenate([curves[0], self._rotation_length * RotationCurves.of(curves[1]).turns], axis=-1)


class ConfigurationForm(CanonicalForm):
    """The canonical form of configurations of an arm.

    Attributes
    ----------
    start_offsets, goal_offsets : (N, eta) [rad], from the pole of the demonstration's group.
    start_groups, goal_groups : (N,) numbers of the groups; start_poles, goal_poles : (G, eta) their means [rad].
    """

    def __init__(
        self,
        demonstrations: JointDemonstrations,
        robot: Robot,
        metric: JointMetricSettings,
        fade: float | None = None,
        closed: bool = False,
    ) -> None:
        """
        fade : exponent with which start offsets fade; None: the likeliest. closed : as of `PoseForm`.

        Raises
        ------
        DemonstrationError : a demonstration starts or ends far from all others of its group.
        """
        self._demonstrations, self._robot, self._metric = demonstrations, robot, metric
        super().__init__([item.name for item in demonstrations], fade, closed)

    def sheet(self, samples: int) -> JointSheet:
        (configurations,) = self.remove_offsets(self.curves(samples), self.fade)
        return JointSheet(
            self.start_offsets, self.goal_offsets, self.modes, math.inf, configurations,
            self.start_groups, self.goal_groups, self.start_poles, self.goal_poles, fade=self.fade,
            times=self._known_times(samples),
        )  # fmt: skip

    def curves(self, samples: int) -> tuple[np.ndarray, ...]:
        return sample_configurations(self._demonstrations, self._robot, self._metric, samples)

    def times(self, samples: int) -> np.ndarray:
        arcs = [body_arc(item.configurations, self._robot, self._metric) for item in self._demonstrations]
        items = zip(arcs, self._demonstrations, strict=True)
        return np.stack([_times_along(arc, item.times, samples) for arc, item in items])

    def remove_offsets(self, curves: tuple[np.ndarray, ...], fade: float) -> tuple[np.ndarray, ...]:
        poles = np.stack([self.start_poles[self.start_groups], self.goal_poles[self.goal_groups]], axis=1)
        own = poles + np.stack([self.start_offsets, self.goal_offsets], axis=1)
        ends = own if self.closed else curves[0][:, [0, -1]]
        each = zip(curves[0], poles, ends, strict=True)
        return (np.stack([remove_offsets(curve, pole, end, self._robot, fade) for curve, pole, end in each]),)

    def _count_offsets(self, curves: tuple[np.ndarray, ...]) -> None:
        self.start_groups, self.start_poles, self.start_offsets = _group_ends(curves[0][:, 0])
        self.goal_groups, self.goal_poles, self.goal_offsets = _group_ends(curves[0][:, -1])
        if self.closed:
            self.start_offsets = self.goal_offsets = (curves[0] - curves[0].mean(axis=0))[:, :-1].mean(axis=1)
            self.start_groups = self.goal_groups = np.zeros(len(curves[0]), dtype=int)
            self.start_poles = self.goal_poles = curves[0][:, 0].mean(axis=0)[None]
        for verb, offsets in (("starts", self.start_offsets), ("ends", self.goal_offsets)):
            sizes = np.linalg.norm(offsets, axis=1)
            if np.any(sizes > LARGEST_OFFSET):
                listed = ", ".join(f"{name} {size:.2f}" for name, size in zip(self.names, sizes, strict=True))
                raise DemonstrationError(
                    f"demonstration '{self.names[int(np.argmax(sizes))]}' {verb} further than "
                    f"{LARGEST_OFFSET:g} rad from the others like it: one skill is learned from demonstrations of one "
                    f"task; distances [rad] from the mean are {listed}"
                )


def sample_pose_arc(
    demonstration: Demonstration, samples: int, rotation_length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Sample positions (samples, 3) and quaternions (samples, 4), equally spaced along the arc of a demonstration."""
    arc = pose_arc_length(demonstration.positions, demonstration.quaternions, rotation_length)
    at = np.linspace(0.0, arc[-1], samples)
    return interpolate(arc, demonstration.positions, demonstration.quaternions, at)


def sample_poses(demonstrations: Demonstrations, samples: int, rotation_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Sample positions (N, samples, 3) and quaternions (N, samples, 4) of all demonstrations by `sample_pose_arc`."""
    curves = [sample_pose_arc(item, samples, rotation_length) for item in demonstrations]
    return np.stack([positions for positions, _ in curves]), np.stack([quaternions for _, quaternions in curves])


def body_arc(configurations: np.ndarray, robot: Robot, metric: JointMetricSettings) -> np.ndarray:
    """Measure the arc [m] up to each configuration of a motion (T, eta) [rad]; (T,), from 0.

    It counts sqrt(mean_k |dp_k|^2 + joint_weight^2 |dtheta|^2), with p_k the metric's body points.
    """
    body = metric.body_points(robot)
    points = place_body_points(np.ascontiguousarray(configurations), body.frames, body.offsets, robot.chain)
    moved = np.sum(np.diff(points, axis=0) ** 2, axis=-1).mean(axis=1)
    turned = np.sum(np.diff(configurations, axis=0) ** 2, axis=1)
    return np.append(0.0, np.cumsum(np.sqrt(moved + metric.joint_weight**2 * turned)))


def sample_body_arc(configurations: np.ndarray, robot: Robot, metric: JointMetricSettings, samples: int) -> np.ndarray:
    """Sample configurations (samples, eta) [rad], equally spaced along the arc of a motion (T, eta) [rad]."""
    arc = body_arc(configurations, robot, metric)
    at = np.linspace(0.0, arc[-1], samples)
    return np.stack([np.interp(at, arc, column) for column in configurations.T], axis=1)


def sample_configurations(
    demonstrations: JointDemonstrations, robot: Robot, metric: JointMetricSettings, samples: int
) -> tuple[np.ndarray]:
    """Sample configurations (N, samples, eta) [rad] of all demonstrations by `sample_body_arc`, as the only array."""
    return (np.stack([sample_body_arc(item.configurations, robot, metric, samples) for item in demonstrations]),)


def remove_pose_offsets(
    positions: np.ndarray, quaternions: np.ndarray, start: np.ndarray, goal: np.ndarray, fade: float
) -> tuple[np.ndarray, np.ndarray]:
    """Take offsets (N, 6) of starts and goals, [m] and rotation vectors [rad], out of curves (N, T, 3), (N, T, 4).

    They are equally spaced along their arcs.
    """
    tau = faded(np.linspace(0.0, 1.0, positions.shape[1]), fade)[:, None]
    blend = (1.0 - tau) * start[:, None] + tau * goal[:, None]
    return positions - blend[..., :3], rotate_by(-blend[..., 3:], quaternions)


def remove_offsets(
    curve: np.ndarray, poles: np.ndarray, ends: np.ndarray, robot: Robot, fade: float = 1.0
) -> np.ndarray:
    """Solve y + D(y, s) = curve (T, eta), which is equally spaced in s, for y (T, eta), with the offsets from poles
    (2, eta) to ends (2, eta) [rad].
    """
    offsets = JointOffsets.between(robot, poles, ends, fade=fade)
    s = np.linspace(0.0, 1.0, len(curve))
    canonical = curve
    for _ in range(_ITERATIONS):
        canonical = curve - offsets.displacements(canonical, s)
    return canonical


def offsets_between(pose: np.ndarray, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Take translations [m] and rotation vectors [rad], (n, 6), from a pose (7,) to poses (n, 3), (n, 4)."""
    turned = rotation_vector_between(np.broadcast_to(pose[3:], quaternions.shape), quaternions)
    return np.concatenate([positions - pose[:3], turned], axis=-1)


def mean_pose(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Average poses (N, 3), (N, 4) into one (7,), its quaternion on the first one's hemisphere."""
    rotation = mean_rotation(quaternions)
    return np.concatenate([positions.mean(axis=0), rotation if rotation @ quaternions[0] >= 0.0 else -rotation])


def mean_ends(positions: np.ndarray, quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average the first and the last poses, (7,) each, of curves (N, T, 3), (N, T, 4)."""
    start, goal = (mean_pose(positions[:, end], quaternions[:, end]) for end in (0, -1))
    return start, goal


def _times_along(arc: np.ndarray, times: np.ndarray, samples: int) -> np.ndarray:
    """When a motion of arc (T,), at times (T,) [s], came to `samples` places along it: 0 where it set out."""
    set_out, arrived = np.searchsorted(arc, [STILL * arc[-1], (1.0 - STILL) * arc[-1]])
    moving = np.clip(times, times[set_out - 1], times[arrived]) - times[set_out - 1]
    return np.interp(np.linspace(0.0, arc[-1], samples), arc, moving)


def _running_times(times: np.ndarray) -> np.ndarray:
    """Times (N, T) [s] of rounds that follow one another: where one was shown alone, from rest to rest, it runs through
    SEAM of its arc at either end at the rates beside that.
    """
    rates = np.diff(times, axis=1)
    seam = max(1, round(SEAM * rates.shape[1]))
    before, after = rates[:, -seam - 1], rates[:, seam]
    between = np.linspace(before, after, 2 * seam + 2, axis=1)[:, 1:-1]
    shown = np.concatenate([rates[:, -seam:], rates[:, :seam]], axis=1)
    rests = shown.max(axis=1) > RESTS * between.max(axis=1)
    running = np.where(rests[:, None], np.minimum(shown, between), shown)
    rates = np.concatenate([running[:, seam:], rates[:, seam:-seam], running[:, :seam]], axis=1)
    return np.concatenate([np.zeros((len(times), 1)), np.cumsum(rates, axis=1)], axis=1)


def _refuse_strange_poses(names: Sequence[str], verb: str, offsets: np.ndarray, lengths: list[float]) -> None:
    """Refuse offsets (N, 6) of starts or goals beyond LARGEST_SHARE of the path or beyond LARGEST_TURN."""
    distances, turns = np.linalg.norm(offsets[:, :3], axis=1), np.linalg.norm(offsets[:, 3:], axis=1)
    allowed = LARGEST_SHARE * float(np.median(lengths))
    strange = (distances > allowed) | (turns > LARGEST_TURN)
    if not np.any(strange):
        return
    listed = ", ".join(
        f"{name} {1e3 * distance:.0f} mm and {np.degrees(turn):.0f} deg"
        for name, distance, turn in zip(names, distances, turns, strict=True)
    )
    raise DemonstrationError(
        f"demonstration '{names[int(np.argmax(strange))]}' {verb} where the others do not: from the mean it is "
        f"further than {1e3 * allowed:.0f} mm ({LARGEST_SHARE:g} of the path) or {np.degrees(LARGEST_TURN):.0f} deg. "
        f"One skill is learned from demonstrations of one task; these are {listed} from their mean"
    )


def _group_ends(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Group (N,) configurations (N, eta); with the groups' means (G, eta), and the offsets (N, eta) from them."""
    groups = np.zeros(len(ends), dtype=int)
    if np.any(np.linalg.norm(ends - ends.mean(axis=0), axis=1) > LARGEST_OFFSET):
        groups = cluster_modes(ends[:, None])
    poles = np.stack([ends[groups == group].mean(axis=0) for group in range(groups.max() + 1)])
    return groups, poles, ends - poles[groups]
