"""The paper's planner: obstacles and a goal in, the decoded spline through the shortest path out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.contract.status import Figures, Refusal, Verdict, VerdictCode
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.fitted_spline import fitted_spline
from geodesic_motion_ros.geometry.quaternions import angle_between, continuous_signs, normalise
from geodesic_motion_ros.manifold.latent_graph import refuse_unsupported
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.paper.dense_graph import dense_graph
from geodesic_motion_ros.paper.follower import TimedPath
from geodesic_motion_ros.paper.literal_search import LiteralSearch
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import ENDPOINT_MULTIPLE, Skill
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: Points of a spline that are decoded, and coefficients that it is fitted with.
SAMPLES, COEFFICIENTS = 100, 10
#: What every verdict of this planner says.
CAUTION = "simulation only: nothing is certified, the path may lead through obstacles"


_NOTHING = np.empty(0, dtype=np.int32)


#: zeta with skills of poses whose metric has kappa itself: an obstacle is not noticed beside its numbers below that.
STRENGTH_OF_POSES = 1e9


@dataclass(frozen=True)
class PaperSettings:
    """Settings of the paper's planner.

    Attributes
    ----------
    strength : zeta of the ambient metric.
    speed, angular_speed : of the leading point on paths of poses [m/s], [rad/s].
    speed_scale : share of the joints' velocity limits, on paths of configurations.
    """

    strength: float = 1000.0
    speed: float = 0.2
    angular_speed: float = 0.8
    speed_scale: float = 0.3


@dataclass(frozen=True)
class PaperGoal:
    """A goal on the graph: its node, and the obstacle-free cost (n,) from every node to it by some weights; offset,
    offset_angle : distance [m] and rotation [rad] between what was asked for and what the node decodes to.
    """

    node: int
    weights: WeightedGraph
    field: np.ndarray
    offset: float
    offset_angle: float


class PaperPlanner:
    """Plans to one goal after the other, from wherever the leading point is.

    Attributes
    ----------
    skill, robot : what is planned with.
    path : to the goal, None before there is one. lead : time [s] of the leading point on it.
    held : what the hand holds. Then x is the position of that object, and radii are r_obstacle + r_object.
    """

    def __init__(
        self, skill: Skill, settings: PaperSettings = PaperSettings(), shape: tuple[int, ...] | None = None
    ) -> None:
        """shape : nodes along each latent axis, see `dense_graph`. SkillError: no node is in the skill's support."""
        self.skill, self.settings, self.robot = skill, settings, Robot.named(skill.robot)
        self._of_joints = skill.space == "joint"
        self.graph, self.weights = dense_graph(skill, shape)
        self.search = LiteralSearch(self.graph.adjacency, self.weights, settings.strength)
        self._poses = self._tool_poses(self.graph.latent)
        # Ends are looked for where the decoder can be trusted.
        limit = ENDPOINT_MULTIPLE * skill.sigma_support
        self._trusted = np.flatnonzero(self.graph.sigma < limit)
        refuse_unsupported(int(np.sum(self.graph.sigma < limit)), limit, "rad" if self._of_joints else "m")
        self._obstacles = Obstacles.none()
        self.held: tuple[HeldObject, ...] = ()
        self._held_radius = 0.0
        self._goal: PaperGoal | None = None
        # Whether goal, place or obstacles have changed since the last search began.
        self._search_due = False
        self._nodes = _NOTHING
        self.path: TimedPath | None = None
        self.lead = 0.0

    def prepare_goal(
        self, position: np.ndarray, quaternion: np.ndarray, most: float = math.inf, most_angle: float = math.inf
    ) -> PaperGoal | Refusal:
        """The goal at the node whose tool pose is nearest to (3,) [m], (4,); a refusal where that is farther than
        `most` [m] or `most_angle` [rad].
        """
        node = self._nearest(position, quaternion)
        offset = float(np.linalg.norm(self._poses[0][node] - position))
        angle = float(angle_between(self._poses[1][node], quaternion))
        if offset > most or angle > most_angle:
            return Refusal(
                VerdictCode.GOAL_OUT_OF_SUPPORT,
                f"the goal is {1000 * offset:.0f} mm and {math.degrees(angle):.1f} deg from the nearest pose that the "
                f"skill knows; allowed are {1000 * most:.0f} mm and {math.degrees(most_angle):.1f} deg",
                Figures(goal_offset=offset, goal_offset_angle=angle),
            )  # fmt: skip
        search = self.search
        return PaperGoal(node, search.weights, search.field(node), offset, angle)

    def take_goal(self, goal: PaperGoal) -> None:
        """Plan to a prepared goal from now on."""
        self._goal, self._search_due, self._nodes = goal, True, _NOTHING
        known = goal.weights is self.search.weights
        self.search.aim(goal.node, goal.field if known else self.search.field(goal.node))

    def clear_goal(self) -> None:
        """Stay where the leading point is, and forget the goal."""
        self._goal = None
        self.halt()

    def halt(self) -> None:
        """Stay where the leading point is; the next tick plans to the goal from there."""
        if self.path is not None and not self.path.stands:
            self._stand_at(self.path.latent_at(self.lead), self.path.place_at(self.lead))
        self._search_due = self._goal is not None

    def stand_at(self, place: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Stay at a place (p,), as of `TimedPath`, whose tool pose is (3,) [m], (4,); plan from the nearest node on: in
        joint space that with the nearest configuration.
        """
        node = self._nearest_configuration(place) if self._of_joints else self._nearest(position, quaternion)
        self._stand_at(self.graph.latent[node], place)
        self._search_due = self._goal is not None

    def set_obstacles(self, obstacles: Obstacles) -> Verdict:
        """Plan among spheres from now on; BAD_INPUT where there is anything else: the paper knows nothing else."""
        objection = obstacles.objection()
        if not objection and (len(obstacles.solids) or obstacles.cloud.squares.size):
            objection = "the paper's planner knows spheres only: send SPHERE markers or points, no solids and no clouds"
        if objection:
            return Refusal(VerdictCode.BAD_INPUT, objection)
        if not obstacles.same_places(self._obstacles):
            self._obstacles, self._search_due = obstacles, self._goal is not None
        return Verdict()

    def hold(self, held: Sequence[HeldObject]) -> Verdict:
        """Plan for what the hand holds from now on, nothing or one object; BAD_INPUT where the paper knows no answer.

        Its radius is half its second side: of a sphere and a bottle their own.
        """
        if tuple(held) == self.held:
            return Verdict()
        if held and (len(held) > 1 or not isinstance(self.graph, PoseGraph)):
            poses = isinstance(self.graph, PoseGraph)
            takes = "one held object: detach the others" if poses else "no held object with skills of joints: detach it"
            return Refusal(VerdictCode.BAD_INPUT, f"the paper's planner takes {takes}")
        self.held = tuple(held)
        self._held_radius = 0.5 * float(np.median(held[0].sides)) if held else 0.0
        if isinstance(self.graph, PoseGraph):
            point = np.array([held[0].position if held else np.zeros(3)])
            self.weights = self.graph.transported(Offsets.none(), point)
            self.search = LiteralSearch(self.graph.adjacency, self.weights, self.settings.strength)
        if self._goal is not None:
            self.take_goal(self._goal)
        return Verdict()

    def tick(self, deadline: Deadline = NEVER) -> Verdict:
        """Bring the path up to date with goal and obstacles, until a deadline at most.

        A search that the deadline ends goes on in the next tick, before it looks at newer obstacles; until it has
        ended, the best path known is followed, and the verdict's cost_gap says by how much it may cost too much.
        """
        if self._goal is None or self.path is None:
            return Refusal(VerdictCode.NO_GOAL, "no goal has been given")
        self.search.go_on(deadline)
        if self.search.finished and self._search_due:
            self._begin_search()
            self.search.go_on(deadline)
        if not np.array_equal(self.search.nodes, self._nodes[-len(self.search.nodes) :]):
            self._follow(self.search.nodes)
        # By this the paper tells that a path is infeasible.
        ratio = f"{self.search.energy_ratio:.2g}"
        reason = CAUTION if ratio == "1" else f"{CAUTION}; its energy is {ratio} times that of the free path"
        inside = float(self.graph.sigma[self._nodes].max()) <= self.skill.sigma_limit
        figures = Figures(
            cost_gap=self.search.gap, in_support=inside, goal_offset=self._goal.offset,
            goal_offset_angle=self._goal.offset_angle,
        )  # fmt: skip
        return Verdict(reason=reason, figures=figures)

    @property
    def is_exact(self) -> bool:
        """Whether what is followed is the cheapest path among the newest obstacles."""
        return self.search.finished and not self._search_due

    def advance(self, period: float) -> None:
        """Move the leading point on by a time [s]; where it ends it stays."""
        if self.path is not None:
            self.lead = min(self.lead + period, self.path.duration)

    def plan(self, start: tuple[np.ndarray, np.ndarray], goal: tuple[np.ndarray, np.ndarray]) -> TimedPath:
        """The path between two tool poses (3,) [m], (4,) among the present obstacles; nothing else changes."""
        return self.plan_between(self._nearest(*start), self._nearest(*goal))[0]

    def tool_curve(
        self, start: tuple[np.ndarray, np.ndarray], goal: tuple[np.ndarray, np.ndarray]
    ) -> PoseCurve:
        """The tool's poses along `plan`."""
        return PoseCurve(*self.tool_poses(self.plan(start, goal)))

    def plan_between(self, source: int, target: int, field: np.ndarray | None = None) -> tuple[TimedPath, float]:
        """The path from one node of the graph to another among the present obstacles, and what the shortest path on the
        graph costs, its length in the metric; nothing else changes. field : the target's, where it is known.
        """
        search = LiteralSearch(self.graph.adjacency, self.weights, self.settings.strength)
        search.aim(target, search.field(target) if field is None else field)
        search.begin(source, self._obstacles.centres, self._obstacles.radii + self._held_radius)
        search.go_on()
        return self._decoded(self.graph.latent[search.nodes]), search.cost

    def tool_poses(self, path: TimedPath) -> tuple[np.ndarray, np.ndarray]:
        """Tool positions (n, 3) [m] and quaternions (n, 4) along a path."""
        return self._tool_poses(path.latent)

    def _begin_search(self) -> None:
        """Look for the cheapest path from where the leading point is; what is followed is known already."""
        assert self.path is not None
        here = self.path.latent_at(self.lead)
        known = self._nodes[self._nearest_of(self._nodes, here) :] if len(self._nodes) else None
        source = self.graph.nodes_near(here, 1)[0] if known is None else known[0]
        self.search.begin(int(source), self._obstacles.centres, self._obstacles.radii + self._held_radius, known)
        self._search_due = False

    def _nearest_of(self, nodes: np.ndarray, here: np.ndarray) -> int:
        """Which node of a path (p,) is nearest to a latent point (d,)."""
        return int(np.argmin(np.sum((self.graph.latent[nodes] - here) ** 2, axis=1)))

    def _follow(self, nodes: np.ndarray) -> None:
        """Follow a path from where the leading point is: what of it lies behind is left out."""
        assert self.path is not None
        here = self.path.latent_at(self.lead)
        ahead = nodes[self._nearest_of(nodes, here) + 1 :]
        self.path, self.lead = self._decoded(np.concatenate([here[None], self.graph.latent[ahead]])), 0.0
        self._nodes = nodes

    def _stand_at(self, latent: np.ndarray, place: np.ndarray) -> None:
        self.path, self.lead = TimedPath.standing(place, latent), 0.0
        self.search.abandon()
        self._nodes = _NOTHING

    def _decoded(self, latent: np.ndarray) -> TimedPath:
        """The path of a spline that is fitted to latent points (n, d), at full speed."""
        points = fitted_spline(latent, COEFFICIENTS)(np.linspace(0.0, 1.0, SAMPLES))
        if self._of_joints:
            places = self.skill.decoder.configurations(points)
            needed = np.abs(np.diff(places, axis=0)) / (self.settings.speed_scale * self.robot.velocity_limits)
            steps = needed.max(axis=1)
        else:
            positions, quaternions = self._tool_poses(points)
            places = np.concatenate([positions, quaternions], axis=1)
            moved = np.linalg.norm(np.diff(positions, axis=0), axis=1) / self.settings.speed
            turned = angle_between(quaternions[1:], quaternions[:-1]) / self.settings.angular_speed
            steps = np.maximum(moved, turned)
        return TimedPath.of(steps, places, points)

    def _tool_poses(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._of_joints:
            positions, quaternions = end_effector_poses(self.skill.decoder.configurations(latent), self.robot.chain)
        else:
            decoded = self.skill.decoder.decode(latent)
            positions, quaternions = decoded.positions, normalise(decoded.quaternions)
        return positions, continuous_signs(quaternions)

    def _nearest(self, position: np.ndarray, quaternion: np.ndarray) -> int:
        """The trusted node whose tool pose is nearest by |dx|^2 + |dq|^2."""
        positions, quaternions = (values[self._trusted] for values in self._poses)
        turned = np.minimum(*(np.sum((quaternions - sign * quaternion) ** 2, axis=1) for sign in (1.0, -1.0)))
        return int(self._trusted[np.argmin(np.sum((positions - position) ** 2, axis=1) + turned)])

    def _nearest_configuration(self, configuration: np.ndarray) -> int:
        """The trusted node whose configuration is nearest to (eta,) [rad]."""
        away = np.sum((self.graph.configurations[self._trusted] - configuration) ** 2, axis=1)
        return int(self._trusted[np.argmin(away)])
