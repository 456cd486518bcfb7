"""FciLink: its process ends with it, whatever that is at."""

from __future__ import annotations

from pathlib import Path

import pytest

from geodesic_motion_ros.hardware.fci_link import FciLink


def children() -> set[str]:
    """Processes that this one has started, by their numbers."""
    return {number for task in Path("/proc/self/task").iterdir() for number in (task / "children").read_text().split()}


def test_a_process_that_has_heard_no_arm_ends_at_once_with_its_link() -> None:
    """It is still loading: it would not hear for a while that nobody needs it."""
    pytest.importorskip("pylibfranka")
    heard: list[object] = []
    before = children()
    link = FciLink("127.0.0.1", "fr3", False, 0, heard.append, heard.append)
    link.start()
    assert children() > before
    link.stop()
    assert children() == before
    assert not heard
