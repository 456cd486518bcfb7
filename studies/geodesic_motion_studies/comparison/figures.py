"""Figures of the comparison: success against similarity, clearances, and one scene as every method plays it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geodesic_motion_ros.visualization.plots import write_figure
from geodesic_motion_studies.comparison.chasing import sphere_centres
from geodesic_motion_studies.comparison.execution import LOOKED_FOR, Outcome, Stage
from geodesic_motion_studies.comparison.method import Method
from geodesic_motion_studies.comparison.report import Figures, Report, hardly_free, mostly_free
from geodesic_motion_studies.comparison.results import Played
from geodesic_motion_studies.comparison.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Postures kept of a run a second, instants of a strip, and the size of one of its pictures.
_RATE, _INSTANTS, _WIDTH, _HEIGHT = 50.0, 5, 300, 225
#: Colour and marker of each row; the first is that of ours.
_OURS = "ours"
_LOOKS = {
    _OURS: ("tab:red", "*"), "ours, detour 0": ("tab:pink", "h"), "ours, hard": ("tab:orange", "o"),
    "ours, soft": ("gold", "s"), "replay": ("0.5", "D"),
    "DMP": ("tab:purple", "v"), "ProMP": ("tab:blue", "^"), "RRT-Connect": ("tab:green", "P"),
    "barriers": ("tab:cyan", "X"), "free demonstration": ("tab:brown", "p"),
    "mean demonstration + detour": ("tab:olive", "<"), "ProMP + detour": ("navy", ">"),
    "nearest demonstration + detour": ("saddlebrown", "d"),
}  # fmt: skip
_OTHER = ("k", "o")
#: Where the name of a row may be beside its mark: offset [points] and alignment.
_BESIDE = (
    ((9, 5), "left", "bottom"), ((9, -5), "left", "top"), ((-9, 5), "right", "bottom"), ((-9, -5), "right", "top"),
    ((0, 11), "center", "bottom"), ((0, -11), "center", "top"), ((9, 17), "left", "bottom"), ((9, -17), "left", "top"),
)  # fmt: skip
#: What is nearer to a demonstration is drawn there [mm]: no distance has no place on a scale of decades.
_LEAST = 0.3
#: How a scene with spheres may end: label, colour, marker.
_ENDS = (
    ("success", "tab:green", "o"), ("touched a sphere in motion", "tab:red", "x"),
    ("touched as it stood, refused, or lost: without a reason, or not there after 15 s", "0.4", "+"),
)  # fmt: skip


def draw_success(report: Report, path: Path) -> None:
    """Success over DTW from what similarity is measured to: upper left is where one wants to be."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.8), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    marks: list[tuple[Axes, dict[str, tuple[float, float]]]] = []
    for axes, part, title in zip(
        panels, (mostly_free, hardly_free), ("at least half of the demonstrations stay free", "fewer stay free"),
        strict=True,
    ):  # fmt: skip
        without, scenes, at = [], 0, {}
        for row in sorted(report.descriptions, key=lambda row: row == _OURS):  # ours on top
            own = report.figures(row, part)
            scenes = own["scenes"]
            if own["dtw_mm"] is None:
                without.append(row)
                continue
            at[row] = _mark(axes, row, own)
        axes.set_xlabel(f"DTW from {report.similar_to}, median of successes [mm]")
        axes.set_title(f"{title}: {scenes} scenes")
        axes.grid(alpha=0.3)
        if without and scenes:
            axes.text(0.03, 0.04, f"no success: {'; '.join(without)}", transform=axes.transAxes, fontsize=8)
        marks.append((axes, at))
    ticks = [_LEAST, 1.0, 3.0, 10.0, 30.0, 100.0]
    panels[0].set(xscale="log", xlim=(0.8 * _LEAST, 150.0), ylim=(-5.0, 108.0), ylabel="success [%]")
    panels[0].set_xticks(ticks, [f"< {_LEAST:g}", *(f"{tick:g}" for tick in ticks[1:])])
    panels[0].minorticks_off()
    # One of each, where there may be none in a panel.
    looks = [
        panels[1].plot([], [], color=colour, marker=marker, linestyle="none", label=row)[0]
        for row, (colour, marker) in ((row, _LOOKS.get(row, _OTHER)) for row in report.descriptions)
    ]
    figure.legend(handles=looks, loc="outside right center", fontsize=9)
    figure.suptitle(f"{report.skill}: the goal reached without contact; bars are intervals at 95 %")
    # Where names fit is known when the panels have their places.
    figure.draw_without_rendering()
    for axes, at in marks:
        _name(axes, at)
    write_figure(figure, path)


def _mark(axes: Axes, row: str, own: Figures) -> tuple[float, float]:
    """Draw a row with its intervals; where its mark is."""
    at, low, high = (max(_LEAST, own[name]) for name in ("dtw_mm", "dtw_low", "dtw_high"))
    success = own["success_percent"]
    colour, marker = _LOOKS.get(row, _OTHER)
    axes.errorbar(
        at, success, color=colour, marker=marker, markersize=14 if row == _OURS else 8, capsize=3, alpha=0.85,
        elinewidth=1.0, xerr=[[at - low], [high - at]],
        yerr=[[max(0.0, success - own["success_low"])], [max(0.0, own["success_high"] - success)]],
        linestyle="none",
    )  # fmt: skip
    return at, success


def _name(axes: Axes, marks: dict[str, tuple[float, float]]) -> None:
    """Write the names of rows beside their marks, where they cover no other one and no mark; the legend has all."""
    from matplotlib.transforms import Bbox

    size = 6.0 * axes.figure.dpi / 72.0
    taken = [Bbox([place - size, place + size]) for place in axes.transData.transform(list(marks.values()))]
    for row, at in reversed(marks.items()):
        for offset, horizontal, vertical in _BESIDE:
            name = axes.annotate(
                row, at, offset, textcoords="offset points", ha=horizontal, va=vertical, fontsize=8,
                color=_LOOKS.get(row, _OTHER)[0],
            )  # fmt: skip
            box = name.get_window_extent()
            inside = axes.bbox.contains(*box.min) and axes.bbox.contains(*box.max)
            if inside and not box.count_overlaps(taken):
                taken.append(box)
                break
            name.remove()


def draw_clearances(report: Report, path: Path) -> None:
    """The smallest clearance of each scene with spheres, by row and by how it ended."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.8), layout="constrained")
    axes = figure.subplots()
    rows = list(report.descriptions)
    random = np.random.default_rng(0)
    for at, row in enumerate(rows):
        outcomes = [item.outcome for item in report.of(row, came_near)]
        ended = [0 if item.success else 1 if item.touched_moving else 2 for item in outcomes]
        for end, (_, colour, marker) in enumerate(_ENDS):
            values = [1e3 * max(item.clearance, 0.0) for item, own in zip(outcomes, ended, strict=True) if own == end]
            places = at + random.uniform(-0.25, 0.25, len(values))
            axes.scatter(places, values, color=colour, marker=marker, s=26, alpha=0.75)
        good = [1e3 * item.clearance for item in outcomes if item.success]
        if good:
            axes.hlines(np.median(good), at - 0.35, at + 0.35, color="k", linewidth=1.5)
    for label, colour, marker in _ENDS:
        axes.scatter([], [], color=colour, marker=marker, s=26, label=label)
    axes.plot([], [], color="k", label="median of successes")
    axes.set_xticks(range(len(rows)), rows)
    # What is farther was not measured: the scale ends there.
    ticks = np.linspace(0.0, 1e3 * LOOKED_FOR, 7)
    axes.set_yticks(ticks, [*(f"{tick:.0f}" for tick in ticks[:-1]), f"{ticks[-1]:.0f}+"])
    axes.set(
        ylabel="smallest clearance while moving [mm]",
        title=f"{report.skill}: scenes with spheres, but those that ended before the arm had moved near one",
    )
    axes.grid(axis="y", alpha=0.3)
    figure.legend(fontsize=9, loc="outside lower center", ncols=2, frameon=False)
    write_figure(figure, path)


def came_near(item: Played) -> bool:
    """Whether there was a sphere to keep clear of: an arm that never sets out is far from all, which says nothing."""
    return item.family != "none" and (item.outcome.success or item.outcome.clearance < LOOKED_FOR)


def draw_strip(stage: Stage, scene: Scene, methods: dict[str, Method], path: Path) -> None:
    """One scene, a row for each method, at the same instants; the last picture of a row is of its end."""
    from matplotlib.figure import Figure

    played = {row: stage.play(scene, method) for row, method in methods.items()}
    last = max(outcome.duration for outcome, _ in played.values())
    instants = np.linspace(0.0, last, _INSTANTS)
    figure = Figure(figsize=(2.3 * _INSTANTS, 1.65 * len(played)), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.01, h_pad=0.01, wspace=0.0, hspace=0.0)
    panels = figure.subplots(len(played), _INSTANTS, squeeze=False)
    for line, (row, (outcome, postures)) in zip(panels, played.items(), strict=True):
        pictures = _pictures(stage, scene, postures, instants, outcome)
        for axes, picture in zip(line, pictures, strict=True):
            axes.set(xticks=[], yticks=[])
            if picture is None:
                axes.axis("off")
                continue
            axes.imshow(picture)
        line[0].set_ylabel(f"{row}\n{_said(outcome)}", fontsize=9)
    for axes, instant in zip(panels[0], instants, strict=True):
        axes.set_title(f"{instant:.1f} s", fontsize=9)
    write_figure(figure, path)


def _said(outcome: Outcome) -> str:
    """How a scene ended."""
    end = f"{outcome.duration:.1f} s"
    if outcome.success:
        return f"goal, {end}"
    if outcome.contact:
        return f"contact, {end}"
    return f"{'refused' if outcome.refused else 'lost'}, {end}"


def _pictures(
    stage: Stage, scene: Scene, postures: np.ndarray, instants: np.ndarray, outcome: Outcome
) -> Sequence[np.ndarray | None]:
    """The arm, and the spheres that do not chase, at the instants and at the scene's end; None once it is over."""
    world, made, over = stage.world, [], False
    for instant in instants:
        if over:
            made.append(None)
            continue
        over, there = instant >= outcome.duration, min(instant, outcome.duration)
        world.reset(postures[min(int(_RATE * there), len(postures) - 1)])
        world.set_obstacles(
            {
                str(i): (sphere_centres(sphere, np.array([there]), np.zeros((1, 3)))[0], sphere.radius)
                for i, sphere in enumerate(scene.spheres)
                if sphere.appears <= there < sphere.vanishes
            }
        )
        made.append(world.render(_WIDTH, _HEIGHT, "front", oversampling=2))
    world.set_obstacles({})
    return made
