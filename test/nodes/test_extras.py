"""What a node lacks without messages that ROS's packages on PyPI do not have is named, and nothing else."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from geodesic_motion_ros.nodes.extras import extra, lacking

PACKAGES = ("geodesic_motion_msgs", "control_msgs", "tf2_msgs", "moveit_msgs")


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    for package in PACKAGES:
        monkeypatch.setitem(sys.modules, package, ModuleType(package))


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("package", "what"),
    [("geodesic_motion_msgs", "action move_to_goal"), ("control_msgs", "trajectory_action"),
     ("tf2_msgs", "frames of /tf"), ("moveit_msgs", "planning_scene")],
)  # fmt: skip
def test_what_one_package_brings_is_named_with_it(package: str, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert lacking() == ""
    monkeypatch.setitem(sys.modules, package, None)
    assert lacking() == f"without {what}: {package} not installed (make ros-extras)"


def test_a_message_is_found_by_its_full_name_or_is_none() -> None:
    assert extra("std_msgs/msg/String").__name__ == "String"
    assert extra("no_such_msgs/msg/String") is None
