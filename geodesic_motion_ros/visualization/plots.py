"""Pictures of skills and motions, by matplotlib. Nothing of this is for a control loop.

Colours are those of Okabe and Ito, which colour-blind people can tell apart; what belongs together has one colour in
every picture: demonstrations grey, the path without obstacle blue, the path around it vermilion, obstacles orange.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import Collection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.ticker import MultipleLocator

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.manifold.ambient_metric import clearances
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.skill.sheet import UNROLLED_ROUNDS
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import PlanningError
from geodesic_motion_ros.visualization.latent_view import magnification_factor

BLUE, VERMILION, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#E69F00", "#009E73", "#6b7280"
_DPI = 150
_RESOLUTION = 400


@dataclass(frozen=True)
class DrawnPath:
    """A path or a motion to be drawn: latent (n, d), positions (m, 3) [m], name and colour."""

    latent: np.ndarray
    positions: np.ndarray
    name: str
    colour: str
    style: str = "-"


@dataclass(frozen=True)
class Sphere:
    """An obstacle to be drawn: where it was when it mattered (3,) [m], its radius [m], and its path (n, 3) [m]."""

    centre: np.ndarray
    radius: float
    track: np.ndarray


def demonstrations_of(skill: Skill) -> np.ndarray:
    """Codes (N, T, d) of the demonstrations as recorded, without their antipodal copies."""
    names = skill.provenance.get("demonstrations")
    count = len(names) if names else len(skill.codes)
    return skill.codes[:count]


def _codes_around(skill: Skill, paths: Sequence[DrawnPath]) -> np.ndarray:
    """Codes of the demonstrations on the sheet of the paths: those of q or those of -q, (N, T, d)."""
    count = len(demonstrations_of(skill))
    sheets = [skill.codes[i : i + count] for i in range(0, len(skill.codes), count)]
    starts = np.array([drawn.latent[0] for drawn in paths])
    return min(sheets, key=lambda sheet: np.linalg.norm(sheet[:, 0].mean(axis=0) - starts.mean(axis=0)))


def draw_latent(
    path: str | os.PathLike[str],
    skill: Skill,
    settings: PlannerSettings,
    paths: Sequence[DrawnPath],
    obstacle: Sphere | None = None,
    title: str = "",
) -> None:
    """The latent space: magnification factor, demonstrations, footprint of an obstacle, paths.

    Parameters
    ----------
    path : picture to write.
    skill, settings : whose paths these are, and its tool spheres.

    Raises
    ------
    PlanningError : the skill's latent space has not two dimensions.
    """
    figure = Figure(figsize=(7.4, 5.6), layout="constrained")
    axes = figure.add_subplot()
    codes = np.concatenate([*_codes_around(skill, paths), *(drawn.latent for drawn in paths)])
    handles = latent_background(figure, axes, skill)
    if obstacle is not None:
        handles.append(_footprint(axes, skill, settings, obstacle))
    handles += draw_latent_paths(axes, paths)
    _frame_codes(axes, skill, codes)
    axes.set_title(title, loc="left", fontsize=11)
    legend_below(figure, handles)
    write_figure(figure, path)


def draw_paths(
    path: str | os.PathLike[str],
    skill: Skill,
    paths: Sequence[DrawnPath],
    obstacle: Sphere | None = None,
    title: str = "",
) -> None:
    """Paths of the tool among the decoded demonstrations: in space, and their heights seen along the x axis."""
    figure = Figure(figsize=(10.0, 3.4), layout="constrained")
    columns = figure.add_gridspec(1, 2, width_ratios=(1.25, 1.0))
    decoded = [skill.decoder.decode(code).positions for code in demonstrations_of(skill)]
    space = figure.add_subplot(columns[0], projection="3d", computed_zorder=False)
    handles = draw_in_space(space, decoded, paths, obstacle, zoom=1.25)
    _side_view(figure.add_subplot(columns[1]), decoded, paths, obstacle)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    legend_below(figure, handles)
    write_figure(figure, path)


def _side_view(
    axes: Axes, demonstrations: Sequence[np.ndarray], paths: Sequence[DrawnPath], obstacle: Sphere | None
) -> None:
    for positions in demonstrations:
        axes.plot(*(100.0 * positions[:, 1:].T), color=GREY, linewidth=0.8, alpha=0.7)
    if obstacle is not None:
        axes.add_patch(Circle(100.0 * obstacle.centre[1:], 100.0 * obstacle.radius, facecolor=ORANGE, alpha=0.85))
    for drawn in paths:
        axes.plot(*(100.0 * drawn.positions[:, 1:].T), color="white", linewidth=3.4)
        axes.plot(*(100.0 * drawn.positions[:, 1:].T), drawn.style, color=drawn.colour, linewidth=2.0)
    axes.set_aspect("equal")
    axes.set_xlabel("y [cm]")
    axes.set_ylabel("z [cm]")
    axes.grid(alpha=0.3)


def training_report(skill: Skill, path: str | os.PathLike[str]) -> None:
    """What a training has led to: the latent space with geodesics and, beside them, the Euclidean line.

    Left the latent space, right the same curves decoded. Geodesics run from the first code of every demonstration to
    the last; one of them has the straight latent line beside it. Where there are not two dimensions the latent space is
    seen along all axes but `shown_axes`, and stands there as the nodes of its graph.
    """
    planner = PosePathPlanner(skill)
    codes = demonstrations_of(skill)
    geodesics = [latent for latent in (_geodesic(planner, code) for code in codes) if latent is not None]
    share = np.linspace(0.0, 1.0, 100)[:, None]
    # the one whose geodesic bends most shows best what the metric does
    bend = [_bend(latent) for latent in geodesics]
    chosen = geodesics[int(np.argmax(bend))] if geodesics else codes[0]
    line = chosen[0] + share * (chosen[-1] - chosen[0])
    figure = Figure(figsize=(11.5, 5.2), layout="constrained")
    shown = shown_axes(skill)
    paths = [DrawnPath(latent, skill.decoder.decode(latent).positions, "geodesics", BLUE) for latent in geodesics]
    paths.append(DrawnPath(line, skill.decoder.decode(line).positions, "straight latent line", VERMILION, "--"))
    if skill.period is not None and len(skill.latent_lower) == 2:
        axes = figure.add_subplot(1, 2, 1, projection="3d", computed_zorder=False)
        handles = draw_cylinder(figure, axes, skill, paths)
    else:
        axes = figure.add_subplot(1, 2, 1)
        flat = len(skill.latent_lower) == 2
        handles = latent_background(figure, axes, skill) if flat else _nodes_background(figure, axes, planner)
        handles += draw_latent_paths(axes, [replace(path, latent=seen_curve(path.latent, shown)) for path in paths])
        seen = [seen_curve(curve, shown) for curve in (*codes, line, *geodesics)]
        _frame_codes(axes, skill, np.concatenate(seen), shown)
    axes.set_title(f"Latent space of {skill.name}", loc="left", fontsize=11)
    space = figure.add_subplot(1, 2, 2, projection="3d", computed_zorder=False)
    draw_in_space(space, [skill.decoder.decode(code).positions for code in codes], paths, zoom=0.9)
    space.set_title("The same curves, decoded", loc="left", fontsize=11)
    legend_below(figure, handles)
    write_figure(figure, path)


def shown_axes(skill: Skill) -> np.ndarray:
    """Choose the two axes (2,) of a latent space along which the codes vary most; of one dimension that one (1,)."""
    spread = np.ptp(skill.codes.reshape(-1, skill.codes.shape[-1]), axis=0)
    return np.sort(np.argsort(spread)[-2:])


def seen_curve(latent: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Take the axes of a curve (n, d) that are shown; beside a single one stands the share of the curve, (n, 2)."""
    if len(shown) > 1:
        return latent[:, shown]
    return np.column_stack([latent[:, shown], np.linspace(0.0, 1.0, len(latent))])


def name_axes(axes: Axes, shown: np.ndarray) -> None:
    """Label the axes on which `seen_curve` is drawn."""
    other = f"$z_{shown[1] + 1}$" if len(shown) > 1 else "share of the curve"
    axes.set(xlabel=f"$z_{shown[0] + 1}$", ylabel=other)


def draw_nodes(axes: Axes, latent: np.ndarray, shown: np.ndarray, values: np.ndarray, **style: Any) -> Collection:
    """Draw nodes (n, d) by values (n,) on the axes that are shown; as upright lines on a single one."""
    if len(shown) == 1:
        return axes.vlines(latent[:, shown[0]], 0.0, 1.0, array=values, cmap="Greys", linewidth=1.5, alpha=0.6)
    return axes.scatter(*latent[:, shown].T, c=values, cmap="Greys", linewidths=0.0, **style)


def _nodes_background(figure: Figure, axes: Axes, planner: PosePathPlanner) -> list[Line2D | Patch]:
    """The nodes of a graph by their sigma, the surest last, with demonstrations, on the axes that are shown."""
    skill, graph = planner.skill, planner.graph
    shown, order = shown_axes(skill), np.argsort(-graph.sigma)
    drawn = draw_nodes(axes, graph.latent[order], shown, 1e3 * graph.sigma[order], s=6)
    figure.colorbar(drawn, ax=axes, label="sigma of the nodes [mm]", shrink=0.9, pad=0.02)
    for code in skill.codes:
        axes.plot(*seen_curve(code, shown).T, color=GREY, linewidth=0.9)
    name_axes(axes, shown)
    return [Line2D([], [], color=GREY, linewidth=0.9, label="demonstrations")]


def _geodesic(planner: PosePathPlanner, code: np.ndarray) -> np.ndarray | None:
    ends = planner.skill.decoder.decode(code[[0, -1]])
    path = planner.plan(ends.positions[0], ends.quaternions[0], ends.positions[1], ends.quaternions[1])
    return path.latent if isinstance(path, PosePath) else None


def _bend(latent: np.ndarray) -> float:
    length = np.linalg.norm(np.diff(latent, axis=0), axis=1).sum()
    return float(length / max(np.linalg.norm(latent[-1] - latent[0]), 1e-9))


def latent_background(figure: Figure, axes: Axes, skill: Skill) -> list[Line2D | Patch]:
    """The magnification factor of a two-dimensional latent space, with demonstrations. Returns what a legend shows.

    Raises
    ------
    PlanningError : the skill's latent space has not two dimensions.
    """
    if len(skill.latent_lower) != 2:
        raise PlanningError(f"a latent picture shows two dimensions, {skill.name} has {len(skill.latent_lower)}")
    values = magnification_factor(skill, _RESOLUTION)
    low, high = np.percentile(values, [2.0, 99.0])
    extent = (skill.latent_lower[0], skill.latent_upper[0], skill.latent_lower[1], skill.latent_upper[1])
    image = axes.imshow(values, extent=extent, cmap="Greys", vmin=low, vmax=high + 0.35 * (high - low), aspect="auto")
    figure.colorbar(image, ax=axes, label=r"magnification factor  $\log\sqrt{\det M(z)}$", shrink=0.9, pad=0.02)
    for code in skill.codes:
        axes.plot(*code.T, color=GREY, linewidth=0.9)
    axes.set_xlabel("$z_1$")
    axes.set_ylabel("$z_2$")
    return [Line2D([], [], color=GREY, linewidth=0.9, label="demonstrations")]


def draw_cylinder(figure: Figure, axes: Axes, skill: Skill, paths: Sequence[DrawnPath]) -> list[Line2D | Patch]:
    """The sheet of a closed skill, rolled up: magnification factor, demonstrations, paths; for a legend."""
    assert skill.period is not None
    values = magnification_factor(skill, _RESOLUTION)[::-1]
    along, across = (np.linspace(skill.latent_lower[i], skill.latent_upper[i], values.shape[1 - i]) for i in range(2))
    one_round = np.flatnonzero(along <= along[0] + skill.period)
    one_round, rows = one_round[:: max(1, len(one_round) // 160)], np.arange(0, len(across), max(1, len(across) // 80))
    latent = np.stack(np.meshgrid(along[np.append(one_round, one_round[0])], across[rows]), axis=-1)
    low, high = np.percentile(values, [2.0, 99.0])
    colours = ScalarMappable(Normalize(low, high + 0.35 * (high - low)), "Greys")
    faces = colours.to_rgba(values[np.ix_(rows, one_round)])[:-1]
    faces[..., 3] = 0.75
    axes.plot_surface(*_rolled_up(skill, latent), facecolors=faces, rstride=1, cstride=1, shade=False, zorder=1)
    figure.colorbar(colours, ax=axes, label=r"magnification factor  $\log\sqrt{\det M(z)}$", shrink=0.9, pad=0.02)
    middle = len(skill.codes[0]) // UNROLLED_ROUNDS
    for code in demonstrations_of(skill):
        axes.plot(*_rolled_up(skill, code[middle : 2 * middle + 1]), color=GREY, linewidth=0.9, zorder=2)
    handles = {"demonstrations": Line2D([], [], color=GREY, linewidth=0.9, label="demonstrations")}
    for drawn in paths:
        (handles[drawn.name],) = axes.plot(
            *_rolled_up(skill, drawn.latent), drawn.style, color=drawn.colour, linewidth=2.2, label=drawn.name, zorder=3
        )
    axes.view_init(28.0, -60.0)
    axes.set_axis_off()
    return list(handles.values())


def _rolled_up(skill: Skill, latent: np.ndarray) -> np.ndarray:
    """Latent points (..., 2) of a closed skill on its cylinder, (3, ...)."""
    return np.moveaxis(skill.decoder.seen(latent), -1, 0)


def _footprint(axes: Axes, skill: Skill, settings: PlannerSettings, obstacle: Sphere) -> Patch:
    """Shade the latent points whose decoded tool would touch the obstacle."""
    shape = (160, 160)
    first, second = (np.linspace(skill.latent_lower[i], skill.latent_upper[i], shape[i]) for i in range(2))
    grid = np.stack(np.meshgrid(first, second), axis=-1).reshape(-1, 2)
    decoded = skill.decoder.decode(grid)
    body = tool_points(decoded.positions, decoded.quaternions, np.array(settings.tool_points))
    free = clearances(body, np.array(settings.tool_radii), obstacle.centre[None], np.array([obstacle.radius]), np.inf)
    free = free.reshape(shape[1], shape[0])
    axes.contourf(first, second, free, levels=[-np.inf, 0.0], colors=[ORANGE], alpha=0.45)
    axes.contour(first, second, free, levels=[0.0], colors=[ORANGE], linewidths=1.2)
    return Patch(facecolor=ORANGE, alpha=0.55, edgecolor=ORANGE, label="the hand would touch the obstacle")


def draw_latent_paths(axes: Axes, paths: Sequence[DrawnPath]) -> list[Line2D | Patch]:
    """Paths in a two-dimensional latent space, a dot at their beginnings, a square at their ends; for a legend."""
    handles: dict[str, Line2D | Patch] = {}
    for drawn in paths:
        axes.plot(*drawn.latent.T, color="white", linewidth=3.8, alpha=0.9, zorder=4)
        (line,) = axes.plot(*drawn.latent.T, drawn.style, color=drawn.colour, linewidth=2.2, label=drawn.name, zorder=5)
        handles[drawn.name] = line
    for drawn in paths:
        axes.plot(*drawn.latent[0], "o", color=drawn.colour, markersize=6, markeredgecolor="white", zorder=6)
        axes.plot(*drawn.latent[-1], "s", color=drawn.colour, markersize=7, markeredgecolor="white", zorder=6)
    return list(handles.values())


def _frame_codes(axes: Axes, skill: Skill, codes: np.ndarray, shown: Sequence[int] | np.ndarray = (0, 1)) -> None:
    """Show the part of the box that holds codes (n, 2), as of `seen_curve`, with a margin."""
    lower, upper = codes.min(axis=0), codes.max(axis=0)
    margin, own = 0.14 * (upper - lower), list(shown)
    lower, upper = lower - margin, upper + margin
    lower[: len(own)] = np.maximum(lower[: len(own)], skill.latent_lower[own])
    upper[: len(own)] = np.minimum(upper[: len(own)], skill.latent_upper[own])
    axes.set_xlim(lower[0], upper[0])
    axes.set_ylim(lower[1], upper[1])


def draw_in_space(
    axes: Axes,
    demonstrations: Sequence[np.ndarray],
    paths: Sequence[DrawnPath],
    obstacle: Sphere | None = None,
    zoom: float = 1.0,
    also: Sequence[np.ndarray] = (),
) -> list[Line2D | Patch]:
    """Curves in space with equal scales; in centimetres. Points (n, 3) [m] of `also` must be seen too."""
    axes.view_init(18.0, -28.0)
    axes.set_proj_type("ortho")
    for positions in demonstrations:
        axes.plot(*(100.0 * positions.T), color=GREY, linewidth=0.8, alpha=0.7, zorder=1)
    handles: dict[str, Line2D | Patch] = {
        "demonstrations": Line2D([], [], color=GREY, linewidth=0.9, label="demonstrations")
    }
    everything = [*demonstrations, *also, *(drawn.positions for drawn in paths)]
    if obstacle is not None:
        everything += [obstacle.centre + obstacle.radius, obstacle.centre - obstacle.radius]
        _ball(axes, obstacle)
        handles["obstacle"] = Patch(facecolor=ORANGE, label="obstacle when it was nearest (dotted: its path)")
    for drawn in paths:
        line = 100.0 * drawn.positions.T
        axes.plot(*line, color="white", linewidth=3.4, zorder=3)
        (handles[drawn.name],) = axes.plot(
            *line, drawn.style, color=drawn.colour, linewidth=2.0, label=drawn.name, zorder=4
        )
    points = 100.0 * np.concatenate([np.atleast_2d(part) for part in everything])
    lower, upper = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * np.max(upper - lower)
    for name, low, high in zip("xyz", lower - margin, upper + margin, strict=True):
        getattr(axes, f"set_{name}lim")(low, high)
        getattr(axes, f"set_{name}label")(f"{name} [cm]", labelpad=10.0 if name == "y" else 2.0)
    axes.set_box_aspect(upper - lower + 2.0 * margin, zoom=zoom)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 1.0))
        axis.set_major_locator(MultipleLocator(10.0))
    return list(handles.values())


def _ball(axes: Axes, obstacle: Sphere) -> None:
    polar, around = np.meshgrid(np.linspace(0.0, np.pi, 25), np.linspace(0.0, 2.0 * np.pi, 49))
    unit = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])
    ball = 100.0 * (obstacle.centre[:, None, None] + obstacle.radius * unit)
    axes.plot_surface(*ball, color=ORANGE, alpha=0.75, linewidth=0, shade=True, zorder=2)
    axes.plot(*(100.0 * obstacle.track.T), ":", color=ORANGE, linewidth=1.6, zorder=2)


def legend_below(figure: Figure, handles: Sequence[Line2D | Patch]) -> None:
    figure.legend(
        handles=list(handles), loc="outside lower center", ncols=2 if len(handles) > 3 else 3, frameon=False, fontsize=9
    )


def write_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure).print_figure(os.fspath(path), dpi=_DPI)
