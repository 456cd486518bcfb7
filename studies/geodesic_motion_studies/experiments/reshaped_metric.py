"""What the paper draws of a latent space of poses: a moving sphere reshapes the metric, and geodesics bundle.

*Snapshots*: a sphere moves across the middle of a geodesic from the start of one demonstration to the goal of another.
The ambient metric is the paper's, m(p) = 1 + zeta exp(-|p - o|^2 / (2 r^2)), at the tool's origin, and the geodesics
are found as its planner finds them (`paper`): on a dense grid, with a spline through the shortest path; nothing is
removed near the sphere, nothing is certified.

*Change*: a small sphere on the geodesic of a pair of ends that was shown, at every place of it that is tried. Where the
geodesic comes past it by following the demonstrations of another pair, that which stays nearest to them is kept.

*Many geodesics*: between random supported points, on a graph of the whole latent box from which nothing is deleted,
beside straight latent lines. What counts is the share of a curve inside the support.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from scipy.spatial import cKDTree

from geodesic_motion_ros.geometry.fitted_spline import fitted_spline
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.paper.dense_graph import dense_graph
from geodesic_motion_ros.paper.literal_search import LiteralSearch, ambient_factors
from geodesic_motion_ros.paper.paper_planner import COEFFICIENTS, SAMPLES, PaperSettings
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization.latent_view import magnification_factor
from geodesic_motion_ros.visualization.plots import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    demonstrations_of,
    write_figure,
)
from geodesic_motion_studies.experiments.grasp_joint_scenes import passed_in_turn
from geodesic_motion_studies.experiments.latent_pictures import MAGNIFICATION_LABEL, draw_haloed
from geodesic_motion_studies.experiments.learned_paths import LearnedPaths, whole_box
from geodesic_motion_studies.experiments.metric_graph import evenly
from geodesic_motion_studies.experiments.pouring_scene import PLACES, SPHERE_RADIUS

#: Where the sphere is on its line, from the middle of the geodesic without it [m].
PLACES_ON_LINE = (-0.15, -0.05, 0.0, 0.05, 0.15)
_LINE = np.array([-1.0, 0.0, 0.0])
#: Pairs of random points, and sides of the pictures.
PAIRS = 60
_SIDE = 200
#: Radius of the sphere on the path of a pair [m], and where it is tried, in samples of the geodesic.
_SMALL, _TRIED = 0.02, range(20, 81, 5)
#: Colours of the groups of demonstrations.
_GROUPS = (GREEN, GREY, ORANGE)
#: zeta of the ambient metric.
_STRENGTH = PaperSettings().strength


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The metric with the sphere at one place.

    Attributes
    ----------
    place : of the sphere on its line [m].
    magnification : (r, r) log sqrt det M, first row at the top.
    geodesic : (n, 2) latent points of the geodesic.
    nearest, nearest_without : least distance of the tool's origin from the sphere's surface [m], on the geodesic and on
        the one without the sphere; negative inside.
    """

    place: float
    magnification: np.ndarray
    geodesic: np.ndarray
    nearest: float
    nearest_without: float


@dataclass(frozen=True, eq=False)
class Change:
    """A sphere on the geodesic of a pair that was shown, which then follows other demonstrations.

    Attributes
    ----------
    centre : of the sphere (3,) [m]. without, geodesic : (n, 2) latent points before and with it.
    passed : groups that the geodesic with it passes, in turn; before it passes that of its pair alone.
    nearest : distance of the tool's origin from the sphere's surface [m]; off, off_without : largest distance of the
        tool's origin from the demonstrations [m].
    tried, clear, found : places that were tried; where it is clear of the sphere; where it passes other groups besides.
    """

    centre: np.ndarray
    without: np.ndarray
    geodesic: np.ndarray
    passed: tuple[int, ...]
    nearest: float
    off: float
    off_without: float
    tried: int = 0
    clear: int = 0
    found: int = 0


@dataclass(frozen=True, eq=False)
class RandomGeodesic:
    """A latent geodesic (n, 2) between two random supported points.

    Attributes
    ----------
    supported, line_supported : share of the geodesic, and of the straight line, inside the support.
    refused : an edge of the geodesic is dearer than the skill's threshold.
    across : its ends are nearest to codes of different signs of the quaternion.
    """

    geodesic: np.ndarray
    supported: float
    line_supported: float
    refused: bool
    across: bool


@dataclass(frozen=True, eq=False)
class ReshapedMetric:
    """Of one skill; `without` : the geodesic without the sphere, (n, 2); `change` : None where none is found.
    """

    skill: Skill
    without: np.ndarray
    snapshots: tuple[Snapshot, ...]
    geodesics: tuple[RandomGeodesic, ...]
    change: Change | None

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        whole = [item.supported == 1.0 for item in self.geodesics]
        return {
            "snapshots": [
                {"place": item.place, "nearest": item.nearest, "nearest_without": item.nearest_without}
                for item in self.snapshots
            ],
            "change": None if self.change is None else vars(self.change),
            "random_geodesics": {
                "pairs": len(self.geodesics),
                "inside_the_support": sum(whole),
                "mean_share": float(np.mean([item.supported for item in self.geodesics])),
                "lines_inside_the_support": sum(item.line_supported == 1.0 for item in self.geodesics),
                "lines_mean_share": float(np.mean([item.line_supported for item in self.geodesics])),
                "refused": sum(item.refused for item in self.geodesics),
                "across": sum(item.across for item in self.geodesics),
                "refused_across": sum(item.refused and item.across for item in self.geodesics),
            },
        }

    def lines(self) -> list[str]:
        """The figures in words, for a table."""
        random, change = self.as_dict()["random_geodesics"], self.change
        return [
            *([] if change is None else [
                f"sphere of {1e3 * _SMALL:.0f} mm on the geodesic of a pair that was shown: of {change.tried} places "
                f"clear in {change.clear}, in {change.found} of these through other groups; drawn: "
                f"{', '.join(map(str, change.passed))}, {1e3 * change.nearest:.1f} mm clear, "
                f"{1e3 * change.off:.1f} mm off the demonstrations ({1e3 * change.off_without:.1f} mm without it)",
            ]),
            *(
                f"the paper's search, sphere at {1e3 * item.place:+.0f} mm: tool's origin {1e3 * item.nearest:.1f} mm "
                f"from its surface, {1e3 * item.nearest_without:.1f} mm without knowing of it"
                for item in self.snapshots
            ),
            f"{random['pairs']} geodesics between random supported points: {random['inside_the_support']} inside the "
            f"support, mean share {random['mean_share']:.3f}, {random['refused']} above the energy threshold; "
            f"{random['across']} between clusters, {random['refused_across']} of them above it; straight lines: "
            f"{random['lines_inside_the_support']} inside, {random['lines_mean_share']:.3f}",
        ]


def reshape_metric(skill: Skill, pairs: int = PAIRS, seed: int = 0) -> ReshapedMetric:
    """Move the sphere across the geodesic from the first demonstration's start to the last one's goal, and draw the
    random points, on a skill with two latent dimensions.
    """
    codes = demonstrations_of(skill)
    search = _Search(skill, codes[0, 0], codes[-1, -1])
    without = search.geodesic(np.empty((0, 3)), np.empty(0))
    positions = skill.decoder.decode(without).positions
    middle = positions[len(positions) // 2]
    snapshots = []
    for place in PLACES_ON_LINE:
        centre = middle + place * _LINE
        latent = search.geodesic(centre[None], np.array([SPHERE_RADIUS]))
        nearest, nearest_without = (
            float(np.linalg.norm(places - centre, axis=1).min()) - SPHERE_RADIUS
            for places in (skill.decoder.decode(latent).positions, positions)
        )
        picture = magnification_factor(skill, _SIDE, partial(_stretched, centre))
        snapshots.append(Snapshot(place, picture, latent, nearest, nearest_without))
    random = tuple(_random_geodesics(skill, pairs, seed))
    return ReshapedMetric(skill, without, tuple(snapshots), random, _change(skill))


class _Search:
    """The paper's search between the nodes nearest to two latent points (2,), here and there."""

    def __init__(self, skill: Skill, here: np.ndarray, there: np.ndarray) -> None:
        self._graph, weights = dense_graph(skill)
        self._source, target = (int(self._graph.nodes_near(latent, 1)[0]) for latent in (here, there))
        self._search = LiteralSearch(self._graph.adjacency, weights, _STRENGTH)
        self._search.aim(target, self._search.field(target))

    def geodesic(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Latent points (n, 2) of the spline, among spheres (o, 3), (o,) [m]."""
        self._search.begin(self._source, centres, radii)
        self._search.go_on()
        return fitted_spline(self._graph.latent[self._search.nodes], COEFFICIENTS)(np.linspace(0.0, 1.0, SAMPLES))


def _stretched(centre: np.ndarray, positions: np.ndarray, radius: float = SPHERE_RADIUS) -> np.ndarray:
    """The paper's ambient factor (n,) of a sphere at (3,) [m] at positions (n, 3) [m]."""
    factors = np.empty(len(positions))
    ambient_factors(positions, centre[None], np.array([radius]), _STRENGTH, factors)
    return factors


def _change(skill: Skill) -> Change | None:
    codes = demonstrations_of(skill)
    each = len(codes) // len(PLACES)
    searches = [_Search(skill, codes[group * each, 0], codes[group * each, -1]).geodesic for group in PLACES]

    def positions(latent: np.ndarray) -> np.ndarray:
        return skill.decoder.decode(latent).positions

    groups = np.split(positions(codes[: each * len(PLACES)].reshape(-1, 2)), len(PLACES))
    return change_of_groups(searches, positions, np.stack(groups))


def change_of_groups(
    searches: Sequence[Callable[[np.ndarray, np.ndarray], np.ndarray]],
    positions: Callable[[np.ndarray], np.ndarray],
    groups: np.ndarray,
) -> Change | None:
    """Put the sphere on the geodesic of each group, and keep the change that stays nearest to the demonstrations.

    searches : of each group, the geodesic (n, 2) of one of its pairs of ends among spheres (o, 3), (o,) [m].
    positions : of the tool (n, 3) [m] at latent points (n, 2). groups : positions (g, m, 3) [m] that each group shows.
    """
    shown, size = cKDTree(groups.reshape(-1, 3)), groups.shape[1]
    changes, tried, clear = [], 0, 0
    for group, geodesic in enumerate(searches):
        without = geodesic(np.empty((0, 3)), np.empty(0))
        before = positions(without)
        away_before, index = shown.query(before)
        if passed_in_turn(index // size) != (group,):
            continue
        for centre in before[_TRIED]:
            latent = geodesic(centre[None], np.array([_SMALL]))
            after = positions(latent)
            nearest = float(np.linalg.norm(after - centre, axis=1).min()) - _SMALL
            away, index = shown.query(after)
            passed = passed_in_turn(index // size)
            tried, clear = tried + 1, clear + (nearest > 0.0)
            if nearest > 0.0 and set(passed) - {group}:
                off, off_without = float(away.max()), float(away_before.max())
                changes.append(Change(centre, without, latent, passed, nearest, off, off_without))
    if not changes:
        return None
    best = min(changes, key=lambda change: change.off)
    return replace(best, tried=tried, clear=clear, found=len(changes))


def _random_geodesics(skill: Skill, pairs: int, seed: int) -> list[RandomGeodesic]:
    paths, random = LearnedPaths(whole_box(skill)), np.random.default_rng(seed)
    latent = paths.graph.latent
    candidates = latent[paths.graph.sigma <= skill.sigma_limit]
    codes = cKDTree(skill.codes.reshape(-1, 2))
    found = []
    for _ in range(pairs):
        start, goal = candidates[random.choice(len(candidates), 2, replace=False)]
        path = paths.shortest(start, goal)
        shares = [_supported_share(skill, curve) for curve in (latent[path.nodes], np.stack([start, goal]))]
        # The first half of the codes are those of q, the others those of -q.
        begin, end = codes.query(np.stack([start, goal]))[1] >= codes.n // 2
        refused = path.dearest > skill.energy_per_edge
        found.append(RandomGeodesic(latent[path.nodes], *shares, refused, bool(begin != end)))
    return found


def _supported_share(skill: Skill, curve: np.ndarray) -> float:
    sigma, _ = skill.decoder.uncertainty(evenly(curve))
    return float(np.mean(rms_sigma(sigma) <= skill.sigma_limit))


def draw_reshaped_metric(report: ReshapedMetric, path: Path) -> None:
    """The snapshots under one scale, and the geodesics between random points; in NAME_change.png the change of groups.
    """
    if report.change is not None:
        _draw_change(report.skill, report.change, path.with_stem(f"{path.stem}_change"))
    figure = Figure(figsize=(13.0, 7.4), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    free = magnification_factor(report.skill, _SIDE)
    everything = np.stack([item.magnification for item in report.snapshots])
    scale = {"vmin": np.percentile(free, 2.0), "vmax": np.percentile(everything, 99.8)}
    for letter, axes, item in zip("abcde", panels, report.snapshots, strict=False):
        image = _draw_background(axes, report.skill, item.magnification, scale)
        draw_haloed(axes, report.without, BLUE, "--")
        draw_haloed(axes, item.geodesic, VERMILION, "-")
        axes.set_title(f"{letter}  sphere at {100.0 * item.place:+.0f} cm", loc="left", fontsize=11)
    last = panels[len(report.snapshots)]
    _draw_background(last, report.skill, free, scale)
    for item in sorted(report.geodesics, key=lambda item: not item.refused):
        last.plot(*item.geodesic.T, color="white", linewidth=2.4)
        last.plot(*item.geodesic.T, color=VERMILION if item.refused else BLUE, linewidth=1.4)
        last.plot(*item.geodesic[[0, -1]].T, "o", color="black", markersize=3.0)
    last.set_title(f"f  {len(report.geodesics)} geodesics between random points", loc="left", fontsize=11)
    figure.colorbar(image, ax=panels, label=MAGNIFICATION_LABEL, pad=0.01, shrink=0.8)
    handles = [
        Line2D([], [], color=BLUE, linestyle="--", linewidth=2.2, label="a to e: geodesic without the sphere"),
        Line2D([], [], color=VERMILION, linewidth=2.2, label="a to e: geodesic at the time"),
        Line2D([], [], color=BLUE, linewidth=1.2, label="f: below the energy threshold"),
        Line2D([], [], color=VERMILION, linewidth=1.2, label="f: above it"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    write_figure(figure, path)


def _draw_change(skill: Skill, change: Change, path: Path) -> None:
    """Before and after, in the latent space and from above."""
    figure = Figure(figsize=(12.0, 5.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    factors = partial(_stretched, change.centre, radius=_SMALL)
    picture = magnification_factor(skill, _SIDE, factors)
    scale = {"vmin": np.percentile(picture, 2.0), "vmax": np.percentile(picture, 99.8)}
    image = _draw_background(left, skill, picture, scale)
    figure.colorbar(image, ax=left, label=MAGNIFICATION_LABEL, pad=0.01)
    left.set_title("a  latent space with the sphere", loc="left", fontsize=11)
    codes = demonstrations_of(skill)
    for number, code in enumerate(codes):
        colour = _GROUPS[number // (len(codes) // len(PLACES))]
        left.plot(*code.T, color=colour, linewidth=1.0)
        right.plot(*(100.0 * skill.decoder.decode(code).positions[:, 1::-1].T), color=colour, linewidth=1.0)
    for latent, colour, style in ((change.without, BLUE, "--"), (change.geodesic, VERMILION, "-")):
        draw_haloed(left, latent, colour, style)
        right.plot(*(100.0 * skill.decoder.decode(latent).positions[:, 1::-1].T), style, color=colour, linewidth=2.2)
    right.add_patch(Circle(100.0 * change.centre[1::-1], 100.0 * _SMALL, color="black", alpha=0.5))
    right.set(xlabel="y [cm]", ylabel="x [cm]", aspect="equal")
    right.set_title("b  from above: the sphere and the tool", loc="left", fontsize=11)
    handles = [
        Line2D([], [], color=BLUE, linestyle="--", linewidth=2.2, label="geodesic before"),
        Line2D([], [], color=VERMILION, linewidth=2.2, label="geodesic with the sphere"),
        *(Line2D([], [], color=colour, label=f"shown, bottle {group}") for group, colour in enumerate(_GROUPS)),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    write_figure(figure, path)


def _draw_background(axes: Axes, skill: Skill, values: np.ndarray, scale: dict[str, float]) -> Any:
    (left, bottom), (right, top) = skill.latent_lower, skill.latent_upper
    image = axes.imshow(values, extent=(left, right, bottom, top), cmap="viridis", aspect="auto", **scale)
    for code in skill.codes:
        axes.plot(*code.T, color="white", linewidth=0.5, alpha=0.7)
    axes.set(xlabel="$z_1$", ylabel="$z_2$")
    return image
