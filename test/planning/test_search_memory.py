"""What an arm without a path tries: everything at first, then little in every tick, and nothing twice as often."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from geodesic_motion_ros.deadline import NEVER
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planning import search_memory
from geodesic_motion_ros.planning.search_memory import SearchMemory
from geodesic_motion_ros.planning.settings import ATTEMPTS, Attempt
from geodesic_motion_ros.verdict import Verdict, VerdictCode

AROUND = tuple(attempt for attempt in ATTEMPTS if attempt.around_moving)
SOLVER = SimpleNamespace(attempts_among=lambda obstacles: AROUND if obstacles.stand else ATTEMPTS)
QUERY = SimpleNamespace()
NO_PATH = Verdict(VerdictCode.NO_FEASIBLE_PATH, "no path")
TICK = 0.01


def situation(now: float, stand: bool = False) -> SimpleNamespace:
    obstacles = Obstacles.none() if stand else SimpleNamespace(stand=False)
    return SimpleNamespace(
        now=now, at_rest=True, followed=SimpleNamespace(is_stop=True, approaching=False), obstacles=obstacles,
        expected=obstacles, deadline=NEVER, late=NEVER,
    )  # fmt: skip


def tried(ticks: int, stand: bool = False) -> list[tuple[Attempt, ...]]:
    """What is tried tick after tick by an arm that has lost its path, and finds none."""
    memory, chosen = SearchMemory(), []
    for tick in range(ticks):
        attempts, memory = memory.chosen_attempts(SOLVER, QUERY, situation(tick * TICK, stand))
        memory = replace(memory, without_path=QUERY, refusal=NO_PATH)
        chosen.append(attempts)
    return chosen


@pytest.fixture
def coming(monkeypatch) -> list[bool]:
    """Whether an evasion path is searched in the next ticks, each in its turn; False after the last."""
    searched: list[bool] = []
    monkeypatch.setattr(search_memory, "is_searched", lambda *_: bool(searched) and searched.pop(0))
    return searched


@pytest.mark.usefixtures("coming")
@pytest.mark.parametrize(("stand", "attempts"), [(False, ATTEMPTS), (True, AROUND)])
def test_an_arm_that_has_lost_its_path_tries_all_at_once_then_one_in_every_tick(
    stand: bool, attempts: tuple[Attempt, ...]
) -> None:
    """Among what stands those that pass before or after what moves differ in nothing from the others."""
    chosen = tried(1 + 2 * len(attempts), stand)
    assert chosen[0] == attempts
    in_turn = [(attempt,) for attempt in (*attempts[1:], attempts[0])]
    assert chosen[1:] == 2 * in_turn


def test_in_a_tick_that_searches_an_evasion_path_none_to_the_goal_is_tried_and_none_left_out(coming) -> None:
    without = tried(6)
    coming += [True, False, False, True]
    chosen = tried(8)
    assert [len(attempts) for attempts in chosen[1:]] == [0, 1, 1, 0, 1, 1, 1]
    assert [attempts for attempts in chosen if attempts][:4] == without[:4]
