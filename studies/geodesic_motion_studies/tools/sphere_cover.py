"""The sphere file of the Panda's folder: made of PyBullet's meshes, with pairs whose contact is proved possible."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from geodesic_motion_ros.robot.sphere_cover import DECIMALS, PROTRUSION, file_spheres
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry
from geodesic_motion_studies.tools.self_collision import joints_between, pairs_that_can_meet, telling_sphere_pairs

PANDA_PROTRUSIONS = dict.fromkeys(("panda_hand", "panda_leftfinger", "panda_rightfinger"), 0.02)
"""How far [m] those of the Panda's hand may, as that is what comes near things."""
HEADER = (
    "# Spheres that hold the collision meshes of this arm, made by geodesic_motion_studies.tools.sphere_cover: do not "
    "edit by hand.",
    "# self_collision: links that can meet; all their spheres are checked against each other, or those listed.",
)


def write_panda_spheres(path: Path) -> None:
    """Write the sphere file of the Panda's folder; takes about two minutes."""
    with CollisionGeometry("panda") as geometry:
        spheres = {
            part.name: file_spheres(part.vertices, PANDA_PROTRUSIONS.get(part.name, PROTRUSION))
            for part in geometry.parts
        }
        path.write_text(_file_text(geometry, spheres))


def _file_text(geometry: CollisionGeometry, spheres: Mapping[str, np.ndarray]) -> str:
    """A sphere file, see `CollisionModel.load`; the spheres of a part are listed under the link that carries it."""
    lines = [*HEADER, "spheres:"]
    first: dict[str, int] = {}
    counts: dict[str, int] = {}
    for part in geometry.parts:
        if part.link not in counts:
            lines.append(f"  {part.link}:  # [x, y, z, radius] [m] in its frame")
        first[part.name] = counts.get(part.link, 0)
        counts[part.link] = first[part.name] + len(spheres[part.name])
        rows = [", ".join(f"{value:.{DECIMALS}f}" for value in sphere) for sphere in spheres[part.name]]
        lines += [f"    - [{row}]  # {part.name}" for row in rows]
    links: dict[tuple[str, str], list[list[int]] | None] = {}
    always_close: dict[tuple[int, ...], list] = {}
    for one, other in pairs_that_can_meet(geometry):
        joints = joints_between(geometry, one, other)
        if len(joints) == 2:
            always_close.setdefault(tuple(joints), []).append((one, other))
        else:
            links[one.link, other.link] = None
    link_of = {part.name: part.link for part in geometry.parts}
    for group in always_close.values():
        for (one, i), (other, j) in telling_sphere_pairs(geometry, group, spheres):
            numbers = links.setdefault((link_of[one], link_of[other]), [])
            numbers.append([first[one] + i, first[other] + j])
    lines.append("self_collision:")
    for (one, other), numbers in links.items():
        chosen = "" if numbers is None else f", spheres: {numbers}"
        lines.append(f"  - {{links: [{one}, {other}]{chosen}}}")
    return "\n".join(lines) + "\n"
