"""Differential inverse kinematics with control barrier functions, along the nearest demonstration (pink).

S. Caron et al., pink, "Inverse kinematics for articulated robot models, based on Pinocchio"; A. Ames et al., "Control
barrier functions: theory and applications", ECC 2019. In every tick a quadratic program finds the joint velocities that
follow the demonstration's pose and posture best, within the limits of positions and velocities, such that the distance
h of each of the nearest pairs of a collision sphere and an obstacle falls no faster than

    dh/dt >= -gain h,       h = |p - o| - r_body - r_obstacle - kept_off,

with the obstacle's own velocity in dh/dt; of a declared solid |p - o| - r_obstacle is the distance from its surface.
The demonstration waits where the arm falls behind.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.body_points import body_point_jacobians, place_body_points
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.cloned_policy import RENEWED, cloned_policy
from geodesic_motion_studies.comparison.method import TICK, Answer
from geodesic_motion_studies.comparison.scene import Scene

if TYPE_CHECKING:
    from pink import Configuration

#: Pairs that are looked at, gain of the barrier [1/s], and what is kept from obstacles [m].
PAIRS, GAIN, KEPT_OFF = 20, 20.0, 0.02
#: Costs of the tool's pose and of the posture, as in the library's examples of arms.
POSITION_COST, ORIENTATION_COST, POSTURE_COST = 1.0, 1.0, 0.1
#: Share of the error that a task removes in one tick.
TASK_GAIN = 0.2
#: The demonstration goes on at full speed while the arm is within this of it [rad], and waits where that is doubled.
FOLLOWED = 0.15


class BarrierKinematics:
    """Follows the demonstration that begins and ends nearest, among barriers."""

    def __init__(self, arena: Arena, gain: float = GAIN, kept_off: float = KEPT_OFF, pairs: int = PAIRS) -> None:
        """gain, kept_off, pairs : see the constants."""
        import pinocchio
        from pink.tasks import FrameTask, PostureTask

        self._arena, self._gain = arena, gain
        self._model = pinocchio.buildModelFromUrdf(str(arena.robot.urdf))
        limits = arena.limits
        self._model.velocityLimit = np.array(limits.velocity)
        self._model.lowerPositionLimit, self._model.upperPositionLimit = np.array(limits.lower), np.array(limits.upper)
        self._data = self._model.createData()
        self._pose = FrameTask(arena.robot.tool_link, POSITION_COST, ORIENTATION_COST, gain=TASK_GAIN)
        self._posture = PostureTask(POSTURE_COST, gain=TASK_GAIN)
        self._barrier = _sphere_barrier(arena, gain, kept_off, pairs)
        self.settings: dict[str, Any] = {
            "library": "pin-pink", "solver": "daqp", "gain": gain, "kept_off": kept_off, "pairs": pairs,
            "costs": [POSITION_COST, ORIENTATION_COST, POSTURE_COST], "task_gain": TASK_GAIN, "followed": FOLLOWED,
        }  # fmt: skip

    def reset(self, scene: Scene) -> None:
        """Choose the demonstration."""
        self._reference = scene.demonstrations[self._arena.nearest(scene.start, scene.goal)]
        self._joints, self._along = scene.start.copy(), 0.0
        self._solids = scene.declared.solids

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """One step of the demonstration, and one quadratic program; it stops where that has no solution."""
        import pinocchio
        from pink import Configuration, solve_ik
        from pink.exceptions import NoSolutionFound

        wanted = self._wanted(now)
        position, quaternion = self._arena.robot.forward(wanted)
        self._pose.set_target(pinocchio.SE3(to_rotation(quaternion).as_matrix(), position))
        self._posture.set_target(wanted)
        configuration = Configuration(self._model, self._data, self._joints)
        barriers = []
        obstacles = obstacles.beside(self._solids)
        if len(obstacles.radii) or len(obstacles.solids):
            self._barrier.see(obstacles)
            barriers = [self._barrier]
        try:
            velocities = solve_ik(
                configuration, [self._pose, self._posture], TICK, "daqp", barriers=barriers, safety_break=False
            )
        except NoSolutionFound:
            return Answer.moving(self._joints, np.zeros_like(self._joints), now, "no velocity keeps all barriers")
        self._joints = self._joints + TICK * velocities
        return Answer.moving(self._joints, velocities, now)


    def _wanted(self, now: float) -> np.ndarray:
        """Where the joints are to be (eta,) [rad]."""
        wanted = self._reference.sample(self._along)[0]
        behind = float(np.max(np.abs(wanted - self._joints)))
        self._along += TICK * float(np.clip(2.0 - behind / FOLLOWED, 0.0, 1.0))
        return self._reference.sample(self._along)[0]


class PolicyAmongBarriers(BarrierKinematics):
    """Follows the chunks of a policy in the place of a demonstration, among the same barriers."""

    def __init__(self, arena: Arena) -> None:
        super().__init__(arena)
        self._policy = cloned_policy(arena)
        self.settings = {**self.settings, **self._policy.settings}

    def reset(self, scene: Scene) -> None:
        """Forget the chunk before."""
        super().reset(scene)
        self._goal, self._begun = scene.goal, -np.inf

    def _wanted(self, now: float) -> np.ndarray:
        """Of the newest chunk, so far ahead of the present that the arm, which lags, is on time."""
        if now >= self._begun + RENEWED - 1e-6:
            self._begun, self._chunk = now, self._policy.chunk(self._joints, self._goal)
        ahead = now - self._begun + TICK / TASK_GAIN
        return np.array([np.interp(ahead, self._chunk[0], joint) for joint in self._chunk[1].T])


def _sphere_barrier(arena: Arena, gain: float, kept_off: float, pairs: int) -> Any:
    """The barrier between the collision spheres and obstacles, as the library wants one to be written."""
    from pink.barriers import Barrier

    points = arena.collision.points
    frames = np.ascontiguousarray(points.frames[arena.collision.moving])
    offsets = np.ascontiguousarray(points.offsets[arena.collision.moving])

    class SphereBarrier(Barrier):
        """h = |p - o| - r_body - r_obstacle - kept_off of the nearest pairs."""

        def see(self, obstacles: Obstacles) -> None:
            self._obstacles = obstacles

        def compute_barrier(self, configuration: Configuration) -> np.ndarray:
            return self._nearest(configuration)[0]

        def compute_jacobian(self, configuration: Configuration) -> np.ndarray:
            _, spheres, _, normals = self._nearest(configuration)
            return self._rows(configuration, spheres, normals)

        def compute_qp_inequalities(self, configuration: Configuration, dt: float = TICK) -> tuple[Any, Any]:
            """-J dq / dt <= gain h - n . v: obstacles move too. Nothing is kept from the tick before, as they do."""
            values, spheres, which, normals = self._nearest(configuration)
            rows = self._rows(configuration, spheres, normals)
            velocities = np.concatenate([self._obstacles.velocities, self._obstacles.solid_velocities])
            coming = np.sum(normals * velocities[which], axis=1)
            return -rows / dt, gain * values - coming

        def compute_qp_objective(self, configuration: Configuration) -> tuple[np.ndarray, np.ndarray]:
            """No safe displacement is asked for."""
            count = configuration.model.nv
            return np.zeros((count, count)), np.zeros(count)

        def _rows(self, configuration: Configuration, spheres: np.ndarray, normals: np.ndarray) -> np.ndarray:
            jacobians = body_point_jacobians(configuration.q[None], frames, offsets, arena.robot.chain)[0]
            return np.einsum("pi,pij->pj", normals, jacobians[spheres])

        def _nearest(self, configuration: Configuration) -> tuple[np.ndarray, ...]:
            """Values, numbers of the body's spheres and of obstacles, solids after spheres, and normals away from
            these, of the nearest pairs.
            """
            body = place_body_points(configuration.q[None], frames, offsets, arena.robot.chain)[0]
            apart = body[:, None] - self._obstacles.centres
            distances = np.linalg.norm(apart, axis=-1)
            normals = apart / np.maximum(distances, 1e-9)[..., None]
            of_solids, normals_of_solids = from_solids(body, self._obstacles.solids)
            distances = np.hstack([distances - self._obstacles.radii, of_solids])
            values = distances - arena.body_radii[:, None] - kept_off
            nearest = np.argsort(values, axis=None)[:pairs]
            spheres, which = np.unravel_index(nearest, values.shape)
            normals = np.concatenate([normals, normals_of_solids], axis=1)[spheres, which]
            return values[spheres, which], spheres, which, normals

    return SphereBarrier(dim=pairs, gain=gain)


def from_solids(points: np.ndarray, solids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distances (n, b) [m] of points (n, 3) from solids (b, 16), as of `geometry/shapes.py`, and unit normals
    (n, b, 3) away from these: towards the nearest face from inside.
    """
    rotations = solids[:, 7:].reshape(-1, 3, 3)
    local = np.einsum("bji,nbj->nbi", rotations, points[:, None] - solids[:, :3])
    beyond = np.abs(local) - solids[:, 3:6]
    outside = np.maximum(beyond, 0.0)
    length = np.linalg.norm(outside, axis=-1)
    nearest_face = beyond == beyond.max(axis=-1, keepdims=True)
    direction = np.where(length[..., None] > 0.0, outside, nearest_face)
    direction = np.copysign(direction / np.linalg.norm(direction, axis=-1, keepdims=True), local)
    distances = length + np.minimum(beyond.max(axis=-1), 0.0) - solids[:, 6]
    return distances, np.einsum("bij,nbj->nbi", rotations, direction)
