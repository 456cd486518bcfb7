"""Obstacles, and how they are tracked; knows nothing of ROS."""

from geodesic_motion_ros.utils.moved import forwarding

__getattr__ = forwarding(__name__, "Obstacles", "obstacles")
