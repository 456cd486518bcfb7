"""Three pairs shown, small: poses of the tool are learned, pairs planned, the bottle kept clear, all cups poured."""

from __future__ import annotations

import json

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.held_bottle import bottle_settings
from geodesic_motion_ros.experiments.pouring_chain import pour_all_cups
from geodesic_motion_ros.experiments.pouring_stream import past_a_moving_sphere
from geodesic_motion_ros.experiments.pouring_task import (
    PouringTaskReport,
    PouringTaskSettings,
    all_pairs,
    blocked_pairs,
    draw_pouring_task,
)
from geodesic_motion_ros.manifold.training import TrainingSettings, train_task_space_skill
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.simulation.joint_teacher import pouring_guidances
from geodesic_motion_ros.tables import write_json

SMALL = TrainingSettings(
    steps=900, batch=128, learning_rate=6e-3, hidden=(64, 32), samples=60, kernels=100, precision_samples=2,
    precision_iterations=40, sheet="raw",
)  # fmt: skip


@pytest.fixture(scope="module")
def shown() -> Demonstrations:
    """Three of each pair, as told to the arm, without physics."""
    told = [guidance.motion for guidance in pouring_guidances(3, 0)]
    return Demonstrations(
        tuple(Demonstration(each.positions, each.quaternions, each.times, each.name) for each in told)
    )


@pytest.fixture(scope="module")
def report(shown: Demonstrations) -> PouringTaskReport:
    skill = train_task_space_skill(shown, SMALL, name="pouring")
    planner = ReactivePlanner(skill, bottle_settings())
    return PouringTaskReport(
        PouringTaskSettings(3, (0,)),
        tuple(all_pairs(planner, shown, "raw", 0)),
        tuple(blocked_pairs(planner, ReactivePlanner(skill), "raw", 0, (0,))),
        (pour_all_cups(planner, 0),),
        past_a_moving_sphere(planner),
        shown,
        skill,
    )


def test_all_nine_pairs_are_reached_along_what_was_shown(report: PouringTaskReport) -> None:
    assert [(item.bottle, item.cup) for item in report.pairs] == [(b, c) for b in range(3) for c in range(3)]
    assert all(item.reference is not None for item in report.pairs)
    assert max(item.off for item in report.pairs) < 0.1


def test_a_known_bottle_is_kept_clear_and_an_unknown_one_hits(report: PouringTaskReport) -> None:
    known = [item.with_bottle for item in report.blocked if np.isfinite(item.with_bottle)]
    assert known
    assert min(known) > 0.0
    hand_alone = [item.hand_alone for item in report.blocked if np.isfinite(item.hand_alone)]
    assert len(hand_alone) == 9
    assert max(hand_alone) < 0.0


def test_the_chain_pours_every_cup(report: PouringTaskReport) -> None:
    (chain,) = report.chains
    assert chain.reason == ""
    assert len(chain.parts) == len(chain.mouth_off) == 3
    assert max(chain.mouth_off) < 1e-3
    assert chain.behind < 0.005
    assert chain.clearance > 0.0
    for before, after in zip(chain.parts, chain.parts[1:], strict=False):
        np.testing.assert_allclose(before.positions[-1], after.positions[0], atol=1e-6)


def test_a_moving_sphere_is_passed_that_the_way_without_it_meets(report: PouringTaskReport) -> None:
    stream = report.stream
    assert stream.reached
    assert stream.unaware < 0.0 < stream.clearance
    early, late = stream.moments
    assert early.time < late.time
    assert len(early.gone) < len(late.gone)


def test_what_is_handed_over_is_complete(report: PouringTaskReport, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert [len(content[part]) for part in ("pairs", "blocked", "chains")] == [9, 9, 1]
    assert content["moving"]["reached"] is True
    assert "9 of 9" in report.table()
    draw_pouring_task(report, tmp_path / "pouring_task.png")
    assert (tmp_path / "pouring_task.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("wrong", [{"shown": 0}, {"seeds": ()}])
def test_impossible_settings_are_refused(wrong) -> None:
    with pytest.raises(ParameterError):
        PouringTaskSettings(**wrong)
