"""Picture of how well held-out demonstrations are given back with each number of latent dimensions."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from geodesic_motion_ros.visualization.plots import BLUE, write_figure


def draw_dimensions(path: str | os.PathLike[str], compared: Mapping[str, Any]) -> None:
    """Mean errors [mm] with their standard errors; compared : as of `DimensionFigures.as_dict`."""
    dimensions, means, errors = (
        np.array(compared[name], dtype=float) for name in ("dimensions", "held_out_mm", "standard_error_mm")
    )
    chosen, best = dimensions == compared["chosen"], int(np.argmin(means))
    figure = Figure(figsize=(5.0, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.errorbar(dimensions, means, errors, color=BLUE, marker="o", markerfacecolor="white", capsize=3.0)
    axes.plot(dimensions[chosen], means[chosen], "o", color=BLUE, markersize=8.0)
    axes.axhline(means[best] + errors[best], color="black", linewidth=0.8, linestyle=":")
    axes.set(xlabel="latent dimensions", ylabel="error, held out [mm]", xticks=dimensions)
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    write_figure(figure, path)
