"""One scene: a source of motion, the stream of obstacles, and a judge who knows of no planner.

The motion is that of a method, whose arm is the skill's in PyBullet and plays what it is sent by the rules of
joint_trajectory_controller, or follows a stream of poses as the twin does, inside its limits of velocity and
acceleration; or it is a table of joint positions (`motions.py`). Obstacles are judged 200 times a second by PyBullet's
distance of the collision meshes, where they are measured to be, from each sphere: the meshes of what is guarded
(`guard.py`), the arm, or hand and fingers alone. A scene ends

- at the goal: the tool is measured within `REACHED` and `REACHED_ANGLE` of the goal pose, and rests;
- at the first contact of what is guarded, with a sphere or with the declared scene, by the same meshes;
- after `LONGEST`, or where the arm has stood for `GIVEN_UP` since there were spheres that move or will go.

Success is the first of these. A contact is one *in motion* where the arm moved within `AFTER_MOTION` before it, and
*standing* otherwise; of one in motion there was *no room* where the sphere, when it was first there, was too near for
an arm at rest to react to it in time. For a standing one the outcome says whether an arm that had waited at the
start of the scene, for `LONGEST`, would have been touched too. One with the declared scene is counted apart, as
`scene`: it does not move, so that the arm did.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, Protocol

import numpy as np

from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.trajectory.trajectory import PERIOD
from geodesic_motion_ros.utils.errors import RobotError
from geodesic_motion_studies.comparison.chasing import chased_point
from geodesic_motion_studies.comparison.guard import GuardedArm
from geodesic_motion_studies.comparison.method import Answer, Method
from geodesic_motion_studies.comparison.scene import Scene
from geodesic_motion_studies.experiments.moving_spheres import (
    STEP,
    STEP_HZ,
    STEPS_PER_TICK,
    SpheresInMotion,
    needed_room,
)
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry
from geodesic_motion_studies.tools.similarity import compare

#: The goal is reached within so much [m], [rad]; an arm rests whose joints are all slower than this [rad/s], a tool all
#: of whose spheres are slower than this [m/s].
REACHED, REACHED_ANGLE, RESTING, TOOL_RESTING = 0.01, 0.1, 0.02, 0.005
#: A scene ends after so long [s], or where the arm has stood for so long while nothing will change.
LONGEST, GIVEN_UP = 15.0, 5.0
#: A contact this soon [s] after the arm moved is one in motion: what a stop a moment before the contact leaves in a
#: sphere's path was not avoided. Of the order of the longest stop and of a person's reaction.
AFTER_MOTION = 0.5
#: Distances are looked for up to this [m].
LOOKED_FOR = 0.3
#: Every so many steps the posture is kept for what is said of similarity.
_KEPT = 4
#: A tick is in time within this [s].
DEADLINE = 0.01

Contact = Literal["", "moving", "standing", "no room", "scene"]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one scene.

    Attributes
    ----------
    mostly_free : whether at least half of the demonstrations stayed free.
    reached : whether the goal was reached, after `duration` [s]. contact : what ended the scene, where a contact did.
    refusal : why the method followed no path to the goal at the end, where it said so.
    clearance : least distance [m] of what is guarded from a sphere while the arm moved and for AFTER_MOTION after it,
        no more than LOOKED_FOR.
    arm_touched : whether a part of the arm that is not guarded touched a sphere or the declared scene: that ends no
        scene.
    stood : for how long [s] what is guarded had not moved at the end.
    waiting_avoids : whether an arm that waits at the start is not touched; None where no standing contact was.
    lag : largest distance [m] of a sphere of what is guarded from where it was to be, where the arm lags (`lag.py`).
    in_view : for how long [s], until a contact, clouds had shown the sphere that touched (`cloud.py`); None elsewhere.
    dtw, orientation : of the tool's motion from that of the closest demonstration, or of the one held out [m], [rad].
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
    stood: float = 0.0
    waiting_avoids: bool | None = None
    lag: float = 0.0
    in_view: float | None = None

    @property
    def success(self) -> bool:
        return self.reached and not self.contact

    @property
    def touched_moving(self) -> bool:
        """Whether a sphere was touched in motion, with room to stop for it or without."""
        return self.contact in ("moving", "no room")

    @property
    def refused(self) -> bool:
        """Whether the method said that it had no path, and touched nothing."""
        return not self.reached and not self.contact and bool(self.refusal)

    def as_dict(self) -> dict[str, Any]:
        """For a file; `Outcome(**...)` reads it."""
        return asdict(self)


@dataclass
class Effort:
    """What a method says of itself while a scene is played; all but the first as of `Outcome`."""

    refusal: str = ""
    replans: list[float] = field(default_factory=list)
    ticks: int = 0
    in_time: int = 0
    lag: float = 0.0


class Motion(Protocol):
    """A source of motion of an arm, from the start of one scene after the other.

    Attributes
    ----------
    joint_positions, joint_velocities : where the arm is by now (eta,) [rad], [rad/s].
    commanded_positions : where it is to be (eta,) [rad]. effort : in this scene.
    """

    effort: Effort

    @property
    def joint_positions(self) -> np.ndarray: ...

    @property
    def joint_velocities(self) -> np.ndarray: ...

    @property
    def commanded_positions(self) -> np.ndarray: ...

    def reset(self, scene: Scene) -> None:
        """The arm stands at the scene's start at time 0."""

    def tick(self, now: float, obstacles: Obstacles) -> None:
        """Called every STEPS_PER_TICK steps, from 0 [s] on, with the obstacles that are there."""

    def step(self) -> None:
        """Go on by one step of the judge."""


class PlayedMethod:
    """A method, and the arm in physics that plays its answers, each of them one tick later."""

    def __init__(self, world: ArmWorld, method: Method) -> None:
        self._world, self._method = world, method

    def reset(self, scene: Scene) -> None:
        self._world.reset(scene.start)
        self._method.reset(scene)
        self._pending, self.effort = Answer(), Effort()

    def tick(self, now: float, obstacles: Obstacles) -> None:
        self.hand_over(self._pending)
        began = time.thread_time()
        answer = self._method.tick(now, obstacles)
        took = time.thread_time() - began
        effort = self.effort
        if answer.planned and (answer.waypoints is not None or answer.pose is not None):
            effort.replans.append(took)
        effort.ticks += 1
        effort.in_time += took <= DEADLINE
        effort.refusal = answer.refusal
        self._pending = answer

    def step(self) -> None:
        self._world.step()

    @property
    def joint_positions(self) -> np.ndarray:
        return self._world.joint_positions

    @property
    def joint_velocities(self) -> np.ndarray:
        return self._world.joint_velocities

    @property
    def commanded_positions(self) -> np.ndarray:
        return self._world.commanded_positions

    def hand_over(self, answer: Answer) -> None:
        """Give the arm what it is to play from now on."""
        try:
            if answer.pose is not None:
                self._world.set_target_pose(*answer.pose)
            elif answer.waypoints is not None:
                self._world.set_joint_trajectory(answer.waypoints, answer.begin)
        except RobotError as error:
            # As the controller does: what was played goes on.
            self.effort.refusal = f"the controller refused: {error}"


class Judge:
    """The meshes by which motions are judged, in one scene after the other."""

    def __init__(self, arm: GuardedArm, geometry: CollisionGeometry | None = None) -> None:
        """geometry : the meshes; None: the arm's."""
        self.arm, self.geometry = arm, geometry or CollisionGeometry(arm.name)
        self.guarded = frozenset(arm.collision.points.names)

    def judge(self, scene: Scene, motion: Motion) -> tuple[Outcome, np.ndarray]:
        """What became of the scene, and the postures (n, eta) [rad], 50 a second, the last one at its end."""
        return _Run(self, scene, motion).judged()

    def waiting_is_touched(self, scene: Scene) -> bool:
        """Whether a sphere touches what is guarded of an arm that stays at the scene's start for LONGEST."""
        self.geometry.place(scene.start)
        spheres = SpheresInMotion(scene.spheres, lambda: chased_point(self.arm, scene.tool_chased, scene.start))

        def clearance(centre: np.ndarray, radius: float) -> float:
            clearances = self.geometry.clearances(centre, radius, LOOKED_FOR)
            return min((clearances[link] for link in self.guarded.intersection(clearances)), default=np.inf)

        for step in range(1, int(LONGEST * STEP_HZ) + 1):
            spheres.move(step / STEP_HZ)
            spheres.judge(step / STEP_HZ, False, clearance)
            if spheres.contacts:
                return True
        return False


class Stage(Judge):
    """A judge, and the arm in physics that methods move."""

    def __init__(self, arm: GuardedArm, geometry: CollisionGeometry | None = None) -> None:
        """geometry : as of `Judge`."""
        super().__init__(arm, geometry)
        self.world = ArmWorld(rate_hz=STEP_HZ, robot=arm.name)

    def play(self, scene: Scene, method: Method) -> tuple[Outcome, np.ndarray]:
        """As `judge`, the motion of a method."""
        return self.judge(scene, PlayedMethod(self.world, method))


class _Run:
    """One scene being judged."""

    def __init__(self, judge: Judge, scene: Scene, motion: Motion) -> None:
        self._judge, self._arm, self._geometry = judge, judge.arm, judge.geometry
        self._guarded, self._arm_touched, self._scene_touched = judge.guarded, False, False
        # A scene of an older revision (`at_revision.py`) declares nothing.
        declared = getattr(scene, "declared", None)
        self._surrounded = declared is not None
        if declared is not None:
            self._geometry.surround(declared)
        self._scene, self._motion = scene, motion
        self._spheres = SpheresInMotion(
            scene.spheres, lambda: chased_point(self._arm, scene.tool_chased, motion.joint_positions)
        )
        motion.reset(scene)
        self._commanded = [motion.commanded_positions]
        self._postures: list[np.ndarray] = []

    def judged(self) -> tuple[Outcome, np.ndarray]:
        motion = self._motion
        # When the arm last moved, and when it did or something was still to change [s].
        moved, changed = -math.inf, 0.0
        reached, step, posture = False, 0, motion.joint_positions
        while step < LONGEST * STEP_HZ:
            now = step / STEP_HZ
            if step % STEPS_PER_TICK == 0:
                motion.tick(now, Obstacles.of_spheres(*self._spheres.seen(now, self._has_room), now))
            step += 1
            motion.step()
            now = step / STEP_HZ
            self._spheres.move(now)
            self._commanded.append(motion.commanded_positions)
            before, posture = posture, motion.joint_positions
            if step % _KEPT == 0:
                self._postures.append(posture)
            moves = self._moves(before, posture)
            moved = now if moves else moved
            self._geometry.place(posture)
            self._spheres.judge(now, now - moved <= AFTER_MOTION, self._clearance)
            self._scene_touched = self._touches_scene()
            if self._spheres.contacts or self._scene_touched:
                break
            reached = not moves and self._at_goal(posture)
            changed = now if moves or self._will_change(now) else changed
            if reached or now - changed >= GIVEN_UP:
                break
        self._postures.append(posture)
        return self._outcome(reached, now, min(now, now - moved)), np.array(self._postures)

    def _moves(self, before: np.ndarray, posture: np.ndarray) -> bool:
        """Whether what is guarded moved in the last step, between two postures (eta,) [rad]: a hand may rest while the
        elbow swings.
        """
        if self._arm.guard == "arm":
            return bool(np.max(np.abs(self._motion.joint_velocities)) > RESTING)
        steps = np.diff(self._arm.body(np.stack([before, posture])), axis=0)
        return bool(np.max(np.linalg.norm(steps, axis=-1)) > TOOL_RESTING * STEP)

    def _clearance(self, centre: np.ndarray, radius: float) -> float:
        """Of what is guarded from a sphere [m], and take note of the rest of the arm."""
        return self._of_guarded(self._geometry.clearances(centre, radius, LOOKED_FOR))

    def _touches_scene(self) -> bool:
        """Whether what is guarded touches the declared scene, and take note of the rest of the arm."""
        return self._surrounded and self._of_guarded(self._geometry.surrounding_clearances(0.0)) <= 0.0

    def _of_guarded(self, clearances: dict[str, float]) -> float:
        """The least of what is guarded, of the distances [m] of links, and take note of the rest of the arm."""
        guarded = np.inf
        for link, distance in clearances.items():
            if link in self._guarded:
                guarded = min(guarded, distance)
            else:
                self._arm_touched |= distance <= 0.0
        return guarded

    def _has_room(self, centre: np.ndarray, radius: float, speed: float) -> bool:
        """Whether a sphere is far enough for an arm at rest to take note of: all are in sight before it moves."""
        self._geometry.place(self._motion.joint_positions)
        return self._clearance(centre, radius) > needed_room(0.0, PERIOD, speed)

    def _will_change(self, now: float) -> bool:
        """Whether spheres are there that will move or go."""
        return any(math.isfinite(sphere.vanishes) and now < sphere.vanishes for sphere in self._scene.spheres)

    def _at_goal(self, posture: np.ndarray) -> bool:
        position, quaternion = self._arm.robot.forward(posture)
        goal = self._scene.goal_pose
        near = float(np.linalg.norm(position - goal[0])) <= REACHED
        return near and float(angle_between(quaternion, goal[1])) <= REACHED_ANGLE

    def _outcome(self, reached: bool, duration: float, stood: float) -> Outcome:
        contacts, effort = self._spheres.contacts, self._motion.effort
        contact: Contact = contacts[0] if contacts else "scene" if self._scene_touched else ""
        executed = self._arm.tool_curve(np.array(self._postures))
        dtw, orientation = _to_closest(executed, self._scene.compared)
        jerks = np.diff(self._commanded, 3, axis=0) * STEP_HZ**3
        waiting_avoids = None
        if contact == "standing":
            waiting_avoids = not self._judge.waiting_is_touched(self._scene)
        return Outcome(
            mostly_free=self._scene.mostly_free, reached=reached, contact=contact,
            refusal="" if reached else effort.refusal, duration=duration,
            clearance=float(min(self._spheres.clearance, LOOKED_FOR)), dtw=dtw, orientation=orientation,
            jerk=float(np.sqrt(np.mean(np.sum(jerks**2, axis=1)))) if len(jerks) else 0.0,
            replans=tuple(effort.replans), ticks=effort.ticks, in_time=effort.in_time,
            arm_touched=self._arm_touched, stood=stood, waiting_avoids=waiting_avoids, lag=effort.lag,
        )  # fmt: skip


def _to_closest(executed: PoseCurve, compared: tuple[PoseCurve, ...]) -> tuple[float, float]:
    """DTW [m] and mean angle [rad] from the one with the least DTW."""
    closest = min((compare(executed, item) for item in compared), key=lambda one: one.dtw)
    return closest.dtw, closest.orientation
