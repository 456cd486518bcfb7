"""What a relay passes on, and when; the node and the time are the test's own."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import UInt32

from geodesic_motion_studies.faults import relay as module
from geodesic_motion_studies.faults.relay import Relay


class Line:
    """A relay between `say` and `heard`, at a time [s] that passes by `wait`."""

    def __init__(self) -> None:
        self.now, self.heard = 10.0, []
        self.relay = Relay(self, UInt32, "from", "to")

    def create_publisher(self, *_) -> SimpleNamespace:
        return SimpleNamespace(publish=self._pass)

    def create_subscription(self, kind, topic, take, qos, raw) -> None:
        self._take = take

    def create_timer(self, every, look) -> None:
        self._look = look

    def monotonic(self) -> float:
        return self.now

    def _pass(self, message: bytes) -> None:
        self.heard.append(deserialize_message(message, UInt32).data)

    def say(self, *numbers: int) -> None:
        for number in numbers:
            self._take(serialize_message(UInt32(data=number)))

    def wait(self, duration: float) -> None:
        self.now += duration
        self._look()


@pytest.fixture
def line(monkeypatch) -> Line:
    line = Line()
    monkeypatch.setattr(module, "time", line)
    return line


def test_it_passes_on_what_it_hears_and_knows_when(line) -> None:
    line.say(1, 2)
    assert line.heard == [1, 2]
    assert line.relay.last_passed == 10.0


def test_stopped_it_passes_nothing_until_it_is_released(line) -> None:
    line.relay.passing = False
    line.say(1)
    line.relay.release()
    line.say(2)
    assert line.heard == [2]


def test_changed_messages_pass_in_the_place_of_others(line) -> None:
    line.relay.change = lambda message: [] if message.data == 1 else [message, UInt32(data=10 * message.data)]
    line.say(1, 2)
    assert line.heard == [2, 20]


def test_late_messages_keep_their_order(line) -> None:
    delays = iter((0.05, 0.01))
    line.relay.delay = lambda: next(delays)
    line.say(1, 2)
    line.wait(0.02)
    assert line.heard == []
    line.wait(0.04)
    assert line.heard == [1, 2]


def test_late_messages_overtake_each_other_where_they_may(line) -> None:
    delays = iter((0.05, 0.01))
    line.relay.delay, line.relay.overtaking = lambda: next(delays), True
    line.say(1, 2)
    line.wait(0.02)
    line.wait(0.04)
    assert line.heard == [2, 1]


def test_what_was_late_when_it_is_released_is_lost(line) -> None:
    line.relay.delay = lambda: 0.05
    line.say(1)
    line.relay.release()
    line.wait(0.1)
    assert line.heard == []
