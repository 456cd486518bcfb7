"""Loading an arm into PyBullet, with what stands in for masses, strengths and positions that its URDF leaves out."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import pybullet_data
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.inertials import GRAVITY, complete_inertials, holding_strengths
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.urdf import read_urdf
from geodesic_motion_ros.simulation.physics_client import PhysicsClient, PhysicsError
from geodesic_motion_ros.utils.errors import RobotError


def simulated_urdf(described: RobotDescription) -> Path:
    """The URDF of a robot in the simulation: of its folder, or one that PyBullet brings."""
    brought = described.simulated_urdf.removeprefix("pybullet_data/")
    return Path(pybullet_data.getDataPath() if brought != described.simulated_urdf else "") / brought


def load_arm(client: PhysicsClient, described: RobotDescription, bodies_shown: bool = False) -> int:
    """An arm from the URDF of its folder for the simulation, its base link in the origin; PyBullet's number.

    Gravity acts along the world's vertical, which is that of the URDF's root link. Links without masses have those that
    stand in for them.

    bodies_shown : pictures show the bodies that collide, and not those that are drawn.

    Raises
    ------
    RobotError : PyBullet cannot read the URDF or a mesh, or it lacks the base link.
    """
    urdf = simulated_urdf(described)
    with TemporaryDirectory() as folder:
        try:
            arm = client.loadURDF(str(_completed(urdf, Path(folder), bodies_shown)), useFixedBase=True)
        except PhysicsError as error:
            raise RobotError(f"PyBullet cannot read {urdf}: are its meshes where it says?") from error
    infos = [client.getJointInfo(arm, index) for index in range(client.getNumJoints(arm))]
    if client.getBodyInfo(arm)[0].decode() == described.base_link:
        return arm
    base = [info[0] for info in infos if info[12].decode() == described.base_link]
    if not base:
        raise RobotError(f"link '{described.base_link}' is not in {urdf}")
    state = client.getLinkState(arm, base[0], computeForwardKinematics=True)
    back = Rotation.from_quat(state[5]).inv()
    client.resetBasePositionAndOrientation(arm, -back.apply(state[4]), back.as_quat())
    client.setGravity(*back.apply((0.0, 0.0, -GRAVITY)))
    return arm


def joint_numbers(client: PhysicsClient, arm: int) -> dict[str, int]:
    """PyBullet's numbers of an arm's joints, in their order, by name."""
    infos = [client.getJointInfo(arm, index) for index in range(client.getNumJoints(arm))]
    return {info[1].decode(): info[0] for info in infos}


def _completed(urdf: Path, folder: Path, bodies_shown: bool) -> Path:
    """The URDF itself, or where links with bodies lack their masses, or others are shown, a copy in a folder."""
    root = read_urdf(urdf)
    if not complete_inertials(root, urdf) and not bodies_shown:
        return urdf
    if bodies_shown:
        for link in root.iter("link"):
            for drawn in link.findall("visual"):
                link.remove(drawn)
            for body in link.findall("collision"):
                shown = deepcopy(body)
                shown.tag = "visual"
                link.append(shown)
    for mesh in root.iter("mesh"):
        # As PyBullet does, from the URDF's folder.
        name = mesh.get("filename", "").removeprefix("package://")
        mesh.set("filename", str((urdf.parent / name).resolve()))
    copy = folder / urdf.name
    copy.write_text(ElementTree.tostring(root, encoding="unicode"))
    return copy


def standing_beside(infos: Sequence[tuple], joints: Sequence[int]) -> dict[int, float]:
    """Where joints beside the chain stand [rad, m] whose limits do not hold 0: at the nearer of them; by number."""
    limits = {info[0]: info[8:10] for info in infos if info[0] not in joints}
    return {
        index: min(max(0.0, lower), upper)
        for index, (lower, upper) in limits.items()
        if lower < upper and not lower <= 0.0 <= upper
    }


def strengths(efforts: Sequence[float], robot: Robot, described: RobotDescription) -> list[float]:
    """Strengths (n,) of the motors [N m; prismatic: N]: limits of effort (n,), or what holds the arm where these are 0.
    """
    if all(effort > 0.0 for effort in efforts):
        return list(efforts)
    urdf = simulated_urdf(described)
    root = read_urdf(urdf)
    complete_inertials(root, urdf)
    held = holding_strengths(robot, root)
    return [effort if effort > 0.0 else float(own) for effort, own in zip(efforts, held, strict=True)]
