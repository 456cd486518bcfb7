"""The file that describes a robot, URDF or xacro -> a plain URDF, its meshes found wherever their packages are.

Knows no ROS: xacro files are expanded by the library `xacro`, packages are looked for in the folders around the file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

from geodesic_motion_ros.robot.urdf import parse_urdf, read_urdf
from geodesic_motion_ros.utils.errors import RobotError

#: Names of meshes by their ROS package, as ROS and as Gazebo write them.
_PACKAGED = re.compile(r"(?:package|model)://([^/]+)/(.*)")


def plain_urdf(
    source: Path, folder: Path, arguments: Mapping[str, str] | None = None, packages: Mapping[str, Path] | None = None
) -> Path:
    """Write the URDF that a file describes into a folder.

    Parameters
    ----------
    source : a URDF or a xacro file.
    arguments : of the xacro file, by name.
    packages : folders of ROS packages by name, before those around the file and those of a sourced ROS.

    Returns
    -------
    The file, called like the source; its meshes that collide have absolute paths.

    Raises
    ------
    RobotError : the file cannot be read or expanded, an argument is not one of its, a package or a mesh is not found.
    """
    root = parse_urdf(_expanded(source, dict(arguments or {}), packages or {}), source)
    for mesh in root.iterfind("link/collision/geometry/mesh"):
        mesh.set("filename", str(mesh_path(mesh.get("filename", ""), source, packages or {})))
    path = folder / f"{source.name.removesuffix('.xacro').removesuffix('.urdf')}.urdf"
    path.write_text(ElementTree.tostring(root, encoding="unicode"))
    return path


def limit_velocities(urdf: Path, velocities: Mapping[str, float]) -> None:
    """Write limits of velocity [rad/s, m/s] into a URDF, by joint, in the place of those that it has or lacks."""
    root = read_urdf(urdf)
    for joint in root.findall("joint"):
        if joint.get("name") in velocities:
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit", effort="0") if limit is None else limit
            limit.set("velocity", str(velocities[joint.get("name")]))
    urdf.write_text(ElementTree.tostring(root, encoding="unicode"))


def published_urdf(urdf: Path, prefix: str = "") -> str:
    """The text of a URDF for the topic `robot_description`: meshes, also those that are shown alone, as file:// URLs.

    A mesh that is not there keeps its name. Names of links and joints get the prefix.
    """
    root = read_urdf(urdf)
    named = [*root.findall("link"), *root.findall("joint")]
    for element, key in [*((one, "name") for one in named), *_references(root)]:
        element.set(key, prefix + element.get(key, ""))
    for mesh in root.iter("mesh"):
        with suppress(RobotError):
            mesh.set("filename", mesh_path(mesh.get("filename", ""), urdf, {}).as_uri())
    return ElementTree.tostring(root, encoding="unicode")


def _references(root: ElementTree.Element) -> Iterator[tuple[ElementTree.Element, str]]:
    """Elements of joints that name a link or a joint, each with the attribute that does."""
    for tag, key in (("parent", "link"), ("child", "link"), ("mimic", "joint")):
        for element in root.iterfind(f"joint/{tag}"):
            yield element, key


def mesh_path(name: str, source: Path, packages: Mapping[str, Path]) -> Path:
    """Absolute path of a mesh: relative to the file that names it, or `package://` in the folder of that package, or
    below any folder around the file, whatever that is called.

    RobotError : it is in none of these places.
    """
    packaged = _PACKAGED.fullmatch(name)
    if packaged is None:
        places = [source.parent / name.removeprefix("file://")]
    else:
        package, inside = packaged.groups()
        places = [folder / inside for folder in _package_folders(package, source, packages)]
        places += [folder / inside for folder in source.resolve().parents]
    for place in places:
        if place.is_file():
            return place.resolve()
    if packaged is None:
        raise RobotError(f"mesh '{name}' of {source.name} is not there: {places[0]} is no file")
    if package in packages:
        raise RobotError(f"mesh '{name}' of {source.name} is not in {packages[package]}, the folder of its package")
    raise RobotError(
        f"mesh '{name}' of {source.name} is in no folder around it: say where the package is, "
        f"--package {package}=FOLDER"
    )


def _package_folders(name: str, source: Path, packages: Mapping[str, Path]) -> Iterator[Path]:
    """Folders of a ROS package: the one that is given alone, else those around a file, nearest first, that are called
    so, or whose package.xml says so; at last that of a sourced ROS."""
    if name in packages:
        yield packages[name]
        return
    for folder in source.resolve().parents:
        if folder.name == name or _package_name(folder) == name:
            yield folder
        if (folder / name).is_dir():
            yield folder / name
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if (folder := Path(prefix, "share", name)).is_dir():
            yield folder


def _package_name(folder: Path) -> str | None:
    try:
        return ElementTree.parse(folder / "package.xml").findtext("name")
    except (OSError, ElementTree.ParseError):
        return None


class _Arguments(dict[str, str]):
    """Arguments of a xacro file, and those that it has: xacro asks for each whether it was given, or what it is."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.requested: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.requested.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.requested.add(name)
        return super().__getitem__(name)


def _expanded(source: Path, arguments: Mapping[str, str], packages: Mapping[str, Path]) -> str:
    """The text of a file, expanded where it is xacro."""
    try:
        text = source.read_text()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise RobotError(f"cannot read the robot's file {source}: {reason}") from error
    if source.suffix != ".xacro" and "<xacro:" not in text:
        if arguments:
            raise RobotError(f"{source.name} is no xacro file: it has no argument {', '.join(arguments)}")
        return text

    # loaded here, for most files do without
    import xacro
    from xacro import substitution_args

    absent = []

    def find(package: str) -> str:
        for folder in _package_folders(package, source, packages):
            return str(folder.resolve())
        absent.append(package)
        raise LookupError(package)

    # xacro asks ROS's index of installed packages for $(find ...), and has no other place to say where they are
    substitution_args._eval_find = substitution_args._eval_dict["find"] = find
    known = _Arguments(arguments)
    try:
        document = xacro.process_file(str(source), mappings=known)
    except Exception as error:  # what is evaluated in the file raises anything
        if absent:
            raise RobotError(
                f"package '{absent[0]}', which {source.name} needs, is in no folder around it: say where it is, "
                f"--package {absent[0]}=FOLDER"
            ) from error
        raise RobotError(f"{source.name} cannot be expanded by xacro: {error or type(error).__name__}") from error
    if unknown := sorted(set(arguments) - known.requested):
        there = ", ".join(sorted(known.requested)) or "none"
        raise RobotError(f"{source.name} has no argument {unknown[0]}; it has {there}")
    return document.toxml()
