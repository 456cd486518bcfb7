"""Picture of the largest spheres that are passed, along a motion."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from geodesic_motion_ros.visualization.largest_sphere import LARGEST
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION, write_figure

_COLOURS = (GREY, BLUE, VERMILION, GREEN, ORANGE)


def draw_passed_spheres(
    path: str | os.PathLike[str],
    title: str,
    shares: np.ndarray,
    free: np.ndarray,
    radii: Mapping[str, np.ndarray],
    marked: float | None = None,
) -> None:
    """Radii along the motion, a line for each name; grey is what touches the arm at start or goal.

    Parameters
    ----------
    shares, free : (n,) as of `SpherePlaces`. radii : (n,) [m] by their names. marked : a radius [m] to compare with.
    """
    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    axes = figure.subplots()
    places, top = 100.0 * shares, 100.0 * LARGEST
    axes.fill_between(
        places, np.minimum(100.0 * free, top), top, color=GREY, alpha=0.2, linewidth=0.0, label="touches start or goal"
    )
    for (name, own), colour in zip(radii.items(), _COLOURS, strict=False):
        axes.plot(places, 100.0 * own, color=colour, marker="o", markersize=3.5, linewidth=1.6, label=name)
    if marked is not None:
        axes.axhline(100.0 * marked, color="black", linewidth=0.8, linestyle=":")
    axes.set(
        xlabel="place on the tool's path [%]", ylabel="radius passed [cm]", ylim=(-0.2, top), xlim=(0.0, 100.0),
        title=title,
    )  # fmt: skip
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    write_figure(figure, path)
