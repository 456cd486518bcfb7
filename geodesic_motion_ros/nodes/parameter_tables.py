"""Every parameter of every node: the one place where names, defaults, meanings, units and ranges stand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

from geodesic_motion_ros.contract.settings import LARGEST_DETOUR, Timing, Unseen
from geodesic_motion_ros.manifold.ambient_law import LAWS
from geodesic_motion_ros.nodes.parameters import Parameter
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT, RobotDescription

#: Defaults that belong to a robot are those of this one; each stands for the same of whatever robot a node is of.
_ROBOT = RobotDescription.named(DEFAULT_ROBOT)

PLANNER = (
    Parameter("skill", "panda_reach_to_grasp", "Skill folder, or the name of a shipped skill"),
    Parameter(
        "base_frame",
        _ROBOT.base_link,
        "Frame of all poses; messages in other frames go through tf where tf2_msgs is installed, and are refused "
        "otherwise. "
        "The default stands for the skill's own frame, with joint_prefix",
    ),
    Parameter(
        "joint_prefix",
        "",
        "What the names of joints and frames begin with here, before those of the robot: left_ for left_panda_joint1",
    ),
    Parameter("rate", 100.0, "Planning cycles per second", "Hz", 10.0, 1000.0),
    Parameter(
        "output",
        "joint_trajectory",
        "What commands the arm: joint_trajectory, or target_pose, a stream of tool poses, with target_posture, the "
        "configurations that hold them; only an arm that follows these too is guarded as a whole",
        choices=("joint_trajectory", "target_pose"),
    ),
    Parameter(
        "trajectory_action",
        "",
        "With output joint_trajectory: the FollowJointTrajectory action that trajectories go to as goals, such as "
        "panda_arm_controller/follow_joint_trajectory, in the place of the topic. Empty: the topic",
    ),
    Parameter(
        "armed",
        True,
        "Whether the arm is commanded from the start. false, for real arms: before `~/arm` the planner plans and "
        "shows, and commands nothing; what drops the goal disarms it again, and so does `~/clear_obstacles`",
    ),
    Parameter(
        "avoid",
        "arm",
        "What is kept away from obstacles: the whole arm, or the tool's spheres alone",
        choices=("arm", "tool"),
    ),
    Parameter("avoidance", True, "false ignores all obstacles: for control experiments only"),
    Parameter(
        "tool_spheres",
        [number for sphere in _ROBOT.tool_spheres for number in sphere],
        "Spheres fixed in the tool frame that obstacles are kept away from, each as x, y, z, radius. The default "
        "stands for those of the skill's robot",
        "m",
        -2.0,
        2.0,
        row=4,
    ),
    Parameter(
        "scene",
        "",
        "What always stands around the arm: a file, as in config/scenes, or the name of one of those; none: nothing; "
        "empty: what the skill was recorded in or, where it does not say, not known: no motion leaves what was "
        "demonstrated",
    ),
    Parameter(
        "detour",
        0.25,
        "Where obstacles block every demonstrated path the tool may leave it by so much, and where it "
        "evades, if a scene is declared; 0.0: it waits, and evades along demonstrated paths alone",
        "m",
        0.0,
        LARGEST_DETOUR,
        read_only=False,
    ),
    Parameter(
        "unseen",
        "free",
        "Where detours may lead: free: wherever no obstacle is known; blocked: inside the boxes `seen` of the scene, "
        "which are empty for ever or which the obstacle source observes wholly, and where the arm passes without a "
        "detour",
        choices=get_args(Unseen),
    ),
    Parameter(
        "patience",
        3.0,
        "Obstacles may go by themselves: a detour begins when they have stood, or blocked the arm, for so long",
        "s",
        0.0,
        3600.0,
    ),
    Parameter(
        "approach_covered_goal",
        True,
        "Where what stands covers the goal the arm goes along its path as near to it as it can; false: it waits",
    ),
    Parameter(
        "obstacle_position_error",
        0.0,
        "How far obstacles may be from where their source says, but for noise of single detections, which is measured: "
        "every obstacle is enlarged by it, and by how far the arm was off the path that it was sent along. Every "
        "certificate keeps this distance",
        "m",
        0.0,
        0.5,
        read_only=False,
    ),
    Parameter(
        "obstacle_margin",
        0.005,
        "Clearance that the search of a path keeps from obstacles where it can; not guaranteed, the certificate asks "
        "for less: for a guaranteed distance set obstacle_position_error",
        "m",
        0.0,
        0.5,
        read_only=False,
    ),
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
        "ambient_law",
        "gaussian",
        "How the metric grows towards obstacles: a gaussian hill, completed: without end, hard: not at all",
        choices=LAWS,
    ),
    Parameter(
        "cost_cap",
        20.0,
        "Paths that cost more than so many times what a demonstration costs without obstacles count as blocked",
        "",
        1.0,
        1e9,
    ),
    Parameter(
        "task_frame",
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        "Where the frame that the skill was demonstrated in stands in base_frame, until `task_frame` is heard: "
        "x, y, z [m], quaternion w, x, y, z",
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
    Parameter(
        "speed",
        -1.0,
        "Largest speed of the tool; 0.0: not limited; -1.0: 0.2 with skills of tool poses, not limited with others",
        "m/s",
        -1.0,
        2.0,
        read_only=False,
    ),
    Parameter(
        "angular_speed",
        -1.0,
        "Largest angular speed of the tool; likewise, 0.8",
        "rad/s",
        -1.0,
        6.0,
        read_only=False,
    ),
    Parameter(
        "acceleration",
        -1.0,
        "Largest acceleration of the tool, along and across its path together; likewise, 1.5; its angular acceleration "
        "is kept in proportion, acceleration * angular_speed / speed",
        "m/s^2",
        -1.0,
        20.0,
        read_only=False,
    ),
    Parameter(
        "maximum_joint_offset",
        0.5,
        "Joint-space skills: largest distance of start and goal from what was demonstrated, over all joints",
        "rad",
        0.001,
        6.0,
    ),
    Parameter(
        "speed_scale",
        0.3,
        "Share of the joints' velocity limits; at most that which the robot's joint_limits.yaml allows: 0.8 of an FR3, "
        "whose servo stops the arm where it overshoots them",
        "",
        0.01,
        1.0,
        read_only=False,
    ),
    Parameter(
        "acceleration_scale",
        0.2,
        "Share of the joints' acceleration and jerk limits",
        "",
        0.01,
        1.0,
        read_only=False,
    ),
    Parameter(
        "speed_override",
        1.0,
        "The arm moves at this share of its speed, on the same path: 0.5 at half of it; at 0.0, and where less than "
        "0.01 of the joints' velocity limits would be left, it brakes on its path and rests until there is more",
        "",
        0.0,
        1.0,
        read_only=False,
    ),
    Parameter(
        "timing",
        "demonstrated",
        "How fast a motion to a goal is: demonstrated, no faster than was shown where the skill knows; fastest, as the "
        "limits allow",
        choices=get_args(Timing),
        read_only=False,
    ),
    Parameter(
        "periodic",
        False,
        "A closed skill goes on round after round; false again, it ends with the present round, at the goal",
        read_only=False,
    ),
    Parameter(
        "rounds",
        0,
        "After so many rounds a periodic motion ends at the goal; 0: it goes on until periodic is false, the arm is "
        "held or disarmed",
        "",
        0,
        1_000_000,
        read_only=False,
    ),
    Parameter(
        "latency",
        0.03,
        "A new trajectory takes over so long after its planning began",
        "s",
        0.005,
        0.5,
    ),
    Parameter(
        "prediction",
        2.4,
        "Obstacles are expected to move on as they do for so long, longer than a stop takes",
        "s",
        0.0,
        5.0,
    ),
    Parameter(
        "horizon",
        2.4,
        "A trajectory leads so far ahead, then to rest, and is sent again in time: without the "
        "planner the arm stops by itself; not less than prediction",
        "s",
        0.1,
        60.0,
    ),
    Parameter(
        "body_radius",
        0.08,
        "Joint-space skills: radius of the arm around its body points as the soft metric sees it",
        "m",
        0.001,
        0.5,
    ),
    Parameter(
        "refine",
        True,
        "Make paths on the latent grid continuous ones, which know no directions of a grid",
    ),
    Parameter(
        "state_timeout",
        0.25,
        "A joint state older than this stops the motion: longer than the pauses of an ordinary desktop; 0.1 where the "
        "machine is the robot's own",
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
        "block_timeout",
        30.0,
        "A goal of the action move_to_goal that the arm has stood before for so long ends with the verdict's code, and "
        "is dropped",
        "s",
        0.1,
        3600.0,
    ),
    Parameter(
        "tracking_tolerance",
        0.05,
        "An arm whose tool is further than this from where target_pose sent it is lost: the goal is dropped, and the "
        "arm must come to rest",
        "m",
        0.001,
        1.0,
        read_only=False,
    ),
    Parameter("tracking_tolerance_angle", 0.35, "The same for the orientation", "rad", 0.01, 3.2, read_only=False),
    Parameter(
        "tracking_tolerance_joint",
        0.1,
        "The same for each joint that joint_trajectory sent; with target_posture the arm stops, and plans again from "
        "where it rests; the goal is dropped where that has brought no progress",
        "rad",
        0.005,
        1.0,
        read_only=False,
    ),
    Parameter(
        "obstacle_timeout",
        0.5,
        "An obstacle topic is silent or late when the newest that it has published, by its stamp (0: by its arrival), "
        "is older than this",
        "s",
        0.02,
        3600.0,
        read_only=False,
    ),
    Parameter(
        "obstacle_silence_policy",
        "hold",
        "When an obstacle topic falls silent or is late: hold, or keep moving among the obstacles last known",
        choices=("hold", "keep"),
        read_only=False,
    ),
    Parameter(
        "required_obstacle_topics",
        [""],
        "Obstacle topics that must have been heard before the arm moves, and must go on: one that sees nothing sends "
        "an empty MarkerArray or cloud. none: nothing has to be heard, which must be written where armed is false",
        choices=("obstacles", "obstacle_marker", "obstacle_point", "obstacle_cloud", "none"),
    ),
    Parameter(
        "obstacle_lifetime",
        0.0,
        "The obstacles of `obstacle_point` and `obstacle_cloud` are forgotten so long after the topic's last message, "
        "which is no longer waited for; 0.0: never, what falls silent stops the arm until `~/clear_obstacles`",
        "s",
        0.0,
        3600.0,
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
        0.002,
        "Radius around what `obstacle_cloud` shows: as much as the camera is off",
        "m",
        0.001,
        1.0,
        read_only=False,
    ),
    Parameter(
        "obstacle_cloud_voxel",
        0.02,
        "Edge of the cubes that distinguish points of a cloud; it keeps the robot off by up to 1.7 edges more",
        "m",
        0.005,
        0.1,
        read_only=False,
    ),
    Parameter(
        "obstacle_cloud_thickness",
        0.05,
        "How thick what a cloud shows is taken to be: the hill around it is as wide as that of such a sphere",
        "m",
        0.001,
        1.0,
        read_only=False,
    ),
    Parameter(
        "camera_frame",
        "",
        "Frame of clouds, of a camera that stands where `camera_pose` says; tf is not asked for it. Empty: tf is asked "
        "for every frame",
    ),
    Parameter(
        "camera_pose",
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        "Where the frame `camera_frame` stands in the base frame: position [m] and quaternion, scalar first; z along "
        "the line of sight, x to the right of the picture",
        "",
        -100.0,
        100.0,
    ),
    Parameter(
        "self_filter",
        True,
        "Take the arm and what it holds out of `obstacle_cloud`, where joint states before and after the cloud's stamp "
        "say that it was; false: no cloud shows the arm",
        read_only=False,
    ),
    Parameter(
        "self_filter_padding",
        0.02,
        "Points that are not farther from the arm's spheres than this and the tracking error are taken for the arm: "
        "noise of the camera and error of its calibration. An obstacle that stays as near is lost",
        "m",
        0.0,
        0.2,
        read_only=False,
    ),
    Parameter("path_rate", 5.0, "How often `path` and `~/markers` are published", "Hz", 0.1, 50.0),
    Parameter(
        "latent_view_rate",
        2.0,
        "How often `~/latent_view` is drawn while somebody looks at it; 0.0 never",
        "Hz",
        0.0,
        10.0,
    ),
    Parameter("latent_view_size", 320, "Edge of the square picture `~/latent_view`", "pixels", 64, 360),
)

TWIN = (
    Parameter(
        "base_frame",
        _ROBOT.base_link,
        "Frame of all poses; messages in other frames are refused. The default stands for the base link of the robot, "
        "with joint_prefix",
    ),
    Parameter(
        "skill",
        "panda_reach_to_grasp",
        "Start where this skill begins: its folder, or the name of a shipped one; empty, or with other "
        "initial_joint_positions than the default: start there",
        read_only=False,
    ),
    Parameter("robot", "", f"Name or folder of the robot; empty: that of the skill, or {DEFAULT_ROBOT} without one"),
    Parameter(
        "joint_prefix",
        "",
        "What the names of joints and frames begin with here, before those of the robot: left_ for left_panda_joint1",
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
        [round(angle, 4) for angle in _ROBOT.ready],
        "Where the arm starts, and goes at `~/reset`; the default: where the skill begins, or the ready posture of the "
        "robot with an empty `skill`",
        "rad",
        -7.0,
        7.0,
        row=1,
        read_only=False,
    ),
    Parameter(
        "follow_posture",
        True,
        "Whether the arm holds a target pose as `target_posture` says; false: in a posture of its own",
    ),
    Parameter(
        "command_timeout",
        0.2,
        "Without a target pose for longer than this, the arm brakes and holds; without a pose of the hand in free "
        "drive, the hand has let go; a joint trajectory ends by itself",
        "s",
        0.02,
        10.0,
        read_only=False,
    ),
    Parameter(
        "cmd_timeout",
        0.0,
        "Without a new joint trajectory for longer than this after the end of the last one, the arm holds where it is "
        "measured; 0.0 never. As of joint_trajectory_controller",
        "s",
        0.0,
        60.0,
        read_only=False,
    ),
    Parameter(
        "scene",
        "",
        "What always stands around the arm, as declared to the planner: a file, as in config/scenes, or the name of "
        "one of those; none: nothing; empty: what the skill was recorded in, if it says so",
    ),
    Parameter(
        "spheres",
        "",
        "Obstacles that `~/spawn_obstacles` puts into the world: a name, or a YAML mapping, which needs quotes within "
        "quotes on a command line (an example: twin --help); empty for none",
        read_only=False,
    ),
    Parameter("spawn_at_start", False, "Spawn the spheres as soon as the twin starts"),
    Parameter(
        "cloud_rate",
        0.0,
        "How often `obstacle_cloud` is rendered, as a depth camera sees arm, spheres and scene, in a process of its "
        "own; 0.0 never. Its frame is twin_camera",
        "Hz",
        0.0,
        60.0,
    ),
    Parameter("cloud_delay", 0.06, "A cloud is published so long after its stamp", "s", 0.0, 1.0),
    Parameter(
        "cloud_noise",
        0.002,
        "Standard deviation of a depth of 1 m in the clouds; it grows with the square of the depth",
        "m",
        0.0,
        0.1,
    ),
    Parameter("camera_place", [1.4, -0.8, 1.2], "Where the camera of the clouds stands", "m", -10.0, 10.0),
    Parameter("camera_target", [0.35, 0.0, 0.35], "What is in the middle of its picture", "m", -10.0, 10.0),
)

RECORD = (
    Parameter(
        "folder",
        "recordings",
        "Where the takes of one task go, one file each; new ones are compared with those that stand there",
    ),
    Parameter("robot", DEFAULT_ROBOT, "Whose joints are recorded, by their names in its URDF"),
    Parameter(
        "joint_prefix",
        "",
        "What the names of joints and frames begin with here, before those of the robot: left_ for left_panda_joint1",
    ),
)

FRANKA = (
    Parameter("address", "", "Address of the arm's controller in the network; must be given"),
    Parameter("robot", "fr3", "Which arm it is, by the name or folder of its description: its limits are checked"),
    Parameter(
        "joint_prefix",
        "",
        "What the names of joints begin with here, before those of the robot: left_ for left_fr3_joint1",
    ),
    Parameter(
        "state_rate", 200.0, "How often `joint_states` and `commanded_joint_states` are published", "Hz", 100.0, 1000.0
    ),
    Parameter(
        "clock_from_robot",
        False,
        "Publish the arm's own time as `/clock`, and live by it: for a simulated arm that may be slower than real; "
        "the other nodes then have use_sim_time",
    ),
)

VIEW = (
    Parameter("planner", "planner", "Name of the node that is shown: planner, or filter"),
    Parameter("host", "127.0.0.1", "Address that the page is served at; 0.0.0.0 for every machine that finds this one"),
    Parameter("port", 8080, "Port of the page; where it is taken, the next one that is free; 0: any", "", 0, 65535),
    Parameter(
        "control",
        False,
        "Whether the page commands: goals, hold, speed, reset, and obstacles that are dragged; false: it shows alone",
    ),
    Parameter(
        "skill",
        "panda_reach_to_grasp",
        "With control: whose goal the page sends, a skill folder or the name of a shipped one; empty: it sends none",
    ),
    Parameter(
        "joint_prefix",
        "",
        "What the names of joints begin with here, before those of the robot, in goals that are configurations: left_ "
        "for left_panda_joint1",
    ),
    Parameter(
        "repeat",
        False,
        "With control, beside a twin: repeat the motion from the start on, until that is unticked on the page",
    ),
)

#: Parameters of the planner that belong to its skill, or to poses as output: a filter has none of these.
_OF_SKILLS = {
    "skill", "output", "avoid", "tool_spheres", "ambient_strength", "ambient_width_ratio", "ambient_law", "cost_cap",
    "task_frame", "block_timeout", "ridge_strength", "query_conditioning", "maximum_offset", "maximum_offset_angle",
    "maximum_joint_offset", "timing", "periodic", "rounds", "body_radius", "refine", "approach_covered_goal",
    "tracking_tolerance", "tracking_tolerance_angle", "latent_view_rate", "latent_view_size",
}  # fmt: skip
#: What is otherwise with a filter: what is offered says itself how fast the arm is to be.
_OF_FILTER: dict[str, dict[str, Any]] = {
    "base_frame": {
        "description": "Frame of all poses; messages in other frames go through tf where tf2_msgs is installed, and "
        "are refused otherwise. The default stands for the robot's own frame, with joint_prefix"
    },
    "scene": {
        "description": "What always stands around the arm: a file, as in config/scenes, or the name of one of those; "
        "none: nothing; empty: that is not known, and no motion leaves what is offered"
    },
    "detour": {
        "description": "With recover: detour the tool may leave what is offered by so much, where obstacles block it "
        "and a scene is declared"
    },
    "armed": {
        "description": "Whether the arm is commanded from the start. false, for real arms: before `~/arm` the filter "
        "plans and shows, and commands nothing; what drops the trajectory disarms it again, and so does "
        "`~/clear_obstacles`"
    },
    "horizon": {
        "description": "What is sent leads so far ahead, then to rest, and is sent again in time: without the filter "
        "the arm stops by itself; not less than prediction"
    },
    "obstacle_margin": {
        "description": "Clearance from obstacles, where one moves twice as much, that what is offered must keep; an "
        "arm that is nearer comes no nearer. Obstacles are enlarged by obstacle_position_error besides"
    },
    "resume_timeout": {
        "description": "When joint states return after a longer silence than this the trajectory is dropped; before, "
        "the motion resumes"
    },
    "tracking_tolerance_joint": {
        "description": "An arm with a joint further than this from where joint_trajectory sent it is lost: what is "
        "played is dropped, and the arm must come to rest"
    },
    "speed": {"description": "Largest speed of the tool; -1.0, 0.0: not limited"},
    "angular_speed": {"description": "Largest angular speed of the tool; likewise"},
    "acceleration": {
        "description": "Largest acceleration of the tool, along and across its path together; likewise; its angular "
        "acceleration is kept in proportion, acceleration * angular_speed / speed"
    },
    "speed_scale": {"default": 1.0},
    "acceleration_scale": {"default": 1.0},
}

FILTER = (
    Parameter("robot", DEFAULT_ROBOT, "Which arm it is: the name or the folder of its description"),
    Parameter(
        "recover",
        "wait",
        "What the arm does that has come to rest before what stands on its path: wait until that leaves; or, "
        "where a scene is declared, detour: after `patience` it passes around, and it makes room for what comes",
        choices=("wait", "detour"),
    ),
    *(replace(one, **_OF_FILTER.get(one.name, {})) for one in PLANNER if one.name not in _OF_SKILLS),
)

TABLES = {"planner": PLANNER, "filter": FILTER, "twin": TWIN, "record": RECORD, "franka": FRANKA, "view": VIEW}
