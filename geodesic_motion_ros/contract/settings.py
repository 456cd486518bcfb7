"""The numbers that decide how the planner behaves: its constants, and the settings that a user chooses
(`PlannerSettings`).

A constant states its unit and the range in which it makes sense. Numbers that are a matter of numerics alone
(tolerances of solvers, rounding) stand where they are used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from numbers import Integral, Real
from typing import ClassVar, Literal, NamedTuple, get_args

import numpy as np

from geodesic_motion_ros.manifold.ambient_law import LAWS, AmbientLaw
from geodesic_motion_ros.trajectory.tool_limits import ToolLimits
from geodesic_motion_ros.utils.checked_numbers import LARGEST_NUMBER, check_number, real_array
from geodesic_motion_ros.utils.errors import PlanningError

# ------------------------------------------------------------------ clearance of moving obstacles

#: New paths among obstacles of which one moves are certified with this multiple of the obstacle margin, from 1 on:
#: nothing moves exactly as expected.
DYNAMIC_MARGIN_FACTOR = 2.0
#: An arm that sets out or goes on among moving obstacles must be able to stop this long later [s], the latency or
#: more: by then the next tick has certified its path again.
REPLAN_DELAY = 0.03
#: The places where a moving obstacle may halt on its predicted line are covered by this many spheres, from 2 on; the
#: first stands where the obstacle was last detected.
STOP_POSITION_SAMPLES = 12
#: Obstacles are enlarged by the arm's tracking error, rounded up to steps of this [m]: smaller changes need no new
#: certificate.
TRACKING_ERROR_STEP = 1e-3
#: The arm's lag is rounded up to steps of this [s], for the same reason.
LAG_STEP = 0.01

# ------------------------------------------------------------------ when a path is searched again

#: While the present path is free, a better one is searched once in this time [s]; so is an
#: evasion path where none was found, and an approach.
SEARCH_PERIOD = 0.1
#: A new path replaces a free one where the rest of the free one takes longer by this factor, from 1 on.
WORTHWHILE_RATIO = 1.05

# ------------------------------------------------------------------ how a path is searched


class Attempt(NamedTuple):
    """One kind of search for a path to the goal: with which margin, and how obstacles that move are counted.

    multiple : the search keeps this multiple of the obstacle margin.
    optimistic : the search counts standing obstacles alone, and the certificate does not count a moving one after the
        prediction: it is expected to have left the path by then.
    """

    multiple: float
    optimistic: bool = False


#: The attempts at a path, in their order, until one is certified. The second keeps far enough off that smoothing does
#: not cut into obstacles.
ATTEMPTS = Attempt(1.0), Attempt(4.0), Attempt(1.0, optimistic=True)
#: Width [grid steps] by which a refined path, which has no corners of the grid, is smoothed: first in the latent space,
#: then decoded.
REFINED_WIDTH = 1.0
#: Width [grid steps] by which a path that is not refined is smoothed, likewise.
UNREFINED_WIDTH = 2.0
#: Configurations that hold a path of tool poses are smoothed by this multiple of that width, from 1 on: that takes out
#: kinks of the decoder and of the corrections along mean paths, of a millimetre or two.
TOOL_SMOOTHING_FACTOR = 3.0
#: Multiples of the obstacle margin that `PosePathPlanner` attempts.
MARGIN_MULTIPLES = (1.0, 2.5)
#: Smoothing widths [grid steps] that it attempts with each of them: of the latent path, then of the decoded poses.
SMOOTHING_WIDTHS = ((1.5, 1.5), (0.7, 1.5), (0.0, 1.0))
#: A path may enter the graph up to this many grid steps from the start.
ENTRY_STEPS = 3
#: The smoothed curve may leave the pruned nodes by this factor of sigma, from 1 on, before it counts as unsupported.
CURVE_SIGMA_FACTOR = 1.2

# ------------------------------------------------------------------ evasion

#: An evasion target on the graph is no more grid steps away than this.
EVASION_STEPS = 30
#: About this many of the nodes within these steps are evaluated.
EVASION_NODES = 500
#: This many evasion targets are tried, the nearest first.
EVASION_TARGETS = 4
#: The directions of any two of them have no larger cosine than this.
EVASION_COSINE = 0.7
#: Where the search of a place on the graph failed, and an obstacle meets the arm within this time [s], the tool is
#: displaced by up to so much [m], or the arm swivels by up to so much [rad]; where that does not do, by up to twice as
#: much.
EVASION_DISPLACED_WITHIN, EVASION_DISPLACEMENT, EVASION_SWIVEL = 0.6, 0.15, 0.6
#: So many of these targets are tried.
EVASION_DISPLACED = 3
#: An arm that goes to its goal makes room for what would meet it there within this time [s].
ROOM_WITHIN = 1.2

# ------------------------------------------------------------------ goals that are covered

#: An arm sets out towards a covered goal, or sets out again, where that shortens the rest of the path by this [m], as
#: the sphere of the arm that moves farthest passes it: an arm does not follow every little move of the obstacle.
APPROACH_GAIN = 0.01
#: An approach keeps this multiple of the obstacle margin, more than `DYNAMIC_MARGIN_FACTOR`: where the arm comes to
#: stand it may have to set out among moving obstacles, and the detected position of the obstacle before it trembles.
APPROACH_MARGIN_FACTOR = 3.0
#: An approach to which its certificate objects is made shorter at most this many times, from 0 on.
APPROACH_CUTS = 3

# ------------------------------------------------------------------ detours

#: The tool leaves what was demonstrated by no more than this [m].
LARGEST_DETOUR = 0.30

#: Distance between two samples of the lattice along the base path [m].
DETOUR_SPACING = 0.03
#: Distance between two displacements of the lattice, at most [m].
DETOUR_LATTICE_SPACING = 0.085
#: Angle between two swivels of the lattice [rad].
DETOUR_SWIVEL_SPACING = 0.6
#: Swivels of the lattice to either side.
DETOUR_SWIVELS = 2
#: A rotation of the tool or of the joints counts as this length along the base path [m/rad].
DETOUR_METRES_PER_RADIAN = 0.1
#: A swivel counts as this length beside the base path [m/rad].
DETOUR_METRES_PER_SWIVEL = 0.05
#: A detour costs twice as much per length where the tool is displaced by the standard deviation of the demonstrations,
#: which counts as this at least [m].
DETOUR_NARROWEST_SPREAD = 0.02
#: It costs twice as much per length, too, where the arm has swivelled by this [rad].
DETOUR_SWIVEL_SPREAD = 0.6
#: An obstacle nearer than this makes a detour dearer [m].
DETOUR_FELT_CLEARANCE = 0.03
#: It makes it dearer by this multiple of its cost where it touches.
DETOUR_NEARNESS_STRENGTH = 4.0
#: Between neighbours of the lattice no joint turns farther than this [rad].
DETOUR_LARGEST_JOINT_STEP = 0.7

# ------------------------------------------------------------------ goals and postures

#: `plan` begins in the posture in which the arm stands where its tool is this near the requested start [m], [rad].
SAME_START = 0.005, 0.02
#: A goal of the tool that differs by no more than this is the same goal, received again [m], [rad].
SAME_GOAL = 1e-6, 1e-6
#: A goal configuration of which no joint is farther from where the arm stands is that place [rad].
SAME_CONFIGURATION = 1e-6
#: A goal of the tool that differs by no more than this waits until the arm rests [m], [rad].
NEAR_GOAL = 2e-3, 1e-2
#: A goal pose that moves no further than this during a motion leaves the choice between the demonstrations as it is
#: [m], where a radian counts as `POSE_SCALE` metres.
SAME_TASK_POSE = 0.02
#: A goal configuration that moves no further than this does so, too [rad].
SAME_TASK_JOINTS = 0.05
#: Offsets of both ends that differ by no more than this are those of a motion that comes round [rad].
SAME_ROUND = 1e-3
#: A round that is to begin beside those that were shown is a round moved as a whole, as far as this multiple of their
#: spread; further off it begins where rounds pass nearest. Of 600 held-out beginnings of simulated rounds 99 % are so
#: near.
BEGINS_WITHIN = 1.5
#: Paths of closed skills are drawn to the mean path by this multiple of `ridge_strength`. A path cuts a bend by about
#: kappa sigma^2 / a, with kappa its curvature and sigma how far demonstrations lie apart, and rounds are all bends.
ROUND_RIDGE = 4.0
#: A round is joined to the next where that is as smooth as the rounds, until this share of it is left; then anyhow.
LAST_JOIN = 0.2
#: A motion that was joined to another one begins: its first part of this time [s].
JOIN_LASTS = 0.3
#: A goal pose is searched from this many of the nearest nodes where the demonstrations have no common ends.
NEAREST_POSES = 3
#: A base path is smoothed by this width in the latent space [grid steps].
BASE_PATH_SMOOTHING = 1.5
#: An edge along which a joint turns farther than this is removed [rad]: the arm would change its posture there.
LARGEST_JOINT_STEP = 0.3
#: Steps along the null vectors of the tool's Jacobian by which postures differ [rad], in the order in which they are
#: tried.
SWIVELS = 0.0, 0.5, -0.5, 1.0, -1.0
#: The arm begins to swivel where it stands, and has swivelled into another posture at this progress, up to 1.
SWIVELLED_AT = 0.4

# ------------------------------------------------------------------ settings

#: Limits of the tool with skills of tool poses, where no others are set.
TOOL_LIMITS = ToolLimits(speed=0.2, angular_speed=0.8, acceleration=1.5)
#: Which spheres of the arm are kept away from obstacles: all, or the tool's alone.
Avoid = Literal["arm", "tool"]
#: How detours count places that are not declared as seen: as free, or as occupied.
Unseen = Literal["free", "blocked"]
#: How fast motions to a goal are: as was shown, or as fast as can be.
Timing = Literal["demonstrated", "fastest"]


#: Settings that may change while the arm moves (`ReactivePlanner.change_settings`).
CHANGEABLE = (
    "obstacle_margin", "obstacle_position_error", "speed_scale", "acceleration_scale", "speed", "angular_speed",
    "acceleration", "speed_override", "timing", "periodic", "rounds",
)  # fmt: skip


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
        enlarged by it, and by how far the arm was off its path (`motion/tracking.py`), before anything is searched or
        certified: a certified motion keeps this distance from every obstacle as it was received and predicted. The
        declared scene is not enlarged.
    ambient_strength, ambient_width_ratio : zeta, and Gaussian width over (obstacle + body radius), of the soft metric.
    ambient_law : how the soft metric grows towards obstacles: gaussian, completed, or hard: not at all
        (`manifold/ambient_metric.py`).
    ridge_strength : a of the conformal factor exp(a u^2) off the modes' mean paths (`manifold.mean_path`), which
        were called ridges; 0 leaves the plain pull-back metric.
    cost_cap : a path that costs more than this multiple of a demonstration without obstacles counts as blocked.
    query_conditioning : let start and goal choose between the demonstrations, where the skill found that it helps.
    prediction : obstacles are expected to move on linearly for this time [s], enlarged by the errors of their
        velocities (`velocity_history.py`), and to stand then. Where that leaves no path, an optimistic attempt does not
        count a moving obstacle after it. It must be longer than a stop takes, 0.5 s with the latency: the arm cannot
        stop for an obstacle that comes into sight later.
    avoidance : False ignores obstacles altogether; for control experiments only.
    avoid : "arm": the whole arm is kept away from obstacles; "tool": the tool's spheres alone.
    grid_shape, neighbours : of the latent graph; None: the skill's own.
    refine : make the graph's shortest paths continuous ones, which know no directions of a grid.
    tool_points, tool_radii : spheres (K, 3), (K,) fixed in the tool frame. The metric of a skill of tool poses sees
        them, and with `avoid` "tool" they alone are kept away from obstacles.
    maximum_offset, maximum_offset_angle : how far start and goal of a skill of tool poses may lie from the manifold, or
        beyond the starts and goals that were demonstrated.
    maximum_joint_offset : how far start and goal of a skill of configurations may, over all joints [rad].
    body_radius : radius of the body around its points, as the soft metric of a skill of configurations sees it. The
        removal of nodes and the certificate use the arm's collision spheres instead.
    speed_scale, acceleration_scale : share of the joints' velocity limits, up to `Robot.largest_speed_scale`, and of
        their acceleration and jerk limits.
    speed, angular_speed : limits of the tool [m/s], [rad/s]. 0: none; None: 0.2 and 0.8 with skills of tool poses, none
        with those of configurations.
    acceleration : limit of the tool's acceleration [m/s^2], tangential and centripetal together; None: 1.5, or none.
        That of the angular acceleration follows: full angular speed is reached in the time that full speed takes.
    speed_override : in (0, 1]: the limits of all speeds, of the joints and of the tool, are this share of the above.
    timing : "demonstrated": a motion to a goal is nowhere faster, at the same progress, than the demonstrations were on
        average, if the skill knows, times `speed_override`, but where what moves leaves no such motion; "fastest": as
        fast as the limits allow.
    periodic : a closed skill goes on round after round, until the goal is dropped, or `rounds` are done.
    rounds : after so many rounds a periodic motion ends at its goal; 0: it goes on.
    latency : a new reference takes over this long after its planning began [s].
    detour : how far the tool may leave what was demonstrated where obstacles block every demonstrated path, up to
        `LARGEST_DETOUR`, if it was declared what stands around the arm, and where it evades; 0: it waits there, and
        evades along demonstrated paths alone.
    unseen : "blocked": detours stay inside the declared scene's list `seen`, and where the arm passes along the base
        path (`certification/seen_volume.py`); "free": they lead wherever no obstacle is known.
    patience : a detour begins when obstacles have stood, or have blocked the arm, for this time [s]: they may leave by
        themselves.
    approach_covered_goal : True: where a standing obstacle covers the goal, the arm goes along its path as near to it
        as it can; False: it waits where it is.
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
    speed_override: float = 1.0
    timing: Timing = "demonstrated"
    periodic: bool = False
    rounds: int = 0
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

    def tool_limits(self, default: ToolLimits) -> ToolLimits:
        """Return limits of the tool: by default those of the skill's space."""
        chosen = {field.name: getattr(self, field.name) for field in fields(ToolLimits)}
        full = replace(default, **{name: value for name, value in chosen.items() if value is not None})
        share = self.speed_override
        return replace(full, speed=share * full.speed, angular_speed=share * full.angular_speed)

    @property
    def joint_speed_scale(self) -> float:
        """Share of the joints' velocity limits that counts."""
        return self.speed_scale * self.speed_override

    def __post_init__(self) -> None:
        self._check_choices()
        self._check_tool()
        for field in fields(self):
            name, value = f"setting {field.name}", getattr(self, field.name)
            if field.type == "bool" and not isinstance(value, bool):
                raise PlanningError(f"{name} is {value!r:.60}, must be True or False")
            if field.type == "float" or (field.type == "float | None" and value is not None):
                self._check_number(field.name, value)
        self._check_grid()
        if not _is_whole(self.rounds, 0):
            raise PlanningError(f"setting rounds is {self.rounds!r:.60}, must be a whole number: 0, or how many")

    def _check_choices(self) -> None:
        offered = {"ambient_law": LAWS} | {
            name: get_args(kind) for name, kind in (("avoid", Avoid), ("unseen", Unseen), ("timing", Timing))
        }
        for name, choices in offered.items():
            if getattr(self, name) not in choices:
                raise PlanningError(f"setting {name} is '{getattr(self, name)}', must be one of {', '.join(choices)}")

    def _check_tool(self) -> None:
        points = real_array("setting tool_points", self.tool_points, ("K", 3))
        radii = real_array("setting tool_radii", self.tool_radii, ("K",))
        if len(points) != len(radii) or not len(points):
            raise PlanningError(
                f"{len(points)} tool points and {len(radii)} tool radii: give one radius per point, and at least one"
            )
        if not np.all(np.isfinite(points)):
            raise PlanningError("tool_points must be finite (x, y, z) triples in the tool frame [m]")
        for radius in radii:
            check_number("tool radius [m]", radius, 0.0, LARGEST_NUMBER)

    def _check_grid(self) -> None:
        shape, neighbours = self.grid_shape, self.neighbours
        if shape is not None and not (isinstance(shape, tuple | list) and all(_is_whole(side, 2) for side in shape)):
            raise PlanningError(f"setting grid_shape is {shape!r:.60}, must be whole numbers from 2 on, or None")
        if neighbours is not None and not _is_whole(neighbours, 1):
            raise PlanningError(f"setting neighbours is {neighbours!r:.60}, must be a positive whole number, or None")

    def _check_number(self, name: str, value: object) -> None:
        if isinstance(value, bool) or not isinstance(value, Real):
            raise PlanningError(f"setting {name} is {value!r:.60}, must be a real number")
        number = float(value)
        allowed = number >= 0.0 if name in self.may_be_zero else number > 0.0
        if name == "speed_override" and number > 1.0:
            raise PlanningError(f"setting speed_override is {value}, must be at most 1")
        if name == "detour" and not number <= LARGEST_DETOUR:
            raise PlanningError(f"setting detour is {value} m, must be at most {LARGEST_DETOUR} m")
        if not (allowed and math.isfinite(number)):
            wanted = "0 or positive" if name in self.may_be_zero else "positive"
            raise PlanningError(f"setting {name} is {value}, must be finite and {wanted}")


def _is_whole(value: object, lowest: int) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= lowest
