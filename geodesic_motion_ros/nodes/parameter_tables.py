"""Every parameter of every node: the one place where names, defaults, meanings, units and ranges stand."""

from __future__ import annotations

from geodesic_motion_ros.nodes.parameters import Parameter
from geodesic_motion_ros.robot.kinematics import PANDA_READY

_BASE_FRAME = Parameter("base_frame", "panda_link0", "Frame of all poses; messages in other frames are refused")

# The hand of the Panda, fingers 4 cm apart, in the frame panda_grasptarget: z points out of the hand, the fingers open
# along y. Two rows of spheres cover the palm, two a finger.
_PANDA_HAND = (
    *((0.0, y, z, 0.0393) for z in (-0.099, -0.0625) for y in (-0.069, -0.023, 0.023, 0.069)),
    *((0.0, y, z, 0.022) for z in (-0.033, -0.006) for y in (-0.033, 0.033)),
)

PLANNER = (
    Parameter("skill", "panda_pouring", "Skill folder, or the name of a shipped skill"),
    _BASE_FRAME,
    Parameter("rate", 100.0, "Planning cycles per second", "Hz", 10.0, 1000.0),
    Parameter("avoidance", True, "false ignores all obstacles: for control experiments only"),
    Parameter(
        "tool_spheres",
        [number for sphere in _PANDA_HAND for number in sphere],
        "Spheres fixed in the tool frame that obstacles are kept away from, each as x, y, z, radius",
        "m",
        -2.0,
        2.0,
        row=4,
    ),
    Parameter("obstacle_margin", 0.005, "Clearance the search keeps from obstacles", "m", 0.0, 0.5),
    Parameter(
        "ambient_strength",
        1000.0,
        "zeta of the ambient factor: how steep an obstacle's hill is",
        "",
        0.0,
        1e9,
    ),
    Parameter(
        "ambient_width_ratio",
        0.5,
        "Width of an obstacle's hill over its radius (tool radius included)",
        "",
        0.01,
        10.0,
    ),
    Parameter(
        "task_frame",
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        "Where the frame that the skill was shown in stands in base_frame, until `task_frame` is heard: x, y, z [m], "
        "quaternion w, x, y, z",
        "",
        -10.0,
        10.0,
    ),
    Parameter(
        "ridge_strength",
        1.0,
        "How strongly paths are drawn to where the demonstrations run on average; 0.0 leaves the plain metric",
        "",
        0.0,
        100.0,
    ),
    Parameter(
        "query_conditioning",
        True,
        "Let start and goal choose between the demonstrations, in skills where that was found to help",
    ),
    Parameter(
        "maximum_offset",
        0.05,
        "Largest distance of start and goal from what was demonstrated",
        "m",
        0.001,
        1.0,
    ),
    Parameter(
        "maximum_offset_angle",
        0.5,
        "Largest rotation of start and goal from what was demonstrated",
        "rad",
        0.001,
        3.2,
    ),
    Parameter("speed", 0.2, "Largest speed of the tool", "m/s", 0.001, 2.0),
    Parameter("angular_speed", 0.8, "Largest angular speed of the tool", "rad/s", 0.001, 6.0),
    Parameter(
        "acceleration",
        0.5,
        "Largest acceleration of the tool, along and across its path together; its angular acceleration is kept in "
        "proportion, acceleration * angular_speed / speed",
        "m/s^2",
        0.01,
        20.0,
    ),
    Parameter(
        "state_timeout",
        0.1,
        "A joint state older than this stops the motion",
        "s",
        0.01,
        10.0,
        read_only=False,
    ),
    Parameter(
        "resume_timeout",
        1.0,
        "When joint states return after a longer silence than this the goal is dropped; before, the motion resumes",
        "s",
        0.01,
        60.0,
        read_only=False,
    ),
    Parameter(
        "tracking_tolerance",
        0.05,
        "An arm further than this from where it was sent is lost: the goal is dropped, and the arm must come to rest",
        "m",
        0.001,
        1.0,
        read_only=False,
    ),
    Parameter("tracking_tolerance_angle", 0.35, "The same for the orientation", "rad", 0.01, 3.2, read_only=False),
    Parameter(
        "obstacle_timeout",
        0.5,
        "An obstacle topic not heard for longer than this is silent",
        "s",
        0.02,
        3600.0,
        read_only=False,
    ),
    Parameter(
        "obstacle_silence_policy",
        "hold",
        "When an obstacle topic falls silent: hold, or keep moving among the obstacles last known",
        choices=("hold", "keep"),
        read_only=False,
    ),
    Parameter(
        "obstacle_point_radius",
        0.05,
        "Radius of the obstacle of `obstacle_point`",
        "m",
        0.001,
        2.0,
        read_only=False,
    ),
    Parameter(
        "obstacle_cloud_radius",
        0.02,
        "Radius around every point of `obstacle_cloud`",
        "m",
        0.001,
        1.0,
        read_only=False,
    ),
    Parameter(
        "obstacle_cloud_voxel",
        0.04,
        "Points of a cloud in one cube of this edge become one sphere",
        "m",
        0.005,
        1.0,
        read_only=False,
    ),
    Parameter(
        "obstacle_cloud_most",
        200,
        "Most spheres made of a cloud; cubes are doubled until they suffice",
        "",
        8,
        5000,
        read_only=False,
    ),
    Parameter("path_rate", 5.0, "How often `path` and `~/markers` are published", "Hz", 0.1, 50.0),
    Parameter("latent_view_rate", 2.0, "How often `~/latent_view` is drawn; 0.0 never", "Hz", 0.0, 10.0),
    Parameter("latent_view_size", 320, "Edge of the square picture `~/latent_view`", "pixels", 64, 360),
)

TWIN = (
    _BASE_FRAME,
    Parameter(
        "skill",
        "panda_pouring",
        "Start where this skill begins: its folder, or the name of a shipped one; empty, or with other "
        "initial_joint_positions than the default: start there",
        read_only=False,
    ),
    Parameter("physics_rate", 240.0, "Physics steps per second of real time", "Hz", 100.0, 1000.0),
    Parameter("state_rate", 120.0, "How often `joint_states` and `ee_pose` are published", "Hz", 100.0, 1000.0),
    Parameter("obstacle_rate", 60.0, "How often obstacles and `~/clearance` are published", "Hz", 1.0, 240.0),
    Parameter(
        "image_rate",
        0.0,
        "How often `~/image` is rendered, which stops physics for 0.1 s; 0.0 never",
        "Hz",
        0.0,
        5.0,
    ),
    Parameter("gui", False, "Open PyBullet's window"),
    Parameter(
        "initial_joint_positions",
        [round(angle, 4) for angle in PANDA_READY],
        "Where the arm starts, and goes at `~/reset`; the default, the ready pose, only with an empty `skill`",
        "rad",
        -4.0,
        4.0,
        read_only=False,
    ),
    Parameter(
        "command_timeout",
        0.2,
        "Without a target pose for longer than this, the arm brakes and holds",
        "s",
        0.02,
        10.0,
        read_only=False,
    ),
    Parameter("scene", "", "Obstacles that `~/spawn_obstacles` puts into the world; empty for none", read_only=False),
    Parameter("spawn_at_start", False, "Spawn the scene as soon as the twin starts"),
)

TABLES = {"planner": PLANNER, "twin": TWIN}
