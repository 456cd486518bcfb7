"""FciLink: its process ends with it."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from geodesic_motion_ros.hardware import fci_link
from geodesic_motion_ros.hardware.fci_link import FciLink


def children() -> set[str]:
    """Processes that this one has started, by their numbers."""
    return {number for task in Path("/proc/self/task").iterdir() for number in (task / "children").read_text().split()}


def test_a_process_that_hangs_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is stopped, and so hears nothing: one that compiles kernels hears nothing either."""
    pytest.importorskip("pylibfranka")
    monkeypatch.setattr(fci_link, "_REST", 0.5)
    heard: list[object] = []
    before = children()
    link = FciLink("127.0.0.1", "fr3", False, 0, heard.append, heard.append)
    link.start()
    (process,) = children() - before
    os.kill(int(process), signal.SIGSTOP)
    link.stop()
    assert children() == before
    assert not heard
