"""One method plays one scene: the arm in physics, the stream of obstacles, and a judge who knows of no planner.

The arm is a Panda in PyBullet that plays what it is sent by the rules of joint_trajectory_controller, or follows a
stream of poses as the twin does, inside its limits of velocity and acceleration. Obstacles are judged 200 times a
second by PyBullet's distance of the collision meshes, where they are measured to be, from each sphere: the meshes of
the arm, or, with a skill of the tool, those of hand and fingers, which alone it guards. A scene ends

- at the goal: the tool is measured within `REACHED` and `REACHED_ANGLE` of the goal pose, and rests;
- at the first contact of what is guarded, while the arm moves or as it stands;
- after `LONGEST`, or where the arm has stood for `GIVEN_UP` since there were spheres that move or will go.

Success is the first of these. A contact is one *outside braking room* where the arm moved, and had been far enough from
the sphere when it was first told of it to stop in time.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from geodesic_motion_ros.comparison.arena import Arena
from geodesic_motion_ros.comparison.method import Answer, Method
from geodesic_motion_ros.comparison.scene import Scene
from geodesic_motion_ros.comparison.ways import chased_point
from geodesic_motion_ros.demonstrations.curves import PoseCurve
from geodesic_motion_ros.demonstrations.similarity import compare
from geodesic_motion_ros.errors import RobotError
from geodesic_motion_ros.experiments.moving_spheres import STEP_HZ, STEPS_PER_TICK, SpheresInMotion, needed_room
from geodesic_motion_ros.joint_reference import PERIOD
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.simulation.collision_geometry import CollisionGeometry
from geodesic_motion_ros.simulation.world import PandaWorld

#: The goal is reached within so much [m], [rad]; an arm rests whose joints are all slower than this [rad/s], a tool all
#: of whose spheres are slower than this [m/s].
REACHED, REACHED_ANGLE, RESTING, TOOL_RESTING = 0.01, 0.1, 0.02, 0.005
#: A scene ends after so long [s], or where the arm has stood for so long while nothing will change.
LONGEST, GIVEN_UP = 15.0, 2.0
#: Distances are looked for up to this [m].
LOOKED_FOR = 0.3
#: Every so many steps the posture is kept for what is said of similarity.
_KEPT = 4
#: A tick is in time within this [s].
DEADLINE = 0.01

Contact = Literal["", "moving", "standing", "no room"]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one scene.

    Attributes
    ----------
    mostly_free : whether at least half of the demonstrations stayed free.
    reached : whether the goal was reached, after `duration` [s]. contact : what ended the scene, where a contact did.
    refusal : why the method was on no way to the goal at the end, where it said so.
    clearance : least distance [m] of what is guarded from a sphere while the arm moved, no more than LOOKED_FOR.
    arm_touched : whether a part of the arm that is not guarded touched a sphere: that ends no scene.
    dtw, orientation : of the tool's way from that of the closest demonstration, or of the one held out [m], [rad].
    jerk : root mean square of the command's jerk, over all joints [rad/s^3].
    replans : processor time [s] of the ticks that answered something new (`Answer.planned`).
    ticks, in_time : how many ticks there were, and how many took no more processor time than DEADLINE.
    """

    mostly_free: bool
    reached: bool
    contact: Contact
    refusal: str
    duration: float
    clearance: float
    dtw: float
    orientation: float
    jerk: float
    replans: tuple[float, ...]
    ticks: int
    in_time: int
    arm_touched: bool = False

    @property
    def success(self) -> bool:
        return self.reached and not self.contact

    @property
    def touched_moving(self) -> bool:
        """Whether a sphere was touched in motion, with room to stop for it or without."""
        return self.contact in ("moving", "no room")

    @property
    def refused(self) -> bool:
        """Whether the method said that it had no way, and touched nothing."""
        return not self.reached and not self.contact and bool(self.refusal)

    def as_dict(self) -> dict[str, Any]:
        """For a file; `Outcome(**...)` reads it."""
        return asdict(self)


class Stage:
    """The arm in physics and the judge's meshes: what scenes are played with, one after the other."""

    def __init__(self, arena: Arena) -> None:
        self.arena = arena
        self.world, self.geometry = PandaWorld(rate_hz=STEP_HZ), CollisionGeometry.panda()
        self.guarded = frozenset(arena.collision.points.names)

    def play(self, scene: Scene, method: Method) -> tuple[Outcome, np.ndarray]:
        """What became of the scene, and the measured postures (n, eta) [rad], 50 a second."""
        return _Run(self, scene, method).play()


class _Run:
    """One scene being played."""

    def __init__(self, stage: Stage, scene: Scene, method: Method) -> None:
        self._arena, self._world, self._geometry = stage.arena, stage.world, stage.geometry
        self._guarded, self._arm_touched = stage.guarded, False
        self._scene, self._method = scene, method
        self._spheres = SpheresInMotion(
            scene.spheres, lambda: chased_point(self._arena, scene.tool_chased, self._world.joint_positions)
        )
        self._world.reset(scene.start)
        self._commanded = [self._world.commanded_positions]
        self._postures: list[np.ndarray] = []
        self._refusal = ""
        self._replans: list[float] = []
        self._ticks, self._in_time = 0, 0

    def play(self) -> tuple[Outcome, np.ndarray]:
        world, pending = self._world, Answer()
        self._method.reset(self._scene)
        stood, reached, step, posture = 0.0, False, 0, world.joint_positions
        while step < LONGEST * STEP_HZ:
            now = step / STEP_HZ
            if step % STEPS_PER_TICK == 0:
                self._hand_over(pending)
                pending = self._tick(now)
            step += 1
            world.step()
            self._spheres.move(step / STEP_HZ)
            self._commanded.append(world.commanded_positions)
            before, posture = posture, world.joint_positions
            if step % _KEPT == 0:
                self._postures.append(posture)
            moves = self._moves(before, posture)
            self._geometry.place(posture)
            self._spheres.judge(step / STEP_HZ, moves, self._clearance)
            if self._spheres.contacts:
                break
            reached = not moves and self._at_goal()
            stood = 0.0 if moves or self._will_change(step / STEP_HZ) else stood + world.dt
            if reached or stood >= GIVEN_UP:
                break
        self._postures.append(world.joint_positions)
        return self._outcome(reached, step / STEP_HZ), np.array(self._postures)

    def _moves(self, before: np.ndarray, posture: np.ndarray) -> bool:
        """Whether what is guarded moved in the last step, between two postures (eta,) [rad]: a hand may rest while the
        elbow swings.
        """
        if self._arena.whole_arm:
            return bool(np.max(np.abs(self._world.joint_velocities)) > RESTING)
        ways = np.diff(self._arena.body(np.stack([before, posture])), axis=0)
        return bool(np.max(np.linalg.norm(ways, axis=-1)) > TOOL_RESTING * self._world.dt)

    def _tick(self, now: float) -> Answer:
        obstacles = Obstacles.of_spheres(*self._spheres.seen(now, self._has_room), now)
        began = time.thread_time()
        answer = self._method.tick(now, obstacles)
        took = time.thread_time() - began
        if answer.planned and (answer.waypoints is not None or answer.pose is not None):
            self._replans.append(took)
        self._ticks += 1
        self._in_time += took <= DEADLINE
        self._refusal = answer.refusal
        return answer

    def _clearance(self, centre: np.ndarray, radius: float) -> float:
        """Of what is guarded from a sphere [m], and take note of the rest of the arm."""
        guarded = np.inf
        for link, distance in self._geometry.clearances(centre, radius, LOOKED_FOR).items():
            if link in self._guarded:
                guarded = min(guarded, distance)
            else:
                self._arm_touched |= distance <= 0.0
        return guarded

    def _hand_over(self, answer: Answer) -> None:
        try:
            if answer.pose is not None:
                self._world.set_target_pose(*answer.pose)
            elif answer.waypoints is not None:
                self._world.set_joint_trajectory(answer.waypoints, answer.begin)
        except RobotError as error:
            # As the controller does: what was played goes on.
            self._refusal = f"the controller refused: {error}"

    def _has_room(self, centre: np.ndarray, radius: float, speed: float) -> bool:
        """Whether a sphere is far enough for an arm at rest to take note of: all are in sight before it moves."""
        self._geometry.place(self._world.joint_positions)
        return self._clearance(centre, radius) > needed_room(0.0, PERIOD, speed)

    def _will_change(self, now: float) -> bool:
        """Whether spheres are there that will move or go."""
        return any(math.isfinite(sphere.vanishes) and now < sphere.vanishes for sphere in self._scene.spheres)

    def _at_goal(self) -> bool:
        position, quaternion = self._world.tool_pose()
        goal = self._scene.goal_pose
        near = float(np.linalg.norm(position - goal[0])) <= REACHED
        return near and float(angle_between(quaternion, goal[1])) <= REACHED_ANGLE

    def _outcome(self, reached: bool, duration: float) -> Outcome:
        contacts = self._spheres.contacts
        executed = self._arena.tool_curve(np.array(self._postures))
        dtw, orientation = _to_closest(executed, self._scene.compared)
        jerks = np.diff(self._commanded, 3, axis=0) * STEP_HZ**3
        return Outcome(
            mostly_free=self._scene.mostly_free, reached=reached, contact=contacts[0] if contacts else "",
            refusal="" if reached else self._refusal, duration=duration,
            clearance=float(min(self._spheres.clearance, LOOKED_FOR)), dtw=dtw, orientation=orientation,
            jerk=float(np.sqrt(np.mean(np.sum(jerks**2, axis=1)))) if len(jerks) else 0.0,
            replans=tuple(self._replans), ticks=self._ticks, in_time=self._in_time,
            arm_touched=self._arm_touched,
        )  # fmt: skip


def _to_closest(executed: PoseCurve, compared: tuple[PoseCurve, ...]) -> tuple[float, float]:
    """DTW [m] and mean angle [rad] from the one with the least DTW."""
    closest = min((compare(executed, item) for item in compared), key=lambda one: one.dtw)
    return closest.dtw, closest.orientation
