"""Picture of `obstacle_laws`: the laws themselves, and what the planner does under each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geodesic_motion_ros.manifold.ambient_metric import ambient_factor
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.studies.experiments.obstacle_laws import STRENGTHS, WIDTHS, Kind, LawsReport
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, VERMILION, write_figure

#: The sphere and the strength for which the picture shows the laws [m].
_SHOWN_RADIUS, _SHOWN_STRENGTH = 0.04, 1000.0
_COLOURS: dict[Kind, str] = {"soft alone": VERMILION, "soft and hard": BLUE, "completed": GREEN}
_STYLES = dict(zip(WIDTHS, ("-", "--"), strict=True))
#: How far apart marks of one strength are drawn.
_APART = 0.1


def draw_laws(report: LawsReport, path: Path) -> None:
    """The laws themselves, and what the table says of each against its strength: filled marks the narrow width."""
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    _draw_factors(panels[0])
    rows = report.summary()
    for row in rows:
        row["hit_share"] = row["hits"] / row["found"] if row["found"] else math.nan
    for axes, letter, column, scale, title in (
        (panels[1], "b", "hit_share", 1e2, "paths found that hit the sphere [%]"),
        (panels[2], "c", "clearance_mean", 1e3, "clearance, mean [mm]"),
        (panels[3], "d", "deviation_mean", 1e3, "deviation from the path without [mm]"),
        (panels[4], "e", "infeasible", 1e2, "scenes without a path [%]"),
        (panels[5], "f", "capped_infeasible", 1e2, "without one that costs up to the cap [%]"),
    ):
        _draw_column(axes, rows, column, scale)
        axes.set_title(f"{letter}  {title}", loc="left", fontsize=11)
    handles, names = panels[1].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    write_figure(figure, path)


def _draw_factors(axes: Axes) -> None:
    """The ambient factor of a body point over its distance from a sphere's surface."""
    away = np.linspace(0.002, 0.25, 300)
    body = PlannerSettings().body_radius
    centres, radii = np.zeros((1, 3)), np.array([_SHOWN_RADIUS])
    for kind in ("soft and hard", "completed"):
        for width, style in _STYLES.items():
            factors = [
                ambient_factor(
                    _SHOWN_RADIUS + d, 0.0, 0.0, body, centres, radii, _SHOWN_STRENGTH, width, kind == "completed"
                )
                for d in away
            ]  # fmt: skip
            axes.plot(100.0 * away, factors, style, color=_COLOURS[kind])
    axes.axvline(100.0 * body, color=GREY, linewidth=0.8)
    axes.annotate("the body touches", (100.0 * body, 2e4), xytext=(4, 0), textcoords="offset points", fontsize=8)
    surface = f"body point from a sphere of {100.0 * _SHOWN_RADIUS:.0f} cm [cm]"
    axes.set(yscale="log", ylim=(0.8, 1e5), xlabel=surface)
    axes.set_title(f"a  ambient factor, zeta {_SHOWN_STRENGTH:.0f}", loc="left", fontsize=11)
    axes.annotate(f"dashed: width {WIDTHS[-1]:g}", (24.5, 6e2), ha="right", fontsize=8)
    axes.grid(alpha=0.3)


def _draw_column(axes: Axes, rows: Sequence[dict[str, Any]], column: str, scale: float) -> None:
    """One column of the table against the strength, a mark for each law and width."""
    for number, (kind, width) in enumerate(product(_COLOURS, WIDTHS)):
        values = [scale * row[column] for row in rows if (row["kind"], row["width"]) == (kind, width)]
        axes.plot(
            np.arange(len(values)) + _APART * (number - 2.5), values, "o", color=_COLOURS[kind], markersize=6,
            markerfacecolor="white" if width == WIDTHS[-1] else None, label=f"{kind}, width {width:g}",
        )  # fmt: skip
    for kind, style in (("hard alone", "-"), ("ignored", ":")):
        for row in rows:
            if row["kind"] == kind:
                axes.axhline(scale * row[column], color="black", linestyle=style, linewidth=1.2, label=kind, zorder=1)
    axes.set_xticks(range(len(STRENGTHS)), [f"{strength:.0f}" for strength in STRENGTHS])
    axes.set_xlabel("zeta")
    axes.grid(alpha=0.3)
