"""The entries of a skill.yaml: every one is checked by its type and its range before it is used.

The ranges are wide: each names a skill that works, several orders of magnitude away from those that were trained.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.errors import SkillError

FORMAT_VERSION = 2

DESCRIPTION, WEIGHTS, LATENT = "skill.yaml", "weights.safetensors", "latent.npz"
#: Files that the description holds the checksums of.
FILES = (WEIGHTS, LATENT)
TEXT_FIELDS = ("name", "space", "robot", "base_frame", "tool_frame", "orientation_model")
METADATA = (*TEXT_FIELDS, "metric", "sigma_support", "energy_per_edge", "quality", "provenance")
SHEETS = ("canonical", "raw")
#: Names are shown in lines of text and in messages.
LONGEST_TEXT = 200
#: The robot may be a path.
_LONGEST_PATH = 4096

#: How orientations can have been learned, by the space.
ORIENTATION_MODELS = {"task": ("two_cluster", "sign_blind"), "joint": ("none",)}
#: What numbers of a metric may be, by the space. Points along the links that are closer than a centimetre are millions.
METRIC_RANGES = {
    "task": {"sigma_weight": (0.0, 1e6), "progress_length": (0.0, 1e3)},
    "joint": {
        "sigma_weight": (0.0, 1e6), "joint_weight": (1e-6, 1e3), "point_spacing": (0.01, 10.0),
        "orientation_weight": (0.0, 1e3), "progress_length": (0.0, 1e3),
    },
}  # fmt: skip
#: What skills of earlier releases lack, for which the default holds.
_LATER = {"orientation_weight", "progress_length"}
METRIC_CHOICES = {"task": {"orientation_scale": ("spread", "kappa")}, "joint": {}}
#: Slower than linear, an offset would fade at an infinite rate at the goal; faster than this, at once.
FADE_RANGE = (1.0, 16.0)
#: A deviation of 10 m or 10 rad is that of no arm. Energies are squared lengths, of kappa too, which reaches 1e5.
RANGES = {"sigma_support": (1e-9, 10.0), "energy_per_edge": (1e-12, 1e15)}


def check_description(described: Any) -> None:
    """Refuse what is not the description of a skill of this release: SkillError names the entry and what it may be."""
    if not isinstance(described, dict) or "format_version" not in described:
        raise SkillError("no format_version, so this is no skill of this package")
    if described["format_version"] != FORMAT_VERSION:
        raise SkillError(
            f"format version {brief(described['format_version'])}, this release reads {FORMAT_VERSION}: "
            "install a matching release or train the skill again"
        )
    missing = [name for name in ("sheet", *METADATA, "sha256") if name not in described]
    if missing:
        raise SkillError(f"lacks {', '.join(missing)}")
    for name in TEXT_FIELDS:
        check_text(name, described[name], _LONGEST_PATH if name == "robot" else LONGEST_TEXT)
    space = described["space"]
    if space not in ORIENTATION_MODELS:
        raise SkillError(f"skills of space {space!r} are not known here; known: {_listed(ORIENTATION_MODELS)}")
    if described["sheet"] not in SHEETS:
        raise SkillError(f"sheets of kind {brief(described['sheet'])} are not known here; known: {_listed(SHEETS)}")
    _check_choice("orientation_model", described["orientation_model"], ORIENTATION_MODELS[space])
    check_thresholds(described)
    _check_metric(described["metric"], space)
    _check_tables(described)
    if described["sheet"] == "canonical":
        _check_penalty(described.get("regression_penalty"))
        _check_number("offset_fade", described.get("offset_fade", 1.0), *FADE_RANGE)
    digests = described["sha256"]
    if not isinstance(digests, dict) or set(digests) != set(FILES):
        raise SkillError(f"sha256 must list exactly {', '.join(FILES)}")


def check_thresholds(values: Mapping[str, Any]) -> None:
    """Refuse deviations and energies that no skill can have: SkillError."""
    for name, bounds in RANGES.items():
        _check_number(name, values[name], *bounds)


def check_text(name: str, value: Any, longest: int = LONGEST_TEXT) -> None:
    """Refuse what is not one line of 1 to `longest` characters: SkillError."""
    if not (isinstance(value, str) and 0 < len(value) <= longest and value.isprintable()):
        raise SkillError(f"{name} is {brief(value)}; it must be one line of 1 to {longest} characters")


def _check_choice(name: str, value: Any, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise SkillError(f"{name} is {brief(value)}; it must be one of {_listed(choices)}")


def _check_number(name: str, value: Any, lowest: float, highest: float) -> None:
    if not (_is_number(value) and lowest <= value <= highest):
        raise SkillError(f"{name} is {brief(value)}; it must be a number between {lowest:g} and {highest:g}")


def _check_penalty(value: Any) -> None:
    if not (_is_number(value) and value > 0.0):
        raise SkillError(f"regression_penalty is {brief(value)}; it must be positive, or .inf for no regression")


def _check_metric(metric: Any, space: str) -> None:
    ranges, choices = METRIC_RANGES[space], METRIC_CHOICES[space]
    known = {*ranges, *choices}
    if not isinstance(metric, dict) or not known - _LATER <= set(metric) <= known:
        raise SkillError(f"metric is {brief(metric)}; it must hold {', '.join(sorted(known))}")
    for name in ranges.keys() & metric.keys():
        _check_number(f"metric.{name}", metric[name], *ranges[name])
    for name, allowed in choices.items():
        _check_choice(f"metric.{name}", metric[name], allowed)


def _check_tables(described: dict[str, Any]) -> None:
    # The scene may be left out: skills of earlier releases have none.
    for name in [name for name in ("quality", "provenance", "scene") if name in described]:
        if not isinstance(described[name], dict):
            raise SkillError(f"{name} is {brief(described[name])}; it must hold names with their values")
        _check_plain(name, described[name])


def _check_plain(name: str, value: Any) -> None:
    """Refuse what cannot be shown or written as JSON: dates, keys that are no text."""
    if isinstance(value, dict):
        for key, item in value.items():
            check_text(f"a name in {name}", key)
            _check_plain(f"{name}.{key}", item)
    elif isinstance(value, list):
        for item in value:
            _check_plain(name, item)
    elif not (value is None or isinstance(value, str | int | float)):
        raise SkillError(f"{name} is {brief(value)}; it must be text, a number, or a list or table of them: quote it")


def _is_number(value: Any) -> bool:
    try:
        return not isinstance(value, bool) and isinstance(value, int | float) and not math.isnan(value)
    except OverflowError:  # an integer beyond all floats
        return False


def _listed(names: Mapping[str, Any] | tuple[str, ...]) -> str:
    return ", ".join(map(repr, names))
