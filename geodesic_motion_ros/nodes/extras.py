"""Messages and actions that ROS's packages on PyPI lack: a node uses those that are installed."""

from __future__ import annotations

from importlib import import_module

#: What a planner lacks without a package.
_LACKS = {
    "geodesic_motion_msgs": "action move_to_goal", "control_msgs": "trajectory_action", "tf2_msgs": "frames of /tf",
    "moveit_msgs": "planning_scene",
}  # fmt: skip


def extra(name: str) -> type | None:
    """Return a message or action by its full name, as tf2_msgs/msg/TFMessage; None where it is not installed."""
    module, _, kind = name.replace("/", ".").rpartition(".")
    try:
        return getattr(import_module(module), kind)
    except ImportError:
        return None


def lacking() -> str:
    """Return for a person what a planner lacks, and why; "" where it is nothing."""
    lacks = {package: what for package, what in _LACKS.items() if not _is_there(package)}
    if not lacks:
        return ""
    return f"without {', '.join(lacks.values())}: {', '.join(lacks)} not installed (make ros-extras)"


def _is_there(package: str) -> bool:
    try:
        import_module(package)
    except ImportError:
        return False
    return True
