from __future__ import annotations

import json
import math

import numpy as np
import pytest

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.geodesics import GRAPHS, Geodesics


@pytest.fixture(scope="module")
def report(fan_skill):
    return Geodesics(pairs=1).measured(fan_skill)


def length(report, method: str) -> float:
    (found,) = [item for item in report.found if item.method == method]
    return found.length


def test_every_method_is_there_between_the_same_ends(report, fan_skill) -> None:
    names = [f"graph {side}x{side}, {neighbours}" for side, neighbours in GRAPHS]
    expected = {"straight line", "gradient, from line", "gradient, from graph"}
    expected |= {name + suffix for name in names for suffix in ("", ", cubic spline", ", smoothed", ", refined")}
    assert set(report.methods) == expected
    for found in report.found:
        np.testing.assert_allclose(found.curve[0], fan_skill.codes[0, 0], atol=1e-9)
        np.testing.assert_allclose(found.curve[-1], fan_skill.codes[1, -1], atol=1e-9)


def test_descent_shortens_what_it_began_from_and_more_neighbours_bend_the_grid_less(report) -> None:
    assert length(report, "gradient, from line") <= length(report, "straight line") * (1.0 + 1e-3)
    assert length(report, "gradient, from graph") <= length(report, "graph 100x100, 16") * (1.0 + 1e-3)
    assert length(report, "graph 100x100, 16") < length(report, "graph 100x100, 8") * 1.02
    assert length(report, "graph 50x50, 8, refined") < length(report, "graph 50x50, 8")
    assert length(report, "graph 100x100, 16") < 1.3 * length(report, "gradient, from graph")


def test_graph_paths_keep_to_the_support(report) -> None:
    for found in report.found:
        if found.method.startswith("graph") and "," not in found.method[12:]:
            assert found.sigma <= 1.2 * report.skill.sigma_limit


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "geodesics.json", report.as_dict()).read_text())
    assert set(content["methods"]) == set(report.methods)
    assert content["methods"]["straight line"]["build_ms"] is None
    assert min(row["worst_over_shortest"] for row in content["methods"].values()) == 1.0
    assert min(row["off_mm"] for row in content["methods"].values()) == 0.0
    assert content["methods"]["straight line"]["off_mm"] > content["methods"]["graph 50x50, 8"]["off_mm"] > 0.0
    assert all(math.isfinite(item["length"]) for item in content["found"])
    assert "graph 50x50, 8" in report.table()
    report.draw(tmp_path / "geodesics.png")
    assert (tmp_path / "geodesics.png").read_bytes().startswith(b"\x89PNG")


def test_no_pairs_are_refused(fan_skill) -> None:
    with pytest.raises(ParameterError, match="at least 1"):
        Geodesics(pairs=0)


def test_ends_that_are_the_same_are_one_pair(canonical_fan_skill) -> None:
    """On a canonical sheet all demonstrations begin in one point and end in another."""
    report = Geodesics(pairs=3).measured(canonical_fan_skill)
    assert {row["pairs"] for row in report.summary().values()} == {1}
