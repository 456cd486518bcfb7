"""A robot of any URDF: kinematics, limits, collision model; knows no scene."""
