"""The fault suite: faults are injected between and into a planner and a twin, and what they promise is measured.

`bench.py` runs the two nodes as processes, with a `relay.py` in every topic that a fault disturbs; `judge.py` looks at
every command that the planner gave; each family of faults has a file, and `catalogue.py` lists them all.
"""

from geodesic_motion_ros import nodes as _nodes  # noqa: F401  (sets the environment of numpy and DDS before they load)
