"""Goals that are prepared beside the loop: none is lost but to a newer one, and nothing queues up."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from geodesic_motion_ros.nodes.preparation import Preparation


@pytest.fixture
def background() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


def test_without_a_background_a_goal_is_settled_where_it_is_asked_for():
    goals = Preparation(None)
    assert goals.take_settled() is None
    goals.ask(lambda: "goal")
    assert goals.take_settled() == "goal"
    assert goals.take_settled() is None


def test_goals_that_come_faster_than_they_are_prepared_are_taken_all_the_same(background):
    goals, asked, taken = Preparation(background), [], []
    for number in range(20):
        go_on = threading.Event()

        def prepare(number: int = number, go_on: threading.Event = go_on) -> int:
            asked.append(number)
            go_on.wait()
            return number

        goals.ask(prepare)
        settled = goals.take_settled()
        if settled is not None:
            taken.append(settled)
        if number == 0:
            first = go_on
        if number == 10:
            # All between the one that is being prepared and the newest are left out.
            first.set()
            background.submit(lambda: None).result()
        if number > 10:
            go_on.set()
    background.submit(lambda: None).result()
    taken.append(goals.take_settled())
    assert taken[0] == 0
    assert asked[:2] == [0, 11]
    assert len(asked) <= 20 - 9
    while taken[-1] != 19:
        background.submit(lambda: None).result()
        newest = goals.take_settled()
        assert newest is not None
        taken.append(newest)


def test_what_is_forgotten_is_never_settled(background):
    goals, go_on = Preparation(background), threading.Event()
    goals.ask(lambda: go_on.wait() and "old")
    assert goals.take_settled() is None
    goals.forget()
    go_on.set()
    background.submit(lambda: None).result()
    assert goals.take_settled() is None
    goals.ask(lambda: "new")
    goals.take_settled()
    background.submit(lambda: None).result()
    assert goals.take_settled() == "new"


def test_what_a_preparation_raises_reaches_the_loop_once(background):
    def fail() -> str:
        raise ValueError("no goal")

    goals = Preparation(background)
    goals.ask(fail)
    goals.take_settled()
    background.submit(lambda: None).result()
    with pytest.raises(ValueError, match="no goal"):
        goals.take_settled()
    assert goals.take_settled() is None
