"""Scenes as files of numbers: played and judged again without drawing them, whichever version of the code does so.

A file is a `.npz` archive of n scenes with m spheres in all; floats are of 64 bits and are read as they were written.

    format                              1
    skill, skill_digest, guard          name, digest of what it learned (`held_out.digest`), arm or tool
    robot                               of the skill; older files lack it, and are of a panda
    seed                                that the scenes were drawn with
    family, number                      (n,) each; together they name a scene
    start, goal                         (n, eta) [rad]
    goal_position, goal_quaternion      (n, 3) [m], (n, 4) w, x, y, z: of the tool there
    tool_chased                         (n,) whether chasing spheres move towards the tool, or the elbow
    free                                (n, N) which demonstrations stay free
    spheres                             (n,) how many each scene has, in its order in:
    radius, appears, vanishes, rests    (m,) [m], [s]; the last two may be infinite
    begin, velocity, chases             (m, 3) [m], (m, 3) [m/s], (m,)
    compared                            (n,) which set of tool paths similarity is measured to: scenes with the same
                                        start and goal share one
    set_curves, curve_samples           curves of each set, in its order, and samples of each curve, in its order in:
    curve_position, curve_quaternion    (.., 3) [m], (.., 4) w, x, y, z
    declared                            (n,) what stands around the arm, as the text of a file of config/scenes; older
                                        files lack it, and nothing does

Of the demonstrations the file holds the tool's paths alone: methods that play demonstrations move them to the start
and goal of a scene as the version of the code does that plays.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import get_args

import numpy as np
import yaml

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.checked_files import PlainDumper, brief, opened, read_arrays, read_yaml
from geodesic_motion_ros.utils.checked_numbers import ARM_REACH, LARGEST_TURN, check_array, check_real, check_unit
from geodesic_motion_ros.utils.errors import FileError, GeodesicMotionError, ParameterError
from geodesic_motion_studies.comparison.families import Family, check_families
from geodesic_motion_studies.comparison.guard import Guard
from geodesic_motion_studies.comparison.held_out import digest
from geodesic_motion_studies.comparison.scene import Scene
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

FORMAT = 1
#: Of a file [B]: a thousand scenes of a skill of the whole arm take a third of it.
LARGEST = 1 << 30
_OF_SPHERES = ("radius", "appears", "vanishes", "rests", "begin", "velocity", "chases")
_KEYS = {
    "format", "skill", "skill_digest", "guard", "seed", "family", "number", "start", "goal", "goal_position",
    "goal_quaternion", "tool_chased", "free", "spheres", *_OF_SPHERES, "compared", "set_curves", "curve_samples",
    "curve_position", "curve_quaternion",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class SceneFile:
    """Scenes of one skill and one seed; those that are read have no demonstrations.

    Attributes
    ----------
    skill, skill_digest : its name, and the digest of what it learned.
    robot : of the skill, a name or the path of a folder.
    """

    skill: str
    skill_digest: str
    robot: str
    guard: Guard
    seed: int
    scenes: tuple[Scene, ...]

    @classmethod
    def of(cls, skill: Skill, guard: Guard, seed: int, scenes: Sequence[Scene]) -> SceneFile:
        return cls(skill.name, digest(skill), skill.robot, guard, seed, tuple(scenes))

    @property
    def families(self) -> tuple[Family, ...]:
        """Those that there are scenes of, in their order."""
        return tuple(dict.fromkeys(scene.family for scene in self.scenes))

    def scene(self, family: Family, number: int) -> Scene:
        """ParameterError: it is not in the file."""
        for scene in self.scenes:
            if (scene.family, scene.number) == (family, number):
                return scene
        raise ParameterError(f"the file has no scene {family}-{number}")

    def check(self, skill: Skill, guard: Guard) -> None:
        """ParameterError: the scenes are of another skill, of what another one of this name learned, or of another
        guard.
        """
        if self.skill != skill.name:
            raise ParameterError(f"the scenes are of the skill {brief(self.skill)}, not of '{skill.name}'")
        if self.skill_digest != digest(skill):
            raise ParameterError(f"the scenes are of another '{skill.name}': what it had learned differs")
        if self.guard != guard:
            raise ParameterError(f"the scenes are of the guard '{self.guard}', not of '{guard}' (--guard)")

    def write(self, path: Path) -> None:
        """Replace the file at a path; its folder is made where it is missing."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as stream:
            np.savez_compressed(stream, **self._arrays())

    @classmethod
    def read(cls, path: Path) -> SceneFile:
        """FileError: it cannot be read, is no such file, or a number of it makes no sense."""
        try:
            with opened(path, LARGEST) as stream:
                arrays = read_arrays(stream)
            return _scene_file(arrays)
        except OSError as error:
            raise FileError(f"{path}: cannot be read ({error.strerror or error})") from error
        except GeodesicMotionError as error:
            raise FileError(f"{path}: {error}") from error

    def _arrays(self) -> dict[str, np.ndarray]:
        sets: dict[bytes, int] = {}
        curves: list[tuple[PoseCurve, ...]] = []
        compared = []
        for scene in self.scenes:
            key = hashlib.sha256(b"".join(
                np.hstack([curve.positions, curve.quaternions]).tobytes() for curve in scene.compared
            )).digest()  # fmt: skip
            if key not in sets:
                sets[key] = len(curves)
                curves.append(scene.compared)
            compared.append(sets[key])
        spheres = [sphere for scene in self.scenes for sphere in scene.spheres]
        flat = [curve for own in curves for curve in own]
        vectors = ("begin", "velocity")
        return {
            "format": np.array(FORMAT),
            "skill": np.array(self.skill),
            "skill_digest": np.array(self.skill_digest),
            "robot": np.array(self.robot),
            "guard": np.array(self.guard),
            "seed": np.array(self.seed),
            "family": np.array([scene.family for scene in self.scenes]),
            "number": np.array([scene.number for scene in self.scenes]),
            "start": np.array([scene.start for scene in self.scenes]),
            "goal": np.array([scene.goal for scene in self.scenes]),
            "goal_position": np.array([scene.goal_pose[0] for scene in self.scenes]),
            "goal_quaternion": np.array([scene.goal_pose[1] for scene in self.scenes]),
            "tool_chased": np.array([scene.tool_chased for scene in self.scenes]),
            "free": np.array([scene.free for scene in self.scenes]),
            "spheres": np.array([len(scene.spheres) for scene in self.scenes]),
            **{
                name: np.array([getattr(sphere, name) for sphere in spheres], dtype=_type(name)).reshape(
                    (-1, 3) if name in vectors else -1
                )
                for name in _OF_SPHERES
            },
            "compared": np.array(compared),
            "set_curves": np.array([len(own) for own in curves]),
            "curve_samples": np.array([len(curve.positions) for curve in flat]),
            "curve_position": np.concatenate([curve.positions for curve in flat]),
            "curve_quaternion": np.concatenate([curve.quaternions for curve in flat]),
            "declared": np.array([yaml.dump(scene.declared.described, Dumper=PlainDumper) for scene in self.scenes]),
        }


def _type(name: str) -> type:
    return bool if name == "chases" else float


def _scene_file(arrays: dict[str, np.ndarray]) -> SceneFile:
    """What arrays hold; FileError, ParameterError or SkillError where they are not those of a file of scenes."""
    if not arrays.keys() >= _KEYS:
        raise FileError(f"lacks {min(_KEYS - arrays.keys())}: it is no file that `benchmark --save-scenes` writes")
    version = arrays["format"]
    if version.shape != () or version.dtype.kind not in "iu" or int(version) != FORMAT:
        raise FileError(f"is of another format of scenes than {FORMAT}")
    text = {name: _text(name, arrays[name]) for name in ("skill", "skill_digest", "guard")}
    text["robot"] = _text("robot", arrays["robot"]) if "robot" in arrays else DEFAULT_ROBOT
    if text["guard"] not in get_args(Guard):
        raise FileError(f"guard is {brief(text['guard'])}: it must be one of {', '.join(get_args(Guard))}")
    guard: Guard = text["guard"]  # type: ignore[assignment]
    seed = int(_whole("seed", arrays["seed"], ()))
    if arrays["family"].ndim != 1 or arrays["family"].dtype.kind != "U" or not len(arrays["family"]):
        raise FileError("family must be a row of names, one a scene")
    families, count = arrays["family"].tolist(), len(arrays["family"])
    check_families(text["skill"], guard, families)
    numbers = _whole("number", arrays["number"], (count,)).tolist()
    names = list(zip(families, numbers, strict=True))
    for name in names:
        if names.count(name) > 1:
            raise FileError(f"has the scene {name[0]}-{name[1]} more than once")
    joints = len(Robot.named(text["robot"]).joint_names)
    starts = _floats("start", arrays["start"], (count, joints), LARGEST_TURN)
    goals = _floats("goal", arrays["goal"], (count, joints), LARGEST_TURN)
    positions = _floats("goal_position", arrays["goal_position"], (count, 3), ARM_REACH)
    quaternions = _floats("goal_quaternion", arrays["goal_quaternion"], (count, 4))
    check_unit("goal_quaternion", quaternions)
    tool_chased = _booleans("tool_chased", arrays["tool_chased"], (count,))
    free = arrays["free"]
    free = _booleans("free", free, (count, free.shape[-1] if free.ndim == 2 else 0))
    if not free.shape[1]:
        raise FileError("free has no demonstrations")
    spheres, sets = _spheres(arrays, count), _compared(arrays)
    compared = _whole("compared", arrays["compared"], (count,), len(sets) - 1)
    declared = _declared(arrays, count)
    return SceneFile(text["skill"], text["skill_digest"], text["robot"], guard, seed, tuple(
        Scene(
            families[i], numbers[i], seed, starts[i], goals[i], (positions[i], quaternions[i]), spheres[i],
            bool(tool_chased[i]), (), free[i], sets[compared[i]], declared[i],
        )
        for i in range(count)
    ))  # fmt: skip


def _spheres(arrays: dict[str, np.ndarray], scenes: int) -> list[tuple[MovingSphere, ...]]:
    """Those of each scene."""
    counts = _whole("spheres", arrays["spheres"], (scenes,))
    total = int(np.sum(counts))
    radius = _floats("radius", arrays["radius"], (total,))
    if np.any(radius <= 0.0):
        raise FileError(f"radius holds {radius[radius <= 0.0][0]}: it must be positive")
    appears = _floats("appears", arrays["appears"], (total,))
    vanishes, rests = (_times(name, arrays[name], (total,)) for name in ("vanishes", "rests"))
    begin, velocity = (_floats(name, arrays[name], (total, 3)) for name in ("begin", "velocity"))
    chases = _booleans("chases", arrays["chases"], (total,))
    each = [
        MovingSphere(
            float(radius[i]), float(appears[i]), float(vanishes[i]), begin[i], velocity[i], bool(chases[i]),
            float(rests[i]),
        )
        for i in range(total)
    ]  # fmt: skip
    return [tuple(each[first:last]) for first, last in _parts(counts)]


def _declared(arrays: dict[str, np.ndarray], scenes: int) -> list[DeclaredScene]:
    """What each scene declares."""
    if "declared" not in arrays:
        return [DeclaredScene.empty()] * scenes
    texts = arrays["declared"]
    if texts.shape != (scenes,) or texts.dtype.kind != "U":
        raise FileError(f"declared must be a row of {scenes} texts")
    try:
        return [DeclaredScene.of(read_yaml(text.encode())) for text in texts.tolist()]
    except FileError as error:
        raise FileError(f"declared: {error}") from error


def _compared(arrays: dict[str, np.ndarray]) -> list[tuple[PoseCurve, ...]]:
    """Sets of tool paths."""
    in_set = arrays["set_curves"]
    in_set = _whole("set_curves", in_set, in_set.shape[:1])
    samples = _whole("curve_samples", arrays["curve_samples"], (int(np.sum(in_set)),))
    if not len(in_set) or np.any(in_set == 0) or np.any(samples < 2):
        raise FileError("set_curves and curve_samples: every set has a curve, and every curve two samples")
    total = int(np.sum(samples))
    positions = _floats("curve_position", arrays["curve_position"], (total, 3), ARM_REACH)
    quaternions = _floats("curve_quaternion", arrays["curve_quaternion"], (total, 4))
    check_unit("curve_quaternion", quaternions)
    curves = [PoseCurve(positions[first:last], quaternions[first:last]) for first, last in _parts(samples)]
    return [tuple(curves[first:last]) for first, last in _parts(in_set)]


def _parts(counts: np.ndarray) -> Sequence[tuple[int, int]]:
    """Where each of consecutive parts begins and ends."""
    return list(pairwise([0, *np.cumsum(counts).tolist()]))


def _text(name: str, array: np.ndarray) -> str:
    if array.shape != () or array.dtype.kind != "U" or not str(array).isprintable():
        raise FileError(f"{name} must be one line of text")
    return str(array)


def _floats(name: str, array: np.ndarray, shape: tuple[int, ...], largest: float = np.inf) -> np.ndarray:
    """Finite numbers; a copy, as compiled code takes no array that cannot be written to."""
    check_array(name, array, shape, -largest, largest)
    return np.array(array, dtype=float)


def _times(name: str, array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Times, infinite where something never comes."""
    check_real(name, array)
    if array.shape != shape or np.any(np.isnan(array)):
        raise FileError(f"{name} must have shape {shape} and no NaN")
    return np.array(array, dtype=float)


def _whole(name: str, array: np.ndarray, shape: tuple[int, ...], largest: int = 2**32 - 1) -> np.ndarray:
    """Whole numbers from 0 on."""
    if array.shape != shape or array.dtype.kind not in "iu" or np.any(array < 0) or np.any(array > largest):
        raise FileError(f"{name} must have shape {shape} and whole numbers from 0 to {largest}")
    return array.astype(np.int64)


def _booleans(name: str, array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    if array.shape != shape or array.dtype.kind != "b":
        raise FileError(f"{name} must have shape {shape} and be true or false")
    return array.copy()
