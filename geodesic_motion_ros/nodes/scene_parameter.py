"""The parameter `scene` of both nodes: what always stands around the arm, as its user declares it."""

from __future__ import annotations

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import FileError, ParameterError


def declared_scene(name: str, skill: Skill | None) -> DeclaredScene | None:
    """Return the scene of `DeclaredScene.from_name`; of an empty text the scene that a skill was recorded in.

    Raises
    ------
    ParameterError : as of `named`; names the parameter and what is wrong. SkillError : as of `DeclaredScene.of_skill`.
    """
    try:
        scene = DeclaredScene.from_name(name)
    except FileError as error:
        raise ParameterError(f"parameter scene: {error}") from error
    return scene or (None if skill is None else DeclaredScene.of_skill(skill))
