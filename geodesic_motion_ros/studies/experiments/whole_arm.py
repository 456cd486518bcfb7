"""The whole arm on one joint-space skill, in parts: no obstacles, spheres that stand there, spheres that move.

What each part asks, and how it is judged, stands in `tubes.py`, `blocked_arm.py` and `moving_arm.py`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.planning.arm_clearance import configuration_clearance
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.studies.experiments.blocked_arm import KINDS, BlockedPaths, BlockedScene, Kind, every
from geodesic_motion_ros.studies.experiments.moving_arm import MovingArmScene, MovingArmStage
from geodesic_motion_ros.studies.experiments.moving_spheres import draw_clearances, moving_figures, play_scenes
from geodesic_motion_ros.studies.experiments.posture_strip import posture_strips
from geodesic_motion_ros.studies.experiments.tubes import TubePath, tube_path
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import write_figure

Part = Literal["tubes", "one path", "all paths", "elbow", "moving"]
PARTS: tuple[Part, ...] = ("tubes", *KINDS, "moving")
#: Time between the postures that a picture chooses from [s].
_PICTURE_PERIOD = 0.02


@dataclass(frozen=True)
class WholeArmSettings:
    """Which parts, how many scenes of standing spheres, or of none, each, and how many of moving ones.

    `seed` is of the scenes. `processes` play scenes of moving spheres at once, which does not change them.
    """

    parts: tuple[Part, ...] = PARTS
    blocked_scenes: int = 40
    moving_scenes: int = 40
    seed: int = 0
    processes: int = 1
    planner: PlannerSettings = field(default_factory=PlannerSettings)

    def __post_init__(self) -> None:
        unknown = [part for part in self.parts if part not in PARTS]
        if unknown or not self.parts:
            raise ParameterError(f"parts are {', '.join(self.parts)}: choose from {', '.join(PARTS)}")
        for name in ("blocked_scenes", "moving_scenes", "processes"):
            if getattr(self, name) < 1:
                raise ParameterError(f"{name} is {getattr(self, name)}; at least 1 is needed")
        if self.seed < 0:
            raise ParameterError(f"seed is {self.seed}; it must not be negative")


@dataclass(frozen=True)
class WholeArmReport:
    """All scenes of the requested parts."""

    settings: WholeArmSettings
    tubes: list[TubePath]
    blocked: dict[Kind, list[BlockedScene]]
    moving: list[MovingArmScene] = field(repr=False)

    def tube_summary(self) -> dict[str, int]:
        """The figures of paths without obstacles."""
        return {
            "pairs": len(self.tubes),
            "in_their_own_familys_tube": sum(path.own for path in self.tubes),
            "in_one_tube": sum(path.kept for path in self.tubes),
            "no_path": sum(bool(path.reason) for path in self.tubes),
        }

    def blocked_summary(self, kind: Kind) -> dict[str, float | int | None]:
        """The figures of one kind of standing spheres."""
        scenes = self.blocked[kind]
        answers = [scene.answer for scene in scenes]
        answered = [1e3 * answer.clearance for answer in answers if answer.answered]
        controls = [scene.hand_only for scene in scenes if scene.hand_only is not None]
        return {
            "scenes": len(scenes),
            "switched": sum(answer.answered and answer.switched and not answer.hits for answer in answers),
            "same_family": sum(answer.answered and not answer.switched and not answer.hits for answer in answers),
            "infeasible": sum(not answer.answered for answer in answers),
            "hits": sum(answer.hits for answer in answers),
            "least_clearance_mm": min(answered, default=None),
            "median_clearance_mm": float(np.median(answered)) if answered else None,
            "promised_too_much": sum(
                answer.answered and answer.certified > answer.clearance + 1e-4 for answer in answers
            ),
            "hand_only_hits": sum(control.hits for control in controls) if controls else None,
        }

    def moving_summary(self) -> dict[str, float | int]:
        """The figures of moving spheres."""
        scenes = self.moving
        worst = np.max([scene.strains for scene in scenes], axis=0)
        return moving_figures(scenes) | {
            "replans": sum(scene.replans for scene in scenes),
            "largest_step_rad": max(scene.step for scene in scenes),
            "samples_over_limits": sum(scene.excess for scene in scenes),
            "velocity_share": float(worst[0]),
            "acceleration_share": float(worst[1]),
            "jerk_share": float(worst[2]),
        }

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        content: dict[str, Any] = {"settings": asdict(self.settings)}
        if self.tubes:
            content["tubes"] = {"summary": self.tube_summary(), "pairs": [asdict(path) for path in self.tubes]}
        for kind, scenes in self.blocked.items():
            content[kind] = {"summary": self.blocked_summary(kind), "scenes": [_as_dict(scene) for scene in scenes]}
        if self.moving:
            content["moving"] = {"summary": self.moving_summary(), "scenes": [scene.as_dict() for scene in self.moving]}
        return content

    def table(self) -> str:
        """The tables as plain text, with what was declared infeasible and why."""
        lines = []
        if self.tubes:
            rows = [[name.replace("_", " "), value] for name, value in self.tube_summary().items()]
            lines.append(text_table(["without obstacles", ""], rows, 0))
        if self.blocked:
            head = [
                "standing spheres", "scenes", "switched", "same family", "infeasible", "hits", "least mm", "median mm",
                "promised too much", "hand alone hits",
            ]  # fmt: skip
            lines.append(text_table(head, [[kind, *self.blocked_summary(kind).values()] for kind in self.blocked], 1))
        for kind, scenes in self.blocked.items():
            reasons = Counter(scene.answer.reason for scene in scenes if not scene.answer.answered)
            lines += [f"{kind}, {count} x: {reason}" for reason, count in reasons.most_common()]
        if self.moving:
            rows = [[name.replace("_", " "), value] for name, value in self.moving_summary().items()]
            lines.append(text_table(["moving spheres", ""], rows, 3))
        return "\n".join(lines)


def measure_whole_arm(
    skill: Skill, settings: WholeArmSettings = WholeArmSettings(), show_progress: bool = True
) -> WholeArmReport:
    """Draw, plan, play and judge.

    Raises
    ------
    ParameterError : the skill is not of joint space, or there are no such scenes with it.
    """
    if skill.space != "joint":
        raise ParameterError(f"'{skill.name}' is a skill of {skill.space} space: this experiment is of joint space")
    tubes = []
    if "tubes" in settings.parts:
        planner = ReactivePlanner(skill, settings.planner)
        pairs = tqdm(range(settings.blocked_scenes), desc="tubes", unit="pair", disable=not show_progress)
        tubes = [tube_path(planner, number, settings.seed) for number in pairs]
    blocked: dict[Kind, list[BlockedScene]] = {}
    kinds = [kind for kind in KINDS if kind in settings.parts]
    if kinds:
        paths, numbers = BlockedPaths(skill, settings.planner), range(settings.blocked_scenes)
        for kind in kinds:
            counted = tqdm(numbers, desc=kind, unit="scene", disable=not show_progress)
            blocked[kind] = [paths.scene(kind, number, settings.seed) for number in counted]
    moving = []
    if "moving" in settings.parts:
        stage = skill, settings.planner, settings.seed
        moving = play_scenes(MovingArmStage, stage, settings.moving_scenes, settings.processes, show_progress)
    return WholeArmReport(settings, tubes, blocked, moving)


def draw_whole_arm(report: WholeArmReport, folder: Path) -> None:
    """Clearances in `whole_arm.png`; postures with and without the sphere of one switch in `strip.png`.

    The switch is the one whose sphere is deepest in the arm halfway on the nominal path.
    """
    from matplotlib.figure import Figure
    from matplotlib.image import imsave

    standing = {
        f"{kind}, {{}} of {len(scenes)} answered": [s.answer.clearance for s in scenes if s.answer.answered]
        for kind, scenes in report.blocked.items()
    }
    moving = {
        f"moving, {{}} of {len(report.moving)} in which the arm moved": [
            run.clearance for run in report.moving if np.isfinite(run.clearance)
        ]
    }
    # What was not measured has no panel.
    panels = [panel for panel in (("references", standing), ("scenes", moving)) if any(panel[1].values())]
    if panels:
        figure = Figure(figsize=(6 * len(panels), 4.5), layout="constrained")
        for axes, (counted, clearances) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            draw_clearances(axes, clearances)
            axes.set(xlabel="least clearance of the arm [mm]", ylabel=counted)
        write_figure(figure, folder / "whole_arm.png")
    switches = [
        scene for scenes in report.blocked.values() for scene in scenes
        if scene.reference is not None and scene.answer.switched
    ]  # fmt: skip
    if switches:
        imsave(folder / "strip.png", switch_strip(min(switches, key=_halfway_clearance)))


def switch_strip(scene: BlockedScene, width: int = 600, height: int = 400) -> np.ndarray:
    """Picture, uint8, of a scene's motions as rows of postures: without the spheres above, with them below.

    One posture is (height, width, 3) pixels. The curves are those of tool and elbow.
    """
    references = [scene.nominal, scene.reference or scene.nominal]
    motions = [every(_PICTURE_PERIOD, reference) for reference in references]
    return posture_strips(motions, ({}, _spheres(scene)), width, height)


def _halfway_clearance(scene: BlockedScene) -> float:
    """How far the arm is from the spheres halfway on the nominal path [m]."""
    model, halfway = CollisionModel.named("panda"), scene.nominal.sample(0.5 * scene.nominal.duration)[0]
    return configuration_clearance(model, Robot.named("panda"), halfway, scene.centres, scene.radii)[0]


def _spheres(scene: BlockedScene) -> dict[str, tuple[np.ndarray, float]]:
    return {
        str(i): (centre, float(radius))
        for i, (centre, radius) in enumerate(zip(scene.centres, scene.radii, strict=True))
    }


def _as_dict(scene: BlockedScene) -> dict[str, Any]:
    return {
        "number": scene.number,
        "start": scene.query.start,
        "goal": scene.query.goal,
        "centres": scene.centres,
        "radii": scene.radii,
        "answer": asdict(scene.answer),
        "hand_only": None if scene.hand_only is None else asdict(scene.hand_only),
    }
