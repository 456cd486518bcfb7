"""Makes a robot's folder (`description.py`) out of a URDF: what `geodesic-motion robot` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial import ConvexHull, QhullError

from geodesic_motion_ros.robot.collision_bodies import (
    Body,
    beside_positions,
    collision_bodies,
    drawn_alone,
    read_mesh,
    write_mesh,
)
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.convex_parts import convex_parts
from geodesic_motion_ros.robot.description import FILE
from geodesic_motion_ros.robot.inertials import complete_inertials
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.mounting import UPRIGHT, is_upright, mount
from geodesic_motion_ros.robot.self_pairs import LinkPair, draw_self_pairs
from geodesic_motion_ros.robot.sphere_cover import DECIMALS, PROTRUSION, SPACING, file_spheres
from geodesic_motion_ros.robot.urdf import read_floats, read_urdf
from geodesic_motion_ros.utils.errors import ParameterError, RobotError

HAND_PROTRUSION = 0.02
"""How far [m] spheres of the links that the last joint carries may stick out: they come near things."""
THINNEST = 0.004
"""Bodies that are too thin for a protrusion are covered with half of it, and so on down to this [m]."""
FALSE_ALARMS, FINER = 0.1, 5.0 / 6.0
"""Where spheres of two links overlap, while their bodies are apart, in more than this share of the draws, the arm is
covered once more with this multiple of the protrusions: it would be refused, folded up, where a real one stands.
"""
MOST_CENTRES = 20_000
"""Spheres of a body, as of a mobile base, are chosen from so many at most: memory and time grow with the square."""
POSTURES = 2000
"""Drawn, of which the ready posture is the best."""
ADRIFT = 0.1
"""Links whose spheres are farther [m] than this from the rest of the arm are hardly where their meshes are meant to be.
"""
APART = 0.01
"""Distance [m] of the spheres that are kept apart, in a ready posture that is proposed."""

#: Called as progress(stage, step, steps).
Progress = Callable[[str, int, int], None]

@dataclass(frozen=True)
class Limits:
    """What a URDF does not say, (n,) each in SI units.

    source : where the numbers are from.
    """

    acceleration: Sequence[float]
    jerk: Sequence[float]
    source: str


@dataclass(frozen=True)
class MadeRobot:
    """What was made, and what of the URDF needs a person's eye.

    Attributes
    ----------
    folder : the folder. bodies : of the URDF. spheres : (S, 4) [m] by link. pairs : of links that touch.
    beside : where the joints beside the chain stand [rad, m], by name.
    without_inertial : links with bodies whose masses were chosen.
    drawn_alone : links with a <visual> but no <collision>, of which nothing is guarded.
    """

    folder: Path
    bodies: tuple[Body, ...]
    spheres: Mapping[str, np.ndarray]
    pairs: tuple[LinkPair, ...]
    beside: Mapping[str, float]
    without_inertial: tuple[str, ...]
    drawn_alone: tuple[str, ...]

    def farthest_outside(self) -> float:
        """How far [m] the farthest vertex of a body is outside all spheres of its link; negative: none is."""
        return max(float(_outside(body.vertices, self.spheres[body.link]).max()) for body in self.bodies)

    def adrift(self) -> dict[str, float]:
        """How far [m] from all of the arm that hangs together the links are that do not, `ADRIFT`, by their names.

        In the ready posture. So are meshes that were written in the frame of the base and not of their links.
        """
        robot = Robot.named(self.folder)
        rotations, origins = robot.link_frames(robot.ready)
        placed = {}
        for link, spheres in self.spheres.items():
            number = robot.link_names.index(link)
            placed[link] = np.column_stack([spheres[:, :3] @ rotations[number].T + origins[number], spheres[:, 3]])
        joined = placed.pop(next(iter(placed)))
        while placed:
            gaps = {link: float(np.min(_outside(rows[:, :3], joined) - rows[:, 3])) for link, rows in placed.items()}
            if min(gaps.values()) > ADRIFT:
                return gaps
            joined = np.concatenate([joined, placed.pop(min(gaps, key=gaps.__getitem__))])
        return {}


def make_robot(
    urdf: Path,
    base_link: str,
    tool_link: str,
    out: Path,
    limits: Limits,
    name: str | None = None,
    ready: Sequence[float] | None = None,
    beside: Mapping[str, float] | None = None,
    progress: Progress = lambda stage, step, steps: None,
) -> MadeRobot:
    """Write a robot's folder, whole or not at all: a URDF of what moves and collides, meshes, limits, spheres, pairs.

    Parameters
    ----------
    urdf : with paths of meshes that are absolute, or relative to it: `plain_urdf`.
    ready : (n,) [rad]; None: a posture is proposed.
    beside : positions [rad, m] of joints beside the chain, as of fingers: `beside_positions`.

    Raises
    ------
    RobotError : the URDF does not fit, as `Robot.from_urdf` and `collision_bodies`.
    ParameterError : the folder exists, or bodies cannot be covered.
    """
    out = out.absolute()
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise ParameterError(f"{out} exists and is no empty folder: give another one")
    source = Robot.from_urdf(urdf, base_link, tool_link)
    posture = None if ready is None else source.checked(np.array(ready))
    standing = beside_positions(source, beside)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        scratch = TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent)
    except OSError as error:
        raise ParameterError(f"{out} cannot be made ({error.strerror}): give another folder") from error
    with scratch:
        draft = Path(scratch.name) / "robot"
        draft.mkdir()
        made = _write(source, draft, limits, name or out.name, posture, standing, progress)
        Robot.named(draft)  # what cannot be read is no robot
        draft.replace(out)
    return replace(made, folder=out)


def _write(
    source: Robot, out: Path, limits: Limits, name: str, posture: np.ndarray | None, beside: Mapping[str, float],
    progress: Progress,
) -> MadeRobot:  # fmt: skip
    """Write the files of a folder; spheres and pairs are those of the bodies in it."""
    urdf = out / source.urdf.name
    without_inertial = _write_urdf(source.urdf, urdf, progress)
    _write_limits(source, limits, out / "joint_limits.yaml")
    robot = Robot.from_urdf(urdf, source.base_link, source.tool_link)
    bodies = collision_bodies(robot, beside)
    spheres, pairs = cover_and_pair(robot, bodies, progress)
    (out / "spheres.yaml").write_text(_spheres_text(spheres, [pair for pair in pairs if pair.spheres != ()]))
    model = CollisionModel.load(out / "spheres.yaml", robot)
    posture = propose_ready(robot, model) if posture is None else posture
    clearance, (one, other) = self_clearance(model, robot, posture)
    if clearance <= 0.0:
        raise RobotError(f"at the ready posture {model.link_of(one)} touches {model.link_of(other)}: give another one")
    described = {
        "name": name, "urdf": urdf.name, "base_link": robot.base_link, "tool_link": robot.tool_link,
        "limits": "joint_limits.yaml", "limits_source": limits.source, "ready": [float(x) for x in posture],
        "spheres": "spheres.yaml",
    }  # fmt: skip
    last = bodies[-1].link
    if not np.any(robot.chain[3][robot.link_names.index(last) :] >= 0):  # it moves with the tool
        described["hand"] = last
    if moved := {joint: float(value) for joint, value in beside.items() if value != 0.0}:
        described["simulation"] = {"joints": moved}
    (out / FILE).write_text(yaml.safe_dump(described, sort_keys=False, default_flow_style=None, width=110))
    return MadeRobot(out, bodies, spheres, pairs, beside, without_inertial, drawn_alone(source))


def cover_and_pair(
    robot: Robot, bodies: Sequence[Body], progress: Progress = lambda stage, step, steps: None
) -> tuple[dict[str, np.ndarray], tuple[LinkPair, ...]]:
    """Spheres that hold all bodies, as of `cover_bodies`, `FINER` where of some links `FALSE_ALARMS` are many; and the
    pairs kept apart.
    """
    for share in (1.0, FINER):
        spheres = cover_bodies(robot, bodies, share, progress)
        pairs = draw_self_pairs(robot, spheres, bodies, progress=progress)
        if all(pair.overlapping - pair.touching <= FALSE_ALARMS for pair in pairs):
            break
    return spheres, pairs


def cover_bodies(
    robot: Robot, bodies: Sequence[Body], share: float = 1.0,
    progress: Progress = lambda stage, step, steps: None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Spheres (S, 4) [m] by link, base first, that hold all bodies; share : of the usual protrusions.

    A body that the first joint alone turns is as high above what an upright arm stands on, z = 0, in every posture:
    where its spheres are lower than that, and it is not, finer ones are taken.
    """
    turned = np.append(0, np.cumsum(robot.chain[3] >= 0))
    rotations, origins = robot.link_frames(robot.ready)
    upright = is_upright(robot)
    found: dict[str, list[np.ndarray]] = {}
    for number, body in enumerate(bodies):
        progress("covering", number, len(bodies))
        link = robot.link_names.index(body.link)
        protrusion = share * (HAND_PROTRUSION if turned[link] == turned[-1] else PROTRUSION)
        rows = _covered(body, protrusion)
        up, height = rotations[link][2], origins[link][2]
        lowest = np.min(rows[:, :3] @ up - rows[:, 3])
        if upright and turned[link] == 1 and lowest < -height < np.min(body.vertices @ up):
            rows = _covered(body, 0.5 * protrusion)
        found.setdefault(body.link, []).append(rows)
    return {link: np.concatenate(rows) for link, rows in found.items()}


def propose_ready(robot: Robot, model: CollisionModel) -> np.ndarray:
    """A posture (n,) [rad] far from limits and singularities, the tool before and above the base, `APART` from itself.

    Of drawn ones within the middle half of the joints' ranges, that of the largest manipulability, the product of the
    singular values of J, times the smallest distance from a limit as a share of its range. The tool of an arm that is
    turned against its base frame, as on a wall, is away from what it is mounted on, and from the axis of that.

    Raises
    ------
    RobotError : none has its tool there.
    """
    bounded = np.isfinite(robot.lower)
    lower, upper = np.where(bounded, robot.lower, -np.pi), np.where(bounded, robot.upper, np.pi)
    middle = 0.5 * (lower + upper)
    drawn = np.round(middle + 0.5 * (robot.sample(POSTURES, np.random.default_rng(0)) - middle), 3)
    turned, foot = mount(robot)
    mounted = turned[2, 2] < UPRIGHT
    best, posture = 0.0, None
    for q in drawn:
        tool, _ = robot.forward(q)
        before, above = tool[0], tool[2]
        if mounted:
            beside, across, above = (tool - foot) @ turned
            before = np.hypot(beside, across)
        if above < 0.1 * robot.reach or before < 0.2 * robot.reach:
            continue
        rooms = np.minimum(q - lower, upper - q)[bounded] / (upper - lower)[bounded]
        score = np.min(rooms, initial=0.5) * np.prod(np.linalg.svd(robot.jacobian(q), compute_uv=False))
        if score > best and self_clearance(model, robot, q)[0] >= APART:
            best, posture = score, q
    if posture is None:
        where = "before and above the base"
        if mounted:
            angle = np.degrees(np.arccos(np.clip(turned[2, 2], -1.0, 1.0)))
            where = f"away from what the arm is mounted on, by {angle:.0f} deg against '{robot.base_link}'"
        raise RobotError(f"no posture was found with the tool {where}: give one with --ready")
    return posture


def _covered(body: Body, protrusion: float) -> np.ndarray:
    """Spheres (S, 4) [m] that hold a body and stick out by a protrusion: more, where it has more centres than
    MOST_CENTRES, and less where it is so thin that it has too few."""
    try:
        volume = ConvexHull(body.vertices).volume
    except QhullError as error:
        raise RobotError(f"a collision body of link '{body.name}' is flat: it needs a thickness") from error
    least = max(THINNEST, (volume / MOST_CENTRES) ** (1.0 / 3.0) / SPACING)
    protrusion = max(protrusion, least)
    while True:
        try:
            return file_spheres(body.vertices, protrusion)
        except ParameterError as error:
            protrusion *= 0.5
            if protrusion < least:
                raise ParameterError(f"the collision body of link '{body.name}' cannot be covered: {error}") from error


def _outside(points: np.ndarray, spheres: np.ndarray) -> np.ndarray:
    """How far (V,) [m] points are outside the union of spheres (S, 4)."""
    gaps = np.linalg.norm(points[:, None] - spheres[:, :3], axis=-1) - spheres[:, 3]
    return gaps.min(axis=1)


def _write_urdf(source: Path, path: Path, progress: Progress) -> tuple[str, ...]:
    """Write the URDF without what is not used here; the links with bodies whose masses were chosen.

    Its meshes are those that collide, in convex parts, for the eye too.
    """
    root, parts_of = read_urdf(source), cache(lambda mesh: convex_parts(read_mesh(mesh)))
    for extra in [child for child in root if child.tag not in ("link", "joint")]:
        root.remove(extra)
    links = root.findall("link")
    for step, link in enumerate(links):
        progress("cutting", step, len(links))
        for visual in link.findall("visual"):
            link.remove(visual)
        parts = []
        for collision in link.findall("collision"):
            link.remove(collision)
            parts += _convex(collision, source, parts_of)
        for number, (part, triangles) in enumerate(parts, start=1):
            if triangles is not None:
                # called by the link, for meshes of several folders may have one name
                file = path.parent / "meshes" / f"{link.get('name', '').replace('/', '_')}_{number}.stl"
                file.parent.mkdir(exist_ok=True)
                write_mesh(triangles, file)
                part.find("geometry/mesh").set("filename", f"{file.parent.name}/{file.name}")
            shown = deepcopy(part)
            shown.tag = "visual"
            link.extend((part, shown))
    without_inertial = complete_inertials(root, path)
    ElementTree.indent(root)
    path.write_text(f'<?xml version="1.0"?>\n{ElementTree.tostring(root, encoding="unicode")}\n')
    return without_inertial


def _convex(
    collision: ElementTree.Element, urdf: Path, parts_of: Callable[[Path], list[np.ndarray]]
) -> list[tuple[ElementTree.Element, np.ndarray | None]]:
    """A collision body, or one for each convex part of its mesh with its triangles (T, 3, 3)."""
    mesh = collision.find("geometry/mesh")
    if mesh is None:
        return [(collision, None)]
    source = urdf.parent / mesh.get("filename", "")
    scale = np.array(read_floats(mesh.attrib.pop("scale", "1 1 1"), 3, f"scale of mesh {source.name}"))
    order = slice(None, None, 1 if np.prod(scale) > 0.0 else -1)  # seen from outside a mirrored triangle turns over
    try:
        return [(deepcopy(collision), (triangles * scale)[:, order]) for triangles in parts_of(source)]
    except ValueError as error:
        raise RobotError(f"mesh {source} holds no body: {error}") from error


def _write_limits(robot: Robot, limits: Limits, path: Path) -> None:
    table = {}
    for i, joint in enumerate(robot.joint_names):
        table[joint] = {"max_acceleration": float(limits.acceleration[i]), "max_jerk": float(limits.jerk[i])}
    text = yaml.safe_dump({"joint_limits": table}, sort_keys=False, default_flow_style=None)
    path.write_text(f"# Accelerations [rad/s^2], jerks [rad/s^3]. From: {limits.source}\n{text}")


def _spheres_text(spheres: Mapping[str, np.ndarray], pairs: Sequence[LinkPair]) -> str:
    lines = ["# Spheres that hold the collision bodies, made by `geodesic-motion robot`.", "spheres:"]
    for link, rows in spheres.items():
        lines.append(f"  {link}:  # [x, y, z, radius] [m] in its frame")
        lines += [f"    - [{', '.join(f'{value:.{DECIMALS}f}' for value in row)}]" for row in rows]
    lines.append("self_collision:" if pairs else "self_collision: []")
    for pair in pairs:
        chosen = "" if pair.spheres is None else f", spheres: {[list(two) for two in pair.spheres]}"
        lines.append(f"  - {{links: [{', '.join(pair.links)}]{chosen}}}")
    return "\n".join(lines) + "\n"
