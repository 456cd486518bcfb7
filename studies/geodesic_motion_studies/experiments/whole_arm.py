"""The whole arm on one joint-space skill, in parts: no obstacles, spheres that stand there, spheres that move.

What each part asks, and how it is judged, stands in `tubes.py`, `blocked_arm.py` and `moving_arm.py`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imsave
from tqdm import tqdm

from geodesic_motion_ros.certification.arm_clearance import configuration_clearance
from geodesic_motion_ros.cli.arguments import name_list
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import write_figure
from geodesic_motion_studies.experiments.blocked_arm import KINDS, BlockedPaths, BlockedScene, Kind, every
from geodesic_motion_studies.experiments.moving_arm import MovingArmScene, MovingArmStage
from geodesic_motion_studies.experiments.moving_spheres import draw_clearances, moving_figures, play_scenes
from geodesic_motion_studies.experiments.posture_strip import numbered, posture_strips
from geodesic_motion_studies.experiments.study import OfSkill, Report, option
from geodesic_motion_studies.experiments.tubes import TubePath, tube_path

Part = Literal["tubes", "one path", "all paths", "elbow", "moving"]
PARTS: tuple[Part, ...] = ("tubes", *KINDS, "moving")
#: Time between the postures that a picture chooses from [s].
_PICTURE_PERIOD = 0.02


@dataclass(frozen=True)
class WholeArm(OfSkill):
    """Draw, plan, play and judge the scenes of the requested parts.

    processes : play scenes of moving spheres at once, which does not change them.
    """

    skill: str = option("panda_reach_to_grasp", "of joint space: its folder, or a shipped name", metavar="SKILL")
    parts: tuple[Part, ...] = option(PARTS, "what is measured", type=name_list(","), metavar="PART,PART")
    scenes: int = option(40, "of standing spheres, or of none, in each part", least=1)
    moving_scenes: int = option(40, "of moving spheres", least=1)
    seed: int = option(0, "of the scenes", least=0)
    processes: int = option(1, "that play scenes of moving spheres", least=1)
    planner: PlannerSettings = field(default_factory=PlannerSettings)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.parts or not set(self.parts) <= set(PARTS):
            raise ParameterError(f"parts are {', '.join(self.parts)}: choose from {', '.join(PARTS)}")

    def measured(self, skill: Skill) -> WholeArmReport:
        """ParameterError: the skill is not of joint space, or there are no such scenes with it."""
        if skill.space != "joint":
            raise ParameterError(f"'{skill.name}' is a skill of {skill.space} space: this experiment is of joint space")
        tubes, moving = [], []
        if "tubes" in self.parts:
            planner = ReactivePlanner(skill, self.planner)
            pairs = tqdm(range(self.scenes), desc="tubes", unit="pair")
            tubes = [tube_path(planner, number, self.seed) for number in pairs]
        blocked: dict[Kind, list[BlockedScene]] = {}
        kinds = [kind for kind in KINDS if kind in self.parts]
        if kinds:
            paths = BlockedPaths(skill, self.planner)
            for kind in kinds:
                numbers = tqdm(range(self.scenes), desc=kind, unit="scene")
                blocked[kind] = [paths.scene(kind, number, self.seed) for number in numbers]
        if "moving" in self.parts:
            stage = skill, self.planner, self.seed
            moving = play_scenes(MovingArmStage, stage, self.moving_scenes, self.processes)
        return WholeArmReport(self, tubes, blocked, moving)


@dataclass(frozen=True)
class WholeArmReport(Report):
    """All scenes of the requested parts."""

    settings: WholeArm
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

    def draw(self, path: Path) -> None:
        """Clearances in `whole_arm.png`; postures with and without the sphere of one switch in `strip.png`.

        The switch is the one whose sphere is deepest in the arm halfway on the nominal path.
        """
        standing = {
            f"{kind}, {{}} of {len(scenes)} answered": [s.answer.clearance for s in scenes if s.answer.answered]
            for kind, scenes in self.blocked.items()
        }
        moving = {
            f"moving, {{}} of {len(self.moving)} in which the arm moved": [
                run.clearance for run in self.moving if np.isfinite(run.clearance)
            ]
        }
        # What was not measured has no panel.
        panels = [panel for panel in (("references", standing), ("scenes", moving)) if any(panel[1].values())]
        if panels:
            figure = Figure(figsize=(6 * len(panels), 4.5), layout="constrained")
            row = figure.subplots(1, len(panels), squeeze=False)[0]
            for axes, (counted, clearances) in zip(row, panels, strict=True):
                draw_clearances(axes, clearances)
                axes.set(xlabel="least clearance of the arm [mm]", ylabel=counted)
            write_figure(figure, path.parent / "whole_arm.png")
        switches = [
            scene for scenes in self.blocked.values() for scene in scenes
            if scene.reference is not None and scene.answer.switched
        ]  # fmt: skip
        if switches:
            imsave(path.parent / "strip.png", switch_strip(min(switches, key=_halfway_clearance)))


def switch_strip(scene: BlockedScene, width: int = 600, height: int = 400) -> np.ndarray:
    """Picture, uint8, of a scene's motions as rows of postures: without the spheres above, with them below.

    One posture is (height, width, 3) pixels. The curves are those of tool and elbow.
    """
    references = [scene.nominal, scene.reference or scene.nominal]
    motions = [every(_PICTURE_PERIOD, reference) for reference in references]
    return posture_strips(motions, ({}, numbered(scene.centres, scene.radii)), width, height)


def _halfway_clearance(scene: BlockedScene) -> float:
    """How far the arm is from the spheres halfway on the nominal path [m]."""
    model, halfway = CollisionModel.named("panda"), scene.nominal.sample(0.5 * scene.nominal.duration)[0]
    return configuration_clearance(model, Robot.named("panda"), halfway, scene.centres, scene.radii)[0]


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
