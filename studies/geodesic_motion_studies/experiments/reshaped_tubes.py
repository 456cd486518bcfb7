"""How a moving sphere reshapes the metric of a whole-arm skill: a cut through its latent tubes, the path in it.

The cut is the plane through the latent space in which the free path lies as nearly as in any. The magnification factor
is log sqrt det M of the metric with the paper's ambient factor,

    M(z) = 1/K [sum_k m(p_k) (J_k^T J_k + S_k^T S_k) + what no obstacle stretches],

J_k, S_k derivatives of body point k and of sigma seen there, by central differences. Columns of the table, a row per
moment: the sphere's distance from the free path, the length of the path in the metric, the tool's clearance along it.
The same of the latent plane of a skill of poses is part of `pouring-task` (`reshaped_metric`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.paper.literal_search import ambient_factors
from geodesic_motion_ros.paper.paper_planner import PaperPlanner, PaperSettings
from geodesic_motion_ros.robot.body_points import BodyPoints, end_effector_poses, place_body_points
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import VERMILION, write_figure
from geodesic_motion_studies.experiments.latent_pictures import MAGNIFICATION_LABEL, draw_haloed
from geodesic_motion_studies.experiments.study import OfSkill, Report

#: How far from the middle of the free path the sphere is at each moment, and its radius [m].
DISTANCES, RADIUS = (0.30, 0.15, 0.05, 0.0), 0.06
#: zeta; points along each side of a picture; half of a difference, as a share of the latent box.
_STRENGTH, _SIDE, _NUDGE = 1000.0, 160, 1e-4


@dataclass(frozen=True)
class Moment:
    """One moment: where the sphere is, log sqrt det M over the picture (side, side), and the path (n, 2) in it."""

    distance_mm: float
    length: float
    clearance_mm: float
    factor: np.ndarray
    path: np.ndarray


@dataclass(frozen=True)
class ReshapedReport(Report):
    """A moment for each of `DISTANCES`; codes : (N, T, 2) of the demonstrations, projected; box : corners (left, right,
    bottom, top) of the pictures.
    """

    skill: str
    moments: tuple[Moment, ...]
    codes: np.ndarray
    box: tuple[float, float, float, float]

    def table(self) -> str:
        head = ("sphere off the free path mm", "length", "tool's clearance mm")
        rows = [(each.distance_mm, each.length, each.clearance_mm) for each in self.moments]
        return "\n".join([self.skill, text_table(head, rows, digits=2)])

    def as_dict(self) -> dict[str, Any]:
        kept = ("distance_mm", "length", "clearance_mm")
        return {"skill": self.skill, "moments": [{name: asdict(each)[name] for name in kept} for each in self.moments]}

    def draw(self, path: Path) -> None:
        """A picture for each moment, all on one scale: bright where lengths are long; demonstrations as thin lines."""
        figure = Figure(figsize=(11.0, 3.1), layout="constrained")
        row = figure.subplots(1, len(self.moments))
        low, high = np.percentile(np.stack([each.factor for each in self.moments]), [1.0, 99.5])
        scale = {"vmin": low, "vmax": high, "extent": self.box, "origin": "lower", "aspect": "auto"}
        for axes, moment in zip(row, self.moments, strict=True):
            image = axes.imshow(moment.factor, **scale)
            for code in self.codes:
                axes.plot(*code.T, color="white", linewidth=0.5, alpha=0.7)
            draw_haloed(axes, moment.path, VERMILION, "-")
            axes.set_xticks([])
            axes.set_yticks([])
            axes.set_title(f"sphere {moment.distance_mm:.0f} mm off the free path", fontsize=9)
        figure.colorbar(image, ax=row, label=MAGNIFICATION_LABEL, pad=0.01)
        write_figure(figure, path)


@dataclass(frozen=True)
class Cut:
    """A plane in a latent space: points origin + u first + v second, first and second (d,) orthonormal."""

    origin: np.ndarray
    axes: np.ndarray

    @classmethod
    def through(cls, path: np.ndarray) -> Cut:
        """The plane that a path (n, d) is nearest to."""
        origin = path.mean(axis=0)
        return cls(origin, np.linalg.svd(path - origin)[2][:2])

    def seen(self, latent: np.ndarray) -> np.ndarray:
        """Coordinates (n, 2) of latent points (n, d), projected."""
        return (latent - self.origin) @ self.axes.T

    def points(self, coordinates: np.ndarray) -> np.ndarray:
        """Latent points (n, d) at coordinates (n, 2)."""
        return self.origin + coordinates @ self.axes


@dataclass(frozen=True)
class ReshapedTubes(OfSkill):
    """Move a sphere onto the free path of a whole-arm skill, and plan at every moment.

    shape : nodes of the graph.
    """

    skill: str = "paper_reach"
    shape: tuple[int, int, int] = (32, 32, 32)

    def measured(self, skill: Skill) -> ReshapedReport:
        planner = PaperPlanner(skill, PaperSettings(_STRENGTH), self.shape)
        ends = tuple(tuple(np.split(pose, [3])) for pose in (skill.start_pose, skill.goal_pose))
        free = planner.plan(*ends)
        middle = planner.tool_poses(free)[0][len(free.latent) // 2]
        cut = Cut.through(free.latent)
        codes = cut.seen(skill.codes)
        border = 0.1 * np.ptp(codes, axis=(0, 1))
        (left, bottom), (right, top) = codes.min(axis=(0, 1)) - border, codes.max(axis=(0, 1)) + border
        across, up = np.meshgrid(np.linspace(left, right, _SIDE), np.linspace(bottom, top, _SIDE))
        shown = cut.points(np.stack([across.reshape(-1), up.reshape(-1)], axis=1))
        moments = []
        for distance in DISTANCES:
            sphere = (middle + distance * np.array([0.0, 0.0, 1.0]))[None], np.array([RADIUS])
            planner.set_obstacles(Obstacles.of_spheres(*sphere))
            path = planner.plan(*ends)
            clearance = float(np.linalg.norm(planner.tool_poses(path)[0] - sphere[0], axis=1).min()) - RADIUS
            factor = 0.5 * np.linalg.slogdet(tensors(skill, shown, *sphere, _STRENGTH))[1]
            length = riemannian_length(skill, path.latent, *sphere, _STRENGTH)
            moments.append(
                Moment(1e3 * distance, length, 1e3 * clearance, factor.reshape(_SIDE, _SIDE), cut.seen(path.latent))
            )
        return ReshapedReport(skill.name, tuple(moments), codes, (left, right, bottom, top))


def tensors(
    skill: Skill, latent: np.ndarray, centres: np.ndarray, radii: np.ndarray, strength: float
) -> np.ndarray:
    """Metric tensors M (n, d, d) of a whole-arm skill at latent points (n, d) among spheres (o, 3), (o,) [m]; without
    its term of the joints alone, which the paper lacks.
    """
    step = _NUDGE * (skill.latent_upper - skill.latent_lower)
    columns = []
    for axis, size in zip(np.eye(len(step)), step, strict=True):
        columns.append([part / (2.0 * size) for part in _differences(skill, latent, size * axis)])
    points, rest = (np.stack(part, axis=-1) for part in zip(*columns, strict=True))
    robot, body = _body(skill)
    places = place_body_points(skill.decoder.configurations(latent), body.frames, body.offsets, robot.chain)
    factors = np.empty(places.shape[:2])
    for i, body in enumerate(places):
        ambient_factors(body, centres, radii, strength, factors[i])
    stretched = np.einsum("nk,nkad,nkae->nde", factors, points, points)
    return (stretched + np.einsum("nrd,nre->nde", rest, rest)) / places.shape[1]


def riemannian_length(
    skill: Skill, curve: np.ndarray, centres: np.ndarray, radii: np.ndarray, strength: float
) -> float:
    """Length of a curve (n, d) in the metric of `tensors`, by its tensors halfway between the points."""
    steps = np.diff(curve, axis=0)
    metric = tensors(skill, curve[:-1] + 0.5 * steps, centres, radii, strength)
    return float(np.sqrt(np.einsum("nd,nde,ne->n", steps, metric, steps)).sum())


def _differences(skill: Skill, latent: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What changes from z - step to z + step: of body points and of sigma seen there (n, K, 6), of the rest (n, r)."""
    robot, body = _body(skill)
    ahead, behind = latent + step, latent - step
    here = skill.decoder.configurations(latent)
    spread = 0.5 * skill.metric.sigma_weight * (skill.decoder.uncertainty(ahead) - skill.decoder.uncertainty(behind))
    ends = skill.decoder.configurations(ahead), skill.decoder.configurations(behind)
    sides = end_effector_poses(here, robot.chain)[1]
    moved, turned = [], []
    for after, before in (ends, (here + spread, here - spread)):
        points = [place_body_points(each, body.frames, body.offsets, robot.chain) for each in (after, before)]
        # With one sign for all axes, as products of their differences are in the metric.
        quaternions = [
            turns * np.where(np.sum(turns * sides, axis=1) < 0.0, -1.0, 1.0)[:, None]
            for turns in (end_effector_poses(each, robot.chain)[1] for each in (after, before))
        ]
        moved.append(points[0] - points[1])
        turned.append(skill.metric.orientation_weight * (quaternions[0] - quaternions[1]))
    return np.concatenate(moved, axis=2), np.concatenate(turned, axis=1)


def _body(skill: Skill) -> tuple[Robot, BodyPoints]:
    robot = Robot.named(skill.robot)
    return robot, skill.metric.body_points(robot)
