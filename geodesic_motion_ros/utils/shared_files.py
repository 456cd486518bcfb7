"""Finds the files that are shipped beside the code: config/, models/."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import geodesic_motion_ros
from geodesic_motion_ros.utils.errors import GeodesicMotionError

PACKAGE = "geodesic_motion_ros"


class SharedFileError(GeodesicMotionError):
    """A shipped file or folder is in none of the places where an installation keeps it."""


def find_shared(relative: str | os.PathLike[str]) -> Path:
    """Find a shipped file or folder, however the package was installed.

    The places, in this order: the install spaces of a sourced ROS workspace that hold this package
    (AMENT_PREFIX_PATH), the environment of the running interpreter, the prefix under which this very package
    is installed (``pip install --user``), and the source tree the package is imported from.

    Parameters
    ----------
    relative : str or path
        Path below the package's share folder: ``"config/planner.yaml"``, ``"models/panda_pouring"``.

    Returns
    -------
    Path
        Absolute path of the first place where it exists.

    Raises
    ------
    SharedFileError
        The path is absolute or leaves the share folder, or nothing of that name exists; the message lists
        every place looked in.
    """
    wanted = Path(relative)
    if wanted.is_absolute() or ".." in wanted.parts:
        raise SharedFileError(
            f"{wanted} is not a path inside the share folder of {PACKAGE}: give one like config/planner.yaml"
        )
    places = list(dict.fromkeys(_share_folders()))
    for folder in places:
        if (folder / wanted).exists():
            return folder / wanted
    looked = "".join(f"\n  {folder / wanted}" for folder in places)
    raise SharedFileError(f"{wanted} is not shipped with this installation of {PACKAGE}; looked for{looked}")


def _share_folders() -> Iterator[Path]:
    """Folders that may hold config/ and models/, the most specific first."""
    # Read here rather than through ament_index_python, which plain pip installations do not have.
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        marker = Path(prefix, "share", "ament_index", "resource_index", "packages", PACKAGE)
        if prefix and marker.is_file():
            yield Path(prefix, "share", PACKAGE).absolute()
    yield Path(sys.prefix, "share", PACKAGE)
    package = Path(geodesic_motion_ros.__path__[0]).resolve()
    if package.parent.name in ("site-packages", "dist-packages"):
        # <prefix>/lib/python3.x/site-packages/<package>
        yield package.parents[3] / "share" / PACKAGE
    if (package.parent / "package.xml").is_file():
        yield package.parent
