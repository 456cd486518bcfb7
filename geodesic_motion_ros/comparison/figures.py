"""Figures of the comparison: success against similarity, clearances, and one scene as every method plays it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geodesic_motion_ros.comparison.execution import Outcome, Stage
from geodesic_motion_ros.comparison.method import Method
from geodesic_motion_ros.comparison.report import Report, figures
from geodesic_motion_ros.comparison.scene import Scene
from geodesic_motion_ros.comparison.ways import sphere_centres
from geodesic_motion_ros.plots import write_figure

#: Postures kept of a run a second, instants of a strip, and the size of one of its pictures.
_RATE, _INSTANTS, _WIDTH, _HEIGHT = 50.0, 5, 300, 225
_COLOURS = ("tab:red", "tab:orange", "gold", "0.5", "tab:purple", "tab:blue", "tab:green", "tab:cyan")


def draw_success(report: Report, path: Path) -> None:
    """Success over DTW from the closest demonstration: upper left is where one wants to be."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, free, title in zip(
        panels, (True, False), ("at least half of the demonstrations stay free", "fewer stay free"), strict=True
    ):
        for row, colour in zip(report.told, _COLOURS, strict=False):
            outcomes = report.outcomes(row, lambda item, free=free: item.outcome.mostly_free == free)
            own = figures(outcomes)
            if not outcomes or own["dtw_mm"] is None:
                continue
            # A replayed demonstration is at no distance, which has no place on a scale of decades.
            at = [max(0.3, own[name]) for name in ("dtw_mm", "dtw_low", "dtw_high")]
            success = own["success_percent"]
            axes.errorbar(
                at[0], success, color=colour, marker="o", markersize=8, capsize=3, label=f"{row} ({len(outcomes)})",
                xerr=[[at[0] - at[1]], [at[2] - at[0]]],
                yerr=[[success - own["success_low"]], [own["success_high"] - success]],
            )  # fmt: skip
        axes.set(xscale="log", xlabel="DTW from the closest demonstration, median of successes [mm]", title=title)
        axes.set(ylim=(-3.0, 103.0))
        axes.grid(alpha=0.3)
        if axes.has_data():
            axes.legend(title="method (scenes)", fontsize=8)
    panels[0].set_ylabel("success [%]")
    figure.suptitle(f"{report.skill}: goal reached without contact; bars: 95 %")
    write_figure(figure, path)


def draw_clearances(report: Report, path: Path) -> None:
    """Smallest clearance of every scene with spheres in which the arm moved, failures too."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.6), layout="constrained")
    axes = figure.subplots()
    rows = list(report.told)
    random = np.random.default_rng(0)
    for at, row in enumerate(rows):
        outcomes = report.outcomes(row, lambda item: item.family != "none")
        for kept, colour, marker in ((True, "tab:green", "o"), (False, "tab:red", "x")):
            values = [1e3 * max(item.clearance, 0.0) for item in outcomes if item.success == kept]
            axes.scatter(
                at + random.uniform(-0.25, 0.25, len(values)), values, color=colour, marker=marker, s=22, alpha=0.7,
                label={True: "success", False: "contact, or goal not reached"}[kept] if at == 0 else None,
            )  # fmt: skip
        good = [1e3 * item.clearance for item in outcomes if item.success]
        if good:
            axes.hlines(np.median(good), at - 0.35, at + 0.35, color="k", linewidth=1.5)
    axes.set_xticks(range(len(rows)), rows, rotation=20)
    axes.set(ylabel="smallest clearance while moving [mm]", title=f"{report.skill}: bars are medians of successes")
    axes.grid(axis="y", alpha=0.3)
    axes.legend(fontsize=8)
    write_figure(figure, path)


def draw_strip(stage: Stage, scene: Scene, methods: dict[str, Method], path: Path) -> None:
    """One scene, a row for each method, at the same instants; a row ends where its scene does."""
    from matplotlib.figure import Figure

    played = {row: stage.play(scene, method) for row, method in methods.items()}
    last = max(outcome.duration for outcome, _ in played.values())
    instants = np.linspace(0.0, last, _INSTANTS)
    figure = Figure(figsize=(2.3 * _INSTANTS, 1.75 * len(played)), layout="constrained")
    panels = figure.subplots(len(played), _INSTANTS, squeeze=False)
    for line, (row, (outcome, postures)) in zip(panels, played.items(), strict=True):
        for axes, picture in zip(line, _pictures(stage, scene, postures, instants, outcome), strict=True):
            axes.set(xticks=[], yticks=[])
            if picture is None:
                axes.axis("off")
                continue
            axes.imshow(picture)
        line[0].set_ylabel(row, fontsize=9)
        line[-1].set_title(_said(outcome), fontsize=8, loc="right")
    for axes, instant in zip(panels[0], instants, strict=True):
        axes.set_title(f"{instant:.1f} s", fontsize=9)
    panels[0][-1].set_title(f"{instants[-1]:.1f} s: {_said(next(iter(played.values()))[0])}", fontsize=8)
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
    """The arm and the spheres that do not chase at the instants; None once the scene is over."""
    world, made = stage.world, []
    for instant in instants:
        if instant > outcome.duration + 0.5 * instants[1]:
            made.append(None)
            continue
        world.reset(postures[min(int(_RATE * instant), len(postures) - 1)])
        there = min(instant, outcome.duration)
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
