"""A service answered beside the executor: by the node's executor and rclpy's own, while it ends, and where it fails."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from geodesic_motion_ros.nodes.background_service import BackgroundService

#: Far more than anything takes [s].
PATIENCE = 60.0


@pytest.fixture
def context() -> Iterator[rclpy.Context]:
    context = rclpy.Context()
    rclpy.init(context=context)
    yield context
    rclpy.try_shutdown(context=context)


class Asked:
    """A node with the service, spun by one executor, and one that asks, by another."""

    def __init__(self, context: rclpy.Context, kind: type[Executor], answer, **options: bool) -> None:
        self.node, self.asking = (rclpy.create_node(name, context=context) for name in ("answering", "asking"))
        self.service = BackgroundService(self.node, Trigger, "slow", answer, **options)
        self.executor, self._other = kind(context=context), SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self._other.add_node(self.asking)
        self._client = self.asking.create_client(Trigger, "slow", qos_profile=QoSProfile(depth=1000))
        assert self._client.wait_for_service(PATIENCE)

    def ask(self) -> rclpy.Future:
        return self._client.call_async(Trigger.Request())

    def turn(self) -> None:
        self.executor.spin_once(timeout_sec=0.01)
        self._other.spin_once(timeout_sec=0.0)

    def turn_until(self, condition) -> None:
        since = self.node.get_clock().now()
        while not condition():
            self.turn()
            assert (self.node.get_clock().now() - since).nanoseconds < PATIENCE * 1e9, "waited too long"

    def close(self) -> None:
        self.service.stop()
        for executor, node in ((self.executor, self.node), (self._other, self.asking)):
            executor.shutdown()
            node.destroy_node()


@pytest.mark.parametrize("kind", [EventsExecutor, SingleThreadedExecutor])
def test_timers_go_on_while_answers_are_worked_out_and_all_arrive(context, kind) -> None:
    release, ticks = threading.Event(), []

    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert release.wait(PATIENCE)
        response.success = True
        return response

    asked = Asked(context, kind, answer)
    asked.node.create_timer(0.001, lambda: ticks.append(0))
    futures = [asked.ask() for _ in range(3)]
    asked.turn_until(lambda: len(ticks) > 20)
    assert not any(future.done() for future in futures)
    release.set()
    asked.turn_until(lambda: all(future.done() for future in futures))
    assert all(future.result().success for future in futures)
    asked.close()


@pytest.mark.parametrize("at_once", [True, False])
def test_of_a_flood_each_request_is_answered_in_its_turn(context, at_once) -> None:
    done = []

    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        done.append(len(done))
        response.message = str(done[-1])
        return response

    asked = Asked(context, EventsExecutor, answer, at_once=at_once)
    futures = [asked.ask() for _ in range(200)]
    if at_once:
        # what was requested is done long before the last answer
        asked.turn_until(lambda: len(done) == 200)
        assert not futures[-1].done()
    asked.turn_until(lambda: all(future.done() for future in futures))
    assert [future.result().message for future in futures] == [str(number) for number in range(200)]
    asked.close()


def test_an_error_is_logged_and_answered_with_an_empty_response(context) -> None:
    def fail(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        raise ZeroDivisionError

    asked = Asked(context, EventsExecutor, fail)
    for _ in range(2):
        future = asked.ask()
        asked.turn_until(future.done)
        assert not future.result().success
    asked.close()


def test_requests_while_it_stops_are_not_answered_and_leave_no_thread(context) -> None:
    began, release = threading.Event(), threading.Event()

    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        began.set()
        assert release.wait(PATIENCE)
        return response

    threads = threading.active_count()
    asked = Asked(context, EventsExecutor, answer)
    first, second = asked.ask(), asked.ask()
    asked.turn_until(began.is_set)
    asked.turn()
    threading.Timer(0.05, release.set).start()
    asked.service.stop()
    third = asked.ask()
    asked.turn_until(first.done)
    for _ in range(20):
        asked.turn()
    assert not second.done()
    assert not third.done()
    asked.close()
    assert threading.active_count() <= threads
