"""Obstacles: everything that the arm must keep away from, at one instant."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from geodesic_motion_ros.distance_field import DistanceField
from geodesic_motion_ros.solids import NUMBERS, no_solids, solid_rows, solids_moved

#: Nothing that an arm has to do with is farther away or larger [m], has turned further [rad], or is faster [m/s].
LARGEST_NUMBER = 1000.0
#: How far a rotation of a solid may be from one.
_ROTATION_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Spheres, solids and a point cloud in one frame, all at `time` [s].

    Attributes
    ----------
    centres, radii, velocities : (o, 3), (o,) [m], (o, 3) [m/s] of spheres.
    solids, solid_velocities : (b, 16) rows as of `solids.py`, (b, 3) [m/s].
    cloud : distances from a point cloud, which stands.
    age : what moves was last seen so long before `time`, and has been expected to move on since [s].
    velocity_errors, solid_velocity_errors : (o,), (b,) [m/s] how far velocities may be off: so fast obstacles grow, to
        every side, as they are expected to move on. Not at all where none are given.
    """

    centres: np.ndarray
    radii: np.ndarray
    velocities: np.ndarray
    solids: np.ndarray
    solid_velocities: np.ndarray
    cloud: DistanceField
    time: float = 0.0
    age: float = 0.0
    velocity_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    solid_velocity_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if not len(self.velocity_errors):
            object.__setattr__(self, "velocity_errors", np.zeros(len(self.velocities)))
        if not len(self.solid_velocity_errors):
            object.__setattr__(self, "solid_velocity_errors", np.zeros(len(self.solid_velocities)))

    @classmethod
    def none(cls) -> Obstacles:
        return cls.of_spheres(np.empty((0, 3)), np.empty(0))

    @classmethod
    def of_spheres(
        cls, centres: np.ndarray, radii: np.ndarray, velocities: np.ndarray | None = None, time: float = 0.0
    ) -> Obstacles:
        """Spheres alone, standing still where no velocities are given."""
        velocities = np.zeros_like(centres) if velocities is None else velocities
        return cls(centres, radii, velocities, no_solids(), np.empty((0, 3)), DistanceField.none(), time)

    @classmethod
    def one_of_each(cls, centre: np.ndarray, velocity: np.ndarray, time: float) -> Obstacles:
        """A sphere, a box and a cloud of one point, none wider than a decimetre, at a centre (3,) [m]: for trials."""
        box = solid_rows(centre[None], np.eye(3)[None], np.full((1, 3), 0.05), np.zeros(1))
        return cls(
            centre[None], np.array([0.05]), velocity[None], box, velocity[None],
            DistanceField.of(centre[None], 0.02, 0.02, 0.02), time,
        )  # fmt: skip

    @property
    def stand(self) -> bool:
        return not (self.velocities.any() or self.solid_velocities.any())

    def at_rest(self) -> Obstacles:
        """Those alone that stand."""
        return self._only(~np.any(self.velocities, axis=1), ~np.any(self.solid_velocities, axis=1), self.cloud)

    def in_motion(self) -> Obstacles:
        """Those alone that move."""
        moving = np.any(self.velocities, axis=1), np.any(self.solid_velocities, axis=1)
        return self._only(*moving, DistanceField.none())

    def _only(self, spheres: np.ndarray, solids: np.ndarray, cloud: DistanceField) -> Obstacles:
        return replace(
            self, centres=self.centres[spheres], radii=self.radii[spheres], velocities=self.velocities[spheres],
            solids=self.solids[solids], solid_velocities=self.solid_velocities[solids], cloud=cloud,
            velocity_errors=self.velocity_errors[spheres], solid_velocity_errors=self.solid_velocity_errors[solids],
        )  # fmt: skip

    def objection(self) -> str:
        """What is wrong with the first obstacle that is not one, or ''."""
        good = np.all((np.abs(self.centres) <= LARGEST_NUMBER) & (np.abs(self.velocities) <= LARGEST_NUMBER), axis=1)
        good &= (self.radii > 0.0) & (self.radii <= LARGEST_NUMBER) & _are_errors(self.velocity_errors)
        if not good.all():
            i = int(np.argmin(good))
            return (
                f"obstacle {i} has centre {self.centres[i].tolist()}, radius {self.radii[i]} and velocity "
                f"{self.velocities[i].tolist()}, which may be off by {self.velocity_errors[i]}: all must be finite, at "
                f"most {LARGEST_NUMBER:g}, the radius positive and the last not negative"
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
            f"{radii[i]} and velocity {self.solid_velocities[i].tolist()}: all must be finite, at most "
            f"{LARGEST_NUMBER:g}, extents and radius not negative, each extent with the radius positive, and the "
            "rotation one"
        )

    def same_places(self, other: Obstacles) -> bool:
        """Whether another scene has the same obstacles at the same places; velocities may differ."""
        if self is other:
            return True
        names = ("centres", "radii", "solids")
        return self.cloud.same_as(other.cloud) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in names
        )

    def unmoved_in(self, later: Obstacles) -> bool:
        """Whether a later scene has the same obstacles at the same places, and none of both moves."""
        return self.same_places(later) and self.stand and later.stand

    def distinct(self) -> Obstacles:
        """In an order of their own: what is told twice, by two sensors, is one obstacle."""
        spheres = _distinct_rows(np.column_stack([self.centres, self.radii, self.velocities, self.velocity_errors]))
        rows = np.column_stack([self.solids, self.solid_velocities, self.solid_velocity_errors])
        centres, radii, velocities, errors = _columns(spheres, 3, 4, 7)
        solids, solid_velocities, solid_errors = _columns(_distinct_rows(rows), NUMBERS, NUMBERS + 3)
        return replace(
            self, centres=centres, radii=radii[:, 0], velocities=velocities, solids=solids,
            solid_velocities=solid_velocities, velocity_errors=errors[:, 0], solid_velocity_errors=solid_errors[:, 0],
        )  # fmt: skip

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

    def throughout(self, duration: float) -> Obstacles:
        """Each of them so large that it covers where it is from its time on for so long [s]."""
        if duration == 0.0 or self.stand:
            return self
        half = 0.5 * duration
        solids = _shifted(self.solids, half * self.solid_velocities)
        solids[:, 6] += half * np.linalg.norm(self.solid_velocities, axis=1) + duration * self.solid_velocity_errors
        radii = self.radii + half * np.linalg.norm(self.velocities, axis=1) + duration * self.velocity_errors
        return replace(self, centres=self.centres + half * self.velocities, radii=radii, solids=solids)

    def at(self, time: float, prediction: float) -> Obstacles:
        """Moved on linearly to `time` [s], by `prediction` [s] at most."""
        elapsed = min(max(time - self.time, 0.0), prediction)
        return replace(self._moved_on(elapsed), time=time, age=self.age + float(elapsed))

    def _moved_on(self, by: float) -> Obstacles:
        """Moved on linearly for so long [s], and grown by what velocities may be off; back in time where negative."""
        solids = self.solids
        if len(solids):
            solids = solids.copy()
            solids[:, :3] += by * self.solid_velocities
            solids[:, 6] += by * self.solid_velocity_errors
        return replace(
            self, centres=self.centres + by * self.velocities, radii=self.radii + by * self.velocity_errors,
            solids=solids,
        )  # fmt: skip

    def swept(self, prediction: float, count: int = 3) -> Obstacles:
        """Where the obstacles are now and will be within the prediction [s], as obstacles that stand.

        count : instants at which they are taken, the first now, the last at its end.
        """
        if self.stand:
            return self
        places = [self._moved_on(step) for step in np.linspace(0.0, prediction, count)]
        centres, solids = (np.concatenate([getattr(at, name) for at in places]) for name in ("centres", "solids"))
        return Obstacles(
            centres, np.concatenate([at.radii for at in places]), np.zeros_like(centres), solids,
            np.zeros((len(solids), 3)), self.cloud, self.time,
        )  # fmt: skip

    def stopping_places(self, duration: float, count: int) -> Obstacles:
        """Wherever what moves may have come to a stand by so much later [s] since it was last seen, as what stands.

        count : so many of each, enlarged so that nothing between two of them is left out.
        """
        if self.stand:
            return self
        return self.as_seen((self.age + duration) / (count - 1)).swept(self.age + duration, count)

    def as_seen(self, apart: float) -> Obstacles:
        """Where they were when they were last seen, enlarged so that where they are at two times so far apart [s]
        covers where they are between.
        """
        half, seen = 0.5 * apart, self._moved_on(-self.age)
        radii = np.hypot(seen.radii, half * np.linalg.norm(self.velocities, axis=1))
        solids = seen.solids.copy()
        solids[:, 6] += half * np.linalg.norm(self.solid_velocities, axis=1)
        return replace(seen, radii=radii, solids=solids, age=0.0)


def _shifted(solids: np.ndarray, by: np.ndarray) -> np.ndarray:
    if not len(solids):
        return solids
    result = solids.copy()
    result[:, :3] += by
    return result


def _are_errors(values: np.ndarray) -> np.ndarray:
    return (values >= 0.0) & (values <= LARGEST_NUMBER)


def _columns(rows: np.ndarray, *at: int) -> list[np.ndarray]:
    """Rows (n, k) split at columns, each part contiguous."""
    return [np.ascontiguousarray(part) for part in np.split(rows, at, axis=1)]


def _distinct_rows(rows: np.ndarray) -> np.ndarray:
    """Rows (n, k) in lexical order, each once: numpy's `unique` takes half a millisecond for ten of them."""
    rows = rows[np.lexsort(rows.T[::-1])]
    return rows[np.append(True, np.any(rows[1:] != rows[:-1], axis=1))] if len(rows) > 1 else rows


def nearness(clearance: float) -> str:
    """How near an obstacle something comes, for a person, by its clearance [m], which is negative inside."""
    if clearance < 0.0:
        return f"goes {-clearance:.3f} m into an obstacle"
    return f"comes within {clearance:.3f} m of an obstacle"
