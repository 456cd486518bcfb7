"""Planning rates and reaction times of the running node."""

from geodesic_motion_ros import nodes as _nodes  # noqa: F401  (sets the environment of numpy and DDS before they load)
