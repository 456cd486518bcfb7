"""Without obstacles: does the geodesic stay in the tube of the family whose start and goal it was given?

A start and a goal are drawn between those of one family's demonstrations (random convex combinations of their offsets),
family after family. The path's family is that of the nearest ridge at each of its latent points. Where families share
starts and goals there is no family to stay in: then the question is whether a path keeps to one of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal
from geodesic_motion_ros.utils.errors import ParameterError


@dataclass(frozen=True)
class TubePath:
    """What became of one start and goal of a family.

    Attributes
    ----------
    own, kept : whether all of the path is in the family's tube, and whether it is all in one.
    reason : why there was no path, else empty.
    """

    number: int
    family: int
    own: bool
    kept: bool
    reason: str = ""


def tube_path(planner: ReactivePlanner, number: int, seed: int) -> TubePath:
    """Draw and plan pair number `number`; it depends on nothing else but the seed.

    Raises
    ------
    ParameterError : the skill is on the raw sheet, which knows no families.
    """
    sheet = planner.skill.canonical
    if sheet is None:
        raise ParameterError("the skill is on the raw sheet: this experiment wants a canonical one")
    random = np.random.default_rng([seed, number])
    family = number % (int(sheet.modes.max()) + 1)
    shown = np.flatnonzero(sheet.modes == family)
    weights = random.dirichlet(np.ones(len(shown)), size=2)
    start = sheet.start_poles[sheet.start_groups[shown[0]]] + weights[0] @ sheet.start_offsets[shown]
    goal = sheet.goal_poles[sheet.goal_groups[shown[0]]] + weights[1] @ sheet.goal_offsets[shown]
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    plan = planner.plan_configurations(start, ConfigurationGoal(goal[None], "drawn"))
    if plan.reference is None:
        return TubePath(number, family, False, False, plan.verdict.reason)
    _, shares = planner.graph.progress_map(plan.reference.latent)
    passed = np.argmax(shares, axis=1)
    return TubePath(number, family, bool(np.all(passed == family)), bool(np.all(passed == passed[0])))
