"""Spheres that move through the arm's path: a Panda in PyBullet plays what the joint-space planner streams.

The spheres, and what their contacts count as, are those of `moving_spheres.py`; contacts are PyBullet's on the arm's
meshes. The start and the goal were demonstrated; chasing spheres chase the elbow. The planner ticks at 100 Hz of
simulated time and receives true positions and velocities; what it answers reaches the arm one tick later and is played
as joint_trajectory_controller does. The control is the same planner, which ignores the spheres.

The command is judged as a stream of positions, one in every physics step: its differences over the arm's own limits of
velocity, acceleration and jerk.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.kernels.loading import load_kernels
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.stopping import stopping_reference
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_studies.experiments.arm_queries import ArmQuery, body_spheres, draw_query
from geodesic_motion_studies.experiments.moving_spheres import (
    LONGEST,
    STEP_HZ,
    STEPS_PER_TICK,
    MovingScene,
    MovingSphere,
    NominalMotion,
    SpheresInMotion,
    draw_spheres,
    needed_room,
)
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

#: A command slower than this [rad/s] rests; a goal is reached within so much [rad].
RESTING, REACHED = 1e-3, 1e-3


@dataclass(frozen=True, kw_only=True)
class MovingArmScene(MovingScene):
    """What happened in one scene.

    Attributes
    ----------
    replans : references that were handed out; step : largest jump of the command at one of them [rad].
    strains : velocity, acceleration and jerk of the command over the arm's limits, at most.
    excess : samples of the command over a limit.
    """

    replans: int
    step: float
    strains: tuple[float, float, float]
    excess: int


def nominal_arm(planner: ReactivePlanner, nominal: JointReference) -> NominalMotion:
    """The collision spheres of an arm that plays a reference; its elbow is chased."""
    return NominalMotion(
        nominal.duration,
        planner.collision.radii[planner.collision.moving],
        lambda times: body_spheres(planner, nominal.samples(times)[0]),
        lambda now: elbow_position(planner.robot, nominal.sample(now)[0]),
    )


class MovingArmRun:
    """One scene being played: the arm in physics, the spheres, the planner, and the judge."""

    def __init__(
        self,
        planner: ReactivePlanner,
        world: ArmWorld,
        geometry: CollisionGeometry,
        query: ArmQuery,
        spheres: Sequence[MovingSphere],
    ) -> None:
        self._planner, self._world, self._geometry = planner, world, geometry
        self._count, self._goal = len(spheres), query.goal
        self._spheres = SpheresInMotion(spheres, lambda: elbow_position(planner.robot, world.joint_positions))
        world.set_obstacles({})
        world.reset(query.start)
        standing = planner.stand_at(query.start, 0.0).reference
        assert standing is not None
        self._played, self._begin = standing, 0.0
        planner.set_obstacles(np.empty((0, 3)), np.empty(0))
        planner.set_goal_configuration(query.goal)
        self._commanded: list[np.ndarray] = []
        self._ticks: list[float] = []
        self._jumps: list[float] = []
        self._stood = 0.0

    def play(self, number: int, longest: float = LONGEST) -> MovingArmScene:
        """Until the goal is reached, or the longest time [s] is over."""
        world, pending = self._world, None
        now, reached = 0.0, False
        for step in range(int(longest * STEP_HZ)):
            now = step / STEP_HZ
            if step % STEPS_PER_TICK == 0:
                if pending is not None:
                    self._hand_over(*pending, now)
                pending = self._tick(now)
            velocity = self._command(now)
            moves = bool(np.max(np.abs(velocity)) > RESTING)
            off = float(np.max(np.abs(self._commanded[-1] - self._goal)))
            if off < REACHED and not moves:
                reached = True
                break
            self._stood += 0.0 if moves else world.dt
            self._spheres.move(now + world.dt)
            self._geometry.place(world.joint_positions)
            # What touches is taken away before physics would push the arm with it.
            self._spheres.judge(world.time, moves, self._geometry.clearance)
            world.set_obstacles(self._spheres.placed(now + world.dt))
            world.step()
        strains, excess = self._strains()
        return MovingArmScene(
            number=number, spheres=self._count, contacts=tuple(self._spheres.contacts), reached=reached, duration=now,
            clearance=float(self._spheres.clearance), stood=self._stood, ticks=tuple(self._ticks),
            replans=len(self._jumps), step=max(self._jumps, default=0.0), strains=strains, excess=excess,
        )  # fmt: skip

    def _tick(self, now: float) -> tuple[JointReference, float] | None:
        seen = self._spheres.seen(now, lambda *sphere: self._has_room(*sphere, now))
        began = time.thread_time()
        self._planner.set_obstacles(*seen, now)
        plan = self._planner.tick(now)
        self._ticks.append(time.thread_time() - began)
        return None if plan.reference is None else (plan.reference, plan.begin)

    def _hand_over(self, reference: JointReference, begin: float, now: float) -> None:
        old = self._played.sample(now - self._begin)[0]
        self._jumps.append(float(np.max(np.abs(reference.sample(now - begin)[0] - old))))
        self._played, self._begin = reference, begin
        if now < begin + reference.duration:
            waypoints = (reference.times, reference.positions, reference.velocities, reference.accelerations)
            self._world.set_joint_trajectory(JointWaypoints(*waypoints), begin)

    def _command(self, now: float) -> np.ndarray:
        """What is desired now, kept; its velocity (eta,) [rad/s]."""
        position, velocity, _ = self._played.sample(now - self._begin)
        self._commanded.append(position)
        return velocity

    def _has_room(self, centre: np.ndarray, radius: float, speed: float, now: float) -> bool:
        """Whether a sphere is far enough for a stop when it is first there."""
        planner = self._planner
        latency = planner.settings.latency + PERIOD
        stop = stopping_reference(self._played, now + latency - self._begin, planner.limits)
        placed = body_spheres(planner, stop.positions)
        travel = float(np.max(np.sum(np.linalg.norm(np.diff(placed, axis=0), axis=-1), axis=0)))
        before = self._played.samples(np.array([now, now + latency]) - self._begin)[0]
        moved = float(np.max(np.linalg.norm(np.diff(body_spheres(planner, before), axis=0), axis=-1)))
        self._geometry.place(self._world.joint_positions)
        return self._geometry.clearance(centre, radius) > needed_room(moved + travel, latency + stop.duration, speed)

    def _strains(self) -> tuple[tuple[float, float, float], int]:
        """Largest differences of the command over the robot's limits, and in how many samples one is exceeded."""
        robot, stream = self._planner.robot, np.array(self._commanded)
        limits = (robot.velocity_limits, robot.acceleration_limits, robot.jerk_limits)
        shares = [
            np.max(np.abs(np.diff(stream, order, axis=0)) * STEP_HZ**order / limit, axis=1, initial=0.0)
            for order, limit in enumerate(limits, start=1)
        ]
        worst = [float(np.max(share, initial=0.0)) for share in shares]
        return (worst[0], worst[1], worst[2]), int(sum(np.sum(share > 1.0) for share in shares))


class MovingArmStage:
    """What all scenes of one process are played with; `seed` is of the scenes."""

    def __init__(self, skill: Skill, settings: PlannerSettings, seed: int) -> None:
        self.planner, self.seed = ReactivePlanner(skill, settings), seed
        load_kernels(self.planner)
        self._blind = ReactivePlanner(skill, replace(settings, avoidance=False))
        self.world, self.geometry = ArmWorld(rate_hz=STEP_HZ), CollisionGeometry("panda")

    def scene(self, number: int) -> MovingArmScene:
        """Draw and play scene number `number`; it depends on nothing else but the seed."""
        random = np.random.default_rng([self.seed, number])
        query, nominal = draw_query(self.planner, random)
        spheres = draw_spheres(nominal_arm(self.planner, nominal), random)
        stage = self.world, self.geometry, query, spheres
        control = MovingArmRun(self._blind, *stage).play(number).contacts.count("moving")
        return replace(MovingArmRun(self.planner, *stage).play(number), control=control)
