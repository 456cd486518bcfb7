"""Free drive: an arm without motors that a hand pulls, as a person guides one.

Gravity is compensated, and the joints lose their speed in the time T. With the mass matrix M, the forces of motion C
and gravity g of the arm in a configuration q (Featherstone 2008, chapter 5: the recursive Newton-Euler algorithm), the
motors turn with

    tau = M(q) (-dq / T) + C(q, dq) dq + g(q),    so that    ddq = -dq / T + M^-1 J^T F

under what a hand does at the tool, F. Damping in proportion to the masses is stable for every step shorter than T,
however light a link is. The hand holds the tool at three points around it; each is drawn to where the hand wants it by
a spring with a damper, f = k (x_hand - x) - d dx. The elbow is not held, and drifts to where the masses let it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.physics_client import PhysicsClient

#: T [s]: pulled at 0.2 m/s, the arm resists with some 10 N.
DECAY = 0.1
#: Of the three springs [N/m] and dampers [N s/m] together: a hand is 1 cm ahead of the tool, at most.
STIFFNESS, DAMPING = 1000.0, 30.0
#: Where the hand holds the tool (3, 3) [m], in the tool's frame: 10 cm around it.
GRIP = 0.1 * np.array([[np.cos(angle), np.sin(angle), 0.0] for angle in 2.0 * np.pi / 3.0 * np.arange(3)])

Pose = tuple[np.ndarray, np.ndarray]


class FreeDrive:
    """Turns the motors off at its construction; from then on `torque` is to be called before each step.

    Parameters
    ----------
    arm : PyBullet's number of the body, joints : those of the robot's joints, tool : that of the tool's link.
    """

    def __init__(self, client: PhysicsClient, robot: Robot, arm: int, joints: list[int], tool: int) -> None:
        self._client, self._robot, self._arm, self._joints, self._tool = client, robot, arm, joints, tool
        indices = range(client.getNumJoints(arm))
        self._moving = [index for index in indices if client.getJointInfo(arm, index)[2] != client.JOINT_FIXED]
        parameters = client.getPhysicsEngineParameters()
        self._gravity = [parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"]
        turned = Rotation.from_quat(client.getBasePositionAndOrientation(arm)[1])
        self._gravity_in_root = turned.inv().apply(self._gravity).tolist()
        client.setJointMotorControlArray(arm, joints, client.VELOCITY_CONTROL, forces=[0.0] * len(joints))
        for joint, lower, upper in zip(joints, robot.lower, robot.upper, strict=True):
            # PyBullet's description of the arm has the limits of its parts, which lie beyond those of its motion
            client.changeDynamics(arm, joint, jointLowerLimit=lower, jointUpperLimit=upper)

    def torque(self, hand: Pose | None) -> None:
        """Apply the motors' torques, and the forces of a hand that wants the tool in a pose; None: it lets the arm be.

        hand : position (3,) [m] and quaternion (4,), scalar first, base frame.
        """
        client = self._client
        states = client.getJointStates(self._arm, self._moving)
        positions, velocities = [state[0] for state in states], [state[1] for state in states]
        slowing = [-velocity / DECAY if joint in self._joints else 0.0
                   for joint, velocity in zip(self._moving, velocities, strict=True)]  # fmt: skip
        # PyBullet's inverse dynamics take gravity in the frame of the root link, however that is turned
        client.setGravity(*self._gravity_in_root)
        torques = client.calculateInverseDynamics(self._arm, positions, velocities, slowing)
        client.setGravity(*self._gravity)
        of_joint = dict(zip(self._moving, zip(positions, velocities, torques, strict=True), strict=True))
        q, dq, tau = np.array([of_joint[joint] for joint in self._joints]).T
        client.setJointMotorControlArray(self._arm, self._joints, client.TORQUE_CONTROL, forces=tau.tolist())
        if hand is not None:
            self._pull(q, dq, hand)

    def _pull(self, q: np.ndarray, dq: np.ndarray, hand: Pose) -> None:
        position, quaternion = self._robot.forward(q)
        twist = self._robot.jacobian(q) @ dq
        arms = to_rotation(quaternion).apply(GRIP)
        wanted = hand[0] + to_rotation(hand[1]).apply(GRIP)
        speeds = twist[:3] + np.cross(twist[3:], arms)
        forces = (STIFFNESS * (wanted - position - arms) - DAMPING * speeds) / len(GRIP)
        for force, point in zip(forces, position + arms, strict=True):
            self._client.applyExternalForce(
                self._arm, self._tool, force.tolist(), point.tolist(), self._client.WORLD_FRAME
            )
