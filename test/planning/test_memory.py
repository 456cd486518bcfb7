"""What an arm without a path tries: everything at first, then little in every tick, and nothing twice as often."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace

from geodesic_motion_ros.contract.settings import ATTEMPTS, Attempt
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.memory import AttemptMemory
from geodesic_motion_ros.utils.deadline import NEVER

CAUTIOUS = tuple(attempt for attempt in ATTEMPTS if not attempt.optimistic)
SOLVER = SimpleNamespace(attempts=ATTEMPTS, cautious_attempts=CAUTIOUS)
QUERY = SimpleNamespace()
NO_PATH = Refusal(VerdictCode.NO_FEASIBLE_PATH, "no path")
TICK = 0.01


def situation(now: float, static: bool = False) -> SimpleNamespace:
    obstacles = Obstacles.none() if static else SimpleNamespace(is_static=False)
    times = {"now": now, "deadline": NEVER, "handover_deadline": NEVER}
    return SimpleNamespace(followed=None, obstacles=obstacles, expected_obstacles=obstacles, **times)


def tried(
    ticks: int, static: bool = False, refusal: Refusal = NO_PATH, shared: Iterable[bool] = ()
) -> list[tuple[Attempt, ...]]:
    """What is tried tick after tick by an arm that has lost its path, and finds none.

    shared : whether another long search is made in the next ticks, each in its turn; False after the last.
    """
    memory, chosen, others = AttemptMemory(), [], iter(shared)
    for tick in range(ticks):
        now = situation(tick * TICK, static)
        attempts, memory = memory.choose_attempts(SOLVER, QUERY, now, lambda _: next(others, False))
        memory = replace(memory, without_path=QUERY, refusal=refusal)
        chosen.append(attempts)
    return chosen


def test_an_arm_that_has_lost_its_path_tries_all_at_once_and_then_one_in_every_tick() -> None:
    chosen = tried(1 + 2 * len(ATTEMPTS))
    assert chosen[0] == ATTEMPTS
    assert chosen[1:] == [(attempt,) for attempt in 2 * ATTEMPTS]


def test_optimistic_attempts_are_made_among_what_moves_alone_and_not_where_the_arm_is_inside_an_obstacle() -> None:
    inside = Refusal(VerdictCode.IN_COLLISION, "inside")
    for chosen in (tried(20, static=True), tried(20, refusal=inside)):
        assert not any(attempts[0].optimistic for attempts in chosen[1:])


def test_in_a_tick_with_another_long_search_no_path_to_the_goal_is_tried_and_none_is_left_out() -> None:
    without = tried(6)
    chosen = tried(8, shared=[True, False, False, True])
    assert [len(attempts) for attempts in chosen[1:]] == [0, 1, 1, 0, 1, 1, 1]
    assert [attempts for attempts in chosen if attempts][:4] == without[:4]
