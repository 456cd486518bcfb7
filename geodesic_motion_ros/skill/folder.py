"""The content of a skill folder, read and checked: every file before it is parsed, every number before it is used."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.robot.description import robot_folder, shipped_robots
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.description import DESCRIPTION, LATENT, METADATA, WEIGHTS, check_description
from geodesic_motion_ros.skill.sheet import UNROLLED_ROUNDS, DemonstratedEnds
from geodesic_motion_ros.skill.space import SPACES, SkillSpace
from geodesic_motion_ros.utils.checked_files import opened, read_arrays, read_tensors, read_yaml
from geodesic_motion_ros.utils.checked_numbers import (
    LARGEST_CODE,
    LARGEST_DIMENSION,
    ROUND_DIMENSIONS,
    SMALLEST_BOX,
    check_array,
    check_pose,
    check_real,
)
from geodesic_motion_ros.utils.errors import GeodesicMotionError, SkillError

#: Arrays of latent.npz, beside those of the canonical demonstrations.
LATENT_ARRAYS = ("codes", "latent_lower", "latent_upper", "start_pose", "goal_pose")
#: Sizes of the files [B]. Those of 16 demonstrations and a whole arm take 1.6 kB, 0.4 MB and 0.1 MB.
LARGEST_DESCRIPTION = 64 << 10
_LARGEST = {DESCRIPTION: LARGEST_DESCRIPTION, WEIGHTS: 16 << 20, LATENT: 16 << 20}
#: Codes that are decoded to see whether an arm could do what a decoder says.
_TRIED_CODES = 1000


def read_folder(path: Path) -> dict[str, Any]:
    """Read the attributes of the skill in a folder, by their names.

    Raises
    ------
    SkillError : names the file, the entry or array, and what it must be.
    """
    content = {DESCRIPTION: _content(path, DESCRIPTION)}
    with _about(path / DESCRIPTION):
        described = read_yaml(content[DESCRIPTION])
        check_description(described)
        described["robot"] = _robot(described["robot"], path)
        joints = len(Robot.named(described["robot"]).joint_names)
    for name, digest in described["sha256"].items():
        content[name] = _content(path, name)
        if hashlib.sha256(content[name]).hexdigest() != digest:
            raise SkillError(f"{path}: {name} differs from its checksum in {DESCRIPTION}: truncated or altered")
    space = SPACES[described["space"]]
    attributes = {name: described[name] for name in METADATA} | {"metric": space.metric(**described["metric"])}
    attributes["scene"] = described.get("scene")
    with _about(path / WEIGHTS):
        attributes |= _networks(content[WEIGHTS], space, joints)
    decoder = attributes["decoder"]
    with _about(path / LATENT):
        arrays = read_arrays(io.BytesIO(content[LATENT]))
        period = float(decoder.period) if decoder.is_closed else None
        attributes |= _latent(arrays, decoder.latent_dimension, period)
        attributes["canonical"] = _canonical(arrays, described, attributes["codes"], joints, decoder.is_closed)
    with _about(path / WEIGHTS):
        _check_decoded(decoder, attributes["codes"], space)
    return attributes


def _robot(name: str, path: Path) -> str:
    """A shipped robot's name, or the absolute path of its folder, which a skill gives relative to its own.

    Paths in skills that were saved before are relative to the working directory of their training.
    """
    return name if name in shipped_robots() else str(robot_folder(name, path, Path()).resolve())


def _content(path: Path, name: str) -> bytes:
    try:
        with _about(path / name), opened(path / name, _LARGEST[name]) as stream:
            return stream.read(_LARGEST[name])
    except FileNotFoundError as error:
        files = ", ".join(_LARGEST)
        raise SkillError(f"{path}: {name} is missing, so this is no skill folder; one holds {files}") from error
    except OSError as error:
        raise SkillError(f"{path / name}: cannot be read ({error.strerror or error})") from error


@contextmanager
def _about(file: Path) -> Iterator[None]:
    """Name the file that an error is about, and make it a SkillError."""
    try:
        yield
    except GeodesicMotionError as error:
        raise SkillError(f"{file}: {error}") from error


def _networks(content: bytes, space: SkillSpace, joints: int) -> dict[str, Any]:
    """Decoder, and the encoder's weights by their names: none, or all that an encoder has."""
    weights = read_tensors(content)
    decoder = space.decoder.from_arrays(_with_prefix(weights, "decoder."))
    d = decoder.latent_dimension
    if not 1 <= d <= LARGEST_DIMENSION:
        raise SkillError(f"the decoder is of {d} latent dimensions; it must be of 1 to {LARGEST_DIMENSION}")
    if space.has_joints and decoder.joints != joints:
        raise SkillError(f"the decoder is of {decoder.joints} joints; the robot has {joints}")
    encoder = _with_prefix(weights, "encoder.")
    if encoder:
        outputs = space.encoder.from_arrays(encoder).b3.size
        if outputs != d:
            raise SkillError(f"the encoder is of {outputs} latent dimensions; the decoder of {d}")
    return {"decoder": decoder, "encoder_arrays": encoder}


def _with_prefix(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}


def _latent(arrays: dict[str, np.ndarray], d: int, period: float | None) -> dict[str, np.ndarray]:
    """Codes, box and ends of a skill of d latent dimensions, with the period of rounds."""
    for name in LATENT_ARRAYS:
        if name not in arrays:
            raise SkillError(f"lacks {name}; it must hold {', '.join(LATENT_ARRAYS)}")
        check_real(name, arrays[name])
    latent = {name: np.array(arrays[name], dtype=float) for name in LATENT_ARRAYS}
    codes, lower, upper = (latent[name] for name in ("codes", "latent_lower", "latent_upper"))
    if codes.ndim != 3 or len(codes) == 0 or codes.shape[1] < 2:
        raise SkillError(f"codes have shape {codes.shape}; it must be (demonstrations, samples, {d})")
    for name, shape in {"codes": (*codes.shape[:2], d), "latent_lower": (d,), "latent_upper": (d,)}.items():
        check_array(name, latent[name], shape, -LARGEST_CODE, LARGEST_CODE)
    size = upper - lower
    if period is not None:
        _check_rounds(codes, size, period)
    if np.any(size < SMALLEST_BOX):
        raise SkillError(f"latent_upper lies {size.min():.4g} above latent_lower; at least {SMALLEST_BOX} is needed")
    rounding = 1e-6 * size
    if np.any(codes < lower - rounding) or np.any(codes > upper + rounding):
        raise SkillError("codes lie outside the box; they must be between latent_lower and latent_upper")
    for name in ("start_pose", "goal_pose"):
        check_pose(name, latent[name])
    return latent


def _check_rounds(codes: np.ndarray, size: np.ndarray, period: float) -> None:
    """Refuse codes (N, S, d) in a box of a size (d,) that are no rounds, unrolled (SkillError)."""
    length, whole = UNROLLED_ROUNDS * period, (codes.shape[1] - 1) % UNROLLED_ROUNDS == 0
    if codes.shape[2] not in ROUND_DIMENSIONS:
        allowed = " or ".join(map(str, ROUND_DIMENSIONS))
        raise SkillError(f"a closed skill has {allowed} latent dimensions, not {codes.shape[2]}")
    if not whole or not np.allclose(codes[:, -1, 0] - codes[:, 0, 0], length, rtol=1e-3):
        raise SkillError(f"codes of a closed skill must lead through {UNROLLED_ROUNDS} rounds of {period:.4g}")
    if not np.isclose(size[0], length, rtol=0.1):
        raise SkillError(f"the box is {size[0]:.4g} long on the first axis; {UNROLLED_ROUNDS} rounds are {length:.4g}")


def _canonical(
    arrays: dict[str, np.ndarray], described: dict[str, Any], codes: np.ndarray, joints: int, closed: bool
) -> DemonstratedEnds | None:
    """The canonical demonstrations of codes (N, S, d); None on the raw sheet."""
    if described["sheet"] == "raw":
        if closed:
            raise SkillError("a closed skill has a canonical sheet, not a raw one")
        return None
    space = SPACES[described["space"]]
    named = {name: f"canonical_{name}" for name in space.canonical_arrays}
    for name in named.values():
        if name not in arrays:
            raise SkillError(f"lacks {name}; the canonical sheet needs {', '.join(named.values())}")
    sheet = space.sheet(
        **{name: arrays[stored] for name, stored in named.items()},
        penalty=float(described["regression_penalty"]),
        # Offsets of skills of earlier releases fade linearly.
        fade=float(described.get("offset_fade", 1.0)),
        # Those of earlier releases, and of recordings without times, have none.
        times=arrays.get("canonical_times"),
    )
    if space.has_joints:
        count = (0, *sheet.configurations.shape)[-1]
        if count != joints:
            raise SkillError(f"the canonical sheet is of {count} joints; the robot has {joints}")
    sheet.check(*codes.shape[:2])
    return sheet


def _check_decoded(decoder: Any, codes: np.ndarray, space: SkillSpace) -> None:
    """Refuse a decoder that makes of the demonstrations' codes what no arm can do."""
    flat = codes.reshape(-1, codes.shape[-1])
    decoded = decoder.decode(flat[:: -(-len(flat) // _TRIED_CODES)])
    farthest = float(np.abs(getattr(decoded, space.coordinates)).max())
    if not farthest <= space.farthest:
        raise SkillError(
            f"the decoder makes of the demonstrations' codes a {space.coordinate} of {farthest:.4g}; "
            f"none is beyond {space.farthest:.3g}"
        )
