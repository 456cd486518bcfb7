"""`inspect`: what is in a skill, or in a recording before it is learned from."""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geodesic_motion_ros.cli.arguments import (
    HelpFormatter,
    add_bag_options,
    add_formats,
    add_json,
    pictured,
    writable,
)
from geodesic_motion_ros.cli.report import planner_of, write_report
from geodesic_motion_ros.skill.description import DESCRIPTION
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_ros.utils.tables import text_table, write_json

if TYPE_CHECKING:
    from geodesic_motion_ros.manifold.latent_graph import LatentGraph
    from geodesic_motion_ros.skill.skill import Skill

_DESCRIPTION = """\
Shows what a skill holds: what it was learned from, how well, where it begins and ends, how large its latent graph is
and from which thresholds on the planner refuses a path. Writes the picture of its latent space; that of a joint-space
skill has a geodesic around an obstacle on the arm besides. With --html all that is known of it is on one page.

Of a recording (whatever `train` reads: a bag, .csv or a folder of them, .npy, .npz) it shows the demonstrations and
everything that is wrong with them, each with its time and what `train` does about it; the picture has positions over
time.
"""
_EPILOG = """\
examples:
  geodesic-motion inspect panda_pouring                 a shipped skill, by its name
  geodesic-motion inspect skills/pouring --json out/pouring.json --picture out/pouring.png
  geodesic-motion inspect skills/pouring --html out/pouring.html
  geodesic-motion inspect pouring.npy --units cm
  geodesic-motion inspect recordings                    a folder written by the node `record`
  geodesic-motion inspect reach_bag --topic /joint_states
  geodesic-motion inspect monday.mcap --topic /tf:panda_link0:panda_hand --split /mark
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "inspect", help="what is in a skill, or in a recording",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument(
        "skill", metavar="SKILL",
        help="its folder, or the name of a shipped one; or a recording: a file, a folder of .csv files, or a bag",
    )  # fmt: skip
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="where its picture goes; without it out/inspect/NAME.png"
    )
    parser.add_argument(
        "--html", type=Path, metavar="FILE",
        help="write the report of a skill as well, as `train` does; takes some seconds",
    )  # fmt: skip
    add_json(parser)
    group = parser.add_argument_group("recording")
    add_formats(group, joints=True)
    add_bag_options(group)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Describe, print, draw."""
    from geodesic_motion_ros.demonstrations.bags import is_bag
    from geodesic_motion_ros.demonstrations.mapped_tables import TEXT_FILES
    from geodesic_motion_ros.demonstrations.recorded_tables import find_files
    from geodesic_motion_ros.skill.skill import Skill

    writable(arguments.json)
    writable(arguments.html)
    path = Path(arguments.skill)
    tables = find_files(path) and not (path / DESCRIPTION).exists()
    if is_bag(path) or tables or path.is_file() or path.suffix.lower() in (*TEXT_FILES, ".npy", ".npz"):
        if arguments.html is not None:
            raise ParameterError(f"--html is of skills, {path} is a recording: `train` writes one of what it learns")
        run_recording(arguments, path, is_bag(path))
        return
    if path.is_dir() and not os.path.lexists(path / DESCRIPTION):
        raise ParameterError(
            f"{path} holds neither a skill ({DESCRIPTION}) nor a recording (metadata.yaml, .mcap, .db3 of a bag; .csv)"
        )
    skill = Skill.load(arguments.skill)
    described = describe(skill)
    _print(described)
    if arguments.json is not None:
        write_json(arguments.json, described)
    picture = _picture(arguments, path)
    pictured(skill, picture)
    if arguments.html is not None:
        write_report(planner_of(skill), picture, arguments.html)


def run_recording(arguments: argparse.Namespace, path: Path, of_bags: bool) -> None:
    """Print the demonstrations of a recording and its flaws, and draw them. The exit status is that of `train`."""
    from geodesic_motion_ros.cli.recorded import read_recorded, refuse_unsaid_order
    from geodesic_motion_ros.visualization.recording_view import draw_recording

    recording = read_recorded(arguments, (path,), of_bags)
    described = recording.describe()
    unit = "rad" if recording.robot else "m"
    print(text_table(
        ("demonstration", "from [s]", "to [s]", "samples", "per s", f"length [{unit}]", "learned from"),
        [tuple(row.values()) for row in described["demonstrations"]], left=(0, 6),
    ))  # fmt: skip
    print()
    rows = [tuple(flaw.values()) for flaw in described["flaws"]]
    print(text_table(("in", "at [s]", "found", "what `train` does"), rows, left=(0, 2, 3)) if rows else "no flaws")
    if arguments.json is not None:
        write_json(arguments.json, described)
    picture = _picture(arguments, path)
    draw_recording(recording.takes, recording.motions, recording.left_out_names, recording.flaws, picture)
    print(f"\nwrote its picture to {picture}")
    demonstrations = recording.demonstrations(arguments.strict)
    if not recording.robot and demonstrations.has_orientation:
        refuse_unsaid_order(arguments, path, demonstrations)


def _picture(arguments: argparse.Namespace, path: Path) -> Path:
    """Where the picture goes; its folder is there then."""
    picture = arguments.picture or Path("out/inspect") / f"{path.name}.png"
    picture.parent.mkdir(parents=True, exist_ok=True)
    return picture


def _halfway(skill: Skill) -> list[float] | None:
    """Where the tool is in the middle of the planned motion (3,) [m], from the mean start to the mean goal; None where
    there is none: a sphere there is in its path.
    """
    from geodesic_motion_ros.planning.planner import ReactivePlanner

    start, goal = skill.start_pose, skill.goal_pose
    try:
        planner = ReactivePlanner(skill)
        reference = planner.plan(start[:3], start[3:], goal[:3], goal[3:]).reference
    except GeodesicMotionError:  # a skill that no planner takes can be looked at all the same
        return None
    if reference is None:
        return None
    position, _ = planner.robot.forward(reference.sample(0.5 * reference.duration)[0])
    return position.tolist()


def describe(skill: Skill) -> dict[str, Any]:
    """What a skill holds, as plain values; lengths in metres unless a name says otherwise."""
    from geodesic_motion_ros.geometry.quaternions import angle_between

    begun = time.perf_counter()
    graph = skill.graph()
    seconds = time.perf_counter() - begun
    sheets = 2 if skill.orientation_model == "two_cluster" and len(skill.codes) % 2 == 0 else 1
    start, goal = skill.start_pose, skill.goal_pose
    return {
        "name": skill.name,
        "robot": {
            "robot": skill.robot, "space": skill.space,
            "base_frame": skill.base_frame, "tool_frame": skill.tool_frame,
        },
        "motion": {
            "demonstrations": len(skill.codes) // sheets,
            "start_position": start[:3].tolist(), "start_quaternion": start[3:].tolist(),
            "goal_position": goal[:3].tolist(), "goal_quaternion": goal[3:].tolist(),
            "halfway_position": _halfway(skill),
            "distance": float(np.linalg.norm(goal[:3] - start[:3])),
            "turn_deg": float(np.degrees(angle_between(start[3:], goal[3:]))),
            "demonstrated_s": None if skill.pace is None else float(skill.pace[-1]),
        } | _families(skill),
        "latent": {
            "dimension": skill.decoder.latent_dimension,
            "lower": skill.latent_lower.tolist(), "upper": skill.latent_upper.tolist(),
            "sheet": skill.sheet, "orientation_model": skill.orientation_model,
            "kernels": len(skill.decoder.rbf_centres), **asdict(skill.metric),
        },
        "graph": _graph(skill, graph) | {"built_in_s": seconds},
        "thresholds": {
            "sigma_support": skill.sigma_support, "sigma_limit": skill.sigma_limit,
            "energy_per_edge": skill.energy_per_edge,
        },
        "quality": dict(skill.quality),
        "provenance": {name: value for name, value in skill.provenance.items() if name != "settings"},
    }  # fmt: skip


def _families(skill: Skill) -> dict[str, Any]:
    """How many demonstrations each family has, and how many groups of starts and goals there are."""
    sheet = skill.canonical
    if sheet is None:
        return {}
    figures: dict[str, Any] = {"demonstrations_per_family": np.bincount(sheet.modes.astype(int)).tolist()}
    if skill.space == "joint":
        figures |= {"start_groups": len(sheet.start_poles), "goal_groups": len(sheet.goal_poles)}
    return figures


def _graph(skill: Skill, graph: LatentGraph) -> dict[str, Any]:
    from scipy.spatial import cKDTree

    from geodesic_motion_ros.manifold.grid import LatentGrid

    counts, grid = np.bincount(graph.component), graph.grid
    of_lattice = isinstance(grid, LatentGrid)
    figures = {
        "shape": list(grid.shape) if of_lattice else None, "nodes": len(graph.latent), "edges": len(graph.edges),
        "kept_percent": 100.0 * len(graph.latent) / float(np.prod(grid.shape)) if of_lattice else None,
        "large_pieces": len(graph.pieces_with_demonstrations()),
        "nodes_per_piece": np.sort(counts[graph.pieces_with_demonstrations()])[::-1].tolist(),
    }  # fmt: skip
    if skill.canonical is not None and np.any(skill.canonical.modes):
        modes = np.repeat(skill.canonical.modes.astype(int), skill.codes.shape[1])
        # Families of a sheet are those of its demonstrations as recorded, without antipodal copies.
        codes = skill.codes[: len(skill.canonical.modes)].reshape(-1, skill.codes.shape[-1])
        figures["nodes_per_family"] = np.bincount(modes[cKDTree(codes).query(graph.latent)[1]]).tolist()
    return figures


def _print(described: dict[str, Any]) -> None:
    print(described["name"])
    for title, values in described.items():
        if isinstance(values, dict) and values:
            print(f"\n{title}")
            for name, value in values.items():
                print(f"  {name:32} {_text(value)}")


def _text(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return str(value)
