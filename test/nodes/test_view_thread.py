"""When the view thread draws: for a new subscriber, and never for nobody."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator

import pytest

from geodesic_motion_ros.nodes.view_thread import ViewThread

PATIENCE = 30.0


class Onlooker:
    """Says whether somebody looks, and knows how often it was asked since that changed."""

    def __init__(self) -> None:
        self._looks, self._asked = False, threading.Semaphore(0)

    def __call__(self) -> bool:
        looks = self._looks
        self._asked.release()
        return looks

    def look(self, looks: bool) -> None:
        """Begin or cease to look, and wait until that has been seen: the first question may be of before."""
        self._looks = looks
        while self._asked.acquire(blocking=False):
            pass
        for _ in range(2):
            assert self._asked.acquire(timeout=PATIENCE)


@pytest.fixture
def drawn() -> queue.Queue[str]:
    return queue.Queue()


@pytest.fixture
def onlooker() -> Onlooker:
    return Onlooker()


@pytest.fixture
def seldom(drawn, onlooker) -> Iterator[ViewThread]:
    """One that draws every day."""
    thread = ViewThread(lambda: drawn.put("picture"), onlooker, 86400.0, lambda error: drawn.put(repr(error)))
    thread.start()
    yield thread
    thread.stop()


def test_a_new_subscriber_is_drawn_a_fresh_picture_at_once(seldom, drawn, onlooker) -> None:
    onlooker.look(True)
    assert drawn.get(timeout=PATIENCE) == "picture"
    onlooker.look(False)
    assert drawn.empty()
    onlooker.look(True)
    assert drawn.get(timeout=PATIENCE) == "picture"


def test_nothing_is_drawn_for_nobody(seldom, drawn, onlooker) -> None:
    onlooker.look(False)
    assert drawn.empty()


def test_a_lasting_subscriber_is_drawn_one_picture_after_the_other(drawn) -> None:
    thread = ViewThread(lambda: drawn.put("picture"), lambda: True, 0.01, lambda error: drawn.put(repr(error)))
    thread.start()
    assert [drawn.get(timeout=PATIENCE) for _ in range(3)] == ["picture"] * 3
    thread.stop()


def test_an_error_is_reported_once_and_ends_it(drawn) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    thread = ViewThread(fail, lambda: True, 0.01, lambda error: drawn.put(type(error).__name__))
    before = set(threading.enumerate())
    thread.start()
    assert drawn.get(timeout=PATIENCE) == "ZeroDivisionError"
    for begun in set(threading.enumerate()) - before:
        begun.join(PATIENCE)
    assert set(threading.enumerate()) <= before
    assert drawn.empty()
