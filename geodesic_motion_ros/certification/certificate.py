"""The arm's certificate: how far its collision spheres stay from obstacles and from each other, between knots too.

Between two knots a sphere's centre p(t) leaves the motion along the straight segment between them, at the same
instant, by at most max |p''| h^2 / 8. With r_j the lever of joint j (how far the centre can be from its axis),

    |p''| <= sum_j r_j |q''_j| + sum_ij r_max(i,j) |q'_i| |q'_j|,

because d^2 p / dq_i dq_j = a_i x (a_j x (p - o_j)) for joints i <= j of axes (o, a). Velocities and accelerations are
bounded by the control points of the quintics that are played (`quintic.py`). How far the segments are from everything
is for `swept_spheres.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numba
import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.certification.seen_volume import SeenVolume, first_unseen
from geodesic_motion_ros.contract.requirement import Requirement
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.geometry.quintic import quintic_bounds
from geodesic_motion_ros.obstacles.obstacles import Obstacles, nearness
from geodesic_motion_ros.obstacles.swept_spheres import clearances_in_motion, clearances_until, self_clearances
from geodesic_motion_ros.robot.body_points import end_effector_poses, lever_bounds, place_body_points
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot, contiguous
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference, joined, kept_knots

#: Two clearances [m] that differ by less are the same: those of a motion count what may be between its knots.
_SAME_CLEARANCE = 1e-3


@dataclass(frozen=True)
class SweptSpheres:
    """The places to which a reference takes the arm's S collision spheres: their centres at its n knots, and a bound
    between knots.

    Attributes
    ----------
    times : (n,) of the knots [s]. placed : (n, S, 3) sphere centres at the knots [m].
    bulges : (n - 1, S) how far a centre may leave the straight segment between two knots [m], at most.
    """

    times: np.ndarray
    placed: np.ndarray
    bulges: np.ndarray


@dataclass(frozen=True)
class SweptArm(SweptSpheres):
    """Swept spheres with the clearances that do not depend on obstacles: from the arm itself and the declared scene.

    They are worked out once for a reference, and certified again in every tick, as obstacles change.

    Attributes
    ----------
    self_clearance, pair, scene_clearance : (n - 1,) as of `Certificate`.
    """

    self_clearance: np.ndarray
    pair: np.ndarray
    scene_clearance: np.ndarray

    def since(self, time: float) -> SweptArm:
        """Return the rest of the motion from a time [s] on, with times counted from there.

        It begins at the knot at or before that, at a time that is not positive. Beyond the end of the motion it is an
        arm that stands for a period.
        """
        if time >= self.times[-1]:
            still = np.array([0.0, PERIOD])
            ends = np.repeat(self.placed[-1:], 2, axis=0)
            return SweptArm(
                still, ends, np.zeros_like(self.bulges[-1:]), self.self_clearance[-1:], self.pair[-1:],
                self.scene_clearance[-1:],
            )  # fmt: skip
        first = max(0, int(np.searchsorted(self.times, time, side="right")) - 1)
        return SweptArm(
            self.times[first:] - time, self.placed[first:], self.bulges[first:], self.self_clearance[first:],
            self.pair[first:], self.scene_clearance[first:],
        )  # fmt: skip

    def stand_until(self, time: float) -> SweptArm:
        """Return the motion with the arm standing where it comes to rest, until a time [s] at least."""
        if time <= self.times[-1]:
            return self
        return SweptArm(
            np.append(self.times, time), np.concatenate([self.placed, self.placed[-1:]]),
            np.concatenate([self.bulges, np.zeros_like(self.bulges[-1:])]),
            *(np.append(values, values[-1]) for values in (self.self_clearance, self.pair, self.scene_clearance)),
        )  # fmt: skip


@dataclass(frozen=True)
class Certificate:
    """The clearances of the arm from obstacles, from itself and from the declared scene between the n knots of a
    reference.

    A certificate states clearances and judges nothing: `ArmCertifier.objection` says whether they are enough.

    Attributes
    ----------
    times : (n,) of the knots [s].
    clearance : (n - 1,) smallest distance [m] of the arm from obstacles, negative inside; inf without obstacles.
    sphere : (n - 1,) the collision sphere that has it, -1 without obstacles.
    self_clearance : (n - 1,) smallest distance [m] of two spheres of the arm from each other; pair : (n - 1,) which.
    scene_clearance : (n - 1,) smallest distance [m] of the arm from the declared scene.
    entered : the link and the part of the scene that meet first; "" where none do.
    """

    times: np.ndarray
    clearance: np.ndarray
    sphere: np.ndarray
    self_clearance: np.ndarray
    pair: np.ndarray
    scene_clearance: np.ndarray
    entered: str = ""


@dataclass(frozen=True)
class JudgedTrajectory:
    """A reference with the clearances of its certificate: the only kind of trajectory that an arm plays.

    Judged does not mean certified: a trajectory is certified where `ArmCertifier.objection` objects to nothing. Every
    trajectory but a stop is certified before it is played. A stop is played even where its certificate states that it
    meets an obstacle: any other motion would come nearer. `ArmCertifier.judge` and `continue_by`
    alone make one.

    Attributes
    ----------
    clearance, self_clearance : (n - 1,) as of `Certificate`; the last one counts the time at rest that was certified.
    """

    reference: JointReference
    clearance: np.ndarray
    self_clearance: np.ndarray
    robot: Robot

    @property
    def nearest(self) -> float:
        """Smallest clearance [m] from obstacles."""
        return float(np.min(self.clearance))

    @property
    def tool_poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) [m] and quaternions (n, 4) of the tool at the knots."""
        positions, quaternions = end_effector_poses(contiguous(self.reference.positions), self.robot.chain)
        return positions, continuous_signs(quaternions)

    def continue_by(self, other: JudgedTrajectory, since: float, until: float) -> JudgedTrajectory:
        """Return this trajectory from the knot at `since` [s] until `until` [s], and another one from there on
        (`trajectory.trajectory.joined`).
        """
        # Beyond its end the arm stands, with the clearance that it has there.
        kept = np.minimum(kept_knots(self.reference, since, until), len(self.clearance) - 1)
        return JudgedTrajectory(
            joined(self.reference, since, other.reference, until),
            np.concatenate([self.clearance[kept], other.clearance]),
            np.concatenate([self.self_clearance[kept], other.self_clearance]),
            self.robot,
        )


class ArmCertifier:
    """A certifier of references of one arm, whose body is covered by S collision spheres.

    Spheres that no joint moves are checked against the rest of the arm and not against obstacles, which no motion of
    the arm keeps away from them.
    """

    def __init__(self, robot: Robot, collision: CollisionModel, scene: DeclaredScene | None = None) -> None:
        """scene : what always stands around the arm; None: nothing."""
        self._scene = scene or DeclaredScene.empty()
        self._standing = self._scene.obstacles
        self._robot, self._radii, self._pairs = robot, collision.radii, collision.self_pairs
        self._frames, self._offsets = collision.points.frames, collision.points.offsets
        self._names = collision.points.names
        self._levers = lever_bounds(robot, self._frames, self._offsets)
        self._moving = np.flatnonzero(collision.moving)

    def certify(
        self, reference: JointReference, obstacles: Obstacles, horizon: float, stand_after_horizon: bool = True
    ) -> Certificate:
        """Return the certificate of a reference among obstacles, which move linearly for `horizon` [s].

        stand_after_horizon : True: a moving obstacle stands after the horizon where it has come to, and the rest of the
            motion is certified among these, too. False: after the horizon a moving obstacle is not counted any more:
            a later part of the motion is certified among standing obstacles alone; and a motion that ends before the
            horizon is certified until then, with the arm at rest.
        """
        return self.certify_swept(self.sweep(reference), obstacles, horizon, stand_after_horizon)

    def judge(self, reference: JointReference, certificate: Certificate) -> JudgedTrajectory:
        """Return a reference with its certificate, which may cover more time than that, with the arm standing at its
        end.
        """
        last = len(reference.times) - 2
        clearance, self_clearance = (
            np.append(values[:last], np.min(values[last:]))
            for values in (certificate.clearance, certificate.self_clearance)
        )
        return JudgedTrajectory(reference, clearance, self_clearance, self._robot)

    def sweep(self, reference: JointReference) -> SweptArm:
        """Return where a reference takes the arm, with its clearances from itself and from the declared scene."""
        spheres = self.sweep_spheres(reference)
        placed, bulges = spheres.placed, spheres.bulges
        scene, _ = clearances_in_motion(spheres.times, placed, bulges, self._radii, self._moving, self._standing, 0.0)
        itself, pair = self_clearances(placed, bulges, self._radii, self._pairs)
        if not reference.is_finite:
            # What is at no place is near nothing that a kernel would find.
            itself = np.full_like(itself, np.nan)
        return SweptArm(spheres.times, placed, bulges, itself, pair, scene)

    def sweep_spheres(self, reference: JointReference) -> SweptSpheres:
        """Return where a reference takes the arm's spheres."""
        times = reference.times
        _, largest = quintic_bounds(times, reference.positions, reference.velocities, reference.accelerations)
        bulges = sphere_bulges(times, largest[0], largest[1], self._levers)
        return SweptSpheres(times, self._place(reference.positions), bulges)

    def room(self, swept: SweptSpheres, standing: Obstacles) -> float:
        """Return the least clearance [m] of a motion from obstacles that stand."""
        clearance, _ = clearances_in_motion(
            swept.times, swept.placed, swept.bulges, self._radii, self._moving, standing, 0.0
        )
        return float(np.min(clearance))

    def clearances_between(self, placed: np.ndarray, standing: Obstacles) -> np.ndarray:
        """Return the clearances (m - 1,) [m] from obstacles that stand, of spheres that move straight between samples
        (m, S, 3).
        """
        times, straight = np.arange(float(len(placed))), np.zeros((len(placed) - 1, placed.shape[1]))
        return clearances_in_motion(times, placed, straight, self._radii, self._moving, standing, 0.0)[0]

    def certify_swept(
        self, swept: SweptArm, obstacles: Obstacles, horizon: float, stand_after_horizon: bool = True
    ) -> Certificate:
        """Certify, as `certify` does, where a reference takes the arm; obstacles are where they are at its time 0."""
        stand = stand_after_horizon or obstacles.is_static
        clearances = clearances_in_motion if stand else clearances_until
        clearance, sphere = clearances(
            swept.times, swept.placed, swept.bulges, self._radii, self._moving, obstacles, horizon
        )
        return Certificate(
            swept.times, clearance, sphere, swept.self_clearance, swept.pair, swept.scene_clearance,
            self._entered(swept),
        )  # fmt: skip

    def assess(
        self, swept: SweptArm, obstacles: Obstacles, requirement: Requirement, present: float = math.inf
    ) -> tuple[Certificate, str]:
        """Return the certificate of where a reference takes the arm, and why it does not meet a requirement
        (`objection`).

        present : the clearance that there is already [m].
        """
        certificate = self.certify_swept(swept, obstacles, requirement.horizon, requirement.stands_after)
        return certificate, self.objection(certificate, requirement.margin(obstacles, present))

    def assess_leaving(
        self, swept: SweptArm, obstacles: Obstacles, requirement: Requirement, stop: JointReference
    ) -> tuple[Certificate, str]:
        """Assess, as `assess` does, where a motion takes an arm that may touch obstacles already: where one of them
        moves it may leave them.

        At no time is it deeper in what moves than it would be if it stopped, and in the end it is free of it; nor is it
        deeper in what stands. What it does not touch in the beginning it does not touch at all.

        stop : the soonest stop from the same state.
        """
        certificate, objection = self.assess(swept, obstacles, requirement)
        if not certificate.clearance[0] < 0.0 or obstacles.is_static:
            return certificate, objection
        stopped = replace(swept, placed=self._place(stop.samples(swept.times)[0]), bulges=np.zeros_like(swept.bulges))
        for part in (obstacles.static_subset, obstacles.moving_subset):
            leaving, stopping = (
                self.certify_swept(one, part, requirement.horizon, requirement.stands_after).clearance
                for one in (swept, stopped)
            )
            allowed = np.minimum(stopping, 0.0) - _SAME_CLEARANCE if leaving[0] < 0.0 else np.zeros_like(stopping)
            if not part.is_static:
                last = max(0, min(int(np.searchsorted(swept.times, requirement.horizon)), len(leaving)) - 1)
                allowed[last] = 0.0
            if np.any(leaving < allowed):
                return certificate, objection
        return certificate, self.objection(certificate, -math.inf)

    def _place(self, positions: np.ndarray) -> np.ndarray:
        """Sphere centres (n, S, 3) [m] in configurations (n, eta)."""
        return place_body_points(contiguous(positions), self._frames, self._offsets, self._robot.chain)

    def _entered(self, swept: SweptArm) -> str:
        """The link and the part of the scene that meet first; "" where none do."""
        inside = np.flatnonzero(~(swept.scene_clearance >= 0.0))
        if not len(inside):
            return ""
        moving = self._moving
        _, part, sphere = self._scene.nearest(swept.placed[inside[0] + 1, moving], self._radii[moving])
        return f"'{self._link(moving[sphere])}' enters '{part}'"

    def objection(self, certificate: Certificate, margin: float = 0.0) -> str:
        """Return why a reference must not be followed, naming the link; "" where it is certified: it keeps `margin` [m]
        from obstacles, and the arm touches neither itself nor the declared scene. A clearance that is no number keeps
        nothing.
        """
        i, j = int(np.argmin(certificate.clearance)), int(np.argmin(certificate.self_clearance))
        if not certificate.clearance[i] >= margin:
            return (
                f"'{self._link(certificate.sphere[i])}' {nearness(certificate.clearance[i])} "
                f"after {max(0.0, certificate.times[i]):.2f} s; {margin:.3f} m are to be kept"
            )
        if np.isnan(certificate.self_clearance[j]):
            return "the motion is not finite: nothing is known of it"
        if not certificate.self_clearance[j] >= 0.0:
            first, second = (self._link(sphere) for sphere in self._pairs[certificate.pair[j]])
            return f"'{first}' and '{second}' touch after {max(0.0, certificate.times[j]):.2f} s"
        if certificate.entered:
            begin = certificate.times[int(np.argmin(certificate.scene_clearance >= 0.0))]
            return f"{certificate.entered} of the scene after {max(0.0, begin):.2f} s"
        return ""

    def seen_objection(self, swept: SweptSpheres, seen: SeenVolume) -> str:
        """Return which link leaves what is seen, and when; "" where none ever does."""
        if seen.everything:
            return ""
        interval, sphere = first_unseen(swept.placed, swept.bulges, self._radii, self._moving, seen)
        if sphere < 0:
            return ""
        return f"'{self._link(sphere)}' enters what is not seen after {swept.times[interval]:.2f} s"

    def first_objection(self, certificate: Certificate, margin: float = 0.0) -> float | None:
        """Return when [s] the first violation begins to which `objection` objects; None where it objects to none."""
        good = (certificate.clearance >= margin) & (certificate.self_clearance >= 0.0)
        good &= certificate.scene_clearance >= 0.0
        return None if np.all(good) else max(0.0, float(certificate.times[int(np.argmin(good))]))

    def _link(self, sphere: int) -> str:
        return self._names[sphere]


@numba.njit(cache=True, nogil=True)
def sphere_bulges(
    times: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray, levers: np.ndarray
) -> np.ndarray:
    """Return how far sphere centres may leave the segments between knots, (n - 1, S) [m].

    Parameters
    ----------
    times : (n,) of the knots [s].
    velocities, accelerations : (n - 1, eta) what magnitudes [rad/s], [rad/s^2] do not exceed between them.
    levers : (eta, S) largest distance [m] of each centre from each joint's axis, joints base first.
    """
    intervals, joints = velocities.shape
    result = np.zeros((intervals, levers.shape[1]))
    for i in range(intervals):
        h = times[i + 1] - times[i]
        before = 0.0
        for j in range(joints):
            speed = velocities[i, j]
            factor = 0.125 * h * h * (accelerations[i, j] + speed * (speed + 2.0 * before))
            before += speed
            for s in range(levers.shape[1]):
                result[i, s] += factor * levers[j, s]
    return result
