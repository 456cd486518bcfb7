"""DeclaredScene: what always stands around an arm, as its user declares it in a file.

People who demonstrate keep off tables and walls without saying so; a path that leaves what they demonstrated has to
know of them. A scene is counted always and is never stale, in the search and in the certificate of every motion. It has
no soft side: what was demonstrated near a table is as good as what was demonstrated elsewhere.

A file is YAML, lengths in metres, all in the arm's base frame:

    boxes:
      - {name: table, centre: [0.5, 0.0, -0.37], size: [1.0, 1.6, 0.72]}   # quaternion: [w, x, y, z] turns it
    cylinders:
      - {name: post, centre: [0.3, 0.6, 0.4], radius: 0.05, height: 0.8}   # along z; turned likewise
    planes:
      - {name: wall, point: [-0.6, 0.0, 0.0], normal: [1.0, 0.0, 0.0]}     # all that is behind it is occupied
    keep_out:
      - {name: screen, centre: [0.9, 0.0, 0.5], size: [0.2, 0.8, 0.5]}     # a box that is empty, and stays so
    seen:
      - {name: front, centre: [0.5, 0.0, 0.4], size: [0.9, 1.4, 0.8]}      # no obstacle: empty for ever, or observed
                                                                           # wholly; with `unseen: blocked` it counts
    workspace: {lower: [-0.9, -0.9, -0.1], upper: [0.9, 0.9, 1.3]}         # the arm stays inside
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.geometry.quaternions import normalise, to_rotation
from geodesic_motion_ros.geometry.shapes import no_solids, solid_distances, solid_rows
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.checked_files import brief, opened, read_yaml
from geodesic_motion_ros.utils.checked_numbers import LARGEST_NUMBER
from geodesic_motion_ros.utils.errors import FileError, GeodesicMotionError, SkillError
from geodesic_motion_ros.utils.shared_files import SharedFileError, find_shared

#: Demonstrations that enter a scene by more than this [m] were not recorded in it: decoders are less far off.
DEMONSTRATION_DEPTH = 0.01

#: What stands in these lists of a file a body can touch; the rest is empty space that the arm is to stay out of.
MASSIVE = ("boxes", "cylinders", "planes")

#: A plane is a plate of this size and thickness [m] behind it: thicker than any step of a search, farther than arms go.
_PLATE, _THICKNESS = 20.0, 0.5
#: A file is no larger [B].
_LARGEST = 1 << 20
#: What entries of each list have; those after the bar may be left out.
_ENTRIES = {
    "boxes": ("name", "centre", "size", "|", "quaternion"),
    "cylinders": ("name", "centre", "radius", "height", "|", "quaternion"),
    "planes": ("name", "point", "normal"),
    "keep_out": ("name", "centre", "size", "|", "quaternion"),
    "seen": ("name", "centre", "size", "|", "quaternion"),
}
_WORKSPACE = ("lower", "upper")
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class DeclaredScene:
    """The surroundings of the arm as a user declares them: solids that always stand, which no motion may enter.

    Attributes
    ----------
    names : of the b solids. solids : (b, 16) rows as of `geometry/shapes.py`.
    kinds : the list of the file that each stands in: `boxes`, `cylinders` (of which the solid is the box around it, its
        axis the box's z), `planes` (a plate behind it), `keep_out`, `workspace`.
    seen : (n, 16) boxes that are no obstacles: empty for ever, or the obstacle source observes them wholly.
    described : what a file says of them.
    """

    names: tuple[str, ...]
    solids: np.ndarray
    kinds: tuple[str, ...]
    seen: np.ndarray
    described: dict[str, Any]

    @classmethod
    def empty(cls) -> DeclaredScene:
        """Return the scene in which nothing stands around the arm."""
        return cls((), no_solids(), (), no_solids(), {})

    @classmethod
    def from_name(cls, name: str) -> DeclaredScene | None:
        """Return the scene that a user names: a file, the name of a file in config/scenes, or `none` where nothing
        stands; an empty text declares nothing, None.

        Raises
        ------
        FileError : as of `load`, or no such scene is shipped.
        """
        if name in ("", "none"):
            return cls.empty() if name else None
        path = Path(name)
        if path.name == name and not path.suffix:
            try:
                path = find_shared(f"config/scenes/{name}.yaml")
            except SharedFileError as error:
                shipped = sorted(file.stem for file in find_shared("config/scenes").glob("*.yaml"))
                known = ", ".join(["none", *shipped])
                raise FileError(f"there is no scene '{name}': give {known}, or a file like {name}.yaml") from error
        return cls.load(path)

    @classmethod
    def of_skill(cls, skill: Skill) -> DeclaredScene | None:
        """Return the scene in which a skill was demonstrated; None where the skill does not state it.

        Raises
        ------
        SkillError : what the skill says is no scene.
        """
        if skill.scene is None:
            return None
        try:
            return cls.of(skill.scene)
        except FileError as error:
            raise SkillError(f"skill {skill.name}: its scene is none: {error}") from error

    @classmethod
    def load(cls, path: str | Path) -> DeclaredScene:
        """Read a scene file.

        Raises
        ------
        FileError : it cannot be read, is no YAML of this form, names something twice or with a number that makes no
            sense; the message names file, entry and reason.
        """
        try:
            with opened(Path(path), _LARGEST) as stream:
                table = read_yaml(stream.read())
            return cls.of(table)
        except OSError as error:
            raise FileError(f"scene {path}: cannot be read ({error.strerror or error})") from error
        except GeodesicMotionError as error:
            raise FileError(f"scene {path}: {error}") from error

    @classmethod
    def of(cls, table: Any) -> DeclaredScene:
        """Return the scene of a table as a file holds it; FileError as of `load`."""
        known = (*_ENTRIES, "workspace")
        if not isinstance(table, dict):
            raise FileError(f"must be a table with {', '.join(known)}; an empty scene is {{}}")
        for key in table:
            _check_known(key, known, "the scene")
        rows: list[np.ndarray] = []
        seen: list[np.ndarray] = []
        called: set[str] = set()
        names: list[str] = []
        kinds: list[str] = []
        for kind in _ENTRIES:
            for name, row in _entries(kind, table.get(kind)):
                if name in called:
                    raise FileError(f"two things are called '{name}'")
                called.add(name)
                if kind == "seen":
                    seen.append(row)
                    continue
                names.append(name)
                rows.append(row)
                kinds.append(kind)
        for side, row in _workspace(table.get("workspace")):
            names.append(side)
            rows.append(row)
            kinds.append("workspace")
        solids, boxes = (np.concatenate([no_solids(), *listed]) for listed in (rows, seen))
        return cls(tuple(names), solids, tuple(kinds), boxes, table)

    @property
    def obstacles(self) -> Obstacles:
        """The solids of the scene as obstacles that stand."""
        none = Obstacles.none()
        return Obstacles(
            none.centres, none.radii, none.velocities, self.solids, np.zeros((len(self.solids), 3)), none.cloud
        )

    def clearances(self, spheres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Return the smallest signed distance [m] of a body's spheres (n, S, 3), (S,) from any of the solids, (n,); inf
        where there is none.
        """
        if not self.names:
            return np.full(len(spheres), np.inf)
        distances = solid_distances(np.ascontiguousarray(spheres).reshape(-1, 3), self.solids)
        return np.min(distances.reshape(spheres.shape[:2]) - radii, axis=1)

    def nearest(self, spheres: np.ndarray, radii: np.ndarray) -> tuple[float, str, int]:
        """Return the smallest signed distance [m] of spheres (S, 3), (S,) from a solid, that one's name and the
        sphere's number; inf, "" and -1 in an empty scene.
        """
        if not self.names:
            return math.inf, "", -1
        apart = np.stack([solid_distances(np.ascontiguousarray(spheres), row[None]) - radii for row in self.solids])
        solid, sphere = np.unravel_index(int(np.argmin(apart)), apart.shape)
        return float(apart[solid, sphere]), self.names[solid], int(sphere)


def check_demonstrations(scene: DeclaredScene, skill: Skill, spheres: np.ndarray, radii: np.ndarray) -> None:
    """Raise SkillError where a skill's demonstrations, as it decodes them, enter a scene by more than
    `DEMONSTRATION_DEPTH`.

    spheres, radii : (n, S, 3), (S,) [m] along all demonstrations (`OutputSpace.demonstrated_spheres`). Nodes that enter
        it by less are left out of the search.
    """
    if not scene.names:
        return
    samples = skill.codes.shape[1]
    clearances = scene.clearances(spheres, radii)
    worst = int(np.argmin(clearances))
    if clearances[worst] >= -DEMONSTRATION_DEPTH:
        return
    depth, part, _ = scene.nearest(spheres[worst], radii)
    raise SkillError(
        f"skill {skill.name}: demonstration {worst // samples} is {-1000 * depth:.0f} mm inside '{part}' of the scene "
        f"at sample {worst % samples}, {100 * (worst % samples) / (samples - 1):.0f} % of its path: it was recorded in "
        f"another one, or '{part}' stands elsewhere"
    )


def _entries(kind: str, listed: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Names and solids (1, 16) of one list of the file."""
    if listed is None:
        return
    if not isinstance(listed, list):
        raise FileError(f"{kind} must be a list of {{{', '.join(_needed(kind))}}}, is {brief(listed)}")
    for number, entry in enumerate(listed):
        where = f"{kind}[{number}]"
        if not isinstance(entry, dict):
            raise FileError(f"{where} must be {{{', '.join(_needed(kind))}}}, is {brief(entry)}")
        name = entry.get("name")
        if not isinstance(name, str) or not name:
            raise FileError(f"{where} has no name")
        where = f"'{name}' in {kind}"
        for key in entry:
            _check_known(key, tuple(field for field in _ENTRIES[kind] if field != "|"), where)
        for field in _needed(kind):
            if field not in entry:
                raise FileError(f"{where} has no {field}")
        yield name, _solid(kind, where, entry)


def _needed(kind: str) -> tuple[str, ...]:
    fields = _ENTRIES[kind]
    return fields[: fields.index("|")] if "|" in fields else fields


def _solid(kind: str, where: str, entry: dict[str, Any]) -> np.ndarray:
    if kind == "planes":
        normal = _vector(where, "normal", entry["normal"])
        length = np.linalg.norm(normal)
        if length < 1e-6:
            raise FileError(f"{where}: normal {normal.tolist()} has no direction")
        return _plate(_vector(where, "point", entry["point"]), normal / length)
    centre = _vector(where, "centre", entry["centre"])
    quaternion = np.asarray(entry.get("quaternion", _UPRIGHT))
    if quaternion.shape != (4,) or quaternion.dtype.kind not in "if" or not 0.5 < np.linalg.norm(quaternion) < 2.0:
        raise FileError(f"{where}: quaternion must be a unit one, [w, x, y, z], is {brief(entry['quaternion'])}")
    rotation = to_rotation(normalise(quaternion[None].astype(float))[0]).as_matrix()
    if kind == "cylinders":
        radius, height = (_size(where, name, entry[name]) for name in ("radius", "height"))
        # A box around it: a capsule would be longer than it by its diameter.
        extents = np.array([radius, radius, 0.5 * height])
    else:
        size = _vector(where, "size", entry["size"])
        if np.any(size <= 0.0):
            raise FileError(f"{where}: size {size.tolist()} must be positive along every axis")
        extents = 0.5 * size
    return solid_rows(centre[None], rotation[None], extents[None], np.zeros(1))


def _plate(point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The solid (1, 16) behind a plane through a point (3,) with a unit normal (3,)."""
    across = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(normal, across)
    first /= np.linalg.norm(first)
    rotation = np.column_stack([first, np.cross(normal, first), normal])
    extents = np.array([0.5 * _PLATE, 0.5 * _PLATE, 0.5 * _THICKNESS])
    return solid_rows((point - 0.5 * _THICKNESS * normal)[None], rotation[None], extents[None], np.zeros(1))


def _workspace(box: Any) -> Iterator[tuple[str, np.ndarray]]:
    """The six plates around a workspace."""
    if box is None:
        return
    if not isinstance(box, dict) or set(box) != set(_WORKSPACE):
        raise FileError(f"workspace must be {{lower: [x, y, z], upper: [x, y, z]}}, is {brief(box)}")
    lower, upper = (_vector("workspace", name, box[name]) for name in _WORKSPACE)
    if np.any(lower >= upper):
        raise FileError(f"workspace: lower {lower.tolist()} must be less than upper {upper.tolist()} along every axis")
    for axis, letter in enumerate("xyz"):
        inwards = np.eye(3)[axis]
        yield f"end of the workspace at -{letter}", _plate(lower, inwards)
        yield f"end of the workspace at +{letter}", _plate(upper, -inwards)


def _check_known(key: object, known: tuple[str, ...], where: str) -> None:
    if key not in known:
        near = difflib.get_close_matches(str(key), known, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise FileError(f"{where} has no {brief(key)}: there are {', '.join(known)}{hint}")


def _vector(where: str, name: str, value: Any) -> np.ndarray:
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.all(np.abs(vector) <= LARGEST_NUMBER):
        raise FileError(f"{where}: {name} must be three numbers [m], is {brief(value)}")
    return vector


def _size(where: str, name: str, value: Any) -> float:
    if type(value) not in (int, float) or not 0.0 < value <= LARGEST_NUMBER:
        raise FileError(f"{where}: {name} must be a positive number [m], is {brief(value)}")
    return float(value)
