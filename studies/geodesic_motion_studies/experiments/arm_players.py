"""Who plans for the whole arm in experiments: ours, and the paper's to the letter, queried alike and judged alike.

Ours plans from a configuration to configurations. The paper's knows the codes of what was shown: it plans from
the code where a demonstration begins to codes where demonstrations end, as the hand alone does not tell where the elbow
is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.demonstrations.canonical import sample_body_arc
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.latent_graph import LatentGraph
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.paper.follower import TimedPath, followed
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference, ending_at_rest, interpolated
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_studies.experiments.blocked_arm import CHECK_PERIOD, every

if TYPE_CHECKING:
    from geodesic_motion_ros.learning.settings import JointTrainingSettings

#: Samples of the families' mean motions.
_SAMPLES = 200
#: After the end of a path what is commanded rests within this [s].
_SETTLING = 3.0


@dataclass(frozen=True)
class Families:
    """Demonstrations of joints in families of equally many, one after the other.

    Attributes
    ----------
    mean_paths : (F, S, eta) of each, equally spaced along their arcs [rad].
    each : demonstrations of one family.
    """

    mean_paths: np.ndarray
    each: int

    @classmethod
    def of(cls, shown: JointDemonstrations, families: int) -> Families:
        robot, metric, each = Robot.named(shown.robot), JointMetricSettings(), len(shown) // families
        curves = np.stack([sample_body_arc(item.configurations, robot, metric, _SAMPLES) for item in shown])
        return cls(curves.reshape(families, each, *curves.shape[1:]).mean(axis=1), each)

    def ends(self, groups: Sequence[int], at: int) -> np.ndarray:
        """Mean configuration (eta,) [rad] where families begin (at = 0) or end (at = -1)."""
        return self.mean_paths[list(groups), at].mean(axis=0)


@dataclass(frozen=True, eq=False)
class Played:
    """What a planner answers.

    Attributes
    ----------
    configurations : (n, eta) [rad] every `CHECK_PERIOD`; latent : (k, d) points that they were decoded from, or are
        near to. duration : [s].
    reference : what an arm plays: of the paper's planner, what is commanded behind its leading point.
    cost : length of the path in the metric of the paper's planner, NaN of ours.
    promised : clearance that the planner promises [m], NaN of the paper's, which promises none.
    """

    configurations: np.ndarray
    latent: np.ndarray
    duration: float
    reference: JointReference
    cost: float = math.nan
    promised: float = math.nan


class Player(Protocol):
    """A planner for the whole arm. Starts and goals are families: where those begin or end on average."""

    name: str
    skill: Skill

    def play(
        self, start: Sequence[int], goals: Sequence[Sequence[int]], centres: np.ndarray, radii: np.ndarray
    ) -> Played | str:
        """The motion to whichever goal is the cheapest among spheres (o, 3), (o,) [m], or why there is none."""
        ...

    def families_at(self, latent: np.ndarray) -> np.ndarray:
        """The families (n,) that latent points (n, d) are in, as the skill sees it."""
        ...


class OurArm:
    """`ReactivePlanner`."""

    name = "ours"

    def __init__(self, planner: ReactivePlanner, families: Families) -> None:
        self.planner, self.skill, self._families = planner, planner.skill, families

    def play(
        self, start: Sequence[int], goals: Sequence[Sequence[int]], centres: np.ndarray, radii: np.ndarray
    ) -> Played | str:
        self.planner.set_obstacles(centres, radii)
        choice = ConfigurationGoal(np.array([self._families.ends(goal, -1) for goal in goals]), "those that were shown")
        plan = self.planner.plan_configurations(self._families.ends(start, 0), choice)
        found = plan.reference
        if found is None:
            return plan.verdict.reason
        path = every(CHECK_PERIOD, found)
        return Played(path, found.latent, found.duration, found, promised=plan.verdict.figures.clearance)

    def families_at(self, latent: np.ndarray) -> np.ndarray:
        """By the nearest ridge."""
        return np.argmax(self.planner.graph.progress_map(latent)[1], axis=1)


class LiteralArm:
    """`PaperPlanner`, along its whole path at the speed that it gives the leading point."""

    name = "literal"

    def __init__(self, planner: PaperPlanner, families: Families) -> None:
        self.planner, self.skill, self._each = planner, planner.skill, families.each
        self._fields: dict[int, np.ndarray] = {}

    def play(
        self, start: Sequence[int], goals: Sequence[Sequence[int]], centres: np.ndarray, radii: np.ndarray
    ) -> Played | str:
        verdict = self.planner.set_obstacles(Obstacles.of_spheres(centres, radii))
        if not verdict.ok:
            return verdict.reason
        source = self._node(start, 0)
        targets = [self._node(goal, -1) for goal in goals]
        for target in targets:
            if target not in self._fields:
                self._fields[target] = self.planner.search.field(target)
        found = [self.planner.plan_between(source, target, self._fields[target]) for target in targets]
        path, cost = min(found, key=lambda each: each[1])
        times = np.append(np.arange(0.0, path.duration, CHECK_PERIOD), path.duration)
        motion = interpolated(times, path.times, path.places)
        return Played(motion, path.latent, path.duration, _followed(path), cost=cost)

    def families_at(self, latent: np.ndarray) -> np.ndarray:
        """By the nearest code of what was shown: a skill on the raw sheet knows no families."""
        codes = self.skill.codes
        _, nearest = cKDTree(codes.reshape(-1, codes.shape[-1])).query(latent)
        return nearest // (codes.shape[1] * self._each)

    def _node(self, groups: Sequence[int], at: int) -> int:
        """The node at that demonstration's first or last code which is nearest to the mean of all of these families."""
        each = self._each
        codes = np.concatenate([self.skill.codes[group * each : (group + 1) * each, at] for group in groups])
        middle = codes[np.argmin(np.sum((codes - codes.mean(axis=0)) ** 2, axis=1))]
        return int(self.planner.graph.nodes_near(middle, 1)[0])


def _followed(path: TimedPath) -> JointReference:
    """What is commanded on a path from rest, until it rests."""
    most = math.ceil((path.duration + _SETTLING) / PERIOD)
    knots = followed(path.times, path.places, 0.0, path.places[0], np.zeros_like(path.places[0]), PERIOD, most)
    times = PERIOD * np.arange(len(knots[0]))
    return ending_at_rest(times, *knots, interpolated(times, path.times, path.latent))


def settings_table(rows: Sequence[tuple[str, Player, JointTrainingSettings]]) -> str:
    """How each row (its name, who plans, with what training) comes about, as plain text."""
    head = [
        "row", "sheet", "learned", "body's likelihood mm", "volume", "units", "kernels", "steps", "samples",
        "sigma weight", "orientation", "ridge", "grid", "zeta", "hard",
    ]  # fmt: skip
    lines: list[list[Cell]] = []
    for name, player, training in rows:
        body = f"{1e3 * training.body_sigma:g}" if training.body_sigma else "none"
        lines.append([
            name, training.sheet, training.schedule, body,
            f"{training.volume_weight:g}", "/".join(map(str, training.hidden)), training.kernels, training.steps,
            training.samples, f"{training.metric.sigma_weight:g}", f"{training.metric.orientation_weight:g}",
            *_planning(player),
        ])  # fmt: skip
    return text_table(head, lines)


def _planning(player: Player) -> list[Cell]:
    """The last four columns of `settings_table`."""
    if isinstance(player, LiteralArm):
        graph = player.planner.graph
        return ["none", f"whole {_sides(graph)}", f"{player.planner.settings.strength:g}", "nothing"]
    assert isinstance(player, OurArm)
    settings = player.planner.settings
    ridge = "none" if player.skill.mean_paths is None else f"{settings.ridge_strength:g}"
    grid = f"support in {_sides(player.planner.graph)}"
    return [ridge, grid, f"{settings.ambient_strength:g}", "nodes removed, path certified"]


def _sides(graph: LatentGraph) -> str:
    return "x".join(map(str, graph.grid.shape))
