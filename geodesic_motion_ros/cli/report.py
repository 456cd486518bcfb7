"""The report of a skill as a file: what `train` and `inspect` write."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geodesic_motion_ros.demonstrations.recordings import Recording
    from geodesic_motion_ros.planning.planner import ReactivePlanner
    from geodesic_motion_ros.skill.skill import Skill


def planner_of(skill: Skill) -> ReactivePlanner:
    """Make the planner that the report of a skill is of: in the scene that the skill keeps, else in an empty one."""
    from geodesic_motion_ros.certification.declared_scene import DeclaredScene
    from geodesic_motion_ros.planning.planner import ReactivePlanner

    # Without a scene there would be no detours to measure.
    return ReactivePlanner(skill, scene=DeclaredScene.of_skill(skill) or DeclaredScene.empty())


def write_report(planner: ReactivePlanner, picture: Path, path: Path, recording: Recording | None = None) -> None:
    """Write the page of a planner's skill, and say where it is.

    picture : of its latent space, as `pictured` draws it. recording : what it was learned from, where that is at hand.
    """
    from tqdm import tqdm

    from geodesic_motion_ros.visualization.skill_report import report_page

    shown = partial(tqdm, desc="largest spheres", unit="place")
    path.write_text(report_page(planner, picture.read_bytes(), recording, shown), encoding="utf-8")
    print(f"wrote its report to {path}")
