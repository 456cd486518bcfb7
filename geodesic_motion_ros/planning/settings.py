"""What decides how the planner behaves: its constants, and what a user may choose (`PlannerSettings`).

A constant states its unit and the range in which it makes sense. What is a matter of numerics alone (tolerances of
solvers, rounding) stands where it is used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Literal, NamedTuple, get_args

import numpy as np

from geodesic_motion_ros.manifold.ambient_law import LAWS, AmbientLaw
from geodesic_motion_ros.trajectory.tool_limits import ToolLimits
from geodesic_motion_ros.utils.errors import PlanningError

# ------------------------------------------------------------------ clearance of moving obstacles

#: Paths among obstacles that move are certified with this multiple of the obstacle margin, from 1 on: nothing moves
#: exactly as expected.
DYNAMIC_MARGIN_FACTOR = 2.0
#: An arm that sets out or moves on among them must be able to stop so long later [s], the latency or more: by then the
#: next tick has judged them again.
REPLAN_DELAY = 0.03
#: The places where a moving obstacle may halt on its predicted line are covered by so many spheres, from 2 on; the
#: first is where it was last detected.
STOP_POSITION_SAMPLES = 12
#: Obstacles are enlarged by the tracking error in steps of this [m], and the arm's lag counts in steps of this [s]:
#: smaller changes need no new certificate.
TRACKING_ERROR_STEP, LAG_STEP = 1e-3, 0.01

# ------------------------------------------------------------------ when a path is searched again

#: While the present path is free better ones are searched so often [s]; so are evasion paths and approaches where none
#: was found.
SEARCH_PERIOD = 0.1
#: A new path replaces a free one where that one takes longer by this factor, from 1 on.
WORTHWHILE_RATIO = 1.05

# ------------------------------------------------------------------ how a path is searched


class Attempt(NamedTuple):
    """A multiple of the obstacle margin that a path keeps.

    optimistic : what moves will have left the path by the time that the arm comes there: it is not counted beyond the
        prediction.
    """

    multiple: float
    optimistic: bool = False


#: What is tried until a path is certified. The second keeps so far off that smoothing does not cut into obstacles.
ATTEMPTS = Attempt(1.0), Attempt(4.0), Attempt(1.0, optimistic=True)
#: Widths in grid steps by which paths are smoothed, first in the latent space, then decoded: refined ones, which have
#: no corners of the grid, and those that are not refined.
REFINED_WIDTH, UNREFINED_WIDTH = 1.0, 2.0
#: Configurations that hold a path of tool poses are smoothed by so many times that width, from 1 on: that takes out
#: kinks of the decoder and of the corrections along mean paths, of a millimetre or two.
TOOL_SMOOTHING_FACTOR = 3.0
#: The same of `PosePathPlanner`: multiples of the obstacle margin, and for each of them smoothing widths in grid steps,
#: of the latent path and of the poses decoded from it.
MARGIN_MULTIPLES = (1.0, 2.5)
SMOOTHING_WIDTHS = ((1.5, 3.0), (0.7, 1.5), (0.0, 1.0))
#: A path may enter the graph this many grid steps from the start.
ENTRY_STEPS = 3
#: The smoothed curve may leave the pruned nodes by this factor of sigma, from 1 on, before it counts as unsupported.
CURVE_SIGMA_FACTOR = 1.2

# ------------------------------------------------------------------ evasion

#: Evasion targets are searched up to so many grid steps around, among so many nodes.
EVASION_STEPS, EVASION_NODES = 30, 500
#: So many of them are tried, in directions of which any two have no larger cosine than this.
EVASION_TARGETS, EVASION_COSINE = 4, 0.7
#: Where no place on the graph is free of what comes within this time [s], the tool is displaced by up to so much [m],
#: or the arm swivels by up to so much [rad].
EVASION_DISPLACED_WITHIN, EVASION_DISPLACEMENT, EVASION_SWIVEL = 0.6, 0.15, 0.6
#: So many of these targets are tried.
EVASION_DISPLACED = 3

# ------------------------------------------------------------------ goals that are covered

#: An arm sets out towards a covered goal, or once more, where that leaves so much less of the path [m]: an arm does not
#: follow every little move of what covers it. Of the arm what moves farthest counts.
APPROACH_GAIN = 0.01
#: An approach keeps this multiple of the obstacle margin, more than `DYNAMIC_MARGIN_FACTOR`: where the arm then stands
#: it may have to set out among what moves, and what it stands before trembles.
APPROACH_MARGIN_FACTOR = 3.0
#: An approach to which its certificate objects is made shorter so often, from 0 on.
APPROACH_CUTS = 3

# ------------------------------------------------------------------ detours

#: The tool leaves what was demonstrated by no more than this [m].
LARGEST_DETOUR = 0.30

#: The coordinates of a detour: a sample of progress so often [m], displacements and swivels so far apart, at most [m],
#: [rad], and so many swivels to either side.
DETOUR_SPACING, DETOUR_LATTICE_SPACING, DETOUR_SWIVEL_SPACING, DETOUR_SWIVELS = 0.03, 0.085, 0.6, 2
#: Turns of the tool and of the joints count so much along the base path, and a swivel so much beside it [m/rad].
DETOUR_METRES_PER_RADIAN, DETOUR_METRES_PER_SWIVEL = 0.1, 0.05
#: To leave the base path costs twice as much per length where the tool is displaced by the demonstrations' deviation,
#: of which no less than this is taken [m], or the arm has swivelled by so much [rad].
DETOUR_NARROWEST_SPREAD, DETOUR_SWIVEL_SPREAD = 0.02, 0.6
#: Obstacles nearer than this [m] make a detour dearer, by this times its cost where they touch.
DETOUR_FELT_CLEARANCE, DETOUR_NEARNESS_STRENGTH = 0.03, 4.0
#: Between neighbours of the lattice no joint turns farther [rad].
DETOUR_LARGEST_JOINT_STEP = 0.7

# ------------------------------------------------------------------ goals and postures

#: `plan` begins in the posture in which the arm stands where its tool is this near the requested start [m], [rad].
SAME_START = 0.005, 0.02
#: Goals of the tool are the same, received again, up to so much [m], [rad]; and hardly elsewhere.
SAME_GOAL, NEAR_GOAL = (1e-6, 1e-6), (2e-3, 1e-2)
#: A goal that moves no further than this during a motion leaves the choice between the demonstrations as it is: of
#: poses [m], a radian like `POSE_SCALE` metres, and of configurations [rad].
SAME_TASK_POSE, SAME_TASK_JOINTS = 0.02, 0.05
#: A goal pose is searched from so many of the nearest nodes where the demonstrations have no common ends.
NEAREST_POSES = 3
#: A base path is smoothed by so many grid steps, in the latent space.
BASE_PATH_SMOOTHING = 1.5
#: Edges along which a joint turns farther are none [rad]: the arm would change its posture there.
LARGEST_JOINT_STEP = 0.3
#: Steps along the null vectors by which the postures differ that are tried in the place of the first [rad]; the arm
#: begins to swivel where it stands, and has done so at this progress, up to 1.
SWIVELS, SWIVELLED_AT = (0.0, 0.5, -0.5, 1.0, -1.0), 0.4

# ------------------------------------------------------------------ settings

#: Limits of the tool with skills of tool poses, where no others are set.
TOOL_LIMITS = ToolLimits(speed=0.2, angular_speed=0.8, acceleration=1.5)
#: Which spheres of the arm are kept away from obstacles: all, or the tool's alone.
Avoid = Literal["arm", "tool"]
#: How detours treat places that are not declared as seen: as free, or as occupied.
Unseen = Literal["free", "blocked"]


@dataclass(frozen=True)
class PlannerSettings:
    """Settings of planning, for every kind of skill. Lengths in metres, angles in radians.

    Attributes
    ----------
    obstacle_margin : clearance [m] that the search of a path keeps from obstacles where it can. It is not guaranteed: a
        new path is certified not to touch what stands; where an obstacle moves, to keep twice the margin, or half of
        the clearance at its ends where that is less. A path that is followed already, and an evasion, are certified not
        to touch. For a guaranteed distance set `obstacle_position_error`.
    obstacle_position_error : how far obstacles may be from where their source says that they are. Every obstacle is
        enlarged by it, and by how far the arm was off its path (`planning/tracking.py`), before anything is searched or
        certified: a certified motion keeps this distance from every obstacle as it was received and predicted. The
        declared scene is not enlarged.
    ambient_strength, ambient_width_ratio : zeta, and Gaussian width over (obstacle + body radius), of the soft metric.
    ambient_law : how it grows towards obstacles: gaussian, completed, or hard: not at all
    (`manifold/ambient_metric.py`).
    ridge_strength : a of the conformal factor exp(a u^2) off the modes' mean paths (`manifold.mean_path`), which
        were called ridges; 0 leaves the plain pull-back metric.
    cost_cap : paths that cost more than so many times what a demonstration costs without obstacles count as blocked.
    query_conditioning : let start and goal choose between the demonstrations, where the skill found that it helps.
    prediction : obstacles are expected to move on linearly for so long [s], enlarged by what their velocities may be
        off (`velocity_history.py`), and to stand then; where that leaves no path, what moves is not counted after it.
        It must be longer than a stop takes, latency included, which is 0.5 s: what comes into sight later cannot be
        stopped for.
    avoidance : False ignores obstacles altogether; for control experiments only.
    avoid : "arm", or "tool": of the arm the tool's spheres alone are kept away from obstacles.
    grid_shape, neighbours : of the latent graph; None: the skill's own.
    refine : make the graph's shortest paths continuous ones, which know no directions of a grid.
    tool_points, tool_radii : spheres (K, 3), (K,) fixed in the tool frame. The metric of a skill of tool poses sees
        them, and they are what is kept away from obstacles where only the tool is.
    maximum_offset, maximum_offset_angle : how far start and goal of a skill of tool poses may lie from the manifold, or
        beyond the starts and goals that were demonstrated.
    maximum_joint_offset : the same of a skill of configurations, over all joints [rad].
    body_radius : radius of the body around its points, as the soft metric of a skill of configurations sees it. What is
        hard, the removal of nodes and the certificate, knows the arm's collision spheres.
    speed_scale, acceleration_scale : share of the joints' velocity limits, and of their acceleration and jerk limits.
    speed, angular_speed : limits of the tool [m/s], [rad/s]. 0: none; None: 0.2 and 0.8 with skills of tool poses, none
        with those of configurations.
    acceleration : limit of the tool's acceleration [m/s^2], tangential and centripetal together; None: 1.5, or none.
        That of the angular acceleration follows: full angular speed is reached in the time that full speed takes.
    latency : a new reference takes over so long after its planning began [s].
    detour : how far the tool may leave what was demonstrated where obstacles block every demonstrated path, up to
        `LARGEST_DETOUR`, if it was declared what stands around the arm, and where it evades; 0: it waits there, and
        evades along demonstrated paths alone.
    unseen : "blocked": detours stay inside the declared scene's list `seen`, and where the arm passes along the base
        path (`planning/seen_volume.py`); "free": they lead wherever no obstacle is known.
    patience : obstacles may go by themselves: a detour begins when they have stood, or blocked the arm, for so long
        [s].
    approach_covered_goal : where what stands covers the goal the arm goes along its path as near to it as it can;
        False: it waits where it is.
    """

    obstacle_margin: float = 0.005
    obstacle_position_error: float = 0.0
    ambient_strength: float = 1000.0
    ambient_width_ratio: float = 0.5
    ambient_law: AmbientLaw = "gaussian"
    ridge_strength: float = 1.0
    cost_cap: float = 20.0
    query_conditioning: bool = True
    prediction: float = 2.4
    avoidance: bool = True
    avoid: Avoid = "arm"
    grid_shape: tuple[int, ...] | None = None
    neighbours: int | None = None
    refine: bool = True
    tool_points: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    tool_radii: tuple[float, ...] = (0.04,)
    maximum_offset: float = 0.05
    maximum_offset_angle: float = 0.5
    maximum_joint_offset: float = 0.5
    body_radius: float = 0.08
    speed_scale: float = 0.3
    acceleration_scale: float = 0.2
    speed: float | None = None
    angular_speed: float | None = None
    acceleration: float | None = None
    latency: float = 0.03
    detour: float = 0.25
    unseen: Unseen = "free"
    patience: float = 3.0
    approach_covered_goal: bool = True

    #: Settings that may be 0.
    may_be_zero: ClassVar[tuple[str, ...]] = (
        "obstacle_margin", "obstacle_position_error", "ambient_strength", "ridge_strength", "prediction", "speed",
        "angular_speed", "acceleration", "detour", "patience",
    )  # fmt: skip

    def tool_limits(self, of_tool_poses: bool) -> ToolLimits:
        """Limits of the tool with a skill of tool poses, or with one of configurations."""
        default = TOOL_LIMITS if of_tool_poses else ToolLimits()
        chosen = {field.name: getattr(self, field.name) for field in fields(ToolLimits)}
        return replace(default, **{name: value for name, value in chosen.items() if value is not None})

    def __post_init__(self) -> None:
        self._check_choices()
        self._check_tool()
        # A whole number is a number too; the grid judges its own settings.
        numbers = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, value in numbers.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                self._check_number(name, value)

    def _check_choices(self) -> None:
        for name, choices in (("ambient_law", LAWS), ("avoid", get_args(Avoid)), ("unseen", get_args(Unseen))):
            if getattr(self, name) not in choices:
                raise PlanningError(f"setting {name} is '{getattr(self, name)}', must be one of {', '.join(choices)}")

    def _check_tool(self) -> None:
        if len(self.tool_points) != len(self.tool_radii) or not self.tool_points:
            raise PlanningError(
                f"{len(self.tool_points)} tool points and {len(self.tool_radii)} tool radii: "
                "give one radius per point, and at least one"
            )
        if np.shape(self.tool_points)[1:] != (3,) or not np.all(np.isfinite(self.tool_points)):
            raise PlanningError("tool_points must be finite (x, y, z) triples in the tool frame [m]")
        if not all(math.isfinite(radius) and radius >= 0.0 for radius in self.tool_radii):
            raise PlanningError(f"tool radii {self.tool_radii} must be finite and not negative [m]")

    def _check_number(self, name: str, value: float) -> None:
        allowed = value >= 0.0 if name in self.may_be_zero else value > 0.0
        if name == "detour" and value > LARGEST_DETOUR:
            raise PlanningError(f"setting detour is {value} m, must be at most {LARGEST_DETOUR} m")
        if not (allowed and math.isfinite(value)):
            wanted = "0 or positive" if name in self.may_be_zero else "positive"
            raise PlanningError(f"setting {name} is {value}, must be finite and {wanted}")
