"""Old path of `planning.pose_query`; goes with the next version."""

from geodesic_motion_ros.utils.moved import forwarding

__getattr__ = forwarding(__name__, "geodesic_motion_ros.planning.pose_query")
