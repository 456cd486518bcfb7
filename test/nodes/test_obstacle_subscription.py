"""Every publisher of an obstacle topic is received, whatever it offers, and every message once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.obstacle_subscription import ObstacleSubscription

PATIENCE = 30.0
RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LATCHED = DurabilityPolicy.TRANSIENT_LOCAL


class Topic:
    """A node that subscribes, one that publishes, and the identities of the markers received so far."""

    def __init__(self, context: Any) -> None:
        self.listener, self.talker = (rclpy.create_node(name, context=context) for name in ("listener", "talker"))
        self.received: list[int] = []
        # Of those that were latched, by how many publishers it may have been; and the publishers that have ended.
        self.latched: list[tuple[int, int]] = []
        self.ended: list[str] = []
        self._executor = EventsExecutor(context=context)
        self._executor.add_node(self.listener)

    def subscribe(self, reliability: ReliabilityPolicy = RELIABLE) -> ObstacleSubscription:
        def take(marker: Marker) -> int:
            self.received.append(marker.id)
            return marker.id

        return ObstacleSubscription(
            self.listener, Marker, "marker", take, 50, reliability,
            take_latched=lambda number, publishers: self.latched.append((number, len(publishers))),
            take_end=self.ended.append,
        )  # fmt: skip

    def publisher(self, reliability: ReliabilityPolicy = RELIABLE, **policies: Any) -> Any:
        return self.talker.create_publisher(Marker, "marker", QoSProfile(depth=50, reliability=reliability, **policies))

    def wait(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, self.received
            self._executor.spin_once(timeout_sec=0.02)

    def close(self) -> None:
        self._executor.shutdown()
        self.listener.destroy_node()
        self.talker.destroy_node()


@pytest.fixture
def topic() -> Iterator[Topic]:
    context = rclpy.Context()
    rclpy.init(context=context)
    topic = Topic(context)
    yield topic
    topic.close()
    rclpy.try_shutdown(context=context)


def test_what_a_latched_publisher_sent_before_is_received_and_what_it_sends_then_once(topic):
    latched = topic.publisher(durability=LATCHED)
    for number in range(3):
        latched.publish(Marker(id=number))
    topic.subscribe()
    topic.wait(lambda: len(topic.received) >= 3)
    # Both of its subscriptions are there.
    topic.wait(lambda: latched.get_subscription_count() == 2)
    for number in range(3, 20):
        latched.publish(Marker(id=number))
    topic.wait(lambda: 19 in topic.received)
    latched.publish(Marker(id=20))
    topic.wait(lambda: 20 in topic.received)
    assert topic.received == list(range(21))


def test_what_was_latched_is_known_and_when_its_publisher_has_ended(topic):
    """Whether it was sent before the subscription or after, and whatever else is published."""
    before = topic.publisher(durability=LATCHED)
    before.publish(Marker(id=1))
    subscription = topic.subscribe()
    topic.wait(lambda: topic.latched == [(1, 1)])
    other = topic.publisher()
    topic.wait(lambda: before.get_subscription_count() == 2 and other.get_subscription_count() == 1)
    before.publish(Marker(id=2))
    other.publish(Marker(id=3))
    topic.wait(lambda: (2, 1) in topic.latched and 3 in topic.received)
    assert subscription.publishers == ("/talker",)
    assert not topic.ended
    topic.talker.destroy_publisher(before)

    def ended() -> bool:
        # The graph may know of it after the subscriptions do.
        subscription.look_for_latching()
        return bool(topic.ended)

    topic.wait(ended)
    assert topic.received == [1, 2, 3]
    assert topic.latched == [(1, 1), (2, 1)]


def test_the_same_message_sent_again_counts_again(topic):
    topic.subscribe()
    latched = topic.publisher(durability=LATCHED)
    topic.wait(lambda: latched.get_subscription_count() == 2)
    for _ in range(5):
        latched.publish(Marker(id=7))
    topic.wait(lambda: len(topic.received) >= 5)
    latched.publish(Marker(id=8))
    topic.wait(lambda: 8 in topic.received)
    assert topic.received == [7, 7, 7, 7, 7, 8]


def test_a_best_effort_publisher_is_received_beside_reliable_ones(topic):
    topic.subscribe()
    reliable, best_effort = topic.publisher(), topic.publisher(BEST_EFFORT)
    topic.wait(lambda: best_effort.get_subscription_count() == 1 and reliable.get_subscription_count() == 2)
    sent = []

    def arrives() -> bool:
        # One that was lost in transit is sent under another number.
        if not set(sent) & set(topic.received):
            sent.append(100 + len(sent))
            best_effort.publish(Marker(id=sent[-1]))
        return bool(set(sent) & set(topic.received))

    topic.wait(arrives)
    for number in range(20):
        reliable.publish(Marker(id=number))
    topic.wait(lambda: 19 in topic.received)
    assert [number for number in topic.received if number < 100] == list(range(20))


def test_a_reliable_burst_arrives_whole_and_in_order(topic):
    topic.subscribe()
    publisher = topic.publisher()
    topic.wait(lambda: publisher.get_subscription_count() == 1)
    for number in range(50):
        publisher.publish(Marker(id=number))
    topic.wait(lambda: len(topic.received) == 50)
    assert topic.received == list(range(50))


def test_publishers_of_another_type_are_named(topic: Topic) -> None:
    """In a process of their own, as it were: a participant has one type for a topic."""
    subscription = topic.subscribe()
    topic.publisher()
    context = rclpy.Context()
    rclpy.init(context=context)
    stranger = rclpy.create_node("stranger", context=context)
    stranger.create_publisher(MarkerArray, "marker", 1)
    said = "/stranger publishes visualization_msgs/msg/MarkerArray, expected is visualization_msgs/msg/Marker"
    topic.wait(lambda: subscription.other_types() == [said])
    stranger.destroy_node()
    rclpy.try_shutdown(context=context)
    topic.wait(lambda: not subscription.other_types())
