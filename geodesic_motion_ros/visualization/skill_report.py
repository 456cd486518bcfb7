"""The report of a skill: one HTML page (`html_page`) with all that is known of it.

The page shows what the skill, the recording it was learned from and the planner hold; figures of demonstrations that
were held out are those that the skill keeps.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.certificate_scope import COUNTED, NOT_COUNTED
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.takes import Action
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.tables import Cell
from geodesic_motion_ros.visualization.dimensions import draw_dimensions
from geodesic_motion_ros.visualization.html_page import cards, figure, heading, listed, note, page, table
from geodesic_motion_ros.visualization.largest_sphere import LARGEST, STEP, SpherePlaces, find_largest_passed
from geodesic_motion_ros.visualization.passed_spheres import draw_passed_spheres
from geodesic_motion_ros.visualization.recording_view import MOST_TAKES, draw_recording
from geodesic_motion_ros.visualization.spread import draw_spread

#: Places of the tool's path where spheres are tried; odd, so that one is the middle.
PLACES = 11
#: Rows of the held-out table by the beginning of their names in `Skill.quality`.
_HELD_OUT = {
    "held_out": "this skill's geodesic", "people": "people among themselves",
    "reconstruction": "the held-out one itself, through the network",
    "mean_demonstration": "mean demonstration", "promp": "ProMP", "dmp_nearest": "DMP of the nearest demonstration",
    "joint_line": "straight line in joint space",
}  # fmt: skip
_COLUMNS = {
    "dtw_mm": "DTW [mm]", "orientation_deg": "orientation [deg]", "joint_dtw_rad": "joints, DTW [rad]",
    "unanswered": "unanswered",
}  # fmt: skip
#: Recordings that `evaluate` reads.
_FILES = (".npy", ".npz", ".csv")
_SPACES = {"task": "tool", "joint": "whole arm"}
_LATENT = {
    "task": "Left the plane that was learned, dark where moving is dear, with the demonstrations and the shortest "
    "paths between their ends; right the same curves decoded, as the tool moves.",
    "joint": "Left the latent space, walled in where the demonstrations' support ends, with the demonstrations and "
    "the shortest paths; right the arm. Vermilion is the path around a sphere on the arm, where there is one.",
}


def report_page(
    planner: ReactivePlanner,
    latent_picture: bytes,
    recording: Recording | None = None,
    shown: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> str:
    """The page as text. What the planner, which is made for this, has as obstacles and as detour changes.

    Parameters
    ----------
    planner : of the skill; with a scene it makes detours as well.
    latent_picture : PNG of the skill's latent space, as `training_report` or `joint_report` draws it.
    recording : what the skill was learned from; None: not at hand.
    shown : what shows the progress of the places where spheres are tried.
    """
    skill = planner.skill
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    plan = planner.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3]))
    if plan.reference is None:
        text = f"The planner has no motion from the mean start to the mean goal: {plan.verdict.reason}"
        missing = note(text, "bad")
        tubes, spheres, middle, free = missing, missing, None, 0.0
    else:
        tubes = _tubes(skill, plan.reference)
        spheres, middle, free = _spheres(planner, plan.reference, shown)
    sections = (
        ("skill", "The skill", _skill(planner)),
        ("recordings", "Recordings", recordings_section(skill, recording)),
        ("latent", "Latent space", _latent(skill, latent_picture)),
        ("tubes", "Tubes", tubes),
        ("held-out", "Held-out demonstrations", held_out_section(skill)),
        ("spheres", "Largest sphere that is passed", spheres),
        ("certificate", "Limits of the certificate", _certificate(planner)),
    )
    return page(skill.name, _lead(skill) + cards(_headlines(skill, middle, free)), sections)


def _lead(skill: Skill) -> str:
    count = len(_names(skill))
    text = (
        f"A skill of the {_SPACES[skill.space]} of a {skill.robot}, learned from {count} "
        f"demonstration{'s' if count != 1 else ''}."
    )
    return note(text, "soft")


def _names(skill: Skill) -> list[str]:
    """Names of the demonstrations that were learned from; numbers where the skill does not keep them."""
    return [str(name) for name in skill.provenance.get("demonstrations", range(len(skill.codes)))]


def _headlines(skill: Skill, middle: np.ndarray | None, free: float) -> list[tuple[str, str]]:
    """The figures that are asked for first.

    middle : radii [m] passed halfway, without a detour and, if any, with one; free : the largest that leaves both ends
    free there [m].
    """
    quality = skill.quality
    figures = [(str(len(_names(skill))), "demonstrations learned from")]
    for name, text in (
        ("training_position_error_mm", "mean position error on these"), ("held_out_dtw_mm", "from held-out ones, DTW"),
        ("mean_demonstration_dtw_mm", "the mean demonstration from these, DTW"),
        ("people_dtw_mm", "people among themselves, DTW"),
    ):  # fmt: skip
        if isinstance(quality.get(name), float):
            figures.append((f"{quality[name]:.1f} mm", text))
    if middle is not None:
        texts = (
            f"largest sphere passed halfway, as demonstrated, of {100.0 * free:.1f} cm that leave both ends free",
            "the same with a detour",
        )
        figures += [(f"{100.0 * radius:.1f} cm", text) for radius, text in zip(middle, texts, strict=False)]
    return figures


def _skill(planner: ReactivePlanner) -> str:
    skill, graph = planner.skill, planner.graph
    start, goal = skill.start_pose, skill.goal_pose
    modes = [] if skill.canonical is None else np.bincount(skill.canonical.modes.astype(int)).tolist()
    dimension = skill.decoder.latent_dimension
    dimensions = "1 dimension" if dimension == 1 else f"{dimension} dimensions"
    rows: list[Sequence[Cell]] = [
        ("robot", f"{skill.robot}, base {skill.base_frame}, tool {skill.tool_frame}"),
        ("latent space", f"{dimensions}, {skill.sheet} sheet"),
        ("demonstrations", ", ".join(_names(skill))),
        ("families", ", ".join(map(str, modes)) + " demonstrations" if len(modes) > 1 else "one"),
        ("mean start", f"{_numbers(start[:3])} m, quaternion (w, x, y, z) {_numbers(start[3:])}"),
        ("mean goal", f"{_numbers(goal[:3])} m, quaternion {_numbers(goal[3:])}"),
        ("latent graph", f"{len(graph.latent)} nodes, {len(graph.edges)} edges"),
        ("scene kept", "none" if skill.scene is None else ", ".join(planner.scene.names) or "nothing stands there"),
    ]
    rows += [(name, str(skill.provenance[name])) for name in ("data", "source", "licence") if name in skill.provenance]
    errors = {name: value for name, value in skill.quality.items() if name.startswith("training_")}
    rows += [(name.replace("_", " "), value) for name, value in errors.items()]
    settings = _flat(skill.provenance.get("settings", {}))
    return table((), rows) + (heading("Training settings") + listed(settings) if settings else "")


def _flat(settings: Mapping[str, Any], above: str = "") -> dict[str, str]:
    flat: dict[str, str] = {}
    for name, value in settings.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{above}{name}.")
        else:
            flat[f"{above}{name}"] = ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
    return flat


def recordings_section(skill: Skill, recording: Recording | None) -> str:
    """What was recorded, what was found in it, and what was done about that."""
    if recording is None:
        return note(
            "The recording is not beside the skill, which keeps the names of the demonstrations that it was learned "
            "from and not what was repaired, left out or refused. `geodesic-motion inspect RECORDING` shows that of a "
            "recording, and `train` writes it into the report of what it learns."
        )
    described, learned = recording.describe(), set(_names(skill))
    refused = {flaw.demonstration for flaw in recording.refusals}
    found: dict[str, set[Action]] = {}
    for flaw in recording.flaws:
        found.setdefault(flaw.demonstration, set()).add(flaw.action)
    rows: list[Sequence[Cell]] = []
    for row in described["demonstrations"]:
        name = row["name"]
        if name in refused:
            done = Action.REFUSED.value
        elif name in recording.left_out_names:
            done = Action.LEFT_OUT.value
        elif name not in learned:
            done = "held out"
        else:
            done = Action.REPAIRED.value if Action.REPAIRED in found.get(name, ()) else Action.KEPT.value
        rows.append((name, row["from"], row["to"], row["samples"], row["rate"], row["length"], done))
    unit = "rad" if recording.robot else "m"
    head = ("demonstration", "from [s]", "to [s]", "samples", "per s", f"length [{unit}]", "outcome")
    flaws = [(flaw["demonstration"], flaw["time"], flaw["what"], flaw["action"]) for flaw in described["flaws"]]
    if not flaws:
        return table(head, rows) + note("Nothing was found in them.")
    marked = {flaw.demonstration for flaw in recording.flaws}
    long = len(recording.takes) < len(recording.motions)
    takes = [take for take in recording.takes if long or take.name in marked]
    picture = _drawn(
        lambda path: draw_recording(takes, recording.motions, recording.left_out_names, recording.flaws, path)
    )
    caption = "Positions over time, the demonstrations shaded, what was found as dashed lines"
    caption += f"; the first {MOST_TAKES} of {len(takes)} recordings." if len(takes) > MOST_TAKES else "."
    return (
        table(head, rows) + heading("What was found, and done about it")
        + table(("in", "at [s]", "found", "done"), flaws) + (figure(picture, caption) if takes else "")
    )  # fmt: skip


def _latent(skill: Skill, picture: bytes) -> str:
    """The latent space; below it how many dimensions it has, where the data chose them."""
    drawn, compared = figure(picture, _LATENT[skill.space]), skill.provenance.get("dimension")
    if not isinstance(compared, Mapping):
        return drawn
    caption = (
        "Errors with which held-out demonstrations are given back, over the number of latent dimensions, each with one "
        "standard error. The smallest within one standard error of the best, filled, was chosen."
    )
    return drawn + figure(_drawn(lambda path: draw_dimensions(path, compared)), caption)


def _tubes(skill: Skill, motion: JointReference) -> str:
    carried = ", carried to the mean start and goal," if skill.canonical is not None else ""
    caption = (
        f"The demonstrations{carried} and the planner's motion from the mean start to the mean goal with two standard "
        "deviations of the decoder: how sure the skill is there. The tube ends where the decoder's deviation is "
        f"{skill.sigma_limit:.3g} {'rad' if skill.space == 'joint' else 'm'} (root mean square over the coordinates)."
    )
    return figure(_drawn(lambda path: draw_spread(path, skill, motion)), caption)


def held_out_section(skill: Skill) -> str:
    """Figures on demonstrations that were not learned from, beside human variation and simple predictors."""
    quality, data = skill.quality, str(skill.provenance.get("data", ""))
    command = f"geodesic-motion evaluate --demos {data if data.endswith(_FILES) else 'FILE'}"
    options = "with the options for reading and robot that `train` was given (--units, --columns, --robot, ...)"
    if not any(name.startswith("held_out_") for name in quality):
        return note(
            f"They were not computed: every demonstration was learned from. `{command}`, {options}, trains again "
            "without some of them, fold after fold, and puts the geodesic beside the mean demonstration, ProMP, DMP "
            "and what people vary by themselves. `geodesic-motion train ... --held-out 0,3` learns a skill without "
            "those two and measures on them."
        )
    columns = [column for column in _COLUMNS if f"held_out_{column}" in quality]
    rows = [
        (text, *(quality.get(f"{name}_{column}") for column in columns))
        for name, text in _HELD_OUT.items()
        if any(f"{name}_{column}" in quality for column in columns)
    ]
    held_out = ", ".join(map(str, quality.get("held_out", ())))
    unanswered = quality.get("held_out_unanswered")
    return (
        note(
            f"Held out: {held_out} (counted from 0 among those that were not left out). Predicted from their start and "
            "goal alone; means, the smaller the nearer to what the person did."
        )
        + table(("", *(_COLUMNS[column] for column in columns)), rows)
        + (note("What is unanswered counts in no mean of its row.", "soft") if unanswered else "")
        + note(f"One split and one training only: `{command}`, {options}, measures several.", "soft")
    )


def _spheres(
    planner: ReactivePlanner, motion: JointReference, shown: Callable[[Sequence[int]], Iterable[int]]
) -> tuple[str, np.ndarray, float]:
    """The section; the radii [m] passed halfway, without a detour and, if the planner makes any, with one; the largest
    radius [m] that leaves start and goal free there.
    """
    detours = (0.0, planner.settings.detour) if planner.may_detour else (0.0,)
    places = SpherePlaces.of_motion(planner, motion, PLACES)
    radii, reasons = np.zeros((PLACES, len(detours))), []
    for place in shown(range(PLACES)):
        radius, reason = 0.0, ""
        for column, detour in enumerate(detours):
            planner.set_detour(detour)
            radius, reason = find_largest_passed(planner, places.centres[place], float(places.free[place]), radius)
            radii[place, column] = radius
        reasons.append(reason)
    names = ("as demonstrated", f"detour up to {100.0 * detours[-1]:.0f} cm")[: len(detours)]
    curves = dict(zip(names, radii.T, strict=True))
    title = f"{planner.skill.name}: the largest sphere that is passed"
    picture = _drawn(lambda path: draw_passed_spheres(path, title, places.shares, places.free, curves))
    rows = [
        (f"{100.0 * share:.0f} %", 100.0 * free, *(100.0 * own).tolist(), reason or "the largest that was tried")
        for share, free, own, reason in zip(places.shares, places.free, radii, reasons, strict=True)
    ]
    scene = "the scene that the skill keeps" if planner.skill.scene is not None else "nothing else around the arm"
    text = (
        "One sphere stands with its centre on the tool's path, all of the arm is kept off it, and it is passed where "
        "a motion from the mean start to the mean goal is certified: as demonstrated, or by a detour. Radii up to "
        f"{100.0 * LARGEST:.0f} cm, in steps of {1e3 * STEP:.0f} mm, by bisection; with {scene}. No motion passes what "
        "touches the arm at start or goal."
    )
    head = ("place", "touches an end from [cm]", *(f"{name} [cm]" for name in names), "why the next one is not passed")
    caption = "Radii along the motion; grey is what touches the arm at start or goal."
    section = note(text) + figure(picture, caption) + table(head, rows, digits=1)
    return section, radii[PLACES // 2], min(float(places.free[PLACES // 2]), LARGEST)


def _certificate(planner: ReactivePlanner) -> str:
    settings, collision = planner.settings, planner.collision
    numbers = (
        f"With default parameters, for this robot: {int(np.count_nonzero(collision.moving))} spheres on moving links, "
        f"`obstacle_margin` {1e3 * settings.obstacle_margin:.0f} mm, `prediction` {settings.prediction:g} s."
    )
    return (
        note("Every motion to a goal is certified before it is sent; without a certificate the arm stops. " + numbers)
        + heading("It counts") + table((), COUNTED) + heading("It does not count") + table((), NOT_COUNTED)
    )  # fmt: skip


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3f}" for value in values)


def _drawn(draw: Callable[[Path], None]) -> bytes:
    """The PNG that a function draws into a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        draw(path)
        return path.read_bytes()
