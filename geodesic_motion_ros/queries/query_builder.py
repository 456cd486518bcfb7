"""QueryBuilder: a start and a goal that are requested -> the query between them.

Which latent points are transported onto start and goal:

- on a canonical sheet, learned from endpoint-normalised demonstrations, where all of these start and where all end, its
  *poles*, as long as what is requested lies within the starts and goals that were demonstrated, or not further beyond
  them than the limits allow;
- otherwise, and always on the raw sheet, the nearest trusted nodes of the manifold.

A closed skill, learned from rounds, has poles all along the round: where it passes nearest to what is requested. A goal
lies ahead of the start, a whole round where both are the same.

Start and goal may choose between the demonstrations: then the corrections along the mean paths, and how near to them
paths stay, are those of demonstrations with such ends.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any, ClassVar, Generic, get_args

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import BEGINS_WITHIN, ROUND_RIDGE, PlannerSettings
from geodesic_motion_ros.contract.status import Figures, Refusal, VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.metric_field import MetricField
from geodesic_motion_ros.manifold.node_body import LinkBounds, NodeBody
from geodesic_motion_ros.manifold.shortest_path import cost_field
from geodesic_motion_ros.manifold.transport import corrections_at
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.queries.query import AlongMeanPaths, ArmQuery, End, EndName, Goal, Output, Pole, Query
from geodesic_motion_ros.queries.round_frame import RoundFrame
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.sheet import UNROLLED_ROUNDS, beyond_demonstrated
from geodesic_motion_ros.skill.skill import ENDPOINT_MULTIPLE, Skill


class QueryBuilder(ABC, Generic[Output]):
    """Makes the queries of an arm with one skill: finds its ends on the manifold, transports the graph, holds it.

    Attributes
    ----------
    follows_task_frame : whether the skill may stand elsewhere than it was demonstrated.
    """

    follows_task_frame: ClassVar[bool]
    #: Offsets of the task differ by less where the same demonstrations are meant, in the scale of offsets.
    _same_task: ClassVar[float]

    def __init__(
        self,
        skill: Skill,
        graph: Any,
        settings: PlannerSettings,
        robot: Robot,
        collision: CollisionModel,
        scene: DeclaredScene | None,
        scale: np.ndarray,
    ) -> None:
        """graph : decoded from the skill; collision : the spheres that obstacles are kept away from; scene : what
        always stands around the arm; scale : (k,) what each number of an offset counts where offsets are compared.
        """
        self._skill, self._graph, self._settings, self._robot = skill, graph, settings, robot
        self._collision, self._links = collision, LinkBounds.of(collision)
        self._scene, self._scale = scene or DeclaredScene.empty(), scale
        self._round_frame = RoundFrame.of(skill)
        self._ridge_strength = settings.ridge_strength * (1.0 if self._round_frame is None else ROUND_RIDGE)
        self._mean_paths = skill.mean_paths if settings.ridge_strength > 0.0 else None
        nowhere = np.zeros(len(scale))
        self._unconditioned = self._along_mean_paths(nowhere, nowhere, conditioned=False)
        self._poles: dict[str, list[Pole[Output]]] = {end: self._find_poles(end) for end in get_args(EndName)}
        self._unmoved = self._unmoved_lengths(self._unconditioned.conformal)
        self._demonstrated_cost = self._cost_of_demonstration()

    def guard(self, collision: CollisionModel, settings: PlannerSettings) -> QueryBuilder[Output]:
        """Return the builder of the arm with other spheres, and with other settings."""
        other = copy(self)
        other._collision, other._links, other._settings = collision, LinkBounds.of(collision), settings
        return other

    # ------------------------------------------------------ ends of an arm

    @abstractmethod
    def goal_by_pose(self, pose: Pose, frame: TaskFrame) -> Goal[Output] | Refusal:
        """Return the goal of a tool pose of the base frame, or why it is refused; frame : the task frame."""

    @abstractmethod
    def goal_by_configuration(self, configuration: np.ndarray, frame: TaskFrame) -> Goal[Output] | Refusal:
        """Return the goal of a configuration (eta,) [rad], or why it is refused; frame : the task frame."""

    @abstractmethod
    def goal_in_place(self, pose: Pose, frame: TaskFrame, standing: np.ndarray) -> Goal[Output] | None:
        """Return the goal in the configuration (eta,) in which the arm stands, where that serves for a pose; None else.
        """

    @abstractmethod
    def start_by_pose(self, pose: Pose, commanded: np.ndarray | None = None) -> np.ndarray | Refusal:
        """Return the configuration (eta,) in which a plan from a tool pose begins, of an arm with a commanded one."""

    @abstractmethod
    def in_turn(self, configuration: np.ndarray) -> np.ndarray:
        """Return a configuration (eta,) with its continuous joints in the turn in which the skill has them."""

    # -------------------------------------------------------------- queries

    def build(self, start: np.ndarray, goal: Goal[Output], rounds: int | None = None) -> ArmQuery | Refusal:
        """Build the query from a configuration (eta,) to a goal; or say why there is none.

        rounds : of a closed skill. 0: the arm has set out to the goal before, and goes there by the shorter part of the
            round; None: the goal is new, and lies ahead.
        """
        found = self.transport(self._output(start, goal.frame), goal.outputs, rounds)
        return found if isinstance(found, Refusal) else self._held(found, goal.frame, start)

    def build_beside(
        self, query: ArmQuery, start: np.ndarray, latent: np.ndarray, goal: Goal[Output]
    ) -> ArmQuery | Refusal:
        """Build the query to the goal of an older one from a configuration (eta,) beside its path, at its latent point
        (d,): of a closed skill as much of the round is left as there.
        """
        beside = None if self._round_frame is None else self.redirect(query, start, latent, goal, 0)
        return self.build(start, goal, 0) if beside is None else beside

    def redirect(
        self, query: ArmQuery, start: np.ndarray, latent: np.ndarray, goal: Goal[Output], rounds: int | None = None
    ) -> ArmQuery | Refusal | None:
        """Build the query that goes on from a configuration on the path of an older one, at its latent point (d,), to a
        new goal.

        rounds : of a closed skill: the goal is that of the older query, so many rounds further on; None: it is new.

        None where the latent point is not connected to any node: then the query has to be built anew.
        """
        if rounds and self._is_same_each_round(query):
            # Another one all the same, for what was found with it is of another round.
            return replace(query, displaced=0.0)
        found = self._redirect(query, self._output(start, goal.frame), latent, goal.outputs, rounds)
        return found if found is None or isinstance(found, Refusal) else self._held(found, goal.frame, start)

    @abstractmethod
    def other_posture(self, query: ArmQuery) -> ArmQuery | None:
        """Return the query in the next posture in which the arm can hold it; None where none is left."""

    @abstractmethod
    def first_posture(self, query: ArmQuery) -> ArmQuery:
        """Return the query in the first posture in which the arm can hold it: itself, where it is in that."""

    @abstractmethod
    def rebuild(self, query: ArmQuery) -> ArmQuery | Refusal:
        """Build the query of a builder that guards other spheres anew, with the spheres of this one."""

    # ------------------------------------------------- in the skill's space

    def goal_refusal(self, goals: Sequence[Output]) -> Refusal | None:
        """Return why none of several goals lies close enough to what was demonstrated, or to some trusted node; None
        where one does.
        """
        pieces = self._graph.pieces_with_demonstrations()
        ends = [end for goal in goals for piece in pieces if (end := self._end("goal", goal, piece)) is not None]
        if not ends:
            return Refusal(VerdictCode.GOAL_OUT_OF_SUPPORT, "the skill has no supported latent point at all")
        return self._offset_refusal("goal", min(ends, key=lambda end: end.misfit))

    def transport(
        self, start: Output, goals: Sequence[Output], rounds: int | None = None
    ) -> Query[Output] | Refusal:
        """Choose both ends on one connected piece of the manifold, and transport the graph to them.

        rounds : as of `build`.
        """
        pairs = []
        for piece in self._graph.pieces_with_demonstrations():
            here = self._end("start", start, piece)
            theres = [] if here is None else [self._end("goal", goal, piece) for goal in goals]
            pairs += [(here, there) for there in theres if here is not None and there is not None]
        if not pairs:
            return Refusal(VerdictCode.START_OUT_OF_SUPPORT, "no supported latent point near start and goal")
        allowed = [pair for pair in pairs if self._is_allowed(pair[0]) and self._is_allowed(pair[1])]
        if not allowed:
            here, there = min(pairs, key=lambda pair: pair[0].misfit + pair[1].misfit)
            refusal = self._offset_refusal("start", here) or self._offset_refusal("goal", there)
            assert refusal is not None
            return refusal
        here, there = min(allowed, key=lambda pair: self._preference(*pair))
        here = self._before(here, there, rounds)
        return self._between(
            here, there, here.task_offset, self._chosen_mean_paths(here.task_offset, there.task_offset)
        )

    def _redirect(
        self, query: Query[Any], start: Output, latent: np.ndarray, goals: Sequence[Output], rounds: int | None
    ) -> Query[Output] | Refusal | None:
        """As `redirect`, not held by an arm yet."""
        piece = int(self._graph.component[query.goal_node])
        node = self._graph.node_near(latent, self._graph.component == piece, 1)
        if node is None:
            return None
        decoded = self._decoded(latent)
        offset = self._difference(decoded, start)
        here = End(latent, node, decoded, start, offset, np.zeros_like(offset), query.task_start)
        ends = [end for goal in goals if (end := self._end("goal", goal, piece)) is not None]
        if not ends:
            return None
        allowed = [end for end in ends if self._is_allowed(end)]
        if not allowed:
            return self._offset_refusal("goal", min(ends, key=lambda end: end.misfit))
        there = min(allowed, key=lambda end: self._preference(here, end))
        here = self._before(here, there, None if rounds is None else query.rounds_left(latent) + rounds)
        along_mean_paths, moved = query.along_mean_paths, there.task_offset - query.ends[1].task_offset
        if np.linalg.norm(self._scale * moved) > self._same_task:
            along_mean_paths = self._chosen_mean_paths(query.task_start, there.task_offset)
        found = self._between(here, there, query.task_start, along_mean_paths)
        progress, _ = self._graph.progress_map(latent[None])
        return replace(found, displaced=self._tool_moved(query, latent, start) + query.displaced_at(progress))

    def _between(
        self, here: End[Output], there: End[Output], task_start: np.ndarray, along_mean_paths: AlongMeanPaths
    ) -> Query[Output]:
        progress, shares = self._graph.progress_map(np.stack([here.latent, there.latent]))
        corrected = corrections_at(along_mean_paths.corrections, progress, shares)
        at = float(progress[0]), float(progress[1])
        offsets = self._offsets(here, there, at, corrected, along_mean_paths.corrections)
        graph, field, body = self._carried(offsets, (here.node, there.node), along_mean_paths)
        to_goal = cost_field(self._graph.adjacency, graph.base, there.node)
        return Query(
            start=here.requested,
            goal=there.requested,
            ends=(here, there),
            decoded=self._graph,
            offsets=offsets,
            graph=graph,
            field=field,
            body=body,
            to_goal=to_goal,
            from_start=cost_field(self._graph.adjacency, graph.base, here.node),
            cost_limit=self._settings.cost_cap * max(self._demonstrated_cost, float(to_goal[here.node])),
            misfits=Figures(**self._misfits("start", here), **self._misfits("goal", there)),
            task_start=task_start,
            along_mean_paths=along_mean_paths,
            round_frame=self._round_frame,
        )

    def _before(self, here: End[Output], there: End[Output], left: float | None) -> End[Output]:
        """Put the start of a closed skill into the round in which about so many rounds are left to the goal; None: less
        than one, and a whole one where start and goal are the same. The start of another skill stays as it is.
        """
        frame = self._round_frame
        if frame is None:
            return here
        between = frame.rounds_to(here.latent, there.latent)
        if left is None:
            ahead = between - np.floor(between)
            same = self._apart(here.requested, there.requested) < self._same_task
            left = ahead + 1.0 if same and ahead < 0.5 else ahead
        latent = frame.moved(here.latent, np.round(between - left))
        piece = self._graph.component == self._graph.component[here.node]
        node = self._graph.node_near(latent, piece, 2)
        return replace(here, latent=latent, node=here.node if node is None else node)

    # ----------------------------------------------------------------- ends

    def _find_poles(self, name: EndName) -> list[Pole[Output]]:
        sheet, poles = self._skill.canonical, []
        if self._round_frame is not None:
            return self._poles_along(self._round_frame)
        for members, mean in self._groups(name):
            assert sheet is not None
            latent = self._skill.codes[members, 0 if name == "start" else -1].mean(axis=0)
            node = self._graph.nearest_node_to(latent)
            if name == "goal":
                # A path ends at a node.
                latent = self._graph.latent[node]
            offsets = sheet.start_offsets if name == "start" else sheet.goal_offsets
            poles.append(Pole(latent, node, self._decoded(latent), mean, offsets[members]))
        return poles

    def _poles_along(self, rounds: RoundFrame) -> list[Pole[Output]]:
        """Find the poles of a closed skill: in the last round, all along the mean of each mode."""
        sheet, codes, poles = self._skill.canonical, self._skill.codes, []
        assert sheet is not None
        weights = sheet.weights(np.zeros(len(self._scale)), np.zeros(len(self._scale)), conditioned=False)
        means = sheet.mean_curves(weights)
        for mode, along in enumerate(np.einsum("kn,nsd->ksd", weights, codes)):
            members = sheet.modes == mode
            last = np.flatnonzero((along[:, 0] >= rounds.last) & (along[:, 0] < rounds.last + rounds.period))
            for sample in range(last[0] - 1, last[-1] + 2):
                latent, mean = along[sample], self._shown([curve[mode, sample] for curve in means])
                node = self._graph.nearest_node_to(latent)
                shown = [curve[members, sample] for curve in sheet.curves]
                offsets = sheet.start_offsets[members] + self._offsets_of(mean, shown)
                poles.append(Pole(latent, node, self._decoded(latent), mean, offsets))
        return poles

    def _end(self, name: EndName, requested: Output, piece: int) -> End[Output] | None:
        """Where a connected piece of the graph meets an output; None where none of it is trusted."""
        poles = [pole for pole in self._poles[name] if self._graph.component[pole.node] == piece]
        if self._round_frame is not None and poles:
            best: End[Output] | None = self._on_round(poles, requested)
        else:
            best = min((self._at_pole(pole, requested) for pole in poles), key=lambda end: end.misfit, default=None)
        if best is not None and self._is_allowed(best):
            return best
        node = self._nearest_node(requested, piece, ENDPOINT_MULTIPLE * self._skill.sigma_support)
        if node is not None and self._round_frame is not None:
            last = self._round_frame.in_last(self._graph.latent[node])
            node = self._graph.node_near(last, self._graph.component == piece, 2)
        if node is None:
            return best
        decoded = self._decoded(self._graph.latent[node])
        offset = self._difference(decoded, requested)
        nearest = End(self._graph.latent[node], node, decoded, requested, offset, offset, np.zeros_like(offset))
        return nearest if best is None else min(nearest, best, key=lambda end: end.misfit)

    def _on_round(self, poles: list[Pole[Output]], requested: Output) -> End[Output]:
        """Find where rounds pass nearest to an output, between two poles, or begin near it."""
        assert self._round_frame is not None
        begin = self._skill.codes[:, 0].mean(axis=0)
        rounds = [self._round_frame.rounds_to(begin, pole.latent) for pole in poles]
        pole = poles[int(np.argmin([abs(left - round(left)) for left in rounds]))]
        first = self._at_pole(pole, requested)
        if np.linalg.norm(self._scale * first.beyond) < BEGINS_WITHIN * self._spread(pole):
            # It lies among the beginnings that were demonstrated, or hardly beside them.
            return first
        means = [np.stack(values) for values in zip(*(self._values(pole.mean) for pole in poles), strict=True)]
        apart = np.linalg.norm(self._scale * self._offsets_of(requested, means), axis=1)
        nearest = self._nearest_pass(poles, apart, rounds)
        pole, near = poles[nearest], 3.0 * self._graph.grid.step
        end = self._at_pole(pole, requested)
        # Those of a mode stand in their order.
        beside = [
            number for number in (nearest - 1, nearest + 1)
            if 0 <= number < len(poles) and abs(poles[number].latent[0] - pole.latent[0]) < near
        ]  # fmt: skip
        if not beside:
            return end
        other = poles[min(beside, key=lambda number: apart[number])]
        step = self._scale * self._difference(pole.mean, other.mean)
        share = np.clip(step @ (self._scale * end.task_offset) / max(step @ step, 1e-12), 0.0, 1.0)
        latent = pole.latent + share * (other.latent - pole.latent)
        decoded, task_offset = self._decoded(latent), end.task_offset - share * step / self._scale
        offset = self._difference(decoded, requested)
        beyond = beyond_demonstrated(task_offset, pole.demonstrated, self._scale)
        return End(latent, pole.node, decoded, requested, offset, beyond, task_offset)

    def _nearest_pass(self, poles: list[Pole[Output]], apart: np.ndarray, rounds: list[float]) -> int:
        """Choose the number of the nearest pole, by distances (P,) as of `_apart`. Where rounds cross themselves, and
        pass nearly as near twice, take the pass nearer to where demonstrations began, so many rounds (P) before.
        """
        nearest = int(np.argmin(apart))
        passes = np.flatnonzero((apart <= np.roll(apart, 1)) & (apart <= np.roll(apart, -1)))
        passes = passes[apart[passes] <= apart[nearest] + self._spread(poles[nearest])]
        since = np.array(rounds)[passes]
        return int(passes[np.argmin(np.abs(since - np.round(since)))])

    def _spread(self, pole: Pole[Output]) -> float:
        """Measure how far from a pole demonstrations were, as `_apart` does: no less than what is the same task."""
        offsets = self._scale * pole.demonstrated
        return max(float(np.sqrt(np.mean(np.sum(offsets**2, axis=1)))), self._same_task)

    def _apart(self, one: Output, other: Output) -> float:
        """Measure the distance of two outputs, in the scale of offsets."""
        return float(np.linalg.norm(self._scale * self._difference(one, other)))

    def _at_pole(self, pole: Pole[Output], requested: Output) -> End[Output]:
        task_offset = self._difference(pole.mean, requested)
        beyond = beyond_demonstrated(task_offset, pole.demonstrated, self._scale)
        offset = self._difference(pole.decoded, requested)
        return End(pole.latent, pole.node, pole.decoded, requested, offset, beyond, task_offset)

    def _offset_refusal(self, name: EndName, end: End[Output]) -> Refusal | None:
        """Why an end is too far from what was demonstrated; None where it is not."""
        if self._is_allowed(end):
            return None
        figures = Figures(**self._misfits(name, end))
        return Refusal(self._out_of_support(name), f"the {name} is {self._stated_misfit(end)}", figures)

    def _is_allowed(self, end: End[Output]) -> bool:
        return all(length <= limit for length, limit in zip(self._lengths(end.beyond), self._limits(), strict=True))

    def _misfits(self, name: EndName, end: End[Output]) -> dict[str, Any]:
        """How far an end is from what is decoded there, and from what was demonstrated, under their names in `Figures`.

        The second length of an offset, where it has two, is an angle.
        """
        parts = (("offset", end.offset), ("beyond", end.beyond))
        return {
            f"{name}_{part}{suffix}": length
            for part, offset in parts
            for suffix, length in zip(("", "_angle"), self._lengths(offset), strict=False)
        }

    @staticmethod
    def _out_of_support(name: EndName) -> VerdictCode:
        """The code of an end that is too far from what was demonstrated."""
        return VerdictCode.START_OUT_OF_SUPPORT if name == "start" else VerdictCode.GOAL_OUT_OF_SUPPORT

    # ------------------------------------------------------ along mean paths

    def _chosen_mean_paths(self, task_start: np.ndarray, task_goal: np.ndarray) -> AlongMeanPaths:
        """Those of start and goal where the skill found that they choose between demonstrations; of the mean else."""
        sheet = self._skill.canonical
        if self._mean_paths is None or sheet is None or not (self._settings.query_conditioning and sheet.regresses):
            return self._unconditioned
        return self._along_mean_paths(task_start, task_goal, conditioned=True)

    def _along_mean_paths(self, start_offset: np.ndarray, goal_offset: np.ndarray, conditioned: bool) -> AlongMeanPaths:
        sheet = self._skill.canonical
        if self._mean_paths is None or sheet is None:
            # No mean path is used, but the graph counts the shares of the skill's.
            return AlongMeanPaths(np.zeros((self._graph.mean_path_count, 2, len(start_offset))), None, None)
        weights = sheet.weights(start_offset, goal_offset, conditioned)
        mean_paths = self._mean_paths.moved_to(np.einsum("kn,nsd->ksd", weights, self._skill.codes))
        corrections = sheet.corrections(self._graph.decoder, mean_paths, weights)
        conformal = mean_paths.conformal_factors(self._graph.latent, self._ridge_strength)
        return AlongMeanPaths(corrections, conformal, mean_paths)

    def _cost_of_demonstration(self) -> float:
        """The cost of the first demonstration's path where the skill was demonstrated."""
        codes = self._skill.codes[0]
        # one of the rounds, that of a closed skill in the middle
        one = len(codes) // UNROLLED_ROUNDS
        ends = [0, -1] if self._round_frame is None else [one, 2 * one]
        start, goal = (self._graph.nearest_node_to(code) for code in codes[ends])
        return float(cost_field(self._graph.adjacency, self._unmoved, goal)[start])

    # ---------------------------------------------- what the space determines

    @abstractmethod
    def _output(self, configuration: np.ndarray, frame: TaskFrame) -> Output:
        """Where an arm in a configuration (eta,) is in the space; frame : the task frame."""

    @abstractmethod
    def _groups(self, name: EndName) -> list[tuple[np.ndarray, Output]]:
        """The demonstrations that start, or end, together, as a mask (N,), and their mean; none on a raw sheet."""

    @abstractmethod
    def _decoded(self, latent: np.ndarray) -> Output:
        """What a latent point (d,) decodes to."""

    @abstractmethod
    def _nearest_node(self, requested: Output, piece: int, sigma_limit: float) -> int | None:
        """The node of a connected piece that decodes to the nearest output; None where none of it is trusted."""

    @abstractmethod
    def _difference(self, start: Output, end: Output) -> np.ndarray:
        """The offset (k,) that carries one output to another."""

    @abstractmethod
    def _is_same_each_round(self, query: ArmQuery) -> bool:
        """Whether a query of a closed skill is, but for where it begins, that of the next round as well."""

    @abstractmethod
    def _shown(self, values: Sequence[np.ndarray]) -> Output:
        """The output of a sample of a sheet's curves."""

    @abstractmethod
    def _values(self, output: Output) -> Sequence[np.ndarray]:
        """An output as a sample of a sheet's curves."""

    @abstractmethod
    def _offsets_of(self, start: Output, ends: Sequence[np.ndarray]) -> np.ndarray:
        """The offsets (N, k) that carry an output to samples (N, ...) of a sheet's curves."""

    @abstractmethod
    def _lengths(self, offset: np.ndarray) -> tuple[float, ...]:
        """The lengths of the parts of an offset (k,): metres and radians are not added."""

    @abstractmethod
    def _limits(self) -> tuple[float, ...]:
        """How long the parts of an offset may be that no demonstration has."""

    @abstractmethod
    def _stated_misfit(self, end: End[Output]) -> str:
        """How far an end is from what was demonstrated, and what is allowed, for a person."""

    @abstractmethod
    def _preference(self, here: End[Output], there: End[Output]) -> float:
        """What two allowed ends cost, where there is a choice."""

    @abstractmethod
    def _unmoved_lengths(self, conformal: np.ndarray | None) -> np.ndarray:
        """Lengths (m,) of the edges where the skill was demonstrated, with conformal factors (n,) of the nodes."""

    @abstractmethod
    def _offsets(
        self,
        here: End[Output],
        there: End[Output],
        progress: tuple[float, float],
        corrected: np.ndarray,
        corrections: np.ndarray,
    ) -> Any:
        """The offsets that carry the graph to two ends at so much progress.

        corrected : (2, k) the corrections there, of those (K, S, k) along the mean paths.
        """

    @abstractmethod
    def _carried(
        self, offsets: Any, ends: tuple[int, int], along_mean_paths: AlongMeanPaths
    ) -> tuple[WeightedGraph, MetricField, NodeBody]:
        """Graph, field and body of a query between two nodes, before an arm holds it."""

    @abstractmethod
    def _tool_moved(self, query: ArmQuery, latent: np.ndarray, start: Output) -> float:
        """How far [m] the tool of an output is from the one that a latent point (d,) of a query stands for."""

    @abstractmethod
    def _held(self, query: Query[Output], frame: TaskFrame, start: np.ndarray) -> ArmQuery | Refusal:
        """The query as the arm holds it from a configuration (eta,) on; frame : the task frame."""
