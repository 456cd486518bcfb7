"""Rates and reactions are measured on the two real nodes, and impossible measurements are refused."""

from __future__ import annotations

import os
from dataclasses import asdict

import pytest

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.rates import chunk_time, node_rate, reaction_time


@pytest.mark.realtime
def test_every_stretch_is_measured_and_goals_and_spheres_really_move(tmp_path):
    domain = int(os.environ["ROS_DOMAIN_ID"])
    rows = node_rate.measure_rates("panda_pouring", tmp_path, (50.0,), seconds=2.5, obstacles=3, domain=domain)
    stays, moves, sphere, cloud = rows
    assert (stays.goals, sphere.goals, cloud.goals) == (1, 1, 1)
    assert moves.goals >= 20
    for row in rows:
        assert 0.0 < row.rate < 60.0
        assert 0.0 < row.tick_p50 <= row.tick_p99
    # Beside the path obstacles are felt and block nothing; a sphere that goes through the middle of it does. A busy
    # machine may keep the twin from telling where the arm is, and says so.
    for row in stays, cloud:
        assert set(row.verdicts) <= {"OK", "STALE_STATE"}
        assert row.verdicts["OK"] > 0.8 * sum(row.verdicts.values())
    assert set(sphere.verdicts) - {"OK", "STALE_STATE"}
    assert stays.name in node_rate.table(rows)
    assert asdict(stays)["verdicts"] == stays.verdicts


@pytest.mark.realtime
def test_the_papers_planner_moves_a_twin_in_both_spaces(tmp_path):
    rows = node_rate.measure_paper(tmp_path, 50.0, seconds=2.0, domain=int(os.environ["ROS_DOMAIN_ID"]))
    assert [row.name.split(":")[0] for row in rows] == ["paper_pouring"] * 2 + ["paper_reach"] * 2
    for row in rows:
        assert 0.0 < row.rate < 60.0
        assert set(row.verdicts) <= {"OK", "STALE_STATE"}
        assert row.verdicts["OK"] > 0.8 * sum(row.verdicts.values())
        assert 0.0 < row.exact_percent <= 100.0


@pytest.mark.realtime
def test_answers_to_spheres_are_timed(tmp_path):
    domain = int(os.environ["ROS_DOMAIN_ID"])
    (row,) = reaction_time.measure_reaction("panda_reach_to_grasp", tmp_path, spheres=3, domain=domain)
    assert row.spheres == 3
    assert 0 < row.answered <= 3
    assert 0.0 < row.p50 <= row.p99 <= row.worst < 1e3 * reaction_time.SHOWN
    assert f"{row.p50:.1f}" in reaction_time.table([row])


@pytest.mark.parametrize("wrong", [{"seconds": 0.0}, {"goals_hz": -1.0}, {"obstacles": -1}, {"rates": ()}])
def test_impossible_measurements_are_refused(tmp_path, wrong):
    with pytest.raises(ParameterError, match="must be positive"):
        node_rate.measure_rates("panda_pouring", tmp_path, **wrong)


@pytest.mark.parametrize("wrong", [{"spheres": 0}, {"rates": (0.0,)}])
def test_impossible_timings_are_refused(tmp_path, wrong):
    with pytest.raises(ParameterError, match="must be positive"):
        reaction_time.measure_reaction("panda_reach_to_grasp", tmp_path, **wrong)


def test_reactions_of_a_skill_that_streams_poses_are_not_timed(tmp_path):
    with pytest.raises(ParameterError, match="skill of joint space"):
        reaction_time.measure_reaction("panda_pouring", tmp_path)


@pytest.mark.realtime
def test_chunks_are_answered_by_the_filter_and_by_a_node_that_forwards_them(tmp_path):
    rows = chunk_time.measure_chunks(tmp_path, hertz=20.0, chunks=20, domain=int(os.environ["ROS_DOMAIN_ID"]))
    assert [row.name for row in rows] == ["filter", "forwards"]
    for row in rows:
        assert 0 < row.answered <= row.chunks == 20
        assert 0.0 < row.p50 <= row.p99 <= row.worst
        assert row.name in chunk_time.table(rows)


@pytest.mark.parametrize(("hertz", "chunks"), [(0.0, 20), (50.0, 0)])
def test_chunks_that_cannot_be_measured_are_refused(tmp_path, hertz, chunks):
    with pytest.raises(ParameterError, match="must be positive"):
        chunk_time.measure_chunks(tmp_path, hertz, chunks)
