"""Old path of the planner of whole-arm skills; goes with the next version."""

from geodesic_motion_ros.utils.moved import forwarding

_PLANNER = "geodesic_motion_ros.planning.planner"
__getattr__ = forwarding(__name__, _PLANNER, JointSpacePlanner=f"{_PLANNER}.ReactivePlanner")
