"""The driver says in one line why it cannot start."""

from __future__ import annotations

import sys

import pytest

from geodesic_motion_ros.hardware.fci_link import FciLink
from geodesic_motion_ros.utils.errors import RobotError


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({}, "parameter address is empty: give the address of the arm"),
        ({"address": "127.0.0.1", "robot": "ur5"}, "parameter robot = 'ur5' has 6 joints: a Franka has 7"),
        ({"address": "127.0.0.1", "use_sim_time": "true"}, "use_sim_time does not fit an arm, whose time is real"),
    ],
)
def test_what_does_not_fit_is_named(bench, parameters: dict[str, str], reason: str) -> None:
    process = bench.launch("franka_node", **parameters)
    _, errors = process.communicate()
    assert process.returncode == 1
    assert f"franka: {reason}" in errors


def test_without_the_library_it_says_how_to_install_it(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pylibfranka", None)  # as where it is not installed
    with pytest.raises(RobotError, match="Franka's own library, is not installed: pip install pylibfranka"):
        FciLink("127.0.0.1", "fr3", False, 0, print, print)
