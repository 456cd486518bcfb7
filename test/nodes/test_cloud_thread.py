"""Clouds beside the control loop: the newest wins, none waits behind another, a fault is reported and forgotten."""

from __future__ import annotations

import threading

import pytest

from geodesic_motion_ros.nodes.cloud_thread import CloudThread

PATIENCE = 5.0


class Work:
    """What is done with messages: each waits to be let go."""

    def __init__(self) -> None:
        self.begun, self.allowed, self.taken = threading.Semaphore(0), threading.Semaphore(0), threading.Semaphore(0)
        self.made: list[object] = []
        self.errors: list[BaseException] = []

    def make(self, message: object) -> object:
        self.begun.release()
        assert self.allowed.acquire(timeout=PATIENCE)
        if isinstance(message, Exception):
            raise message
        return message

    def take(self, made: object, arrived: float) -> None:
        self.made.append(made)
        self.taken.release()

    def failed(self, error: BaseException) -> None:
        self.errors.append(error)


@pytest.fixture
def work():
    return Work()


@pytest.fixture
def thread(work):
    thread = CloudThread(work.make, work.take, work.failed)
    thread.start()
    yield thread
    thread.stop()


def test_the_newest_wins_and_none_waits_behind_another(work, thread):
    thread.put("first")
    assert work.begun.acquire(timeout=PATIENCE)
    for message in ("second", "third", "fourth"):
        thread.put(message)
    for _ in range(2):
        work.allowed.release()
        assert work.taken.acquire(timeout=PATIENCE)
    assert work.made == ["first", "fourth"]


def test_what_is_forgotten_is_not_taken(work, thread):
    thread.put("worked on")
    assert work.begun.acquire(timeout=PATIENCE)
    thread.put("waiting")
    thread.forget()
    work.allowed.release()
    thread.put("new")
    work.allowed.release()
    assert work.taken.acquire(timeout=PATIENCE)
    assert work.made == ["new"]


def test_a_refused_message_and_a_fault_change_nothing(work, thread):
    fault = ValueError("no")
    for message in (None, fault, "good"):
        thread.put(message)
        assert work.begun.acquire(timeout=PATIENCE)
        work.allowed.release()
        if message is fault:
            thread.put("never mind")
            assert work.begun.acquire(timeout=PATIENCE)
            work.allowed.release()
    for _ in range(2):
        assert work.taken.acquire(timeout=PATIENCE)
    assert work.made == ["never mind", "good"]
    assert work.errors == [fault]


def test_a_thread_stops_whether_or_not_it_began(work):
    CloudThread(work.make, work.take, work.failed).stop()
    thread = CloudThread(work.make, work.take, work.failed)
    thread.start()
    thread.stop()
    thread.put("late")
    assert not work.begun.acquire(timeout=0.05)
