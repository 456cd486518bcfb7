"""The digital twin: an arm in PyBullet that follows tool poses or joint positions, in a declared scene, among moving
spheres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pybullet_data
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.certification.declared_scene import MASSIVE, DeclaredScene
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT, RobotDescription
from geodesic_motion_ros.robot.inertials import GRAVITY
from geodesic_motion_ros.robot.inverse_kinematics import checked_pose, solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.camera import View, take_picture, view_named
from geodesic_motion_ros.simulation.free_drive import FreeDrive
from geodesic_motion_ros.simulation.joint_motion import JointMotion
from geodesic_motion_ros.simulation.loading import load_arm, standing_beside, strengths
from geodesic_motion_ros.simulation.physics_client import PhysicsClient
from geodesic_motion_ros.simulation.target_stream import TargetStream
from geodesic_motion_ros.trajectory.trajectory_player import Discontinuity, JointWaypoints, TrajectoryPlayer
from geodesic_motion_ros.utils.errors import ParameterError, RobotError

SMOOTH_SPHERE = Path(pybullet_data.getDataPath()) / "sphere_smooth.obj"  # of radius one
# Share of a position error that PyBullet's motor removes in one step.
POSITION_GAIN = 0.5
OBSTACLE_COLOURS = (
    (0.86, 0.24, 0.18),
    (0.93, 0.58, 0.12),
    (0.56, 0.27, 0.68),
    (0.16, 0.50, 0.73),
    (0.15, 0.63, 0.45),
)
SCENE_COLOUR = (0.72, 0.75, 0.79, 1.0)


class ArmWorld:
    """An arm in a declared scene, with gravity, joint motors, kinematic spheres as obstacles, and a camera.

    Each world is a physics server of its own, so several may live in one process. Base frame = world frame.

    Parameters
    ----------
    gui : open PyBullet's window instead of running headless.
    rate_hz : physics steps per second of simulated time.
    scene : what always stands around the arm; None: nothing. Keep-out boxes and workspaces are no bodies.
    robot : name of a shipped robot, or the path of a folder.

    Attributes
    ----------
    time : simulated time [s] since the last reset.
    clock_offset : what the clock that begins of trajectories are given on shows [s] when `time` is 0; 0 after a reset.
    """

    def __init__(
        self,
        gui: bool = False,
        rate_hz: float = 240.0,
        scene: DeclaredScene | None = None,
        robot: str | Path = DEFAULT_ROBOT,
    ) -> None:
        if not 100.0 <= rate_hz <= 2000.0:
            raise ParameterError(f"rate_hz is {rate_hz}: physics runs at 100 to 2000 steps per second")
        self.robot = Robot.named(robot)
        # worked out and compiled now, not at the first target
        self._reach = self.robot.reach
        _compile_player(self.robot.ready)
        self.dt = 1.0 / rate_hz
        self._client = PhysicsClient(gui)
        self._obstacles: dict[str, tuple[int, float]] = {}
        self._decorations: list[int] = []
        self._build(gui, scene or DeclaredScene.empty(), RobotDescription.named(robot))
        self.reset()

    def reset(
        self,
        joint_positions: np.ndarray | None = None,
        tool_pose: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> None:
        """Put the arm at rest: at joint positions (eta,) [rad], at a tool pose, or else at `robot.ready`.

        A tool pose (position, quaternion) goes through inverse kinematics. Obstacles and curves stay, time
        starts again at zero. Free drive has ended.

        Raises
        ------
        RobotError : joint positions outside the limits; a tool pose not finite or out of reach.
        """
        if joint_positions is None:
            start = self.robot.ready if tool_pose is None else solve(self.robot, *tool_pose)
        else:
            start = self.robot.checked(joint_positions)
        for index, position in zip(self._joints, start, strict=True):
            self._client.resetJointState(self._arm, index, position, 0.0)
        for index, position in self._beside.items():
            self._client.resetJointState(self._arm, index, position, 0.0)
        self.time = self.clock_offset = 0.0
        self._motion = JointMotion(self.robot, start)
        self._target: TargetStream | TrajectoryPlayer | None = None
        self._posture: np.ndarray | None = None
        self._free: FreeDrive | None = None
        self._hand: tuple[np.ndarray, np.ndarray] | None = None
        self._drive(start, np.zeros(len(start)))
        self._client.performCollisionDetection()

    def set_target_pose(
        self, position: np.ndarray, quaternion: np.ndarray, posture: np.ndarray | None = None
    ) -> None:
        """Follow a tool pose from now on: (3,) [m] and unit quaternion (4,), scalar first, base frame.

        posture : (eta,) [rad] the configuration that is to hold it; None: one that is drawn gently to `Robot.ready`.

        To be called at a steady rate, as 100 Hz: in between the target moves on with the stream's velocity.

        Raises
        ------
        RobotError : the pose is not finite or beyond the arm's reach, or the posture is outside the joints' limits, or
            the arm is in free drive; the target stays what it was.
        """
        self._refuse_in_free_drive()
        position, quaternion = checked_pose(position, quaternion)
        if posture is not None:
            posture = self.robot.nearest_turn(self.robot.checked(posture), self._motion.positions)
        if not self.robot.within_reach(position):
            raise RobotError(
                f"target {np.round(position, 3).tolist()} m is out of reach: "
                f"the arm reaches {self._reach:.3f} m from {self.robot.shoulder.tolist()} m"
            )
        if not isinstance(self._target, TargetStream):
            self._target = TargetStream(*self.robot.forward(self._motion.positions))
        self._target.accept(position, quaternion, self.time)
        self._posture = posture

    def set_joint_trajectory(self, waypoints: JointWaypoints, begin: float | None = None) -> Discontinuity | None:
        """Follow a joint trajectory from now on, by the rules of joint_trajectory_controller (`trajectory_player.py`);
        returns where what is desired steps for that, None where it does not.

        What exceeds the arm's limits is followed as far as they allow, a jump too.

        Parameters
        ----------
        begin : time [s] its waypoints count from, on the clock that `clock_offset` tells of; None for now.

        Raises
        ------
        RobotError : it is of another number of joints, or ends in the past, or the arm is in free drive; the target
            stays what it was.
        """
        self._refuse_in_free_drive()
        joints = waypoints.positions.shape[1]
        if joints != len(self.robot.joint_names):
            raise RobotError(f"a trajectory of {joints} joints: expected {', '.join(self.robot.joint_names)}")
        if isinstance(self._target, TrajectoryPlayer):
            player = self._target
        else:
            player = TrajectoryPlayer(self._motion.positions, self._motion.velocities)
        # As the controller does: joints without an end begin the shorter angle from where they are.
        first = waypoints.positions[0]
        turns = self.robot.nearest_turn(first, self._motion.positions) - first
        waypoints = replace(waypoints, positions=waypoints.positions + turns)
        step = player.replace(waypoints, begin, self.time + self.clock_offset)
        self._target = player
        return step

    def begin_free_drive(self) -> None:
        """Compensate gravity and follow no target from now on: the arm goes where it is pulled (`free_drive.py`)."""
        if self._free is None:
            (tool,) = (link for link, name in self._link_names.items() if name == self.robot.tool_link)
            self._free = FreeDrive(self._client, self.robot, self._arm, self._joints, tool)
            self.hold()

    def end_free_drive(self) -> None:
        """Brake to rest from where the arm is, and hold there until the next target."""
        if self._free is None:
            return
        self._free = self._hand = None
        self._motion = JointMotion(self.robot, np.clip(self.joint_positions, self.robot.lower, self.robot.upper))
        fastest = self.robot.velocity_limits
        self._motion.velocities = np.clip(self.joint_velocities, -fastest, fastest)

    def pull(self, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Let a hand draw the tool to a pose in free drive: (3,) [m], unit quaternion (4,), scalar first, base frame.

        Raises
        ------
        RobotError : the pose is not finite, or the arm is not in free drive.
        """
        hand = checked_pose(position, quaternion)
        if self._free is None:
            raise RobotError("the arm is not in free drive: it is held by its motors")
        self._hand = hand

    def let_go(self) -> None:
        """Pull no more."""
        self._hand = None

    def hold(self) -> None:
        """Brake to rest inside the acceleration limits and stay there until the next target."""
        self._target = None

    def hold_if_overdue(self, cmd_timeout: float) -> bool:
        """Hold the joints where they are measured when a joint trajectory ended longer than `cmd_timeout` [s] ago.

        Returns whether it did: once for each trajectory. Where the arm got to its end that changes nothing; one that is
        kept from there pushes no more.
        """
        player = self._target
        if not isinstance(player, TrajectoryPlayer) or not player.overdue(self.time + self.clock_offset, cmd_timeout):
            return False
        player.hold(self.joint_positions)
        return True

    def step(self) -> None:
        """Advance the world by `dt` [s]."""
        if self._free is not None:
            self._free.torque(self._hand)
        else:
            self._follow()
        self._client.stepSimulation()
        self.time += self.dt

    def _follow(self) -> None:
        """Turn the motors to where the target will be after a step, or to where the arm brakes."""
        before = self._motion.positions
        if self._target is None:
            self._motion.stop(self.dt)
        elif isinstance(self._target, TargetStream):
            self._motion.follow(*self._target.sample(self.time + self.dt), self.dt, self._posture)
        else:
            now = self.time + self.clock_offset
            present, ahead = self._target.sample(now)[0], self._target.sample(now + self.dt)[0]
            self._motion.follow_joints(present, ahead, self.dt)
        # the motor adds its share of the position error to the velocity given: the error must be that of now
        self._drive(before, self._motion.velocities)

    @property
    def joint_positions(self) -> np.ndarray:
        """Measured joint positions (eta,) [rad]."""
        return np.array([state[0] for state in self._client.getJointStates(self._arm, self._joints)])

    @property
    def joint_velocities(self) -> np.ndarray:
        """Measured joint velocities (eta,) [rad/s]."""
        return np.array([state[1] for state in self._client.getJointStates(self._arm, self._joints)])

    @property
    def commanded_positions(self) -> np.ndarray:
        """Joint positions (eta,) [rad] that the motors are to reach by now."""
        return self._motion.positions.copy()

    @property
    def commanded_velocities(self) -> np.ndarray:
        """Joint velocities (eta,) [rad/s] at which they are to do so."""
        return self._motion.velocities.copy()

    @property
    def is_driven(self) -> bool:
        """Whether the motors follow commands: not in free drive."""
        return self._free is None

    def tool_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Measured pose of the tool in the base frame: position (3,) [m], quaternion (4,), scalar first."""
        return self.robot.forward(self.joint_positions)

    def set_obstacles(self, obstacles: Mapping[str, tuple[np.ndarray, float]]) -> None:
        """Make these the obstacles, name -> (centre (3,), radius) [m]: known names move, absent ones vanish.

        Raises
        ------
        ParameterError : a centre or radius is not finite or not positive; no obstacle has changed then.
        """
        checked = {name: _checked_sphere(name, *sphere) for name, sphere in obstacles.items()}
        for name, (body, radius) in list(self._obstacles.items()):
            if name not in checked or checked[name][1] != radius:
                self._client.removeBody(body)
                del self._obstacles[name]
        for name, (centre, radius) in checked.items():
            if name not in self._obstacles:
                self._obstacles[name] = (self._add_sphere(centre, radius), radius)
            self._client.resetBasePositionAndOrientation(self._obstacles[name][0], centre, (0.0, 0.0, 0.0, 1.0))

    def clearance(self, cutoff: float = 2.0) -> tuple[float, str]:
        """Smallest signed distance [m] from the arm's collision geometry to an obstacle, and the link's name.

        Negative: penetration. (inf, "") when no obstacle is nearer than `cutoff` [m].
        """
        nearest = (np.inf, "")
        for body, _ in self._obstacles.values():
            for point in self._client.getClosestPoints(self._arm, body, cutoff):
                if point[8] < nearest[0]:
                    nearest = (point[8], self._link_names[point[3]])
        return nearest

    def own_clearance(self, cutoff: float = 0.2) -> tuple[float, str]:
        """Smallest signed distance [m] from the moving arm to the scene or to itself, and what comes so near.

        Links moved by neighbouring joints touch by design and do not count. (inf, "") beyond `cutoff` [m].
        """
        closest = self._client.getClosestPoints
        nearest = (np.inf, "")
        for body, name in self._scene.items():
            for point in closest(self._arm, body, cutoff):
                # what the base is mounted on touches it
                if self._turned[point[3]] and point[8] < nearest[0]:
                    nearest = (point[8], f"{self._link_names[point[3]]} and '{name}'")
        for point in closest(self._arm, self._arm, cutoff):
            one, other = point[3], point[4]
            # what is mounted on the flange moves with the last joint
            if abs(self._turned[one] - self._turned[other]) >= 2 and point[8] < nearest[0]:
                nearest = (point[8], f"{self._link_names[one]} and {self._link_names[other]}")
        return nearest

    def contacts(self) -> dict[str, str]:
        """Names of the obstacles and of the parts of the scene that the arm touched (distance <= 0) at the last step,
        each with the name of a link that touched it. The arm's base may stand on the scene.
        """
        bodies = {body: name for name, (body, _) in self._obstacles.items()}
        return {
            name: self._link_names[point[3]]
            for body, name in {**self._scene, **bodies}.items()
            for point in self._client.getContactPoints(self._arm, body)
            if point[8] <= 0.0 and (self._turned[point[3]] or body in bodies)
        }

    def add_curve(self, points: np.ndarray, colour: tuple[float, float, float], radius: float = 0.004) -> None:
        """Draw a curve (n, 3) [m] as a thin tube of one colour (r, g, b in [0, 1]); it touches nothing."""
        curve = np.asarray(points, dtype=float)
        if curve.ndim != 2 or curve.shape[1] != 3 or len(curve) < 2 or not np.all(np.isfinite(curve)):
            raise ParameterError(f"a curve has shape {curve.shape}: expected (n >= 2, 3), finite, in metres")
        keep = np.unique(np.linspace(0, len(curve) - 1, min(len(curve), 40)).astype(int))
        for start, end in zip(curve[keep[:-1]], curve[keep[1:]], strict=True):
            self._decorations.append(self._add_capsule(start, end, (*colour, 1.0), radius))

    def clear_curves(self) -> None:
        """Remove all that `add_curve` has drawn."""
        for body in self._decorations:
            self._client.removeBody(body)
        self._decorations = []

    def render(
        self, width: int = 640, height: int = 480, view: str | View = "front", oversampling: int = 1
    ) -> np.ndarray:
        """Picture (height, width, 3), uint8; oversampling > 1 smooths edges. A name is one of `camera.VIEWS`.

        Takes about 0.1 s at 320 x 240 and holds Python's global lock: not for a control thread.
        """
        seen = view_named(view) if isinstance(view, str) else view
        return take_picture(self._client, seen, width, height, oversampling)

    def close(self) -> None:
        """End the physics server; a second call does nothing."""
        if self._client.isConnected():
            self._client.disconnect()

    def __enter__(self) -> ArmWorld:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _build(self, gui: bool, scene: DeclaredScene, described: RobotDescription) -> None:
        client = self._client
        if gui:
            client.configureDebugVisualizer(client.COV_ENABLE_GUI, 0)
        client.setTimeStep(self.dt)
        client.setGravity(0.0, 0.0, -GRAVITY)
        # PyBullet's numbers of the bodies, and their names
        self._scene = {
            add_solid(client, solid, kind): name
            for name, solid, kind in zip(scene.names, scene.solids, scene.kinds, strict=True)
            if kind in MASSIVE
        }
        self._arm = load_arm(client, described)
        infos = [client.getJointInfo(self._arm, index) for index in range(client.getNumJoints(self._arm))]
        index_of = {info[1].decode(): info[0] for info in infos}
        for name in (*self.robot.joint_names, *described.simulated_joints):
            if name not in index_of:
                raise RobotError(f"joint '{name}' is not in {described.simulated_urdf}; it has {', '.join(index_of)}")
        self._joints = [index_of[name] for name in self.robot.joint_names]
        self._forces = strengths([infos[index][10] for index in self._joints], self.robot, described)
        self._beside = standing_beside(infos, self._joints)
        self._beside |= {index_of[name]: position for name, position in described.simulated_joints.items()}
        self._link_names = {info[0]: info[12].decode() for info in infos}
        self._link_names[-1] = client.getBodyInfo(self._arm)[0].decode()
        # How many of the arm's joints move a link; parents come before their children.
        self._turned = {-1: 0}
        for info in infos:
            self._turned[info[0]] = self._turned[info[16]] + (info[0] in self._joints)
        for index, position in self._beside.items():
            client.setJointMotorControl2(self._arm, index, client.POSITION_CONTROL, position, force=20.0)

    def _refuse_in_free_drive(self) -> None:
        if self._free is not None:
            raise RobotError("the arm is in free drive, where it follows no target: end that first")

    def _drive(self, positions: np.ndarray, velocities: np.ndarray) -> None:
        count = len(positions)
        self._client.setJointMotorControlArray(
            self._arm,
            self._joints,
            self._client.POSITION_CONTROL,
            targetPositions=positions.tolist(),
            targetVelocities=velocities.tolist(),
            forces=self._forces,
            positionGains=[POSITION_GAIN] * count,
            velocityGains=[1.0] * count,
        )

    def _add_sphere(self, centre: np.ndarray, radius: float) -> int:
        client = self._client
        colour = OBSTACLE_COLOURS[len(self._obstacles) % len(OBSTACLE_COLOURS)]
        shape = client.createCollisionShape(client.GEOM_SPHERE, radius=radius)
        look = client.createVisualShape(
            client.GEOM_MESH,
            fileName=str(SMOOTH_SPHERE),
            meshScale=[radius] * 3,
            rgbaColor=(*colour, 1.0),
        )
        return client.createMultiBody(0.0, shape, look, basePosition=centre)

    def _add_capsule(self, start: np.ndarray, end: np.ndarray, colour: tuple[float, ...], radius: float) -> int:
        client = self._client
        along = end - start
        length = float(np.linalg.norm(along))
        look = client.createVisualShape(client.GEOM_CAPSULE, radius=radius, length=length, rgbaColor=colour)
        # shortest rotation from z to the direction of the capsule, scalar last as PyBullet wants it
        turn = np.array([-along[1], along[0], 0.0, length + along[2]])
        size = np.linalg.norm(turn)
        turn = turn / size if size > 1e-9 else np.array([1.0, 0.0, 0.0, 0.0])
        return client.createMultiBody(0.0, -1, look, basePosition=0.5 * (start + end), baseOrientation=turn)


def add_solid(client: PhysicsClient, solid: np.ndarray, kind: str) -> int:
    """A body of a row (16,) of a declared scene's solids, which stands in this list of its file; PyBullet's number."""
    x, y, z = solid[3:6].tolist()
    if kind == "cylinders":
        shape = client.createCollisionShape(client.GEOM_CYLINDER, radius=x, height=2.0 * z)
        look = client.createVisualShape(client.GEOM_CYLINDER, radius=x, length=2.0 * z, rgbaColor=SCENE_COLOUR)
    else:
        shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=(x, y, z))
        look = client.createVisualShape(client.GEOM_BOX, halfExtents=(x, y, z), rgbaColor=SCENE_COLOUR)
    # scalar last, as PyBullet wants it
    turn = Rotation.from_matrix(solid[7:].reshape(3, 3)).as_quat()
    return client.createMultiBody(0.0, shape, look, basePosition=solid[:3], baseOrientation=turn)


def _checked_sphere(name: str, centre: np.ndarray, radius: float) -> tuple[np.ndarray, float]:
    centre = np.array(centre, dtype=float)
    if centre.shape != (3,) or not np.all(np.isfinite(centre)):
        raise ParameterError(
            f"centre of obstacle '{name}' is {centre.tolist()}: expected three finite numbers in metres"
        )
    if not 0.0 < radius < np.inf:
        raise ParameterError(f"radius of obstacle '{name}' is {radius}: expected a positive number of metres")
    return centre, float(radius)


def _compile_player(positions: np.ndarray) -> None:
    player = TrajectoryPlayer(positions, np.zeros(len(positions)))
    player.replace(JointWaypoints(np.array([0.0, 1.0]), np.stack([positions, positions])), 0.0, 0.0)
    player.sample(0.5)
