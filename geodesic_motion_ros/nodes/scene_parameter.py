"""The parameter `scene` of both nodes: what always stands around the arm, as its user declares it."""

from __future__ import annotations

from geodesic_motion_ros.errors import FileError, ParameterError
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.shared_files import SharedFileError


def declared_scene(name: str) -> DeclaredScene | None:
    """As `DeclaredScene.named`; ParameterError names the parameter and what is wrong."""
    try:
        return DeclaredScene.named(name)
    except (FileError, SharedFileError) as error:
        raise ParameterError(f"parameter scene: {error}") from error
