"""What a skill of the tool does not see: the arm behind it.

A skill of tool poses is learned from reaches to grasp, and a sphere is put beside the path, where it touches the arm
but not the hand. The skill's geodesic stays what it was: no pose of the tool is near the sphere. Whether the arm hits
it is left to the solver of the inverse kinematics. So for every node of a fine grid over the latent space, and for
every pose of the geodesic, many solutions are worked out in closed form (the Panda's `inverse_kinematics`; the last
joint takes evenly spread values, and all branches count), and it is counted how many of them the sphere touches
(collision spheres).

How many these are is a matter of where the sphere is. The first one leaves the arm's other family free, so that there
is a path for the whole arm; a second one of the same size is put where most solutions along the geodesic touch it.

Beside it the geodesic of the paper's own model and planner (*literal*), of the same task and with the first sphere. And
a skill of joint space: it sees the whole arm, and takes its other family.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numba
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.distance import cdist

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.paper.paper_planner import STRENGTH_OF_POSES, PaperPlanner, PaperSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot, link_frames
from geodesic_motion_ros.robot.robots.panda.inverse_kinematics import MOST, solutions_at, wrist_frames
from geodesic_motion_ros.robot.solutions import solutions
from geodesic_motion_ros.simulation.joint_teacher import reach_to_grasp
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.joint_plots import draw_latent_tubes
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION, DrawnPath, Sphere, legend_below, write_figure
from geodesic_motion_studies.experiments.arm_queries import body_spheres, distances
from geodesic_motion_studies.experiments.blocked_arm import (
    CHECK_PERIOD,
    HAND,
    INTERIOR,
    arm_clearance,
    every,
    hand_alone,
)
from geodesic_motion_studies.experiments.grasp_joint_scenes import RADIUS, mean_paths, sphere_on
from geodesic_motion_studies.experiments.posture_strip import draw_strip, posture_strips
from geodesic_motion_studies.experiments.study import Report, Study, option
from geodesic_motion_studies.experiments.trained import BRIEFLY, trained_once
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

TASK = "reach"
#: Angles of the last joint that are tried for one pose, at most.
_ANGLES = 400
#: Where the sphere is looked for that most solutions touch: so far apart [m], for so many poses of the geodesic with so
#: many solutions each; so far from the hand [m], and from the shoulder, which stands in all solutions [m].
_STEP, _POSES, _FEW, _FROM_HAND, _FROM_SHOULDER = 0.05, 7, 40, 0.10, 0.30
_SHOULDER = np.array([0.0, 0.0, 0.333])
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_PICTURE_PERIOD = 0.02


@dataclass(frozen=True)
class Limbs(Study):
    """Show, train and count; `skill` is of the same task in joint space, with two families or more.

    shown : demonstrations that are learned from; seed : of the trainings.
    """

    skill: str = option(
        "panda_reach_to_grasp", "of joint space, of the same reach to grasp: its folder, or a shipped name",
        metavar="SKILL",
    )  # fmt: skip
    side: int = option(150, "nodes along each side of the latent grid", least=2)
    solutions: int = option(100, "of the inverse kinematics for each node", least=2)
    shown: int = 8
    seed: int = 0
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    joint_planner: PlannerSettings = field(default_factory=PlannerSettings)

    def measure(self, out: Path) -> LimbsReport:
        shown = reach_to_grasp(self.shown, 0, families=1).tool_demonstrations(Robot.named("panda"))
        tool = trained_once(TASK, shown, TrainingSettings(**BRIEFLY, seed=self.seed), out / "skills")
        literal = trained_once(TASK, shown, TrainingSettings.paper(seed=self.seed), out / "skills")
        return self.compared(tool, literal, Skill.load(self.skill))

    def compared(self, skill: Skill, literal: Skill, joint_skill: Skill) -> LimbsReport:
        """Put the sphere, ask all skills, and count solutions.

        Raises
        ------
        ParameterError : the skills are not of task space and of joint space with families; one of them finds no path.
        """
        means, arm = mean_paths(joint_skill), ReactivePlanner(joint_skill, self.joint_planner)
        start, goal = means[:, 0].mean(axis=0), means[:, -1].mean(axis=0)
        query = start, ConfigurationGoal(goal[None], "that of all demonstrations")
        nominal = arm.plan_configurations(*query).reference
        tool = PosePathPlanner(skill, self.planner)
        poses = *arm.robot.forward(start), *arm.robot.forward(goal)
        free = tool.plan(*poses)
        if nominal is None or isinstance(free, Refusal):
            raise ParameterError("there is no path, although nothing blocks it: the skills are not of one task")
        arm_path = every(CHECK_PERIOD, nominal)
        family = int(np.argmin([np.linalg.norm(mean[len(mean) // 2] - arm_path[len(arm_path) // 2]) for mean in means]))
        others = np.delete(means, family, axis=0)
        middle = slice(*(round(share * len(arm_path)) for share in INTERIOR))
        sphere = sphere_on(arm, arm_path[middle], np.concatenate(others))
        centres, radii = sphere[None], np.array([RADIUS])
        arm.set_obstacles(centres, radii)
        avoiding = arm.plan_configurations(*query).reference
        tool.set_obstacles(centres, radii)
        path = tool.plan(*poses)
        if isinstance(path, Refusal):
            raise ParameterError(f"the sphere was to leave the tool's path free, but: {path.reason}")
        along = path.positions, path.quaternions
        worst_centre = worst_sphere(*(part[np.linspace(0, len(part) - 1, _POSES).astype(int)] for part in along))
        literal_free, literal_path = (
            _literal_geodesic(literal, poses, *spheres)
            for spheres in ((np.empty((0, 3)), np.empty(0)), (centres, radii))
        )
        grid = LatentGrid(skill.latent_lower, skill.latent_upper, (self.side, self.side))
        decoded = skill.decoder.decode(grid.nodes())
        geometry = CollisionGeometry("panda")
        hand = ReactivePlanner(joint_skill, self.joint_planner, collision=hand_alone(arm.collision))
        evaded = math.nan
        if avoiding is not None:
            evaded = arm_clearance(geometry, every(CHECK_PERIOD, avoiding), centres, radii)
        return LimbsReport(
            settings=self,
            skill=skill,
            joint_planner=arm,
            centre=sphere,
            radius=RADIUS,
            grid=grid,
            supported=rms_sigma(decoded.sigma) <= skill.sigma_limit,
            nodes=solved(decoded.positions, decoded.quaternions, centres, radii, self.solutions),
            free=free,
            path=path,
            along=solved(*along, centres, radii, self.solutions),
            literal_moved=_moved(literal_path, literal_free),
            literal=solved(literal_path.positions, literal_path.quaternions, centres, radii, self.solutions),
            tool_clearance=path.figures.clearance,
            worst_centre=worst_centre,
            worst=solved(*along, worst_centre[None], radii, self.solutions),
            nominal=nominal,
            avoiding=avoiding,
            nominal_clearance=arm_clearance(geometry, arm_path, centres, radii),
            avoiding_clearance=evaded,
            hand_clearance=float(distances(hand, body_spheres(hand, arm_path), sphere, RADIUS).min()),
        )


@dataclass(frozen=True, eq=False)
class Solutions:
    """Inverse kinematics of n poses: how many solutions were found for each, and how many of them the sphere touches.

    An example (7,) [rad] of those touched and one of the free for each pose, NaN where there is none: (n, 2, 7).
    """

    found: np.ndarray
    touched: np.ndarray
    examples: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """(n,) share of the solutions that are touched; NaN where there are none."""
        return np.where(self.found > 0, self.touched / np.maximum(self.found, 1), np.nan)


@dataclass(frozen=True, eq=False)
class LimbsReport(Report):
    """What was found.

    Attributes
    ----------
    centre, radius : of the sphere [m].
    grid, nodes : the grid over the latent space, and its solutions.
    free, path, along : geodesic of the tool without and with the sphere, and solutions at the samples of the latter.
    literal, literal_moved : solutions at the samples of the literal geodesic with the sphere, and how far that is moved
        by it [m].
    tool_clearance : of the tool's spheres on that path, as the planner promises [m].
    worst_centre, worst : the sphere that most solutions touch [m], and solutions at the same samples with it.
    nominal, avoiding : motions of the whole arm without and with the sphere; None where that was refused.
    nominal_clearance, avoiding_clearance : of the arm's meshes from the sphere on them [m].
    hand_clearance : of the hand's collision spheres from the sphere on the nominal motion [m].
    """

    settings: Limbs
    skill: Skill
    joint_planner: ReactivePlanner
    centre: np.ndarray
    radius: float
    grid: LatentGrid
    supported: np.ndarray
    nodes: Solutions
    free: PosePath
    path: PosePath
    along: Solutions
    literal: Solutions
    literal_moved: float
    tool_clearance: float
    worst_centre: np.ndarray
    worst: Solutions
    nominal: JointReference
    avoiding: JointReference | None
    nominal_clearance: float
    avoiding_clearance: float
    hand_clearance: float

    def summary(self) -> dict[str, float | int]:
        """The figures."""
        inside, along = self.supported & (self.nodes.found > 0), self.along.shares
        worst, literal = self.worst.shares, self.literal.shares
        return {
            "nodes": len(self.nodes.found),
            "supported_nodes": int(np.count_nonzero(self.supported)),
            "solutions": int(self.nodes.found.sum()),
            "median_solutions_of_a_supported_node": float(np.median(self.nodes.found[self.supported])),
            "supported_nodes_where_some_solution_is_touched": float(np.mean(self.nodes.touched[inside] > 0)),
            "geodesic_moved_by_the_sphere_mm": 1e3 * _moved(self.path, self.free),
            "clearance_of_the_tool_mm": 1e3 * self.tool_clearance,
            "share_touched_on_the_geodesic_mean": float(np.nanmean(along)),
            "share_touched_on_the_geodesic_most": float(np.nanmax(along)),
            "share_of_the_geodesic_with_touched_solutions": float(np.mean(self.along.touched > 0)),
            "literal_geodesic_moved_by_the_sphere_mm": 1e3 * self.literal_moved,
            "literal_share_touched_on_the_geodesic_mean": float(np.nanmean(literal)),
            "literal_share_touched_on_the_geodesic_most": float(np.nanmax(literal)),
            "literal_share_of_the_geodesic_with_touched_solutions": float(np.mean(self.literal.touched > 0)),
            "worst_sphere_share_touched_mean": float(np.nanmean(worst)),
            "worst_sphere_share_touched_most": float(np.nanmax(worst)),
            "worst_sphere_share_of_the_geodesic_over_90_of_100": float(np.mean(worst > 0.9)),
            "joint_space_without_the_sphere_mm": 1e3 * self.nominal_clearance,
            "joint_space_with_the_sphere_mm": 1e3 * self.avoiding_clearance,
            "hand_of_the_joint_space_path_mm": 1e3 * self.hand_clearance,
        }

    def as_dict(self) -> dict[str, Any]:
        return {
            "settings": asdict(self.settings),
            "sphere": {"centre": self.centre, "radius": self.radius},
            "worst_sphere": {"centre": self.worst_centre, "radius": self.radius},
            "summary": self.summary(),
            "along": {"found": self.along.found, "touched": self.along.touched},
        }

    def table(self) -> str:
        """The table as plain text."""
        rows: list[list[Cell]] = [[name.replace("_", " "), value] for name, value in self.summary().items()]
        return text_table([f"sphere of {100.0 * self.radius:g} cm at the elbow", ""], rows, 3)

    def draw(self, path: Path) -> None:
        """Above: the share of solutions that the sphere touches over the latent space, the same along the geodesic, and
        the paths of the joint-space skill. Below: solutions of single poses, touched and free, and the motion of the
        whole arm.
        """
        figure = Figure(figsize=(13.0, 9.2), layout="constrained")
        grid = figure.add_gridspec(3, 3, height_ratios=(4.6, 2.0, 2.0), width_ratios=(1.25, 1.0, 1.15))
        _heat_map(figure, figure.add_subplot(grid[0, 0]), self)
        axes = figure.add_subplot(grid[0, 1])
        share = np.linspace(0.0, 1.0, len(self.along.found))
        axes.fill_between(share, 100.0 * self.along.shares, color=VERMILION, alpha=0.35, linewidth=0.0)
        axes.plot(share, 100.0 * self.along.shares, color=VERMILION, linewidth=1.8, label="leaves a family free")
        axes.plot(share, 100.0 * self.worst.shares, color="black", linewidth=1.4, label="where most touch it")
        axes.legend(title="the sphere", frameon=False, loc="lower center", bbox_to_anchor=(0.5, 0.24))
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, None), xlabel="share of the geodesic", ylabel="touch the sphere [%]")
        axes.grid(alpha=0.3)
        axes.set_title("b  The same along the tool's geodesic", loc="left", fontsize=11)
        paths = [DrawnPath(self.nominal.latent, np.empty((0, 3)), "geodesic without the sphere", BLUE)]
        if self.avoiding is not None:
            paths.append(DrawnPath(self.avoiding.latent, np.empty((0, 3)), "geodesic with the sphere", VERMILION))
        ball = Sphere(self.centre, self.radius, self.centre[None])
        handles = draw_latent_tubes(
            figure, grid[0, 2], self.joint_planner, paths, [ball], "c  A skill of joint space", zoom=0.95
        )  # fmt: skip
        # Solutions that follow each other are on different branches: their elbows make no curve.
        title = "d  Skill of the tool: arms with the tool on the geodesic, touching the sphere"
        rows = [(title, _hit_arms(self), False)]
        if self.avoiding is not None:
            clear = 1e3 * self.avoiding_clearance
            title = f"e  Skill of joint space: its motion with the sphere there, {clear:.0f} mm clear of it"
            rows.append((title, every(_PICTURE_PERIOD, self.avoiding), True))
        for row, (title, motion, curves) in enumerate(rows, start=1):
            sphere = {"0": (self.centre, self.radius)}
            strip = posture_strips([motion], [sphere], width=400, height=270, curves=curves)
            draw_strip(figure.add_subplot(grid[row, :]), strip, title)
        legend_below(figure, handles)
        write_figure(figure, path)


def _literal_geodesic(
    skill: Skill, ends: tuple[np.ndarray, ...], centres: np.ndarray, radii: np.ndarray
) -> PoseCurve:
    """The paper's planner's, between two tool poses among spheres (o, 3), (o,) [m]."""
    planner = PaperPlanner(skill, PaperSettings(strength=STRENGTH_OF_POSES))
    planner.set_obstacles(Obstacles.of_spheres(centres, radii))
    return planner.tool_curve(ends[:2], ends[2:])


def _moved(path: PoseCurve, free: PoseCurve) -> float:
    """Largest distance [m] of a path's positions from those of another one."""
    return float(np.linalg.norm(path.positions[:, None] - free.positions, axis=-1).min(axis=1).max())


def worst_sphere(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Centre (3,) [m] of the sphere that most of an arm's solutions touch, for tool poses (n, 3), (n, 4) of a Panda.

    It keeps `_FROM_HAND` from the hand at each of the poses.
    """
    robot, model = Robot.named("panda"), CollisionModel.named("panda")
    is_hand = np.array([name == HAND for name in model.points.names])[model.moving]
    axes = (np.arange(low, high, _STEP) for low, high in ((-0.5, 0.8), (-0.7, 0.7), (0.0, 1.1)))
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    allowed = np.linalg.norm(places - _SHOULDER, axis=1) > _FROM_SHOULDER
    shares = np.zeros(len(places))
    for position, quaternion in zip(positions, quaternions, strict=True):
        lasts = _last_joints(robot)[:_FEW]
        found = np.concatenate([solutions(robot, position, quaternion, last) for last in lasts])
        if not len(found):
            continue
        bodies = np.moveaxis(model.positions(robot, found[:_FEW])[:, model.moving], 1, 0)
        touched = np.zeros((bodies.shape[1], len(places)), bool)
        for centres, radius, of_hand in zip(bodies, model.radii[model.moving], is_hand, strict=True):
            apart = cdist(centres, places) - radius - RADIUS
            touched |= apart < 0.0
            if of_hand:
                allowed &= np.all(apart > _FROM_HAND, axis=0)
        shares += touched.mean(axis=0)
    return places[int(np.argmax(np.where(allowed, shares, -1.0)))]


def solved(
    positions: np.ndarray, quaternions: np.ndarray, centres: np.ndarray, radii: np.ndarray, wanted: int
) -> Solutions:
    """So many solutions for tool poses (n, 3), (n, 4) of a Panda, among spheres (o, 3), (o,) [m]."""
    robot, model = Robot.named("panda"), CollisionModel.named("panda")
    moving = model.moving
    return Solutions(*_solved(
        *wrist_frames(robot, positions, quaternions), _last_joints(robot), wanted, robot.lower, robot.upper,
        robot.chain, model.points.frames[moving], model.points.offsets[moving], model.radii[moving], centres, radii,
    ))  # fmt: skip


def _last_joints(robot: Robot) -> np.ndarray:
    """Angles (_ANGLES,) [rad] of the last joint that are tried one after the other.

    They are multiples of the golden section of its range, which are evenly spread however many of them are needed.
    """
    return robot.lower[6] + (robot.upper[6] - robot.lower[6]) * (np.arange(_ANGLES) * _GOLDEN % 1.0)


@numba.njit(cache=True, nogil=True)
def _solved(
    rotations: np.ndarray,
    origins: np.ndarray,
    angles: np.ndarray,
    wanted: int,
    lower: np.ndarray,
    upper: np.ndarray,
    chain: tuple,
    frames: np.ndarray,
    offsets: np.ndarray,
    sizes: np.ndarray,
    centres: np.ndarray,
    radii: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """found, touched and examples of `Solutions`, for frames as of `wrist_frames` and spheres fixed to links."""
    count = len(origins)
    found, touched = np.zeros(count, np.int64), np.zeros(count, np.int64)
    examples = np.full((count, 2, 7), np.nan)
    solutions = np.empty((MOST, 7))
    for i in range(count):
        for angle in angles:
            for j in range(solutions_at(rotations[i], origins[i], angle, lower, upper, solutions)):
                if found[i] == wanted:
                    break
                found[i] += 1
                hit = _touches(solutions[j], chain, frames, offsets, sizes, centres, radii)
                touched[i] += hit
                examples[i, 0 if hit else 1] = solutions[j]
            if found[i] == wanted:
                break
    return found, touched, examples


@numba.njit(cache=True, nogil=True)
def _touches(
    q: np.ndarray,
    chain: tuple,
    frames: np.ndarray,
    offsets: np.ndarray,
    sizes: np.ndarray,
    centres: np.ndarray,
    radii: np.ndarray,
) -> bool:
    """Whether any of an arm's spheres touches one of the spheres (o, 3), (o,) in a configuration (7,)."""
    rotations, origins = link_frames(q, chain)
    for k in range(len(frames)):
        turn, place = rotations[frames[k]], origins[frames[k]]
        for o in range(len(radii)):
            squared = 0.0
            for a in range(3):
                at = place[a] - centres[o, a]
                for b in range(3):
                    at += turn[a, b] * offsets[k, b]
                squared += at * at
            if squared < (sizes[k] + radii[o]) ** 2:
                return True
    return False


def _hit_arms(report: LimbsReport) -> np.ndarray:
    """Solutions (n, 7) that touch the sphere, in the order of the geodesic."""
    hit = report.along.examples[:, 0]
    return hit[np.all(np.isfinite(hit), axis=1)]


def _heat_map(figure: Any, axes: Any, report: LimbsReport) -> None:
    skill, shape = report.skill, (report.settings.side,) * 2
    shares = 100.0 * report.nodes.shares.reshape(shape)
    first, second = (np.linspace(low, high, side) for low, high, side in zip(
        skill.latent_lower, skill.latent_upper, shape, strict=True
    ))  # fmt: skip
    drawn = axes.pcolormesh(first, second, shares.T, cmap="cividis", vmin=0.0, shading="nearest", rasterized=True)
    axes.contour(first, second, report.supported.reshape(shape).T, levels=[0.5], colors="white", linewidths=1.0)
    for code in skill.codes:
        axes.plot(*code.T, color="white", linewidth=0.5, alpha=0.6)
    axes.plot(*report.path.latent.T, color="white", linewidth=4.0)
    axes.plot(*report.path.latent.T, color=BLUE, linewidth=2.4)
    axes.set_facecolor("0.8")
    axes.set(xlabel="$z_1$", ylabel="$z_2$")
    axes.set_title("a  Latent space of a skill of the tool", loc="left", fontsize=11)
    figure.colorbar(drawn, ax=axes, label="solutions that touch the sphere [%]", shrink=0.9, pad=0.02)
