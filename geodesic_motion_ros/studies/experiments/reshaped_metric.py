"""What the paper draws of a latent space of poses: a moving sphere reshapes the metric, and geodesics bundle.

*Snapshots*: a sphere moves across the middle of a geodesic from the start of one demonstration to the goal of another.
The ambient metric is the paper's, m(p) = 1 + zeta exp(-|p - o|^2 / (2 r^2)), at the tool's origin, and the geodesics
are found as its planner finds them (`paper`): on a dense grid, with a spline through the shortest path; nothing is
removed near the sphere, nothing is certified.

*Many geodesics*: between random supported points, on a graph of the whole latent box from which nothing is deleted,
beside straight latent lines. What counts is the share of a curve inside the support.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import cKDTree

from geodesic_motion_ros.geometry.fitted_spline import fitted_spline
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.studies.experiments.latent_pictures import MAGNIFICATION_LABEL, draw_haloed
from geodesic_motion_ros.studies.experiments.learned_paths import LearnedPaths, whole_box
from geodesic_motion_ros.studies.experiments.metric_graph import evenly
from geodesic_motion_ros.studies.experiments.pouring_scene import SPHERE_RADIUS
from geodesic_motion_ros.studies.paper.dense_graph import dense_graph
from geodesic_motion_ros.studies.paper.literal_search import LiteralSearch, ambient_factors
from geodesic_motion_ros.studies.paper.paper_planner import COEFFICIENTS, SAMPLES, PaperSettings
from geodesic_motion_ros.visualization.latent_view import magnification_factor
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION, demonstrations_of, write_figure

#: Where the sphere is on its line, from the middle of the geodesic without it [m].
PLACES_ON_LINE = (-0.15, -0.05, 0.0, 0.05, 0.15)
_LINE = np.array([-1.0, 0.0, 0.0])
#: Pairs of random points, and sides of the pictures.
PAIRS = 60
_SIDE = 200
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
    """Both, of one skill; `without` : the geodesic without the sphere, (n, 2)."""

    skill: Skill
    without: np.ndarray
    snapshots: tuple[Snapshot, ...]
    geodesics: tuple[RandomGeodesic, ...]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        whole = [item.supported == 1.0 for item in self.geodesics]
        return {
            "snapshots": [
                {"place": item.place, "nearest": item.nearest, "nearest_without": item.nearest_without}
                for item in self.snapshots
            ],
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
        random = self.as_dict()["random_geodesics"]
        return [
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
    return ReshapedMetric(skill, without, tuple(snapshots), tuple(_random_geodesics(skill, pairs, seed)))


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


def _stretched(centre: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """The paper's ambient factor (n,) of a sphere at (3,) [m] at positions (n, 3) [m]."""
    factors = np.empty(len(positions))
    ambient_factors(positions, centre[None], np.array([SPHERE_RADIUS]), _STRENGTH, factors)
    return factors


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
    """The snapshots under one scale, and the geodesics between random points."""
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


def _draw_background(axes: Axes, skill: Skill, values: np.ndarray, scale: dict[str, float]) -> Any:
    (left, bottom), (right, top) = skill.latent_lower, skill.latent_upper
    image = axes.imshow(values, extent=(left, right, bottom, top), cmap="viridis", aspect="auto", **scale)
    for code in skill.codes:
        axes.plot(*code.T, color="white", linewidth=0.5, alpha=0.7)
    axes.set(xlabel="$z_1$", ylabel="$z_2$")
    return image
