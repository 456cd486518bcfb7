"""What the volume term does: one joint-space skill learned without and with the change of variables to the body.

Seen at the robot's body the density of a configuration is p(theta | z) / V(theta), V = sqrt(det(J^T J)) of the stacked
Jacobian of the body points and of the tool's orientation (`learning.body_layer`). Weighted by `volume_weight` in the
evidence lower bound, -log V rewards postures in which the joints move the body little. All else is the paper's model
(`JointTrainingSettings.paper`: raw demonstrations, one lower bound for means and sigma, no likelihood of body points)
and its planner (`paper/`). Columns of the table, a row per weight and seed:

seconds         of processor for the training; nothing where the skill came from the cache
error_mm, _deg  of the tool in the training demonstrations that encoder and decoder give back
log_volume      mean log V along the obstacle-free path from the skill's start to its goal; least : its smallest value
from_mean_mm    mean distance of the tool on that path from the mean demonstration of the nearest family
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.cli.arguments import metres
from geodesic_motion_ros.demonstrations.canonical import sample_body_arc
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.modes import cluster_modes
from geodesic_motion_ros.demonstrations.readers import read_joint_demonstrations
from geodesic_motion_ros.learning.likelihoods import body_layer
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.joint_teacher import reach_to_grasp
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION, write_figure
from geodesic_motion_studies.experiments.imitation import stage_shown_on
from geodesic_motion_studies.experiments.joint_imitation import tool_curve
from geodesic_motion_studies.experiments.study import Report, Study, option, seeds, steps
from geodesic_motion_studies.experiments.trained import trained_once
from geodesic_motion_studies.tools.similarity import compare

#: Points of a path at which its volume is evaluated.
_SAMPLES = 200
_COLOURS = (BLUE, VERMILION, GREEN, ORANGE)


@dataclass(frozen=True)
class VolumeRow:
    """What was measured with one weight and seed; `volumes` (samples,) is log V along the path."""

    weight: float
    seed: int
    seconds: float | None
    error_mm: float
    error_deg: float
    log_volume: float
    least: float
    from_mean_mm: float
    volumes: np.ndarray


@dataclass(frozen=True)
class VolumeReport(Report):
    """Rows, and log V (N, samples) along the demonstrations."""

    rows: tuple[VolumeRow, ...]
    shown: np.ndarray

    def table(self) -> str:
        head = ("volume weight", "seed", "seconds", "error mm", "error deg", "log V", "least log V", "from mean mm")
        return text_table(head, [tuple(asdict(row).values())[:-1] for row in self.rows])

    def as_dict(self) -> dict[str, Any]:
        return {"rows": [asdict(row) for row in self.rows], "demonstrations": self.shown}

    def draw(self, path: Path) -> None:
        """log V along the demonstrations and along the planned paths."""
        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        axes = figure.add_subplot()
        share = np.linspace(0.0, 1.0, self.shown.shape[1])
        axes.plot(share, self.shown.T, color=GREY, linewidth=0.8, alpha=0.6)
        axes.plot([], [], color=GREY, label="demonstrations")
        weights = list(dict.fromkeys(row.weight for row in self.rows))
        for weight, colour in zip(weights, _COLOURS, strict=False):
            # The first are drawn broad: paths that coincide are seen as both.
            width = 4.0 if weight == weights[0] else 1.8
            paths = np.stack([row.volumes for row in self.rows if row.weight == weight])
            axes.plot(share, paths.T, color=colour, linewidth=width)
            axes.plot([], [], color=colour, linewidth=width, label=f"planned, volume weight {weight:g}")
        axes.set_xlabel("share of the path")
        axes.set_ylabel("log V: how much the joints move the body")
        axes.legend(frameon=False)
        write_figure(figure, path)


@dataclass(frozen=True)
class Volume(Study):
    """Learn one skill per weight and seed, all else the same, and plan with it.

    shown : what is learned where there are no `demos`; None: simulated reaches.
    training : on the raw sheet; None: the paper's, but for `steps`.
    """

    demos: str | None = option(
        None, "recorded joints, as `demonstrate`'s; without it a simulated reach to grasp, four times in two families",
        type=str, metavar="FILE",
    )  # fmt: skip
    robot: str = option(DEFAULT_ROBOT, "whose joints were recorded")
    weights: tuple[float, ...] = option((0.0, 1.0), "of the volume term", type=metres, metavar="W,W")
    steps: int | None = steps()
    seeds: tuple[int, ...] = seeds("of the trainings, one for each weight")
    shown: JointDemonstrations | None = None
    training: JointTrainingSettings | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.weights:
            raise ParameterError("no volume weights: give at least one, 0 leaves the term out")
        if self.training is not None and self.training.sheet != "raw":
            raise ParameterError("the volume term is compared in the paper's model, on the raw sheet")

    def measure(self, out: Path) -> VolumeReport:
        """SkillError: a skill that came out cannot be used."""
        demonstrations = self._demonstrations()
        base = self.training or JointTrainingSettings.paper(**({} if self.steps is None else {"steps": self.steps}))
        robot, metric = Robot.named(demonstrations.robot), base.metric
        shown = np.stack([sample_body_arc(item.configurations, robot, metric, _SAMPLES) for item in demonstrations])
        rows = []
        with tqdm(list(product(self.weights, self.seeds)), desc="volume", unit="skill") as bar:
            for weight, seed in bar:
                began, trained, tell = time.process_time(), [], stage_shown_on(bar)

                def noted(stage: str, step: int, steps: int, trained: list[str] = trained, tell: Any = tell) -> None:
                    trained.append(stage)
                    tell(stage, step, steps)

                training = replace(base, volume_weight=weight, seed=seed)
                skill = trained_once("volume", demonstrations, training, out / "skills", noted)
                seconds = time.process_time() - began if trained else None
                rows.append(_measured(skill, shown, weight, seed, seconds))
        return VolumeReport(tuple(rows), np.stack([log_volumes(curve, robot, metric) for curve in shown]))

    def _demonstrations(self) -> JointDemonstrations:
        if self.demos is not None:
            return read_joint_demonstrations(Path(self.demos), self.robot)
        return self.shown or reach_to_grasp(4, seed=0, families=2)


def log_volumes(configurations: np.ndarray, robot: Robot, metric: JointMetricSettings) -> np.ndarray:
    """log V (n,) at configurations (n, eta) [rad], of the layer that the training has."""
    return body_layer(robot, metric).log_volume(torch.tensor(configurations)).numpy()


def _measured(skill: Skill, shown: np.ndarray, weight: float, seed: int, seconds: float | None) -> VolumeRow:
    """The row of a skill; shown : (N, samples, eta) its demonstrations [rad]."""
    planner = PaperPlanner(skill)
    start, goal = (tuple(np.split(pose, [3])) for pose in (skill.start_pose, skill.goal_pose))
    path = sample_body_arc(planner.plan(start, goal).places, planner.robot, skill.metric, _SAMPLES)
    modes = cluster_modes(shown)
    means = [shown[modes == mode].mean(axis=0) for mode in np.unique(modes)]
    tool = tool_curve(path, planner.robot)
    volumes = log_volumes(path, planner.robot, skill.metric)
    return VolumeRow(
        weight,
        seed,
        seconds,
        skill.quality["training_position_error_mm"],
        skill.quality["training_orientation_error_deg"],
        float(volumes.mean()),
        float(volumes.min()),
        1e3 * min(compare(tool, tool_curve(mean, planner.robot)).dtw for mean in means),
        volumes,
    )
