"""How a moving sphere reshapes the metric: the magnification factor at several moments, and the path at each.

Upper row: the latent plane of a skill of poses. Lower row: a plane through the latent space of a skill of
configurations, in which its free path lies as nearly as in any, with the tubes that it cuts. The magnification factor
is log sqrt det M of the metric with the paper's ambient factor,

    M(z) = sum_k m(p_k) (J_k^T J_k + S_k^T S_k) + what no obstacle stretches,

J_k, S_k derivatives of body point k and of sigma seen there, by central differences. Columns of the table, a row per
moment: the sphere's distance from the free path, the length of the path in the metric, the tool's clearance along it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from geodesic_motion_ros.graph.pose_graph import MetricSettings
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.paper.literal_search import ambient_factors
from geodesic_motion_ros.paper.paper_planner import PaperPlanner, PaperSettings
from geodesic_motion_ros.plots import write_figure
from geodesic_motion_ros.robot.body_points import BodyPoints, end_effector_poses, place_body_points
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import text_table

#: How far from the middle of the free path the sphere is at each moment, and its radius [m].
DISTANCES, RADIUS = (0.30, 0.15, 0.05, 0.0), 0.06
#: zeta; points along each side of a picture; half of a difference, as a share of the latent box; nodes of the graphs.
_STRENGTH, _SIDE, _NUDGE = 1000.0, 160, 1e-4
_SHAPES = {"task": (100, 100), "joint": (32, 32, 32)}


@dataclass(frozen=True)
class Moment:
    """One moment: where the sphere is, log sqrt det M over the picture (side, side), and the path (n, 2) in it."""

    skill: str
    distance_mm: float
    length: float
    clearance_mm: float
    factor: np.ndarray
    path: np.ndarray


@dataclass(frozen=True)
class ReshapedReport:
    """Moments, as many of each skill as `DISTANCES`; boxes : corners (left, right, bottom, top) of their pictures."""

    moments: tuple[Moment, ...]
    boxes: dict[str, tuple[float, float, float, float]]

    def table(self) -> str:
        head = ("skill", "sphere off the free path mm", "length", "tool's clearance mm")
        rows = [(each.skill, each.distance_mm, each.length, each.clearance_mm) for each in self.moments]
        return text_table(head, rows, digits=2)

    def as_dict(self) -> dict[str, Any]:
        kept = ("skill", "distance_mm", "length", "clearance_mm")
        return {"moments": [{name: asdict(each)[name] for name in kept} for each in self.moments]}


@dataclass(frozen=True)
class Cut:
    """A plane in a latent space: points origin + u first + v second, first and second (d,) orthonormal."""

    origin: np.ndarray
    axes: np.ndarray

    @classmethod
    def through(cls, path: np.ndarray) -> Cut:
        """The plane that a path (n, d) is nearest to; in a latent plane that plane itself."""
        origin = path.mean(axis=0)
        if path.shape[1] == 2:
            return cls(np.zeros(2), np.eye(2))
        return cls(origin, np.linalg.svd(path - origin)[2][:2])

    def seen(self, latent: np.ndarray) -> np.ndarray:
        """Coordinates (n, 2) of latent points (n, d), projected."""
        return (latent - self.origin) @ self.axes.T

    def points(self, coordinates: np.ndarray) -> np.ndarray:
        """Latent points (n, d) at coordinates (n, 2)."""
        return self.origin + coordinates @ self.axes


def measure_reshaped(skills: tuple[Skill, Skill]) -> ReshapedReport:
    """Move a sphere onto the free path of each skill, and plan at every moment."""
    moments, boxes = [], {}
    for skill in skills:
        planner = PaperPlanner(skill, PaperSettings(_STRENGTH), _SHAPES[skill.space])
        ends = tuple(tuple(np.split(pose, [3])) for pose in (skill.start_pose, skill.goal_pose))
        free = planner.plan(*ends)
        middle = planner.tool_poses(free)[0][len(free.latent) // 2]
        cut = Cut.through(free.latent)
        codes = cut.seen(skill.codes.reshape(-1, skill.codes.shape[-1]))
        border = 0.1 * np.ptp(codes, axis=0)
        (left, bottom), (right, top) = codes.min(axis=0) - border, codes.max(axis=0) + border
        boxes[skill.name] = left, right, bottom, top
        across, up = np.meshgrid(np.linspace(left, right, _SIDE), np.linspace(bottom, top, _SIDE))
        shown = cut.points(np.stack([across.reshape(-1), up.reshape(-1)], axis=1))
        for distance in DISTANCES:
            centre = middle + distance * np.array([0.0, 0.0, 1.0])
            planner.set_obstacles(Obstacles.of_spheres(centre[None], np.array([RADIUS])))
            path = planner.plan(*ends)
            tool = planner.tool_poses(path)[0]
            factor = magnification(skill, shown, centre[None], np.array([RADIUS]), _STRENGTH).reshape(_SIDE, _SIDE)
            clearance = float(np.linalg.norm(tool - centre, axis=1).min()) - RADIUS
            length = riemannian_length(skill, path.latent, centre[None], np.array([RADIUS]), _STRENGTH)
            moments.append(
                Moment(skill.name, 1e3 * distance, length, 1e3 * clearance, factor, cut.seen(path.latent))
            )
    return ReshapedReport(tuple(moments), boxes)


def tensors(
    skill: Skill, latent: np.ndarray, centres: np.ndarray, radii: np.ndarray, strength: float
) -> np.ndarray:
    """Metric tensors M (n, d, d) at latent points (n, d) among spheres (o, 3), (o,) [m]."""
    step = _NUDGE * (skill.latent_upper - skill.latent_lower)
    columns = []
    for axis, size in zip(np.eye(len(step)), step, strict=True):
        columns.append([part / (2.0 * size) for part in _differences(skill, latent, size * axis)])
    points, rest = (np.stack(part, axis=-1) for part in zip(*columns, strict=True))
    places = _points(skill, latent)
    factors = np.empty(places.shape[:2])
    for i, body in enumerate(places):
        ambient_factors(body, centres, radii, strength, factors[i])
    stretched = np.einsum("nk,nkad,nkae->nde", factors, points, points)
    return (stretched + np.einsum("nrd,nre->nde", rest, rest)) / places.shape[1]


def magnification(
    skill: Skill, latent: np.ndarray, centres: np.ndarray, radii: np.ndarray, strength: float
) -> np.ndarray:
    """log sqrt det M (n,), of the arguments as of `tensors`."""
    return 0.5 * np.linalg.slogdet(tensors(skill, latent, centres, radii, strength))[1]


def riemannian_length(
    skill: Skill, curve: np.ndarray, centres: np.ndarray, radii: np.ndarray, strength: float
) -> float:
    """Length of a curve (n, d) in the metric of `tensors`, by its tensors halfway between the points."""
    steps = np.diff(curve, axis=0)
    metric = tensors(skill, curve[:-1] + 0.5 * steps, centres, radii, strength)
    return float(np.sqrt(np.einsum("nd,nde,ne->n", steps, metric, steps)).sum())


def draw_reshaped(report: ReshapedReport, path: Path) -> None:
    """A row of pictures for each skill, on one scale each: bright where lengths are long."""
    names = list(report.boxes)
    figure = Figure(figsize=(11.0, 2.9 * len(names)), layout="constrained")
    grid = figure.subplots(len(names), len(DISTANCES), squeeze=False)
    for row, name in zip(grid, names, strict=True):
        moments = [each for each in report.moments if each.skill == name]
        low, high = np.percentile(np.stack([each.factor for each in moments]), [1.0, 99.5])
        for axes, moment in zip(row, moments, strict=True):
            image = axes.imshow(
                moment.factor, origin="lower", extent=report.boxes[name], aspect="auto", vmin=low, vmax=high
            )
            axes.plot(*moment.path.T, color="white", linewidth=3.0)
            axes.plot(*moment.path.T, color="tab:red", linewidth=1.6)
            axes.set_xticks([])
            axes.set_yticks([])
            axes.set_title(f"sphere {moment.distance_mm:.0f} mm off the free path", fontsize=9)
        figure.colorbar(image, ax=row, label=r"$\log\sqrt{\det M(z)}$", pad=0.01)
        row[0].set_ylabel(name)
    write_figure(figure, path)


def picture_skill(skill: Skill) -> Skill:
    """A skill of poses with kappa^(-1/2) in its metric: beside kappa itself no obstacle would be seen."""
    return replace(skill, metric=MetricSettings(1.0, "spread")) if skill.space == "task" else skill


def _points(skill: Skill, latent: np.ndarray) -> np.ndarray:
    """Body points (n, K, 3) [m]: of the tool its origin."""
    if skill.space == "task":
        return skill.decoder.decode(latent).positions[:, None]
    robot, body = _body(skill)
    return place_body_points(skill.decoder.configurations(latent), body.frames, body.offsets, robot.chain)


def _differences(skill: Skill, latent: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What changes from z - step to z + step: of body points and of sigma seen there (n, K, 6), of the rest (n, r)."""
    ahead, behind = latent + step, latent - step
    if skill.space == "task":
        after, before = skill.decoder.decode(ahead), skill.decoder.decode(behind)
        spread = skill.metric.orientation_feature(after) - skill.metric.orientation_feature(before)
        sigma = skill.metric.sigma_weight * (after.sigma - before.sigma)
        moved = np.concatenate([after.positions - before.positions, sigma], axis=1)[:, None]
        return moved, np.concatenate([after.quaternions - before.quaternions, spread[:, None]], axis=1)
    robot, body = _body(skill)
    here = skill.decoder.configurations(latent)
    spread = 0.5 * skill.metric.sigma_weight * (skill.decoder.uncertainty(ahead) - skill.decoder.uncertainty(behind))
    ends = skill.decoder.configurations(ahead), skill.decoder.configurations(behind)
    moved, turned = [], []
    for after, before in (ends, (here + spread, here - spread)):
        points = [place_body_points(each, body.frames, body.offsets, robot.chain) for each in (after, before)]
        quaternions = [end_effector_poses(each, robot.chain)[1] for each in (after, before)]
        sign = np.where(np.sum(quaternions[0] * quaternions[1], axis=1) < 0.0, -1.0, 1.0)
        moved.append(points[0] - points[1])
        turned.append(skill.metric.orientation_weight * (quaternions[0] - sign[:, None] * quaternions[1]))
    return np.concatenate(moved, axis=2), np.concatenate(turned, axis=1)


def _body(skill: Skill) -> tuple[Robot, BodyPoints]:
    robot = Robot.named(skill.robot)
    return robot, skill.metric.body_points(robot)
