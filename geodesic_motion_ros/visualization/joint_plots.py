"""Pictures of joint-space skills: the latent tubes in which the arm moves, and the tool's paths. Colours as in `plots`.

The wall of a tube is where the decoder's standard deviation reaches the end of the support: inside moving is cheap,
outside the latent graph has no nodes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from geodesic_motion_ros.geometry.isosurface import isosurface
from geodesic_motion_ros.manifold.ambient_metric import clearances
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal
from geodesic_motion_ros.robot.body_points import (
    BodyPoints,
    body_point_jacobians,
    end_effector_poses,
    place_body_points,
)
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization.plots import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    DrawnPath,
    Sphere,
    draw_in_space,
    draw_nodes,
    legend_below,
    name_axes,
    seen_curve,
    shown_axes,
    write_figure,
)

#: Of demonstrations by their family.
FAMILY_COLOURS = (GREY, GREEN, "#CC79A7", "#56B4E9", "#000000")
_WALL = np.array([0.45, 0.55, 0.70])
_WALL_ALPHA = 0.16
#: Step of the central differences of the decoder, of the box.
_STEP = 1e-4
#: How strongly the arm is drawn at each moment of a path.
_POSTURE_ALPHA = (0.3, 0.9, 0.3)
#: Radius [m] of the obstacle that a report puts into the arm's path.
_OBSTACLE_RADIUS = 0.05


def joint_magnification_factor(graph: ConfigurationGraph) -> np.ndarray:
    """log sqrt det M (n,) at the graph's nodes, M the pull-back metric of `configuration_graph`, without obstacles.

    The decoder's Jacobians are central differences.
    """
    mean, sigma = (_derivatives(graph, of) for of in (graph.decoder.configurations, graph.decoder.uncertainty))
    jacobians = body_point_jacobians(graph.configurations, graph.body.frames, graph.body.offsets, graph.robot.chain)
    weights, points = graph.metric, jacobians.shape[1]
    rows = []
    for scale, columns in ((1.0, mean), (weights.sigma_weight, sigma)):
        moved = np.einsum("nkaj,njd->nkad", jacobians, columns).reshape(len(columns), 3 * points, -1)
        rows += [scale / np.sqrt(points) * moved, scale * weights.joint_weight * columns]
    stacked = np.concatenate(rows, axis=1)
    return 0.5 * np.linalg.slogdet(np.einsum("nrd,nre->nde", stacked, stacked))[1]


def _derivatives(graph: ConfigurationGraph, of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Jacobians (n, eta, d) of a function of latent points at the graph's nodes."""
    steps = _STEP * np.diag(graph.grid.upper - graph.grid.lower)
    return np.stack(
        [(of(graph.latent + step) - of(graph.latent - step)) / (2.0 * np.max(step)) for step in steps], axis=-1
    )


def path_between(
    planner: ReactivePlanner, start: np.ndarray, goal: np.ndarray, name: str, colour: str, style: str = "-"
) -> DrawnPath | None:
    """The planner's path between two configurations (eta,) among its obstacles, to be drawn; None without one."""
    reference = planner.plan_configurations(start, ConfigurationGoal(goal[None], name)).reference
    if reference is None:
        return None
    return DrawnPath(reference.latent, _tool_positions(planner, reference.positions), name, colour, style)


def example_paths(planner: ReactivePlanner) -> tuple[list[DrawnPath], Sphere | None]:
    """What the skill can do: a geodesic from every start to every goal that demonstrations join, and a path around.

    The obstacle is a sphere on the arm, halfway along the first geodesic, at the first body point from the tool down
    where that leaves another path; None where no path around was found.
    """
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    ends = _shown_ends(planner.skill)
    found = [path_between(planner, *pair, "geodesic", BLUE) for pair in ends]
    paths = [drawn for drawn in found if drawn is not None]
    if found[0] is None:
        return paths, None
    middle = planner.graph.decoder.configurations(found[0].latent[len(found[0].latent) // 2][None])
    body = planner.graph.body
    for centre in place_body_points(middle, body.frames, body.offsets, planner.robot.chain)[0, ::-1]:
        planner.set_obstacles(centre[None], np.array([_OBSTACLE_RADIUS]))
        around = path_between(planner, *ends[0], "geodesic around the obstacle", VERMILION)
        planner.set_obstacles(np.empty((0, 3)), np.empty(0))
        if around is not None:
            return [*paths, around], Sphere(centre, _OBSTACLE_RADIUS, centre[None])
    return paths, None


def joint_report(skill: Skill, path: str | os.PathLike[str]) -> None:
    """What a joint-space skill holds: left its latent space with tubes, demonstrations, geodesics and the path around
    an obstacle on one; right the same paths in space.
    """
    planner = ReactivePlanner(skill)
    paths, obstacle = example_paths(planner)
    figure = Figure(figsize=(13.0, 6.0), layout="constrained")
    title = f"Latent space of {skill.name}"
    handles = draw_latent_tubes(figure, (1, 2, 1), planner, paths, _listed(obstacle), title)
    space = figure.add_subplot(1, 2, 2, projection="3d", computed_zorder=False)
    demonstrated = [_tool_positions(planner, skill.decoder.configurations(code)) for code in skill.codes]
    postures = [_postures(planner, drawn) for drawn in paths]
    draw_in_space(space, demonstrated, paths, obstacle, zoom=1.1, also=[part for arm in postures for part in arm])
    for drawn, arm in zip(paths, postures, strict=True):
        for posture, alpha in zip(arm, _POSTURE_ALPHA, strict=True):
            points = 100.0 * posture.T
            space.plot(*points, "o-", color=drawn.colour, linewidth=2.5, markersize=3, alpha=alpha, zorder=3)
    space.set_title("The tool's paths, and the arm at three moments of each", loc="left", fontsize=11)
    if obstacle is not None:
        handles.append(Patch(facecolor=ORANGE, label="obstacle"))
    legend_below(figure, handles)
    write_figure(figure, path)


def draw_tubes(
    path: str | os.PathLike[str],
    planner: ReactivePlanner,
    paths: Sequence[DrawnPath] = (),
    obstacle: Sphere | None = None,
    title: str = "",
) -> None:
    """The latent space of a joint-space skill alone: tubes, demonstrations, footprint of an obstacle, paths."""
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    title = title or f"Latent space of {planner.skill.name}"
    handles = draw_latent_tubes(figure, (1, 1, 1), planner, paths, _listed(obstacle), title)
    legend_below(figure, handles)
    write_figure(figure, path)


def draw_latent_tubes(
    figure: Figure,
    place: tuple[int, int, int] | SubplotSpec,
    planner: ReactivePlanner,
    paths: Sequence[DrawnPath],
    obstacles: Sequence[Sphere] = (),
    title: str = "",
    zoom: float = 1.1,
) -> list[Line2D | Patch]:
    """One panel: tubes, demonstrations, where the arm would touch obstacles, paths. Returns what a legend shows.

    Parameters
    ----------
    place : of the panel in the figure, as `Figure.add_subplot` takes it: (rows, columns, number), or of a grid.
    """
    skill, graph = planner.skill, planner.graph
    solid = len(skill.latent_lower) == 3
    shown = np.arange(3) if solid else shown_axes(skill)
    at = place if isinstance(place, tuple) else (place,)
    axes = figure.add_subplot(*at, **({"projection": "3d", "computed_zorder": False} if solid else {}))
    handles: list[Line2D | Patch] = []
    if solid:
        _wall(axes, planner)
        handles.append(Patch(facecolor=_WALL, alpha=0.5, label="end of the support"))
    else:
        _magnification(figure, axes, graph, shown)
    if obstacles:
        colliding = np.any([colliding_nodes(planner, obstacle) for obstacle in obstacles], axis=0)
        touched = graph.latent[colliding][:, shown].T
        if len(shown) == 1:
            axes.vlines(touched[0], 0.0, 1.0, color=ORANGE, alpha=0.5, linewidth=1.5, zorder=3)
        else:
            axes.scatter(*touched, s=9, color=ORANGE, alpha=0.5, linewidths=0.0, zorder=3)
        handles.append(Patch(facecolor=ORANGE, alpha=0.6, label="the arm would touch the obstacle"))
    modes = np.zeros(len(skill.codes), dtype=int) if skill.canonical is None else skill.canonical.modes
    for code, mode in zip(skill.codes, modes, strict=True):
        axes.plot(*seen_curve(code, shown).T, color=FAMILY_COLOURS[mode], linewidth=0.9, alpha=0.9, zorder=4)
    for mode in np.unique(modes):
        said = "demonstrations" if modes.max() == 0 else f"demonstrations, family {mode}"
        handles.append(Line2D([], [], color=FAMILY_COLOURS[mode], linewidth=1.2, label=said))
    named: dict[str, Line2D | Patch] = {}
    for drawn in paths:
        latent = seen_curve(drawn.latent, shown)
        axes.plot(*latent.T, color="white", linewidth=4.0, zorder=5)
        (named[drawn.name],) = axes.plot(
            *latent.T, drawn.style, color=drawn.colour, linewidth=2.4, label=drawn.name, zorder=6
        )
        axes.plot(*latent[0, :, None], "o", color=drawn.colour, markersize=6, markeredgecolor="white", zorder=7)
        axes.plot(*latent[-1, :, None], "s", color=drawn.colour, markersize=6, markeredgecolor="white", zorder=7)
    _frame(axes, skill, shown, zoom)
    axes.set_title(title, loc="left", fontsize=11)
    return [*handles, *named.values()]


def _listed(obstacle: Sphere | None) -> list[Sphere]:
    return [] if obstacle is None else [obstacle]


def _frame(axes: Axes, skill: Skill, shown: np.ndarray, zoom: float) -> None:
    for name, axis in zip("xyz", shown, strict=False):
        getattr(axes, f"set_{name}lim")(skill.latent_lower[axis], skill.latent_upper[axis])
        getattr(axes, f"set_{name}label")(f"$z_{axis + 1}$")
    if len(shown) == 1:
        name_axes(axes, shown)
        axes.set_ylim(0.0, 1.0)
    if len(shown) == 3:
        axes.view_init(24.0, -62.0)
        axes.set_proj_type("ortho")
        sides = skill.latent_upper - skill.latent_lower
        axes.set_box_aspect(sides, zoom=zoom)
        for axis, side in zip((axes.xaxis, axes.yaxis, axes.zaxis), sides, strict=True):
            axis.set_pane_color((1.0, 1.0, 1.0, 1.0))
            # Labels of a short side would run into each other.
            axis.set_major_locator(MaxNLocator(max(2, round(4 * side / np.max(sides)))))


def _magnification(figure: Figure, axes: Axes, graph: ConfigurationGraph, shown: np.ndarray) -> None:
    """The nodes by their magnification factor, on the axes of the latent space that are shown."""
    values = joint_magnification_factor(graph)
    low, high = np.percentile(values, [2.0, 98.0])
    drawn = draw_nodes(axes, graph.latent, shown, values, s=14, marker="s")
    drawn.set_clim(low, high)
    figure.colorbar(drawn, ax=axes, label=r"magnification factor  $\log\sqrt{\det M(z)}$", shrink=0.9, pad=0.02)


def _wall(axes: Axes, planner: ReactivePlanner) -> None:
    """The end of the support, shaded by a lamp behind the viewer's left shoulder."""
    skill, grid = planner.skill, planner.graph.grid
    sigma = np.log(rms_sigma(skill.decoder.uncertainty(grid.nodes()))).reshape(grid.shape)
    vertices, quads = isosurface(sigma, float(np.log(skill.sigma_limit)))
    corners = (grid.lower + vertices * grid.spacing)[quads]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    lamp = np.array([-0.3, -0.7, 0.65])
    light = 0.35 + 0.65 * np.abs(normals @ lamp)[:, None]
    colours = np.concatenate([np.clip(light * (0.35 + _WALL), 0.0, 1.0), np.full((len(quads), 1), _WALL_ALPHA)], axis=1)
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colours, linewidths=0.0, zorder=2))


def colliding_nodes(planner: ReactivePlanner, obstacle: Sphere) -> np.ndarray:
    """Nodes (mask (n,)) in whose configuration a sphere of the arm touches an obstacle."""
    spheres, moving = planner.collision.points, planner.collision.moving
    placed = place_body_points(
        planner.graph.configurations, spheres.frames[moving], spheres.offsets[moving], planner.robot.chain
    )
    radii = planner.collision.radii[moving]
    return clearances(placed, radii, obstacle.centre[None], np.array([obstacle.radius]), 0.0) <= 0.0


def _postures(planner: ReactivePlanner, drawn: DrawnPath) -> list[np.ndarray]:
    """The arm as a polyline (n, 3) [m] from its base to the tool, at a few moments of a path."""
    joints = BodyPoints.of(planner.robot)
    at = (len(drawn.latent) - 1) * np.arange(1, len(_POSTURE_ALPHA) + 1) // (len(_POSTURE_ALPHA) + 1)
    configurations = planner.graph.decoder.configurations(drawn.latent[at])
    placed = place_body_points(configurations, joints.frames, joints.offsets, planner.robot.chain)
    return [np.concatenate([np.zeros((1, 3)), points]) for points in placed]


def _shown_ends(skill: Skill) -> list[tuple[np.ndarray, np.ndarray]]:
    """Where demonstrations begin and end (eta,) [rad]: of every pair of groups that they join, without offsets."""
    sheet = skill.canonical
    if sheet is None:
        first, last = skill.decoder.configurations(skill.codes[0, [0, -1]])
        return [(first, last)]
    joined = sorted(set(zip(sheet.start_groups.tolist(), sheet.goal_groups.tolist(), strict=True)))
    return [(sheet.start_poles[int(start)], sheet.goal_poles[int(goal)]) for start, goal in joined]


def _tool_positions(planner: ReactivePlanner, configurations: np.ndarray) -> np.ndarray:
    return end_effector_poses(np.ascontiguousarray(configurations), planner.robot.chain)[0]
