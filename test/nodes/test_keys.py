"""Keys are handed out as they are pressed, and the terminal is left as it was."""

from __future__ import annotations

import os
import pty
import select
import termios
from collections.abc import Iterator

import pytest

from geodesic_motion_ros.nodes.keys import Keys


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """Descriptors of the side of the keyboard and of the program."""
    both = pty.openpty()
    yield both
    for descriptor in both:
        os.close(descriptor)


def test_keys_come_without_enter_and_nothing_is_waited_for(terminal: tuple[int, int]) -> None:
    keyboard, ours = terminal
    keys = Keys(ours)
    assert keys
    assert keys.read() == ""
    os.write(keyboard, b" d")
    select.select([ours], [], [], 10.0)
    assert keys.read() == " d"
    assert keys.read() == ""


def test_the_terminal_is_left_as_it_was(terminal: tuple[int, int]) -> None:
    before = termios.tcgetattr(terminal[1])
    keys = Keys(terminal[1])
    assert termios.tcgetattr(terminal[1]) != before
    # Ctrl-C stays a signal
    assert termios.tcgetattr(terminal[1])[3] & termios.ISIG
    keys.close()
    keys.close()
    assert termios.tcgetattr(terminal[1]) == before
    assert not keys


def test_what_is_no_terminal_has_no_keys() -> None:
    reading, writing = os.pipe()
    os.write(writing, b"q")
    keys = Keys(reading)
    assert not keys
    assert keys.read() == ""
    keys.close()
    assert os.read(reading, 1) == b"q"
    os.close(reading)
    os.close(writing)
