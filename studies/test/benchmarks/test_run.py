"""One small run from end to end: what it writes, what it prints, what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.benchmarks import run
from geodesic_motion_studies.benchmarks.peers import installed
from geodesic_motion_studies.benchmarks.report import BenchReport
from geodesic_motion_studies.benchmarks.run import BenchSettings, measure, measured_alone
from geodesic_motion_studies.benchmarks.scenes import NAMES

TINY = BenchSettings(
    shape=(8, 8, 8), skill_shape=(24, 24, 24), ticks=6, peer_ticks=2, scaling_ticks=2, grids=((8, 8), (8, 8, 8)),
    obstacles=(0, 3), points=(2,), points_shape=(6, 6, 6), pairs=2,
)  # fmt: skip
PERCENTILES = {"p50", "p99", "max"}


@pytest.fixture(scope="module")
def report() -> BenchReport:
    """As the command makes it, from a process of its own."""
    return measured_alone(Skill.load("panda_reach_to_grasp"), TINY)


@pytest.fixture(scope="module")
def content(report: BenchReport, tmp_path_factory: pytest.TempPathFactory) -> dict:
    path = tmp_path_factory.mktemp("bench") / "bench.json"
    write_json(path, report.as_dict())
    return json.loads(path.read_text())


@pytest.mark.parametrize("of_skill", [False, True], ids=["synthetic", "skill"])
def test_every_scene_has_its_figures(of_skill: bool, content: dict) -> None:
    scenes = content["skill"]["scenes"] if of_skill else content["scenes"]
    assert tuple(scenes) == NAMES
    for figures in scenes.values():
        assert set(figures["tick_ms"]) == set(figures["cpu_ms"]) == PERCENTILES
        assert 0.0 < figures["tick_ms"]["p50"] <= figures["tick_ms"]["p99"] <= figures["tick_ms"]["max"]
        in_time, refused = figures["deadline"]["in_time"], figures["deadline"]["refused"]
        assert 0.0 <= in_time <= 1.0
        assert refused == pytest.approx(figures["no_path"])
        assert figures["deadline"]["undecided"] == pytest.approx(0.0)
        assert figures["deadline"]["gap_max"] == (None if refused == 1.0 else 0.0)
        assert figures["expanded_p50"] > 0
        assert figures["ticks"] == TINY.ticks
        assert set(figures["peers"]) == {"exact", "A*", "dijkstra", *(peer.module for peer in installed()[0])}
        for name, peer in figures["peers"].items():
            assert peer["tick_ms_p50"] >= peer["search_ms_p50"] > 0.0
            assert peer["ratio"] > 0.0
            assert peer["ticks"] == (TINY.networkx_ticks if name == "networkx" else TINY.peer_ticks)


@pytest.mark.parametrize("of_skill", [False, True], ids=["synthetic", "skill"])
def test_the_cost_is_scipys_in_every_scene(of_skill: bool, content: dict) -> None:
    scenes = content["skill"]["scenes"] if of_skill else content["scenes"]
    assert max(figures["cost_error_max"] for figures in scenes.values()) < 1e-9
    assert min(figures["no_path"] for figures in scenes.values()) == 0.0


def test_a_wrong_cost_shows() -> None:
    assert run.difference(1.1, 1.0) == pytest.approx(0.1)
    assert run.difference(float("inf"), 1.0) == run.difference(1.0, float("inf")) == float("inf")
    assert run.difference(float("inf"), float("inf")) == 0.0


def test_stages_and_scaling_have_rows_of_their_own(content: dict) -> None:
    stages = {"mark", "search", "refine", "curve", "time law", "certificate", "tick", "kinematics"}
    assert stages <= set(content["stages"])
    for stage in content["stages"].values():
        assert set(stage["ms"]) == set(stage["cpu_ms"]) == PERCENTILES
        assert stage["runs"] == TINY.ticks
    rows = content["scaling"]
    assert {name: [row["value"] for row in rows[name]] for name in rows} == {
        "grid": ["8x8", "8x8x8"], "obstacles": ["0", "3"], "body points": ["2"],
    }  # fmt: skip
    assert [row["nodes"] for row in rows["grid"]] == [64, 512]
    assert rows["obstacles"][1]["spheres"] == 3


def test_no_path_is_shorter_than_the_best_known_geodesic_and_refined_ones_come_nearer(content: dict) -> None:
    assert set(content["bias"]) == {"panda_reach_to_grasp", "8x8x8"}
    for row in content["bias"].values():
        over = row["over_best_known"]
        assert row["pairs"] == TINY.pairs
        assert all(1.0 - 1e-9 <= over[curve]["p50"] <= over[curve]["max"] for curve in ("graph", "smoothed", "refined"))
        assert over["refined"]["p50"] < over["graph"]["p50"]
        assert set(row["refine_cpu_ms"]) == PERCENTILES


def test_tables_fit_a_terminal(report: BenchReport) -> None:
    lines = report.table().splitlines()
    assert max(map(len, lines)) <= 120
    assert all(any(line.startswith(name) for line in lines) for name in (*NAMES, "certificate", "body points"))


def test_what_was_left_out_is_said(report: BenchReport) -> None:
    last = replace(report, missing=["igraph", "networkit"]).table().splitlines()[-1]
    assert last.startswith("not installed: igraph, networkit")


def test_a_table_with_every_peer_fits_a_terminal(report: BenchReport) -> None:
    scenes = {}
    for name, figures in report.synthetic.scenes.items():
        slow = replace(figures.peers["scipy"], cpu=[1e3 * value for value in figures.peers["scipy"].cpu])
        peers = {**figures.peers, "igraph": slow, "networkit": slow, "networkx": slow}
        scenes[name] = replace(figures, wall=[0.0123, 0.1234], looked=[123_456], peers=peers)
    table = replace(report.synthetic, name="50x50x50", nodes=125_000, edges=1_500_000, scenes=scenes).table()
    assert max(map(len, table.splitlines())) <= 120


def test_a_skill_of_poses_is_refused() -> None:
    with pytest.raises(ParameterError, match="joint-space skill"):
        measure(Skill.load("panda_pouring"), TINY, show_progress=False)
