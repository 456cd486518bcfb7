"""Picture of a recording: positions and orientations over time, the demonstrations in it, and what was found marked."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take
from geodesic_motion_ros.visualization.plots import BLUE, GREY, ORANGE, VERMILION, write_figure

#: More takes than this are not drawn: the picture would not be legible.
MOST_TAKES = 20
#: More samples of a line than this are thinned out.
_MOST_SAMPLES = 4000
_COLOURS = {Action.KEPT: GREY, Action.REPAIRED: ORANGE, Action.LEFT_OUT: VERMILION, Action.REFUSED: VERMILION}
_LINES = (GREY, "kept"), (ORANGE, "repaired"), (VERMILION, "left out or refused")


def draw_recording(
    takes: Sequence[Take],
    motions: Sequence[Take],
    left_out: frozenset[str],
    flaws: Sequence[Flaw],
    path: str | os.PathLike[str],
) -> None:
    """Write a picture with a row for each take, at most MOST_TAKES.

    motions : the demonstrations, all in the only take or one called like each; `left_out` are shaded otherwise.
    """
    drawn = takes[:MOST_TAKES]
    figure = Figure(figsize=(11.0, 1.2 + 1.9 * len(drawn)), layout="constrained")
    rows = np.atleast_1d(figure.subplots(len(drawn), 1, squeeze=False)[:, 0])
    for axes, take in zip(rows, drawn, strict=True):
        own = [motion for motion in motions if len(takes) == 1 or motion.name == take.name]
        names = {take.name, *(motion.name for motion in own)}
        found = [flaw for flaw in flaws if flaw.demonstration in names]
        _draw_take(axes, take, own, left_out, found)
    rows[-1].set_xlabel("time [s]")
    handles = [
        *(Line2D([], [], color=f"C{number % 10}", label=name) for number, name in enumerate(drawn[0].names)),
        Patch(color=BLUE, alpha=0.12, label="demonstration"),
        Patch(color=VERMILION, alpha=0.15, label="demonstration that is left out"),
        *(Line2D([], [], color=colour, ls="--", label=f"flaw, {done}") for colour, done in _LINES),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    write_figure(figure, path)


def _draw_take(
    axes: Axes, take: Take, motions: Sequence[Take], left_out: frozenset[str], flaws: Sequence[Flaw]
) -> None:
    step = max(1, len(take) // _MOST_SAMPLES)
    of_joints, beside = take.is_of_joints, None if take.is_of_joints or len(take.names) == 3 else axes.twinx()
    for number, column in enumerate(take.values.T):
        drawn, style = (axes, "-") if of_joints or number < 3 else (beside, ":")
        drawn.plot(take.times[::step], column[::step], color=f"C{number % 10}", lw=0.9, ls=style)
    if beside is not None:
        beside.set_ylabel("quaternion (dotted)", fontsize=8)
        beside.set_ylim(-1.05, 1.05)
    for motion in motions:
        out = motion.name in left_out
        axes.axvspan(motion.times[0], motion.times[-1], color=VERMILION if out else BLUE, alpha=0.15 if out else 0.12)
    for flaw in flaws:
        if flaw.action in _COLOURS:
            axes.axvline(flaw.time, color=_COLOURS[flaw.action], ls="--", lw=1.0)
    axes.set_title(take.name, fontsize=8, loc="left")
    axes.set_ylabel("joints [rad]" if of_joints else "position [m]", fontsize=8)
    axes.margins(x=0.01)
