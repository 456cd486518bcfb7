"""The demo of the README: planner and twin as two processes, an obstacle, pictures."""

from geodesic_motion_ros import nodes as _nodes  # noqa: F401  (sets the environment of numpy and DDS before they load)
