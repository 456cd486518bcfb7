"""The arm as spheres: how near a configuration comes to the arm itself.

The spheres hold all of the collision meshes, so a clearance is never larger than that of the meshes (as a penetration
grows deeper the two may differ in depth, not in sign). Which spheres an arm has is written in a file of its folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import yaml

from geodesic_motion_ros.robot.body_points import BodyPoints, link_points, place_body_points
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import VECTOR, Robot, contiguous
from geodesic_motion_ros.utils.checked_files import load_yaml
from geodesic_motion_ros.utils.errors import RobotError

POSITIONS = numba.types.Array(numba.float64, 3, "C", readonly=True)
PAIRS = numba.types.Array(numba.int64, 2, "C", readonly=True)


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """S spheres fixed to the links of an arm.

    Attributes
    ----------
    points : their centres, named after their links, or the objects that they cover.
    radii : (S,) [m].
    moving : (S,) bool, which of them are kept away from obstacles: those that joints move. The others, those of the
        base, matter to self-collision alone: no motion keeps them from an obstacle.
    self_pairs : (P, 2) int64, the spheres that must not overlap: of links that can meet, one of these pairs overlaps
        wherever they touch. Spheres of other pairs may overlap in any configuration.
    """

    points: BodyPoints
    radii: np.ndarray
    moving: np.ndarray
    self_pairs: np.ndarray

    @classmethod
    def named(cls, name: str | Path) -> CollisionModel:
        """Of a robot that this package ships, or of a folder; errors as `Robot.named` and `load`."""
        return cls.load(RobotDescription.named(name).spheres, Robot.named(name))

    @classmethod
    def load(cls, path: str | Path, robot: Robot) -> CollisionModel:
        """Read a sphere file for an arm.

        The file is YAML. `spheres` maps links of the chain to lists of [x, y, z, radius] [m] in the link's frame;
        `self_collision` lists entries {links: [one, other]}: all their spheres are checked against each other, or, with
        a further `spheres: [[i, j], ...]`, sphere i of one against sphere j of the other, counted from 0.

        Raises
        ------
        RobotError : the file cannot be read or lacks one of the two parts; a link is not in the chain or without
            spheres; a sphere is not four finite numbers with a positive radius; a pair names no sphere.
        """
        file = Path(path).name
        try:
            table = load_yaml(Path(path).read_text())
        except (OSError, yaml.YAMLError) as error:
            raise RobotError(f"cannot read the sphere file {path}: {error}") from error
        if not isinstance(table, dict) or not isinstance(table.get("spheres"), dict) or not table["spheres"]:
            raise RobotError(f"{file} must have a mapping `spheres`: link -> list of [x, y, z, radius]")
        of_link = {link: _link_spheres(robot, link, rows, file) for link, rows in table["spheres"].items()}
        names = [link for link, rows in of_link.items() for _ in rows]
        frames = np.array([robot.link_names.index(name) for name in names], dtype=np.int64)
        spheres = np.concatenate(list(of_link.values()))
        pairs = _self_pairs(of_link, table.get("self_collision"), file)
        first_joint = int(np.flatnonzero(robot.chain[3] >= 0)[0])
        points = BodyPoints(tuple(names), frames, np.ascontiguousarray(spheres[:, :3]))
        return cls(points, spheres[:, 3].copy(), frames > first_joint, pairs)

    def __len__(self) -> int:
        return len(self.radii)

    def of_link(self, link: str) -> CollisionModel:
        """The spheres of one link alone, of which none can meet another.

        Raises
        ------
        RobotError : the link has no spheres.
        """
        own = np.array(self.points.names) == link
        if not np.any(own):
            names = ", ".join(dict.fromkeys(self.points.names))
            raise RobotError(f"the link '{link}' has no spheres; there are spheres of {names}")
        points = BodyPoints((link,) * int(np.sum(own)), self.points.frames[own], self.points.offsets[own])
        return CollisionModel(points, self.radii[own], self.moving[own], np.empty((0, 2), dtype=np.int64))

    def guarding_tool(
        self, robot: Robot, points: Sequence[Sequence[float]], radii: Sequence[float]
    ) -> CollisionModel:
        """Of which only spheres (K, 3), (K,) [m] fixed to the robot's tool are kept away from obstacles; all of the
        arm's are still kept away from each other.
        """
        joined = self._with(robot, [robot.tool_link] * len(radii), points, radii)
        return replace(joined, moving=np.repeat([False, True], [len(self), len(radii)]))

    def holding(self, robot: Robot, objects: Sequence[HeldObject]) -> CollisionModel:
        """With the spheres of objects that the robot's tool holds, which are kept away from obstacles like its own, and
        from the spheres of all links that two joints or more turn against the tool; the hand, and the link before the
        last joint, they may overlap.
        """
        model = self
        turned = np.append(0, np.cumsum(robot.chain[3] >= 0))
        apart = np.flatnonzero(turned[self.points.frames] <= turned[-1] - 2)
        for held in objects:
            centres, radii = held.spheres
            own = np.arange(len(model), len(model) + len(radii))
            pairs = np.stack(np.meshgrid(own, apart, indexing="ij"), axis=-1).reshape(-1, 2)
            model = model._with(robot, [held.name] * len(radii), centres, radii)
            model = replace(model, self_pairs=np.concatenate([model.self_pairs, pairs]))
        return model

    def _with(
        self, robot: Robot, names: Sequence[str], points: Sequence[Sequence[float]], radii: Sequence[float]
    ) -> CollisionModel:
        """With spheres (K, 3), (K,) [m] fixed to the robot's tool, of names (K,)."""
        frame = np.full(len(radii), robot.link_names.index(robot.tool_link), dtype=np.int64)
        joined = BodyPoints(
            (*self.points.names, *names), np.concatenate([self.points.frames, frame]),
            np.concatenate([self.points.offsets, link_points(robot, robot.tool_link, points)]),
        )  # fmt: skip
        moving = np.append(self.moving, np.ones(len(radii), dtype=bool))
        return CollisionModel(joined, np.concatenate([self.radii, radii]), moving, self.self_pairs)

    def link_of(self, sphere: int) -> str:
        """The link that a sphere is fixed to, or the object that it covers."""
        return self.points.names[sphere]

    def positions(self, robot: Robot, configurations: np.ndarray) -> np.ndarray:
        """Centres (n, S, 3) [m] of the spheres in the base frame in configurations (n, eta) [rad]."""
        return place_body_points(contiguous(configurations), self.points.frames, self.points.offsets, robot.chain)


def tool_spheres(name: str | Path) -> np.ndarray:
    """Spheres (K, 4) [m] of a robot's tool in the frame of its tool link: those its folder lists, or its hand's.

    Raises
    ------
    RobotError : the folder says neither, or the hand has no spheres, or joints move it against the tool.
    """
    described = RobotDescription.named(name)
    if described.tool_spheres:
        return np.array(described.tool_spheres)
    if described.hand is None:
        raise RobotError(f"{described.folder}: neither a hand nor tool_spheres is listed: list one of them")
    robot = Robot.named(name)
    model = CollisionModel.load(described.spheres, robot).of_link(described.hand)
    frame = int(model.points.frames[0])
    if np.any(robot.chain[3][frame:] >= 0):
        raise RobotError(f"the hand '{described.hand}' of robot {described.name!r} does not move with its tool link")
    rotations, origins = robot.link_frames(robot.ready)
    placed = model.positions(robot, robot.ready[None])[0]
    return np.column_stack([(placed - origins[-1]) @ rotations[-1], model.radii])


def self_clearance(model: CollisionModel, robot: Robot, configuration: np.ndarray) -> tuple[float, tuple[int, int]]:
    """Signed distance [m] between the spheres of an arm that must not overlap, and the two that are nearest.

    configuration is (eta,) [rad]. Positive: no two links touch but neighbours, which overlap at their joint. It is no
    larger than the distance of the links, except of those whose pairs were chosen to tell their contact alone.
    (inf, (-1, -1)) for an arm whose links cannot meet.
    """
    if not len(model.self_pairs):
        return np.inf, (-1, -1)
    clearances, nearest = self_clearances(model.positions(robot, configuration[None]), model.radii, model.self_pairs)
    one, other = model.self_pairs[nearest[0]].tolist()
    return float(clearances[0]), (one, other)


@numba.njit((POSITIONS, VECTOR, PAIRS), cache=True, nogil=True)
def self_clearances(positions, radii, pairs):
    """Smallest signed distance (n,) [m] between pairs (P, 2) of spheres at (n, S, 3), and the number of that pair (n,).

    inf and -1 without pairs.
    """
    smallest = np.full(len(positions), np.inf)
    nearest = np.full(len(positions), -1)
    for i in range(len(positions)):
        for pair in range(len(pairs)):
            one, other = pairs[pair, 0], pairs[pair, 1]
            squared = 0.0
            for axis in range(3):
                squared += (positions[i, one, axis] - positions[i, other, axis]) ** 2
            # nearly all pairs are farther apart than the nearest so far: no root for them
            reach = smallest[i] + radii[one] + radii[other]
            if reach > 0.0 and squared < reach * reach:
                smallest[i] = np.sqrt(squared) - radii[one] - radii[other]
                nearest[i] = pair
    return smallest, nearest


def _link_spheres(robot: Robot, link: str, rows: Any, file: str) -> np.ndarray:
    """Spheres (S, 4) of one link, checked."""
    wanted = f"spheres of link '{link}' in {file}: expected a list of [x, y, z, radius]"
    if not isinstance(rows, list) or not rows or not all(isinstance(row, list) and len(row) == 4 for row in rows):
        raise RobotError(f"{wanted}, not {rows}")
    centres = link_points(robot, link, [row[:3] for row in rows])
    try:
        radii = np.array([row[3] for row in rows], dtype=float)
    except (TypeError, ValueError) as error:
        raise RobotError(f"{wanted} with numbers in metres") from error
    if not np.all(np.isfinite(radii) & (radii > 0.0)):
        raise RobotError(f"{wanted} with positive radii, not {radii.tolist()}")
    return np.column_stack([centres, radii])


def _self_pairs(of_link: dict[str, np.ndarray], entries: Any, file: str) -> np.ndarray:
    """Pairs (P, 2) of sphere numbers that a file's `self_collision` asks for."""
    if not isinstance(entries, list):
        raise RobotError(f"{file} must have a list `self_collision` of {{links: [one, other]}}; it may be empty")
    first, counts, total = {}, {}, 0
    for link, rows in of_link.items():
        first[link], counts[link], total = total, len(rows), total + len(rows)
    pairs: list[tuple[int, int]] = []
    for entry in entries:
        links = entry.get("links") if isinstance(entry, dict) else None
        if not isinstance(links, list) or len(links) != 2:
            raise RobotError(f"self_collision in {file} has the entry {entry}: expected {{links: [one, other]}}")
        for link in links:
            if link not in first:
                raise RobotError(
                    f"self_collision in {file} names the link '{link}', which has no spheres; "
                    f"there are spheres of {', '.join(map(str, first))}"
                )
        one, other = links
        rows, columns = range(counts[one]), range(counts[other])
        for pair in entry.get("spheres", [[i, j] for i in rows for j in columns]):
            if not (isinstance(pair, list) and len(pair) == 2 and pair[0] in rows and pair[1] in columns):
                raise RobotError(
                    f"self_collision in {file} names the spheres {pair} of '{one}' and '{other}': expected two numbers "
                    f"from 0 below {counts[one]} and {counts[other]}"
                )
            pairs.append((first[one] + pair[0], first[other] + pair[1]))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
