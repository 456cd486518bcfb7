"""The report of a skill as a file: what `train` and `inspect` write."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geodesic_motion_ros.demonstrations.recordings import Recording
    from geodesic_motion_ros.skill.skill import Skill


def write_report(skill: Skill, picture: Path, path: Path, recording: Recording | None = None) -> None:
    """Write the page of a skill, and say where it is.

    picture : of its latent space, as `pictured` draws it. recording : what it was learned from, where that is at hand.
    """
    from tqdm import tqdm

    from geodesic_motion_ros.planning.declared_scene import DeclaredScene
    from geodesic_motion_ros.planning.planner import ReactivePlanner
    from geodesic_motion_ros.visualization.skill_report import report_page

    # Without a scene there would be no detours to measure.
    scene = DeclaredScene.recorded(skill) or DeclaredScene.empty()
    shown = partial(tqdm, desc="largest spheres", unit="place")
    page = report_page(ReactivePlanner(skill, scene=scene), picture.read_bytes(), recording, shown)
    path.write_text(page, encoding="utf-8")
    print(f"wrote its report to {path}")
