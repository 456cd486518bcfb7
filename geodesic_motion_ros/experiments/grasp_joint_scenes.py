"""Scenes of `grasp_joint`: spheres in the way of families, and which of them the planner's way passes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.arm_queries import body_spheres, distances
from geodesic_motion_ros.experiments.blocked_arm import CHECK_PERIOD, arm_clearance, every
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.joint_query import GoalChoice
from geodesic_motion_ros.joint_reference import JointReference
from geodesic_motion_ros.joint_sheet import JointSheet
from geodesic_motion_ros.simulation.collision_geometry import CollisionGeometry
from geodesic_motion_ros.skill import Skill

#: Radius of the spheres [m].
RADIUS = 0.04
#: Parts of a way, as shares of the body's arc: begin and end, and the two openings.
BEGIN, END, FIRST, SECOND = (0.0, 0.3), (0.6, 1.0), (0.15, 0.35), (0.65, 0.85)
#: Every so many samples of ways are looked at for a place.
_EVERY = 6
#: A way that is in a family for less than this share of it has only brushed against it, where families meet.
PASSED = 0.15


@dataclass(frozen=True, eq=False)
class Scene:
    """Spheres, and what the planner makes of them.

    Attributes
    ----------
    name : as of `grasp_joint`; family : whose start the arm begins at, -1 where all begin alike.
    centres, radii : (o, 3), (o,) of the spheres [m].
    wanted : the families that the way is to pass one after the other, each of the tuples would do; empty: there should
        be no way.
    passed : those that it passes; empty where the planner refused. reason : why it did.
    clearance, certified : least distance of the arm from the spheres [m], as measured and as promised; NaN refused.
    duration : of the way [s]. reference : of the planner, None where it refused.
    """

    name: str
    family: int
    centres: np.ndarray
    radii: np.ndarray
    wanted: tuple[tuple[int, ...], ...]
    passed: tuple[int, ...]
    reason: str
    clearance: float = math.nan
    certified: float = math.nan
    duration: float = math.nan
    reference: JointReference | None = None

    @property
    def as_expected(self) -> bool:
        """Whether the way is one of those wanted and clear, or refused where there is none."""
        if not self.wanted:
            return self.reference is None
        return self.passed in self.wanted and not self.clearance <= 0.0

    def told(self) -> dict[str, Any]:
        """What `--json` writes."""
        left_out = {"reference"}
        told = {name: value for name, value in vars(self).items() if name not in left_out}
        return told | {"as_expected": self.as_expected}


def mean_ways(skill: Skill) -> np.ndarray:
    """Mean canonical motions (F, S, eta) [rad] of a skill's families.

    Raises
    ------
    ParameterError : the skill is not of joint space, or on the raw sheet, which knows no families.
    """
    sheet = skill.canonical
    if not isinstance(sheet, JointSheet):
        raise ParameterError(f"'{skill.name}' is not a joint-space skill on a canonical sheet: it knows no families")
    return np.array([
        sheet.configurations[sheet.modes == mode].mean(axis=0) for mode in range(int(sheet.modes.max()) + 1)
    ])  # fmt: skip


def separated_scenes(planner: JointSpacePlanner) -> tuple[Scene, ...]:
    """The scenes of families that never meet."""
    ways = mean_ways(planner.skill)
    stage, families = _Stage(planner), range(len(ways))
    goals = GoalChoice(ways[:, -1], "the hand's goal, in whichever family")
    hand = planner.robot.forward(ways[0, -1])[0]
    scenes = [stage.scene("free", f, ways[f, 0], goals, [], [(f,)]) for f in families]
    for blocked in families:
        # Where the arm starts it is not to stand in the sphere.
        free = [*np.delete(ways, blocked, axis=0), _part(ways[blocked], *BEGIN)]
        sphere = sphere_on(planner, _part(ways[blocked], *END), np.concatenate(free))
        scenes += [
            stage.scene(f"way {blocked} blocked", f, ways[f, 0], goals, [sphere], [] if f == blocked else [(f,)])
            for f in families
        ]
    return (*scenes, *(stage.scene("goal blocked", f, ways[f, 0], goals, [hand], []) for f in families))


def meeting_scenes(planner: JointSpacePlanner) -> tuple[Scene, ...]:
    """The scenes of two families that meet at both ends and half way."""
    ways = mean_ways(planner.skill)
    if len(ways) != 2:
        raise ParameterError(f"the skill has {len(ways)} families; these scenes are of two")
    stage = _Stage(planner)
    start, goal = ways[:, 0].mean(axis=0), GoalChoice(ways[:, -1].mean(axis=0)[None], "that of all demonstrations")
    ends = ways[:, [0, -1]].reshape(-1, ways.shape[-1])

    def spheres(first: int, second: int) -> list[np.ndarray]:
        """On the other family's openings than those of a way."""
        way = np.concatenate([_part(ways[first], 0.0, 0.5), _part(ways[second], 0.5, 1.0)])
        return [sphere_on(planner, _part(ways[1 - family], *part), way)
                for family, part in ((first, FIRST), (second, SECOND))]  # fmt: skip

    asked: list[tuple[str, list[np.ndarray], list[tuple[int, ...]]]] = [
        ("free", [], [(0,), (1,), (0, 1), (1, 0)]),
        ("first of 0 blocked", spheres(1, 1)[:1], [(1,), (1, 0)]),
        ("hybrid, 1 then 0", spheres(1, 0), [(1, 0)]),
        ("hybrid, 0 then 1", spheres(0, 1), [(0, 1)]),
        ("both blocked", [sphere_on(planner, _part(way, *FIRST), ends) for way in ways], []),
    ]
    return tuple(stage.scene(name, -1, start, goal, centres, wanted) for name, centres, wanted in asked)


def sphere_on(planner: JointSpacePlanner, blocked: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Centre (3,) [m] of a sphere in the arm somewhere on a motion (n, eta), as far as may be from it on another."""
    places = body_spheres(planner, blocked[::_EVERY]).reshape(-1, 3)
    bodies = body_spheres(planner, free[::_EVERY])
    return max(places, key=lambda place: float(distances(planner, bodies, place, RADIUS).min()))


class _Stage:
    """Asks one planner, and judges what it answers."""

    def __init__(self, planner: JointSpacePlanner) -> None:
        self._planner, self._geometry = planner, CollisionGeometry.panda()

    def scene(
        self,
        name: str,
        family: int,
        start: np.ndarray,
        goal: GoalChoice,
        spheres: Sequence[np.ndarray],
        wanted: Sequence[tuple[int, ...]],
    ) -> Scene:
        """From a start (eta,) to a goal among spheres, given by their centres."""
        centres, radii = np.array(spheres).reshape(-1, 3), np.full(len(spheres), RADIUS)
        self._planner.set_obstacles(centres, radii)
        plan = self._planner.plan_configurations(start, goal)
        asked = name, family, centres, radii, tuple(wanted)
        if plan.reference is None:
            return Scene(*asked, (), plan.verdict.reason)
        way = every(CHECK_PERIOD, plan.reference)
        clearance = arm_clearance(self._geometry, way, centres, radii)
        return Scene(
            *asked, self._passed(plan.reference.latent), "", clearance, plan.verdict.clearance,
            plan.reference.duration, plan.reference,
        )  # fmt: skip

    def _passed(self, latent: np.ndarray) -> tuple[int, ...]:
        """The families that latent points (n, d) pass, one after the other."""
        return passed_in_turn(np.argmax(self._planner.graph.progress_map(latent)[1], axis=1))


def _part(way: np.ndarray, first: float, last: float) -> np.ndarray:
    """A motion (n, eta) between two shares of it."""
    return way[round(first * (len(way) - 1)) : round(last * (len(way) - 1)) + 1]


def passed_in_turn(families: np.ndarray) -> tuple[int, ...]:
    """Of families (n,) that a way is in, those that it stays in for more than PASSED of it, in turn."""
    bounds = np.flatnonzero(np.diff(families, prepend=-1, append=-1))
    stays = [
        int(families[begin]) for begin, end in pairwise(bounds)
        if end - begin > PASSED * len(families)
    ]  # fmt: skip
    return tuple(family for i, family in enumerate(stays) if i == 0 or family != stays[i - 1])
