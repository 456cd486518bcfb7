"""Whatever planners come: the paper's answers 200 recorded queries of each space as it did when they were recorded.

What depends on the processor, the decoded nodes and their weights, is computed anew from the shipped skills' arrays.
Record anew, where the paper's planner itself was wrong: python test/paper/test_literal_profile.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.geometry.fitted_spline import fitted_spline
from geodesic_motion_ros.paper.literal_search import LiteralSearch
from geodesic_motion_ros.paper.paper_planner import COEFFICIENTS, PaperPlanner

FOLDER = Path(__file__).parent / "literal_profile"
QUERIES, MOST_OBSTACLES = 200, 10


def answer(
    planner: PaperPlanner, source: int, target: int, centres: np.ndarray, radii: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost, nodes (p,) and control points (c, d) of the spline of one query."""
    search = LiteralSearch(planner.graph.adjacency, planner.weights, planner.settings.strength)
    search.aim(target, search.field(target))
    search.begin(source, centres, radii)
    search.go_on()
    return search.cost, search.nodes, fitted_spline(planner.graph.latent[search.nodes], COEFFICIENTS).c


def record(space: str, planner: PaperPlanner) -> None:
    """Write the queries of a space with their answers."""
    random = np.random.default_rng(24)
    points = planner.weights.body_points.reshape(-1, 3)
    stored: dict[str, list] = {name: [] for name in ("ends", "centres", "radii", "count", "cost", "nodes", "splines")}
    lengths = []
    for query in range(QUERIES):
        ends = random.choice(len(planner.graph.latent), 2, replace=False)
        count = query % (MOST_OBSTACLES + 1)
        centres = points[random.integers(len(points), size=count)] + random.normal(scale=0.03, size=(count, 3))
        radii = random.uniform(0.02, 0.12, size=count)
        cost, nodes, spline = answer(planner, int(ends[0]), int(ends[1]), centres, radii)
        for name, value in zip(stored, (ends, centres, radii, count, cost, nodes, spline), strict=True):
            stored[name].append(value)
        lengths.append((len(nodes), len(spline)))
    joined = ("centres", "radii", "nodes", "splines")
    arrays = {name: np.concatenate(rows) if name in joined else np.array(rows) for name, rows in stored.items()}
    FOLDER.mkdir(exist_ok=True)
    np.savez_compressed(FOLDER / f"{space}.npz", lengths=np.array(lengths), **arrays)


@pytest.mark.parametrize("space", ["task", "joint"])
def test_costs_paths_and_splines_are_those_that_were_recorded(space, planners) -> None:
    planner = planners[space]
    with np.load(FOLDER / f"{space}.npz") as file:
        stored = dict(file)
    obstacles = np.concatenate([[0], np.cumsum(stored["count"])])
    nodes_at, splines_at = np.concatenate([np.zeros((1, 2), int), np.cumsum(stored["lengths"], axis=0)]).T
    assert len(stored["cost"]) == QUERIES
    same = 0
    for query, (source, target) in enumerate(stored["ends"]):
        among = slice(*obstacles[query : query + 2])
        found = answer(planner, int(source), int(target), stored["centres"][among], stored["radii"][among])
        cost, nodes, spline = found
        np.testing.assert_allclose(cost, stored["cost"][query], rtol=1e-9)
        recorded = stored["nodes"][slice(*nodes_at[query : query + 2])]
        # Another path may cost the same to the last digit.
        if np.array_equal(nodes, recorded):
            same += 1
            expected = stored["splines"][slice(*splines_at[query : query + 2])]
            np.testing.assert_allclose(spline, expected, atol=1e-9 * np.abs(expected).max())
    assert same >= 0.98 * QUERIES


if __name__ == "__main__":
    from conftest import CASES, literal_planner

    for name in CASES:
        record(name, literal_planner(name))
