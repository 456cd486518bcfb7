"""A skill: what was learned from demonstrations, in a folder."""

from geodesic_motion_ros.utils.moved import forwarding

__getattr__ = forwarding(__name__, "Skill", "skill")
