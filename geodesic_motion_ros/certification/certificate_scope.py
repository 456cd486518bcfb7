"""The scope of a trajectory's certificate, what it counts and what not, in words: this is the one place that states it.
"""

from __future__ import annotations

#: Subject, and what holds of every trajectory that leads to a goal; parameters are those of the planner.
COUNTED = (
    ("the arm", "every collision sphere of its moving links, between samples too, from every obstacle; with "
     "`avoid: tool` those of the tool alone"),
    ("the arm itself", "every pair of spheres whose links can meet"),
    ("the declared scene", "every sphere, from every part of it"),
    ("obstacles that move", "straight on for `prediction`, enlarged by how uncertain their velocities are, standing "
     "afterwards; where that leaves no path, not after `prediction`"),
    ("the arm's tracking", "its measured distance from its path and its measured lag"),
    ("the obstacle source", "the stated `obstacle_position_error`"),
    ("objects in the hand", "those that are published as held"),
    ("joint limits", "position, velocity, acceleration and jerk, between samples too"),
)  # fmt: skip
NOT_COUNTED = (
    ("what no sensor sees", "a covered lens, a gap between cameras, and what stands around the arm undeclared"),
    ("obstacles that start, turn or appear", "what does so closer than the arm can stop is met"),
    ("what moves into a standing arm", "it is evaded where an evasion is certified, and touches the arm elsewhere"),
    ("delays beyond the stamps", "of detections, and of commands on their path to the motors"),
    ("contacts that are meant", "a grasp, a cup that is set down: forces are not modelled"),
    ("the decoder", "whether the motion does the task: clearance is certified, not success"),
)  # fmt: skip
