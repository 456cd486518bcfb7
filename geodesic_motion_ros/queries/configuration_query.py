"""Queries of skills of configurations, R^eta: their graph of configurations, each node held as it is.

A goal that is given as a pose may be reached by several configurations, one in each family that was demonstrated: the
query goes to the one that is cheapest to reach from where the arm is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import (
    NEAREST_POSES,
    SAME_GOAL,
    SAME_ROUND,
    SAME_START,
    SAME_TASK_JOINTS,
    PlannerSettings,
)
from geodesic_motion_ros.contract.status import Figures, Refusal, VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.manifold.metric_field import MetricField
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.shortest_path import cost_field
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.queries.query import AlongMeanPaths, ArmQuery, End, EndName, Goal, edges_in_scene
from geodesic_motion_ros.queries.query_builder import QueryBuilder
from geodesic_motion_ros.queries.turns import in_turn_of
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import ENDPOINT_MULTIPLE, Skill
from geodesic_motion_ros.utils.errors import RobotError


@dataclass(frozen=True)
class ConfigurationGoal(Goal[np.ndarray]):
    """A goal and the configurations that would meet it, best supported first.

    configurations : (c, eta) [rad].
    """

    configurations: np.ndarray
    stated: str
    frame: TaskFrame = field(default_factory=TaskFrame.identity)

    @property
    def outputs(self) -> Sequence[np.ndarray]:
        return list(self.configurations)

    def is_same(self, other: ConfigurationGoal) -> bool:
        return np.array_equal(self.configurations, other.configurations)

    def is_near(self, other: ConfigurationGoal) -> bool:
        """Whether the same is meant: configurations of a path are near each other, and each is followed at once."""
        return self.is_same(other)


class ConfigurationLift:
    """Nodes that are configurations already, of the base frame."""

    def configurations_along(self, query: ArmQuery, latent: np.ndarray, start: np.ndarray) -> np.ndarray:
        decoded = query.decoded.decoder.configurations(latent)
        return query.offsets.carried(decoded, *query.decoded.progress_map(latent))

    def turn_to_base(self, covariances: np.ndarray) -> np.ndarray:
        return covariances


class ConfigurationQueryBuilder(QueryBuilder[np.ndarray]):
    """Makes the queries of a skill of configurations.

    follows_task_frame : configurations are of the base frame.
    """

    follows_task_frame = False
    _same_task = SAME_TASK_JOINTS

    def __init__(
        self,
        skill: Skill,
        graph: ConfigurationGraph,
        settings: PlannerSettings,
        robot: Robot,
        collision: CollisionModel,
        scene: DeclaredScene | None = None,
    ) -> None:
        """As of `QueryBuilder`."""
        self._point_radii = np.full(len(graph.body), settings.body_radius)
        self._fields: dict[int, np.ndarray] = {}
        super().__init__(skill, graph, settings, robot, collision, scene, np.ones(len(robot.joint_names)))
        # Queries whose ends choose between no demonstrations share their corrections.
        self._steps = self._graph.tool_steps(self._unconditioned.corrections)
        self._tool_positions, self._tool_quaternions = end_effector_poses(graph.configurations, self._robot.chain)

    # ------------------------------------------------------ ends of an arm

    def goal_by_configuration(self, configuration: np.ndarray, frame: TaskFrame) -> ConfigurationGoal | Refusal:
        return self._supported(ConfigurationGoal(configuration[None], "the requested configuration"))

    def goal_by_pose(self, pose: Pose, frame: TaskFrame) -> ConfigurationGoal | Refusal:
        """The configurations that hold the tool in a pose of the base frame, searched near every mode that was
        demonstrated; or why there are none.
        """
        found, reason = self._configurations_at("goal", pose)
        if not found:
            return self._unheld("goal", reason)
        stated = f"the cheapest of {len(found)} configurations near those demonstrated"
        return self._supported(ConfigurationGoal(np.stack(found), stated))

    def goal_in_place(self, pose: Pose, frame: TaskFrame, standing: np.ndarray) -> ConfigurationGoal | None:
        """The configuration (eta,) in which the arm stands, where that holds the tool in a requested pose already:
        another one would turn the elbow for nothing. None where it does not; and where the skill shows just such a
        turn.
        """
        here, skill = Pose(*self._robot.forward(standing)), self._skill
        start, end = (Pose(*np.split(given, [3])) for given in (skill.start_pose, skill.goal_pose))
        if not here.is_within(pose, SAME_GOAL) or (start.is_within(end, SAME_START) and self._round_frame is None):
            return None
        goal = self.goal_by_configuration(standing, frame)
        return None if isinstance(goal, Refusal) else replace(goal, stated="the configuration in which the arm stands")

    def start_by_pose(self, pose: Pose, commanded: np.ndarray | None = None) -> np.ndarray | Refusal:
        """The configuration (eta,) nearest to where demonstrations started that holds the tool in a pose."""
        found, reason = self._configurations_at("start", pose)
        pieces = self._graph.pieces_with_demonstrations()
        ends = [self._end("start", requested, piece) for requested in found for piece in pieces]
        best = min((end for end in ends if end is not None), key=lambda end: end.misfit, default=None)
        if best is None:
            return self._unheld("start", reason)
        return best.requested

    def in_turn(self, configuration: np.ndarray) -> np.ndarray:
        """A configuration (eta,) with its continuous joints in the turn in which the graph has them."""
        return in_turn_of(self._graph.configurations, configuration, self._robot)

    def _supported(self, choice: ConfigurationGoal) -> ConfigurationGoal | Refusal:
        """A goal that is near enough to what was demonstrated, with the configurations in which no two links touch."""
        refusal = self.goal_refusal(choice.outputs)
        if refusal is not None:
            return refusal
        found = [self_clearance(self._collision, self._robot, goal) for goal in choice.configurations]
        free = np.array([clearance > 0.0 for clearance, _ in found])
        if np.any(free):
            return replace(choice, configurations=choice.configurations[free])
        clearance, pair = found[0]
        first, second = (self._collision.link_of(sphere) for sphere in pair)
        reason = f"at the goal '{first}' and '{second}' would overlap by {-1000 * clearance:.0f} mm"
        return Refusal(VerdictCode.IN_COLLISION, reason, Figures(clearance=clearance))

    def _unheld(self, name: EndName, reason: str) -> Refusal:
        """The refusal of a pose that the arm holds in no configuration, and why in none."""
        held = f"no configuration near the demonstrated ones holds the tool at the {name}: {reason}"
        if not self._robot.takes_poses:
            joints = len(self._robot.joint_names)
            held = f"an arm of {joints} joints holds its tool in few poses, not in that of the {name}: " + (
                "send it a configuration, goal_joints" if name == "goal" else "let it begin in a configuration"
            )
        return Refusal(self._out_of_support(name), held)

    def _configurations_at(self, name: EndName, pose: Pose) -> tuple[list[np.ndarray], str]:
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

    def _guesses(self, name: EndName, pose: Pose) -> list[np.ndarray]:
        if self._poles[name] and self._round_frame is None:
            return [pole.mean for pole in self._poles[name]]
        trusted = np.flatnonzero(self._graph.sigma < ENDPOINT_MULTIPLE * self._skill.sigma_support)
        offset = np.linalg.norm(self._tool_positions[trusted] - pose.position, axis=1)
        turn = 1.0 - np.abs(self._tool_quaternions[trusted] @ pose.quaternion)
        nearest = trusted[np.argsort(offset**2 + 2.0 * turn)[:NEAREST_POSES]]
        return list(self._graph.configurations[nearest])

    # -------------------------------------------------------------- postures

    def rebuild(self, query: ArmQuery) -> ArmQuery:
        rebuilt = self._between(*query.ends, query.task_start, query.along_mean_paths)
        return replace(rebuilt, displaced=query.displaced, lift=query.lift)

    def other_posture(self, query: ArmQuery) -> None:
        """None: in which posture a path is followed is what was demonstrated."""

    def first_posture(self, query: ArmQuery) -> ArmQuery:
        """The query itself."""
        return query

    def _held(self, query: ArmQuery, frame: TaskFrame, start: np.ndarray) -> ArmQuery:
        return replace(query, lift=ConfigurationLift())

    # ------------------------------------------------------------- the space

    def _output(self, configuration: np.ndarray, frame: TaskFrame) -> np.ndarray:
        return configuration

    def _groups(self, name: EndName) -> list[tuple[np.ndarray, np.ndarray]]:
        sheet: Any = self._skill.canonical
        if sheet is None:
            return []
        starts, goals = (sheet.start_groups, sheet.start_poles), (sheet.goal_groups, sheet.goal_poles)
        groups, means = starts if name == "start" else goals
        return [(groups == group, mean) for group, mean in enumerate(means)]

    def _decoded(self, latent: np.ndarray) -> np.ndarray:
        decoded: np.ndarray = self._graph.decoder.configurations(latent[None])[0]
        return decoded

    def _nearest_node(self, requested: np.ndarray, piece: int, sigma_limit: float) -> int | None:
        node: int | None = self._graph.nearest_node(requested, piece, sigma_limit)
        return node

    def _difference(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        return end - start

    def _is_same_each_round(self, query: ArmQuery) -> bool:
        here, there = query.ends
        return bool(np.linalg.norm(there.offset - here.offset) < SAME_ROUND)

    def _shown(self, values: Sequence[np.ndarray]) -> np.ndarray:
        return values[0]

    def _values(self, output: np.ndarray) -> Sequence[np.ndarray]:
        return (output,)

    def _offsets_of(self, start: np.ndarray, ends: Sequence[np.ndarray]) -> np.ndarray:
        offsets: np.ndarray = ends[0] - start
        return offsets

    def _lengths(self, offset: np.ndarray) -> tuple[float, ...]:
        return (float(np.linalg.norm(offset)),)

    def _limits(self) -> tuple[float, ...]:
        return (self._settings.maximum_joint_offset,)

    def _stated_misfit(self, end: End[np.ndarray]) -> str:
        worst = int(np.argmax(np.abs(end.beyond)))
        return (
            f"{end.misfit:.2f} rad from what was demonstrated, most in joint '{self._robot.joint_names[worst]}' "
            f"({end.beyond[worst]:+.2f} rad); allowed are {self._settings.maximum_joint_offset:.2f} rad (setting "
            "maximum_joint_offset)"
        )

    def _preference(self, here: End[np.ndarray], there: End[np.ndarray]) -> float:
        """The cost between two nodes without obstacles, where the skill was demonstrated."""
        if there.node not in self._fields:
            self._fields[there.node] = cost_field(self._graph.adjacency, self._unmoved, there.node)
        return float(self._fields[there.node][here.node])

    def _unmoved_lengths(self, conformal: np.ndarray | None) -> np.ndarray:
        none = JointOffsets.none(self._robot, self._graph.mean_path_count)
        lengths: np.ndarray = self._graph.transported(none, conformal).base
        return lengths

    def _offsets(
        self,
        here: End[np.ndarray],
        there: End[np.ndarray],
        progress: tuple[float, float],
        corrected: np.ndarray,
        corrections: np.ndarray,
    ) -> JointOffsets:
        decoded, requested = np.stack([here.decoded, there.decoded]), np.stack([here.requested, there.requested])
        return JointOffsets.between(
            self._robot, decoded + corrected, requested, progress, corrections, self._skill.fade
        )

    def _carried(
        self, offsets: JointOffsets, ends: tuple[int, int], along_mean_paths: AlongMeanPaths
    ) -> tuple[WeightedGraph, MetricField, NodeBody]:
        steps = self._steps if along_mean_paths is self._unconditioned else None
        nodes = self._graph.carried(offsets, steps)
        points = self._graph.body
        body = NodeBody.of_arm(nodes, points, self._point_radii, self._collision, self._links, self._robot)
        graph = self._graph.weighted(nodes, body.points, along_mean_paths.conformal)
        graph = graph.without(edges_in_scene(self._scene, graph, body, *ends, self._settings.obstacle_margin))
        return graph, self._graph.field(along_mean_paths.mean_paths, self._ridge_strength), body

    def _tool_moved(self, query: ArmQuery, latent: np.ndarray, start: np.ndarray) -> float:
        decoded = self._graph.decoder.configurations(latent[None])
        along = query.offsets.carried(decoded, *self._graph.progress_map(latent[None]))
        return float(np.linalg.norm(self._robot.forward(start)[0] - self._robot.forward(along[0])[0]))
