"""Spheres that move through the arm's way: a Panda in PyBullet plays what the joint-space planner streams.

A scene is a start and a goal as they were demonstrated, and one to five spheres of 3 to 6 cm. *Crossing* ones move in
a straight line towards a place where some part of the arm would be, at that time, without obstacles, and beyond it;
*chasing* ones move towards the elbow wherever it is. Those that are not there from the beginning appear at least
`DISTANCE` from the arm. The planner ticks at 100 Hz of simulated time and is told their true positions and velocities;
what it answers reaches the arm one tick later and is played as joint_trajectory_controller does.

A contact, by PyBullet on the arm's meshes, counts against the planner unless

- the arm stood: its command rested, and the sphere ran into it. Such a sphere is then taken away; or
- there was no room to brake: when the sphere was first there it was no farther from the arm than

      v_arm t_latency + stopping travel + v_sphere (t_latency + stopping time) + 1 cm,

  with t_latency until the new reference takes over, and the stop that was possible then.

The control is the same planner told to ignore the spheres.

The command is judged as a stream of positions, one in every physics step: its differences over the arm's own limits of
velocity, acceleration and jerk.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Literal

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.experiments.arm_queries import ArmQuery, body_spheres, distances, draw_query
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.joint_reference import PERIOD, JointReference, stopping_reference
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.simulation.collision_geometry import CollisionGeometry
from geodesic_motion_ros.simulation.trajectory_player import JointWaypoints
from geodesic_motion_ros.simulation.world import PandaWorld
from geodesic_motion_ros.skill import Skill

#: Steps of physics, and of the judged command, per second, and per tick of the planner.
STEP_HZ, STEPS_PER_TICK = 200.0, 2
#: Radii [m] and speeds [m/s] of the spheres; chasing ones are no faster than the last.
RADII, SPEEDS, CHASING_SPEED = (0.03, 0.06), (0.05, 0.5), 0.15
#: Share of spheres that chase the elbow.
CHASING_SHARE = 0.2
#: From the arm to a sphere that appears while the arm moves, and to one that is there from the beginning [m].
DISTANCE, DISTANCE_AT_REST = 0.4, 0.02
#: Crossing spheres pass the arm's place this far off [m], as a standard deviation, and vanish so long after [s];
#: chasing ones begin so far [m] from the elbow and give up after so long [s].
OFF, VANISHING, CHASE_FROM, CHASE_FOR = 0.04, 3.0, 0.5, 5.0
#: A scene ends at the goal, or after so long [s].
LONGEST = 25.0
#: A command slower than this [rad/s] rests; a goal is reached within so much [rad].
RESTING, REACHED = 1e-3, 1e-3
#: Added to what braking needs [m].
ROOM = 0.01

Outcome = Literal["moving", "standing", "no room"]


@dataclass(frozen=True, eq=False)
class MovingSphere:
    """A sphere that is there from `appears` to `vanishes` [s].

    Attributes
    ----------
    begin : (3,) centre where it appears [m]. velocity : (3,) [m/s]; of a chasing one its magnitude counts.
    """

    radius: float
    appears: float
    vanishes: float
    begin: np.ndarray
    velocity: np.ndarray
    chases: bool


@dataclass(frozen=True)
class MovingScene:
    """What happened in one scene.

    Attributes
    ----------
    spheres : how many; contacts : what each contact was. reached : whether the goal was reached, after `duration` [s].
    replans : references that were handed out; step : largest jump of the command at one of them [rad].
    strains : velocity, acceleration and jerk of the command over the arm's limits, at most.
    excess : samples of the command over a limit.
    clearance : least distance [m] from a sphere while the arm moved.
    stood : time [s] that the arm stood on the way.
    ticks : processor time [s] of each tick.
    control : contacts of the moving arm where the same planner ignores the spheres.
    """

    number: int
    spheres: int
    contacts: tuple[Outcome, ...]
    reached: bool
    duration: float
    replans: int
    step: float
    strains: tuple[float, float, float]
    excess: int
    clearance: float
    stood: float
    ticks: tuple[float, ...]
    control: int = 0


def draw_spheres(
    planner: JointSpacePlanner, nominal: JointReference, random: np.random.Generator
) -> tuple[MovingSphere, ...]:
    """One to five spheres in the way of an arm that plays `nominal` from time 0 on."""
    kinds = [_chasing if random.uniform() < CHASING_SHARE else _crossing for _ in range(random.integers(1, 6))]
    return tuple(kind(planner, nominal, random) for kind in kinds)


def _crossing(planner: JointSpacePlanner, nominal: JointReference, random: np.random.Generator) -> MovingSphere:
    while True:
        radius, speed = random.uniform(*RADII), random.uniform(*SPEEDS)
        meeting = random.uniform(0.1, 1.0) * nominal.duration
        body = body_spheres(planner, nominal.samples(np.array([meeting]))[0])[0]
        place = body[random.integers(len(body))] + random.normal(scale=OFF, size=3)
        # Rather from the sides than from above or below.
        direction = random.normal(size=3) * [1.0, 1.0, 0.5]
        velocity = speed * direction / np.linalg.norm(direction)
        before = np.arange(meeting, 0.0, -0.05)
        arms = body_spheres(planner, nominal.samples(before)[0])
        centres = place - (meeting - before)[:, None] * velocity
        far = np.flatnonzero(distances(planner, arms, centres[:, None], radius) >= DISTANCE)
        if len(far):
            appears = float(before[far[0]])
            return MovingSphere(radius, appears, meeting + VANISHING, centres[far[0]], velocity, False)
        begin = place - meeting * velocity
        if distances(planner, body_spheres(planner, nominal.positions[:1]), begin, radius)[0] >= DISTANCE_AT_REST:
            return MovingSphere(radius, 0.0, meeting + VANISHING, begin, velocity, False)


def _chasing(planner: JointSpacePlanner, nominal: JointReference, random: np.random.Generator) -> MovingSphere:
    while True:
        radius, speed = random.uniform(*RADII), random.uniform(SPEEDS[0], CHASING_SPEED)
        appears = random.uniform(0.0, 0.5) * nominal.duration
        posture = nominal.samples(np.array([appears]))[0]
        direction = random.normal(size=3)
        begin = elbow_position(planner.robot, posture[0]) + CHASE_FROM * direction / np.linalg.norm(direction)
        if distances(planner, body_spheres(planner, posture), begin, radius)[0] >= DISTANCE - radius:
            return MovingSphere(radius, appears, appears + CHASE_FOR, begin, np.array([speed, 0.0, 0.0]), True)


class MovingRun:
    """One scene being played: the arm in physics, the spheres, the planner, and the judge."""

    def __init__(
        self,
        planner: JointSpacePlanner,
        world: PandaWorld,
        geometry: CollisionGeometry,
        query: ArmQuery,
        spheres: Sequence[MovingSphere],
    ) -> None:
        self._planner, self._world, self._geometry = planner, world, geometry
        self._spheres = dict(enumerate(spheres))
        self._centres = {i: sphere.begin.copy() for i, sphere in self._spheres.items()}
        self._room: dict[int, bool] = {}
        self._contacts: list[Outcome] = []
        self._goal = query.goal
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
        self._clearance, self._stood = np.inf, 0.0

    def play(self, number: int, longest: float = LONGEST) -> MovingScene:
        """Until the goal is reached, or the longest time [s] is over."""
        world, count = self._world, len(self._spheres)
        pending = None
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
            self._move_spheres(now + world.dt)
            self._judge(moves)
            world.set_obstacles(
                {str(i): (self._centres[i], self._spheres[i].radius) for i in self._present(now + world.dt)}
            )
            world.step()
        strains, excess = self._strains()
        return MovingScene(
            number, count, tuple(self._contacts), reached, now, len(self._jumps), max(self._jumps, default=0.0),
            strains, excess, float(self._clearance), self._stood, tuple(self._ticks),
        )  # fmt: skip

    def _present(self, now: float) -> list[int]:
        return [i for i, sphere in self._spheres.items() if sphere.appears <= now < sphere.vanishes]

    def _velocity(self, i: int) -> np.ndarray:
        sphere = self._spheres[i]
        if not sphere.chases:
            return sphere.velocity
        towards = elbow_position(self._planner.robot, self._world.joint_positions) - self._centres[i]
        return np.linalg.norm(sphere.velocity) * towards / max(float(np.linalg.norm(towards)), 1e-9)

    def _tick(self, now: float) -> tuple[JointReference, float] | None:
        present = self._present(now)
        velocities = np.array([self._velocity(i) for i in present]).reshape(-1, 3)
        for i, velocity in zip(present, velocities, strict=True):
            if i not in self._room:
                self._room[i] = self._has_room(i, float(np.linalg.norm(velocity)), now)
        began = time.thread_time()
        self._planner.set_obstacles(
            np.array([self._centres[i] for i in present]).reshape(-1, 3),
            np.array([self._spheres[i].radius for i in present]), velocities, now,
        )  # fmt: skip
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

    def _move_spheres(self, until: float) -> None:
        for i in self._present(until):
            if self._spheres[i].appears < until - self._world.dt:
                self._centres[i] = self._centres[i] + self._world.dt * self._velocity(i)

    def _has_room(self, i: int, speed: float, now: float) -> bool:
        """Whether a sphere is far enough for a stop when it is first there."""
        planner = self._planner
        latency = planner.settings.latency + PERIOD
        stop = stopping_reference(self._played, now + latency - self._begin, planner.limits)
        placed = body_spheres(planner, stop.positions)
        travel = float(np.max(np.sum(np.linalg.norm(np.diff(placed, axis=0), axis=-1), axis=0)))
        before = self._played.samples(np.array([now, now + latency]) - self._begin)[0]
        moved = float(np.max(np.linalg.norm(np.diff(body_spheres(planner, before), axis=0), axis=-1)))
        self._geometry.place(self._world.joint_positions)
        distance = self._geometry.clearance(self._centres[i], self._spheres[i].radius)
        return distance > moved + travel + speed * (latency + stop.duration) + ROOM

    def _judge(self, moves: bool) -> None:
        """Count contacts. What touches is taken away before physics would push the arm with it."""
        present = self._present(self._world.time)
        self._geometry.place(self._world.joint_positions)
        for i in present:
            distance = self._geometry.clearance(self._centres[i], self._spheres[i].radius)
            if moves:
                self._clearance = min(self._clearance, distance)
            if distance <= 0.0:
                had_room = self._room.get(i, True)
                self._contacts.append("standing" if not moves else "moving" if had_room else "no room")
                del self._spheres[i]

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


class MovingStage:
    """What all scenes of one process are played with; `seed` is of the scenes."""

    def __init__(self, skill: Skill, settings: JointPlannerSettings, seed: int) -> None:
        self.planner, self.seed = JointSpacePlanner(skill, settings), seed
        self._blind = JointSpacePlanner(skill, replace(settings, avoidance=False))
        self.world, self.geometry = PandaWorld(rate_hz=STEP_HZ), CollisionGeometry.panda()

    def scene(self, number: int) -> MovingScene:
        """Draw and play scene number `number`; it depends on nothing else but the seed."""
        random = np.random.default_rng([self.seed, number])
        query, nominal = draw_query(self.planner, random)
        spheres = draw_spheres(self.planner, nominal, random)
        stage = self.world, self.geometry, query, spheres
        control = MovingRun(self._blind, *stage).play(number).contacts.count("moving")
        return replace(MovingRun(self.planner, *stage).play(number), control=control)


#: Of a process that plays scenes.
_stage: MovingStage | None = None


def _prepare(skill: Skill, settings: JointPlannerSettings, seed: int) -> None:
    global _stage
    _stage = MovingStage(skill, settings, seed)


def _scene(number: int) -> MovingScene:
    assert _stage is not None
    return _stage.scene(number)


def play_moving_scenes(
    skill: Skill, settings: JointPlannerSettings, scenes: int, seed: int, processes: int = 1, show_progress: bool = True
) -> list[MovingScene]:
    """Draw and play scenes in processes of their own; the same ones for the same seed, however many processes."""
    # As the planner node does: threads of the linear algebra would only wait for each other.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    with get_context("spawn").Pool(processes, _prepare, (skill, settings, seed)) as pool:
        made = pool.imap(_scene, range(scenes))
        return list(tqdm(made, desc="moving", unit="scene", total=scenes, disable=not show_progress))
