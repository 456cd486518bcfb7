"""`inspect`: what is in a skill."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geodesic_motion_ros.cli.arguments import HelpFormatter, add_json, pictured, writable
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.tables import write_json

if TYPE_CHECKING:
    from geodesic_motion_ros.skill import Skill

_DESCRIPTION = """\
Shows what a skill holds: what it was learned from, how well, where it begins and ends, how large its latent graph is
and from which thresholds on the planner refuses a path. Writes the picture of its latent space.
"""
_EPILOG = """\
examples:
  geodesic-motion inspect panda_pouring                 a shipped skill, by its name
  geodesic-motion inspect skills/pouring --json out/pouring.json --picture out/pouring.png
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "inspect", help="what is in a skill",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("skill", metavar="SKILL", help="its folder, or the name of a shipped one")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="where its picture goes; without it out/inspect/NAME.png"
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Describe, print, draw."""
    from geodesic_motion_ros.skill import Skill

    skill = Skill.load(arguments.skill)
    writable(arguments.json)
    described = describe(skill)
    _print(described)
    if arguments.json is not None:
        write_json(arguments.json, described)
    picture = arguments.picture or Path("out/inspect") / f"{Path(arguments.skill).name}.png"
    picture.parent.mkdir(parents=True, exist_ok=True)
    pictured(skill, picture)


def describe(skill: Skill) -> dict[str, Any]:
    """What a skill holds, as plain values; lengths in metres unless a name says otherwise."""
    graph = skill.graph()
    sheets = 2 if skill.orientation_model == "two_cluster" and len(skill.codes) % 2 == 0 else 1
    counts = np.bincount(graph.component)
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
            "distance": float(np.linalg.norm(goal[:3] - start[:3])),
            "turn_deg": float(np.degrees(angle_between(start[3:], goal[3:]))),
        },
        "latent": {
            "dimension": skill.decoder.latent_dimension,
            "lower": skill.latent_lower.tolist(), "upper": skill.latent_upper.tolist(),
            "orientation_model": skill.orientation_model, "kernels": len(skill.decoder.rbf_centres),
            "sigma_weight": skill.metric.sigma_weight, "orientation_scale": skill.metric.orientation_scale,
        },
        "graph": {
            "shape": list(graph.grid.shape), "nodes": len(graph.latent), "edges": len(graph.edges),
            "kept_percent": 100.0 * len(graph.latent) / float(np.prod(graph.grid.shape)),
            "large_pieces": int(np.sum(counts >= 0.05 * counts.max())),
        },
        "thresholds": {
            "sigma_support": skill.sigma_support, "sigma_limit": skill.sigma_limit,
            "energy_per_edge": skill.energy_per_edge,
        },
        "quality": dict(skill.quality),
        "provenance": {name: value for name, value in skill.provenance.items() if name != "settings"},
    }  # fmt: skip


def _print(described: dict[str, Any]) -> None:
    print(described["name"])
    for title, values in described.items():
        if isinstance(values, dict) and values:
            print(f"\n{title}")
            for name, value in values.items():
                print(f"  {name:32} {_text(value)}")


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return str(value)
