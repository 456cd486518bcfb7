"""The parameters of the node with the paper's planner, and its help."""

from __future__ import annotations

from dataclasses import replace

from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.parameters import Parameter
from geodesic_motion_ros.nodes.usage import Program

#: Those of the node `planner` that count here too, by their names.
_SHARED = (
    "base_frame", "joint_prefix", "rate", "avoidance", "ambient_strength", "task_frame", "maximum_offset",
    "maximum_offset_angle", "speed", "angular_speed", "speed_scale", "latency", "state_timeout", "resume_timeout",
    "tracking_tolerance", "tracking_tolerance_angle", "tracking_tolerance_joint", "obstacle_timeout",
    "obstacle_silence_policy", "required_obstacle_topics", "obstacle_lifetime", "obstacle_point_radius",
    "camera_frame", "camera_pose",
    "obstacle_cloud_radius", "obstacle_cloud_voxel", "obstacle_cloud_thickness", "self_filter", "self_filter_padding",
    "path_rate", "latent_view_rate", "latent_view_size",
)  # fmt: skip
#: Of these the ones that cannot change here while the node runs.
_FIXED = ("speed", "angular_speed", "speed_scale")

PAPER = (
    Parameter("skill", "paper_pouring", "Skill folder, or the name of a shipped skill: paper_pouring, paper_reach"),
    Parameter("simulation_only", False, "That no real arm hears the commands: without it the node does not start"),
    *(
        replace(parameter, read_only=parameter.read_only or parameter.name in _FIXED)
        for parameter in PLANNER
        if parameter.name in _SHARED
    ),
)

PROGRAM = Program(
    "paper_planner",
    PAPER,
    "paper.yaml",
    about="The planner of the paper to the letter, for comparisons in simulation. It takes the place of `planner`: the "
    "same name, topics and services. It sees spheres and points alone, predicts nothing and certifies nothing: its "
    "path may lead through obstacles. Skills of the tool stream target_pose, of the whole arm joint_trajectory.",
    examples=(
        "twin --ros-args -p skill:=paper_pouring",
        "paper_planner --ros-args --params-file config/paper.yaml",
        "geodesic-motion goal paper_pouring",
        "paper_planner --ros-args -p simulation_only:=true -p skill:=paper_reach -p ambient_strength:=1000.0",
    ),
)
