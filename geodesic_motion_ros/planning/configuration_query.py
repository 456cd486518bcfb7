"""ConfigurationQuery: a start and a goal configuration, with a skill's graph of configurations transported to them.

As `pose_query.PoseQuery` for poses. A goal that is given as a pose may be reached by several configurations, one in
each family that was demonstrated: the query goes to the one that is cheapest to reach from where the arm is
(`ConfigurationGoal`).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.manifold.node_body import LinkBounds, NodeBody
from geodesic_motion_ros.manifold.shortest_path import cost_field
from geodesic_motion_ros.manifold.transport import corrections_at
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.pose_query import Pose
from geodesic_motion_ros.planning.search import demonstrated_cost
from geodesic_motion_ros.planning.settings import (
    NEAREST_POSES,
    SAME_GOAL,
    SAME_START,
    SAME_TASK_JOINTS,
    PlannerSettings,
)
from geodesic_motion_ros.planning.status import Figures, Verdict, VerdictCode
from geodesic_motion_ros.planning.transported_query import (
    AlongMeanPaths,
    End,
    TransportedQuery,
    TransportedQueryBuilder,
    edges_in_scene,
)
from geodesic_motion_ros.planning.turns import in_turn_of
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.skill.sheet import JointSheet, beyond_demonstrated
from geodesic_motion_ros.skill.skill import ENDPOINT_MULTIPLE, Skill
from geodesic_motion_ros.utils.errors import RobotError


@dataclass(frozen=True)
class ConfigurationGoal:
    """A goal and the configurations that would meet it, best supported first.

    Attributes
    ----------
    configurations : (c, eta) [rad].
    stated : how they were found, for a person.
    """

    configurations: np.ndarray
    stated: str

    def is_same(self, other: ConfigurationGoal) -> bool:
        """Whether the same configurations are meant."""
        return np.array_equal(self.configurations, other.configurations)

    def is_near(self, other: ConfigurationGoal) -> bool:
        """Whether it is hardly elsewhere, and may wait until the arm rests: configurations of a path are near each
        other, and each new goal is followed at once.
        """
        return self.is_same(other)


@dataclass(frozen=True)
class _End:
    """A start or goal configuration and the latent point that is transported onto it.

    Attributes
    ----------
    node : the graph's node at, or nearest to, the latent point (d,).
    decoded : (eta,) of the latent point; requested : (eta,) the configuration.
    beyond : (eta,) what of the difference no demonstration has.
    task_offset : (eta,) from the pole of the demonstrations; zeros where the latent point is no pole.
    """

    latent: np.ndarray
    node: int
    decoded: np.ndarray
    requested: np.ndarray
    beyond: np.ndarray
    task_offset: np.ndarray

    def misfits(self, name: End) -> Figures:
        """Under their names in a Verdict, [rad] over all joints."""
        sizes = (np.linalg.norm(self.requested - self.decoded), np.linalg.norm(self.beyond))
        return {f"{name}_offset": float(sizes[0]), f"{name}_beyond": float(sizes[1])}


@dataclass(frozen=True)
class ConfigurationQuery(TransportedQuery):
    """The query of a skill of configurations: a start, a goal (eta,) [rad], and the graph transported to them.

    decoded : the skill's graph, before it was transported.
    ends : the start and the goal, with the latent points that are transported onto them.
    """

    decoded: ConfigurationGraph
    ends: tuple[_End, _End]

    def turned_to_base(self, covariances: np.ndarray) -> np.ndarray:
        """Covariances (m, 3, 3) themselves: configurations are of the base frame."""
        return covariances

    def configurations_along(self, latent: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, str]:
        """The configurations (m, eta) of a latent curve (m, d): of this kind of query every one is a configuration."""
        decoded = self.decoded.decoder.configurations(latent)
        return self.offsets.carried(decoded, *self.decoded.progress_map(latent)), ""


class ConfigurationQueryBuilder(TransportedQueryBuilder):
    """Finds where on the manifold a start and a goal configuration lie, and transports the graph to them.

    follows_task_frame : configurations are of the base frame.
    """

    follows_task_frame = False

    def __init__(
        self,
        skill: Skill,
        graph: ConfigurationGraph,
        settings: PlannerSettings,
        collision: CollisionModel,
        scene: DeclaredScene | None = None,
    ) -> None:
        """graph : decoded from the skill; collision : of its robot; scene : what always stands around it."""
        super().__init__(skill, graph, settings, len(graph.robot.joint_names), scene)
        assert skill.canonical is None or isinstance(skill.canonical, JointSheet)
        self._sheet = skill.canonical
        self._robot, self._collision, self._links = graph.robot, collision, LinkBounds.of(collision)
        self._point_radii = np.full(len(graph.body), settings.body_radius)
        still = graph.transported(JointOffsets.none(self._robot, graph.mean_path_count), self._unconditioned[1])
        self._unmoved = still.base
        self._demonstrated_cost = demonstrated_cost(graph, self._unmoved, skill.codes)
        self._fields: dict[int, np.ndarray] = {}
        self._poles = {end: self._find_poles(end) for end in ("start", "goal")}
        self._tool_positions, self._tool_quaternions = end_effector_poses(graph.configurations, self._robot.chain)

    def guarding(self, collision: CollisionModel, settings: PlannerSettings) -> ConfigurationQueryBuilder:
        """The same where other spheres are kept away from obstacles, with another margin."""
        other = copy(self)
        other._collision, other._links, other._settings = collision, LinkBounds.of(collision), settings
        return other

    def rebuilt(self, query: ConfigurationQuery) -> ConfigurationQuery:
        """The query of a builder that guards other spheres, with the spheres of this one."""
        return self._between(*query.ends, query.task_start, query.along_mean_paths)

    # ------------------------------------------------------------------ goals

    def goal_by_configuration(self, configuration: np.ndarray, frame: TaskFrame) -> ConfigurationGoal | Verdict:
        """A goal (eta,) [rad], refused where it is too far from what was demonstrated.

        frame : the base frame, in which all configurations are.
        """
        return self._supported(ConfigurationGoal(configuration[None], "the requested configuration"))

    def goal_by_pose(self, pose: Pose, frame: TaskFrame) -> ConfigurationGoal | Verdict:
        """The configurations that hold the tool in a pose of the base frame, searched near every mode that was
        demonstrated; frame : as of `goal_by_configuration`.
        """
        found, reason = self._configurations_at("goal", pose)
        if not found:
            return self._unheld("goal", reason)
        stated = f"the cheapest of {len(found)} configurations near those demonstrated"
        return self._supported(ConfigurationGoal(np.stack(found), stated))

    def _free_of_itself(self, choice: ConfigurationGoal) -> ConfigurationGoal | Verdict:
        """The configurations in which no two links touch."""
        found = [self_clearance(self._collision, self._robot, goal) for goal in choice.configurations]
        free = np.array([clearance > 0.0 for clearance, _ in found])
        if np.any(free):
            return replace(choice, configurations=choice.configurations[free])
        clearance, pair = found[0]
        first, second = (self._collision.link_of(sphere) for sphere in pair)
        reason = f"at the goal '{first}' and '{second}' would overlap by {-1000 * clearance:.0f} mm"
        return Verdict(VerdictCode.IN_COLLISION, reason, clearance=clearance)

    def goal_in_place(self, pose: Pose, frame: TaskFrame, standing: np.ndarray) -> ConfigurationGoal | None:
        """The configuration (eta,) in which the arm stands, where that holds the tool in a requested pose already:
        another one would turn the elbow for nothing. None where it does not; and where the skill shows just such a
        turn.
        """
        here, skill = Pose(*self._robot.forward(standing)), self._skill
        start, end = (Pose(*np.split(given, [3])) for given in (skill.start_pose, skill.goal_pose))
        if not here.is_within(pose, SAME_GOAL) or start.is_within(end, SAME_START):
            return None
        goal = self.goal_by_configuration(standing, frame)
        return None if isinstance(goal, Verdict) else replace(goal, stated="the configuration in which the arm stands")

    def in_turn(self, configuration: np.ndarray) -> np.ndarray:
        """A configuration (eta,) with its continuous joints in the turn in which the graph has them."""
        return in_turn_of(self._graph.configurations, configuration, self._robot)

    def start_by_pose(self, pose: Pose, commanded: np.ndarray | None = None) -> np.ndarray | Verdict:
        """The configuration (eta,) nearest to where demonstrations started that holds the tool in a pose."""
        found, reason = self._configurations_at("start", pose)
        pieces = self._graph.pieces_with_demonstrations()
        ends = [self._end("start", requested, piece) for requested in found for piece in pieces]
        best = min((end for end in ends if end is not None), key=self._misfit, default=None)
        if best is None:
            return self._unheld("start", reason)
        return best.requested

    def _unheld(self, name: End, reason: str) -> Verdict:
        """The refusal of a pose that the arm holds in no configuration, and why in none."""
        held = f"no configuration near the demonstrated ones holds the tool at the {name}: {reason}"
        if not self._robot.takes_poses:
            joints = len(self._robot.joint_names)
            held = f"an arm of {joints} joints holds its tool in few poses, not in that of the {name}: " + (
                "send it a configuration, goal_joints" if name == "goal" else "let it begin in a configuration"
            )
        return Verdict(self._out_of_support(name), held)

    def _configurations_at(self, name: End, pose: Pose) -> tuple[list[np.ndarray], str]:
        """Distinct configurations that hold the tool in a pose, and why there is not one more."""
        found: list[np.ndarray] = []
        reason = ""
        for guess in self._guesses(name, pose):
            # A mean of configurations at a limit may lie beyond it by rounding, a decoded one by more.
            near = np.clip(guess, self._robot.lower, self._robot.upper)
            try:
                configuration = solve(self._robot, pose.position, pose.quaternion, start=near, attempts=1)
            except RobotError as error:
                reason = str(error)
                continue
            if all(np.max(np.abs(configuration - other)) > 1e-2 for other in found):
                found.append(configuration)
        return found, reason

    def _guesses(self, name: End, pose: Pose) -> list[np.ndarray]:
        if self._poles[name]:
            return [pole.requested for pole in self._poles[name]]
        trusted = np.flatnonzero(self._graph.sigma < ENDPOINT_MULTIPLE * self._skill.sigma_support)
        offset = np.linalg.norm(self._tool_positions[trusted] - pose.position, axis=1)
        turn = 1.0 - np.abs(self._tool_quaternions[trusted] @ pose.quaternion)
        nearest = trusted[np.argsort(offset**2 + 2.0 * turn)[:NEAREST_POSES]]
        return list(self._graph.configurations[nearest])

    def _supported(self, choice: ConfigurationGoal) -> ConfigurationGoal | Verdict:
        pieces = self._graph.pieces_with_demonstrations()
        ends = [self._end("goal", requested, piece) for requested in choice.configurations for piece in pieces]
        best = min((end for end in ends if end is not None), key=self._misfit, default=None)
        if best is None:
            return Verdict(VerdictCode.GOAL_OUT_OF_SUPPORT, "the skill has no supported latent point at all")
        verdict = self._offset_verdict("goal", best)
        return self._free_of_itself(choice) if verdict.ok else verdict

    # ------------------------------------------------------------------- ends

    def _find_poles(self, end: End) -> list[_End]:
        sheet = self._sheet
        if sheet is None:
            return []
        groups, means = (
            (sheet.start_groups, sheet.start_poles) if end == "start" else (sheet.goal_groups, sheet.goal_poles)
        )
        poles = []
        for group, mean in enumerate(means):
            latent = self._skill.codes[groups == group, 0 if end == "start" else -1].mean(axis=0)
            node = self._pole_node(latent)
            if end == "goal":
                # A path ends at a node.
                latent = self._graph.latent[node]
            still = np.zeros_like(mean)
            poles.append(_End(latent, node, self._decoded(latent), mean, still, still))
        return poles

    def _decoded(self, latent: np.ndarray) -> np.ndarray:
        return self._graph.decoder.configurations(latent[None])[0]

    def _end(self, name: End, requested: np.ndarray, piece: int) -> _End | None:
        """Where a connected piece meets a configuration; None where none of it is trusted."""
        sheet, ends = self._sheet, []
        for group, pole in enumerate(self._poles[name]):
            assert sheet is not None
            if self._graph.component[pole.node] != piece:
                continue
            demonstrated = sheet.start_offsets[sheet.start_groups == group]
            if name == "goal":
                demonstrated = sheet.goal_offsets[sheet.goal_groups == group]
            offset = requested - pole.requested
            beyond = beyond_demonstrated(offset, demonstrated, sheet.scale)
            ends.append(_End(pole.latent, pole.node, pole.decoded, requested, beyond, offset))
        best = min(ends, key=self._misfit, default=None)
        if best is not None and self._allowed(best):
            return best
        node = self._graph.nearest_node(requested, piece, ENDPOINT_MULTIPLE * self._skill.sigma_support)
        if node is None:
            return best
        decoded = self._graph.configurations[node]
        beyond, still = requested - decoded, np.zeros_like(requested)
        nearest = _End(self._graph.latent[node], node, decoded, requested, beyond, still)
        return nearest if best is None else min(nearest, best, key=self._misfit)

    def _allowed(self, end: _End) -> bool:
        return float(np.linalg.norm(end.beyond)) <= self._settings.maximum_joint_offset

    def _offset_verdict(self, name: End, end: _End) -> Verdict:
        if self._allowed(end):
            return Verdict(VerdictCode.OK, in_support=True, **end.misfits(name))
        worst = int(np.argmax(np.abs(end.beyond)))
        reason = (
            f"the {name} is {np.linalg.norm(end.beyond):.2f} rad from what was demonstrated, most in joint "
            f"'{self._robot.joint_names[worst]}' ({end.beyond[worst]:+.2f} rad); allowed are "
            f"{self._settings.maximum_joint_offset:.2f} rad (setting maximum_joint_offset)"
        )
        return Verdict(self._out_of_support(name), reason, **end.misfits(name))

    # ------------------------------------------------------------------ query

    def build(self, start: np.ndarray, goal: ConfigurationGoal) -> ConfigurationQuery | Verdict:
        """Choose both ends on one connected piece of the manifold and transport the graph to the query."""
        pairs = []
        for piece in self._graph.pieces_with_demonstrations():
            here = self._end("start", start, piece)
            if here is None:
                continue
            for requested in goal.configurations:
                there = self._end("goal", requested, piece)
                if there is not None:
                    pairs.append((here, there))
        if not pairs:
            return Verdict(VerdictCode.START_OUT_OF_SUPPORT, "no supported latent point near start and goal")
        good = [pair for pair in pairs if self._allowed(pair[0]) and self._allowed(pair[1])]
        if not good:
            here, there = min(pairs, key=lambda pair: self._misfit(pair[0]) + self._misfit(pair[1]))
            verdict = self._offset_verdict("start", here)
            return self._offset_verdict("goal", there) if verdict.ok else verdict
        here, there = min(good, key=lambda pair: self._unmoved_cost(*pair))
        along_mean_paths = self._chosen_mean_paths(here.task_offset, there.task_offset)
        return self._between(here, there, here.task_offset, along_mean_paths)

    def redirected(
        self, query: ConfigurationQuery, start: np.ndarray, latent: np.ndarray, goal: ConfigurationGoal
    ) -> ConfigurationQuery | Verdict | None:
        """The query that goes on from a configuration on the path of an older one, at its latent point, to a new goal.

        None where the latent point is not connected to any node: then the query has to be built anew.
        """
        piece = int(self._graph.component[query.goal_node])
        node = self._graph.node_near(latent, self._graph.component == piece, 1)
        if node is None:
            return None
        still = np.zeros_like(start)
        here = _End(latent, node, self._decoded(latent), start, still, query.task_start)
        ends = [end for requested in goal.configurations if (end := self._end("goal", requested, piece)) is not None]
        allowed = [end for end in ends if self._allowed(end)]
        if not allowed:
            return self._offset_verdict("goal", min(ends, key=self._misfit)) if ends else None
        there = min(allowed, key=lambda end: self._unmoved_cost(here, end))
        along_mean_paths = query.along_mean_paths
        if np.linalg.norm(there.task_offset - query.task_goal) > SAME_TASK_JOINTS:
            along_mean_paths = self._chosen_mean_paths(query.task_start, there.task_offset)
        along, _ = query.configurations_along(latent[None], start)
        moved = np.linalg.norm(self._robot.forward(start)[0] - self._robot.forward(along[0])[0])
        progress, _ = self._graph.progress_map(latent[None])
        displaced = float(moved) + query.displaced_at(progress)
        return replace(self._between(here, there, query.task_start, along_mean_paths), displaced=displaced)

    def other_posture(self, query: ConfigurationQuery) -> None:
        """None: in which posture a path is followed is what was demonstrated."""

    def first_posture(self, query: ConfigurationQuery) -> ConfigurationQuery:
        """The query itself."""
        return query

    def _unmoved_cost(self, here: _End, there: _End) -> float:
        """Obstacle-free cost between two nodes where the skill was demonstrated."""
        if there.node not in self._fields:
            self._fields[there.node] = cost_field(self._graph.adjacency, self._unmoved, there.node)
        return float(self._fields[there.node][here.node])

    def _between(
        self, here: _End, there: _End, task_start: np.ndarray, along_mean_paths: AlongMeanPaths
    ) -> ConfigurationQuery:
        corrections, conformal, mean_paths = along_mean_paths
        progress, shares = self._graph.progress_map(np.stack([here.latent, there.latent]))
        decoded = np.stack([here.decoded, there.decoded]) + corrections_at(corrections, progress, shares)
        requested, along = np.stack([here.requested, there.requested]), (float(progress[0]), float(progress[1]))
        offsets = JointOffsets.between(self._robot, decoded, requested, along, corrections, self._skill.fade)
        graph = self._graph.transported(offsets, conformal)
        body = NodeBody.of_arm(
            graph.configurations, graph.body_points, self._point_radii, self._collision, self._links, self._robot
        )
        margin = self._settings.obstacle_margin
        graph = graph.without(edges_in_scene(self._scene, graph, body, here.node, there.node, margin))
        return ConfigurationQuery(
            start=here.requested,
            goal=there.requested,
            start_latent=here.latent,
            goal_node=there.node,
            body=body,
            offsets=offsets,
            graph=graph,
            field=self._graph.field(mean_paths, self._settings.ridge_strength),
            **self._costs(graph, here.node, there.node),
            misfits=here.misfits("start") | there.misfits("goal"),
            task_start=task_start,
            task_goal=there.task_offset,
            along_mean_paths=along_mean_paths,
            decoded=self._graph,
            ends=(here, there),
        )
