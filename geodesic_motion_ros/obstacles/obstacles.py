"""Obstacles: everything that the arm must keep away from, at one instant."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from typing import Any

import numpy as np

from geodesic_motion_ros.geometry.distance_field import DistanceField, field_distances
from geodesic_motion_ros.geometry.shapes import NUMBERS, no_solids, solid_distances, solid_rows, solids_moved
from geodesic_motion_ros.utils.checked_numbers import LARGEST_NUMBER, check_time, real_array
from geodesic_motion_ros.utils.errors import PlanningError

#: How far a rotation of a solid may be from one.
_ROTATION_TOLERANCE = 1e-6
#: What each array has of one obstacle.
_SHAPES = {
    "centres": (3,), "radii": (), "velocities": (3,), "ages": (), "velocity_errors": (),
    "solids": (NUMBERS,), "solid_velocities": (3,), "solid_ages": (), "solid_velocity_errors": (),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Everything that the arm must keep away from: spheres, solids and a point cloud in one frame, at `time` [s].

    Attributes
    ----------
    centres, radii, velocities : (o, 3), (o,) [m], (o, 3) [m/s] of spheres.
    solids, solid_velocities : (b, 16) rows as of `geometry/shapes.py`, (b, 3) [m/s].
    cloud : distances from a point cloud, which stands.
    ages, solid_ages : (o,), (b,) [s] each was last detected so long before `time`, and has been expected to move on
        since.
    velocity_errors, solid_velocity_errors : (o,), (b,) [m/s] bounds of the errors of the velocities: a moving obstacle
        is enlarged by its bound times the time for which it is expected to move on.
    names, solid_names, cloud_name : for a person, (o,), (b,) texts and one; empty where there are none.

    Ages and errors are 0 where none are given.
    """

    centres: np.ndarray
    radii: np.ndarray
    velocities: np.ndarray
    solids: np.ndarray
    solid_velocities: np.ndarray
    cloud: DistanceField
    time: float = 0.0
    ages: np.ndarray = field(default_factory=lambda: np.zeros(0))
    solid_ages: np.ndarray = field(default_factory=lambda: np.zeros(0))
    velocity_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    solid_velocity_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()
    solid_names: tuple[str, ...] = ()
    cloud_name: str = ""

    def __post_init__(self) -> None:
        for kind, count in (("", len(self.centres)), ("solid_", len(self.solids))):
            for name in (f"{kind}ages", f"{kind}velocity_errors"):
                if len(getattr(self, name)) == 0:
                    object.__setattr__(self, name, np.zeros(count))

    @classmethod
    def none(cls) -> Obstacles:
        return cls.of_spheres(np.empty((0, 3)), np.empty(0))

    @classmethod
    def of_spheres(
        cls, centres: object, radii: object, velocities: object = None, time: float | None = None
    ) -> Obstacles:
        """Spheres alone, centres (o, 3) and radii (o,) [m], which stand where no velocities (o, 3) [m/s] are given.

        time : when they are there [s], by the clock of the planner that takes them; 0 where none moves.

        Raises
        ------
        PlanningError : names what is no array of numbers of that shape; or some move, and no time is given.
        """
        places, sizes = real_array("obstacle centres", centres, ("o", 3)), real_array("radii", radii, ("o",))
        given = np.zeros_like(places) if velocities is None else velocities
        speeds = real_array("obstacle velocities", given, ("o", 3))
        if time is None and speeds.any():
            raise PlanningError("obstacles move, and the time [s] at which they are there is not given")
        at = 0.0 if time is None else time
        return cls(places, sizes, speeds, no_solids(), np.empty((0, 3)), DistanceField.none(), at)

    @classmethod
    def of_cloud(
        cls, points: np.ndarray, voxel: float = 0.02, radius: float = 0.002, thickness: float = 0.05, time: float = 0.0
    ) -> Obstacles:
        """Everything that points (n, 3) [m] show, as what stands; the arm must not be among them.

        voxel, radius, thickness : as the planner's parameters `obstacle_cloud_...` [m], with their defaults.

        Raises
        ------
        PlanningError : a number is not finite, or voxel, radius or thickness not positive.
        """
        return replace(cls.none(), cloud=DistanceField.of(points, voxel, radius, thickness), time=time)

    @classmethod
    def one_of_each(cls, centre: np.ndarray, velocity: np.ndarray, time: float) -> Obstacles:
        """A sphere, a box and a cloud of one point, none wider than a decimetre, at a centre (3,) [m]: for trials."""
        box = solid_rows(centre[None], np.eye(3)[None], np.full((1, 3), 0.05), np.zeros(1))
        return cls(
            centre[None], np.array([0.05]), velocity[None], box, velocity[None],
            DistanceField.of(centre[None], 0.02, 0.02, 0.02), time,
        )  # fmt: skip

    @cached_property
    def is_static(self) -> bool:
        """Whether none of them moves."""
        return not (self.velocities.any() or self.solid_velocities.any())

    @cached_property
    def static_subset(self) -> Obstacles:
        """Those alone that stand."""
        return self._only(~np.any(self.velocities, axis=1), ~np.any(self.solid_velocities, axis=1), self.cloud)

    @cached_property
    def moving_subset(self) -> Obstacles:
        """Those alone that move."""
        moving = np.any(self.velocities, axis=1), np.any(self.solid_velocities, axis=1)
        return self._only(*moving, DistanceField.none())

    def _only(self, spheres: np.ndarray, solids: np.ndarray, cloud: DistanceField) -> Obstacles:
        return Obstacles(
            self.centres[spheres], self.radii[spheres], self.velocities[spheres], self.solids[solids],
            self.solid_velocities[solids], cloud, self.time, self.ages[spheres], self.solid_ages[solids],
            self.velocity_errors[spheres], self.solid_velocity_errors[solids],
            tuple(compress(self.names, spheres)), tuple(compress(self.solid_names, solids)), self.cloud_name,
        )  # fmt: skip

    def leaving_free(self, centres: np.ndarray, radii: np.ndarray, prediction: float) -> Obstacles:
        """Those alone that overlap none of a body's spheres (S, 3), (S,) [m] when they have moved on for a prediction
        [s]; a cloud as a whole.
        """
        later = self.at(self.time + prediction, prediction)
        spheres = np.linalg.norm(centres[:, None] - later.centres, axis=-1) > radii[:, None] + later.radii
        solids = [bool(np.all(solid_distances(centres, row[None]) > radii)) for row in later.solids]
        cloud = self.cloud
        if cloud.squares.size and np.any(field_distances(centres, *cloud) <= radii):
            cloud = DistanceField.none()
        return self._only(np.all(spheres, axis=0), np.array(solids, dtype=bool), cloud)

    def as_floats(self) -> Obstacles:
        """Return the same in arrays of doubles, row by row, for which kernels are compiled."""
        arrays = {name: getattr(self, name) for name in _SHAPES}
        other: dict[str, Any] = {
            name: np.ascontiguousarray(array, dtype=float)
            for name, array in arrays.items()
            if array.dtype != float or not array.flags.c_contiguous
        }
        return replace(self, **other) if other else self

    def objection(self) -> str:
        """What is wrong with the time, a shape, or the first obstacle that is not one; or ''."""
        try:
            check_time("time of the obstacles", self.time)
        except PlanningError as error:
            return str(error)
        spheres, solids = len(self.radii), len(self.solids)
        for name, shape in _SHAPES.items():
            array, count = getattr(self, name), solids if name.startswith("solid") else spheres
            if not isinstance(array, np.ndarray) or array.dtype.kind not in "iuf" or array.shape != (count, *shape):
                found = f"shape {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
                return f"{name} of {count} obstacles have {found}: expected {(count, *shape)}, as many of each"
        if not isinstance(self.cloud, DistanceField):
            return f"the cloud is {self.cloud!r:.60}: a DistanceField is needed"
        if not np.all(np.isfinite(np.concatenate([self.ages, self.solid_ages]))):
            return "ages of obstacles must be finite"
        good = np.all((np.abs(self.centres) <= LARGEST_NUMBER) & (np.abs(self.velocities) <= LARGEST_NUMBER), axis=1)
        good &= (self.radii > 0.0) & (self.radii <= LARGEST_NUMBER) & _are_errors(self.velocity_errors)
        if not good.all():
            i = int(np.argmin(good))
            return (
                f"obstacle {i} has centre {self.centres[i].tolist()}, radius {self.radii[i]} and velocity "
                f"{self.velocities[i].tolist()}, which may be off by {self.velocity_errors[i]}: all must be finite, at "
                f"most {LARGEST_NUMBER:g}, the radius positive and the error not negative"
            )
        if not len(self.solids):
            return ""
        good = np.all(np.abs(np.hstack([self.solids, self.solid_velocities])) <= LARGEST_NUMBER, axis=1)
        good &= _are_errors(self.solid_velocity_errors)
        extents, radii = self.solids[:, 3:6], self.solids[:, 6]
        good &= np.all(extents >= 0.0, axis=1) & (radii >= 0.0) & (extents.min(axis=1, initial=np.inf) + radii > 0.0)
        turns = self.solids[:, 7:].reshape(-1, 3, 3)
        off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        good &= off <= _ROTATION_TOLERANCE
        if np.all(good):
            return ""
        i = int(np.argmin(good))
        return (
            f"solid {i} has centre {self.solids[i, :3].tolist()}, half extents {extents[i].tolist()}, radius "
            f"{radii[i]} and velocity {self.solid_velocities[i].tolist()}, which may be off by "
            f"{self.solid_velocity_errors[i]}: all must be finite, at most {LARGEST_NUMBER:g}, extents, radius and "
            "error not negative, each extent with the radius positive, and the rotation one"
        )

    def same_places(self, other: Obstacles) -> bool:
        """Whether another scene has the same obstacles at the same places; velocities may differ."""
        if self is other:
            return True
        names = ("centres", "radii", "solids")
        return self.cloud.same_as(other.cloud) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in names
        )

    def is_static_and_unchanged(self, later: Obstacles) -> bool:
        """Whether later obstacles are the same at the same places, and none moves, neither now nor then."""
        return self.same_places(later) and self.is_static and later.is_static

    def distinct(self) -> Obstacles:
        """In an order of their own: what is published twice, by two sensors, is one obstacle."""
        fields = "centres", "radii", "velocities", "ages", "velocity_errors"
        solid_fields = "solids", "solid_velocities", "solid_ages", "solid_velocity_errors"
        return replace(self, **self._distinct(fields, "names"), **self._distinct(solid_fields, "solid_names"))

    def _distinct(self, fields: tuple[str, ...], names: str) -> dict[str, Any]:
        """Values of several fields, of as many obstacles each, without obstacles of which all are the same, and their
        names.
        """
        values = [getattr(self, name) for name in fields]
        chosen = _distinct_rows(np.column_stack(values))
        named = getattr(self, names)
        kept = {name: np.ascontiguousarray(value[chosen]) for name, value in zip(fields, values, strict=True)}
        return {**kept, names: tuple(named[i] for i in chosen) if named else ()}

    def moved(self, rotation: np.ndarray, translation: np.ndarray) -> Obstacles:
        """Seen from another frame: p -> rotation p + translation, (3, 3) and (3,) [m]."""
        return replace(
            self,
            centres=np.ascontiguousarray(self.centres @ rotation.T + translation),
            velocities=np.ascontiguousarray(self.velocities @ rotation.T),
            solids=solids_moved(self.solids, rotation, translation),
            solid_velocities=np.ascontiguousarray(self.solid_velocities @ rotation.T),
            cloud=self.cloud.moved(rotation, translation),
        )

    def enlarged(self, by: float) -> Obstacles:
        """All of them larger by a length [m] to every side."""
        if by == 0.0:
            return self
        solids = self.solids.copy()
        solids[:, 6] += by
        return replace(self, radii=self.radii + by, solids=solids, cloud=self.cloud.enlarged(by))

    def beside(self, solids: np.ndarray) -> Obstacles:
        """With solids (b, 16) that stand besides."""
        count = len(solids)
        if not count:
            return self
        return replace(
            self, solid_names=(), solids=np.concatenate([self.solids, solids]),
            solid_velocities=np.concatenate([self.solid_velocities, np.zeros((count, 3))]),
            solid_ages=np.concatenate([self.solid_ages, np.zeros(count)]),
            solid_velocity_errors=np.concatenate([self.solid_velocity_errors, np.zeros(count)]),
        )  # fmt: skip

    def throughout(self, duration: float) -> Obstacles:
        """Each of them so large that it covers where it is from its time on for so long [s]."""
        if duration == 0.0 or self.is_static:
            return self
        half = 0.5 * duration
        solids = self.solids.copy()
        solids[:, :3] += half * self.solid_velocities
        solids[:, 6] += half * np.linalg.norm(self.solid_velocities, axis=1) + duration * self.solid_velocity_errors
        radii = self.radii + half * np.linalg.norm(self.velocities, axis=1) + duration * self.velocity_errors
        return replace(self, centres=self.centres + half * self.velocities, radii=radii, solids=solids)

    def at(self, time: float, prediction: float) -> Obstacles:
        """Moved on linearly to `time` [s], by `prediction` [s] at most."""
        elapsed = min(max(time - self.time, 0.0), prediction)
        return self._moved_on(np.full(len(self.radii), elapsed), np.full(len(self.solids), elapsed), time)

    def _moved_on(self, by: np.ndarray, solids_by: np.ndarray, time: float) -> Obstacles:
        """At `time` [s], where each is moved on for a time of its own, (o,) and (b,) [s]."""
        centres, radii, solids = self._places(by[None], solids_by[None])
        return Obstacles(
            centres, radii, self.velocities, solids, self.solid_velocities, self.cloud, time, self.ages + by,
            self.solid_ages + solids_by, self.velocity_errors, self.solid_velocity_errors,
            self.names, self.solid_names, self.cloud_name,
        )  # fmt: skip

    def _places(self, by: np.ndarray, solids_by: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centres (k o, 3), radii (k o,) and solids (k b, 16), each moved on linearly, or back, for k times of its own,
        (k, o) and (k, b) [s], and enlarged by the error of its velocity times those.
        """
        centres = (self.centres + by[..., None] * self.velocities).reshape(-1, 3)
        radii = (self.radii + by * self.velocity_errors).reshape(-1)
        solids = self.solids
        if len(solids):
            solids = np.tile(solids, (len(by), 1))
            solids[:, :3] += (solids_by[..., None] * self.solid_velocities).reshape(-1, 3)
            solids[:, 6] += (solids_by * self.solid_velocity_errors).reshape(-1)
        return centres, radii, solids

    def swept(self, prediction: float, count: int = 3) -> Obstacles:
        """Where the obstacles are now and will be within the prediction [s], as obstacles that stand.

        count : instants at which they are taken, the first now, the last at its end.
        """
        if self.is_static:
            return self
        return self._along(np.full(len(self.radii), prediction), np.full(len(self.solids), prediction), count)

    def _along(self, by: np.ndarray, solids_by: np.ndarray, count: int) -> Obstacles:
        """As what stands: where each is at so many instants of a time of its own, (o,) and (b,) [s], the first now."""
        shares = np.linspace(0.0, 1.0, count)[:, None]
        centres, radii, solids = self._places(shares * by, shares * solids_by)
        return Obstacles(
            centres, radii, np.zeros_like(centres), solids, np.zeros((len(solids), 3)), self.cloud, self.time
        )

    def stopping_places(self, duration: float, count: int) -> Obstacles:
        """Wherever what moves may have come to a stand by so much later [s] since it was last seen, as what stands.

        count : so many of each, enlarged so that nothing between two of them is left out.
        """
        if self.is_static:
            return self
        seen = self._moved_on(-self.ages, -self.solid_ages, self.time)
        by, solids_by = self.ages + duration, self.solid_ages + duration
        # Between two instants the middle of what moves is no farther from both than half of what it moves.
        half = 0.5 / (count - 1)
        radii = np.hypot(seen.radii, half * by * np.linalg.norm(self.velocities, axis=1))
        solids = seen.solids.copy()
        solids[:, 6] += half * solids_by * np.linalg.norm(self.solid_velocities, axis=1)
        return replace(seen, radii=radii, solids=solids)._along(by, solids_by, count)


def _are_errors(values: np.ndarray) -> np.ndarray:
    return (values >= 0.0) & (values <= LARGEST_NUMBER)


def _distinct_rows(rows: np.ndarray) -> np.ndarray:
    """Numbers of rows (n, k) in lexical order, equal ones once: numpy's `unique` takes half a millisecond for ten."""
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    return order[np.append(True, np.any(ordered[1:] != ordered[:-1], axis=1))] if len(rows) > 1 else order


def nearness(clearance: float) -> str:
    """How near an obstacle something comes, for a person, by its clearance [m], which is negative inside."""
    if clearance < 0.0:
        return f"goes {-clearance:.3f} m into an obstacle"
    return f"comes within {clearance:.3f} m of an obstacle"
