"""Starts and goals for experiments with the whole arm, and how the demonstrated families would go between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError

#: How often a start and a goal are drawn before an error reports that there are none.
_ATTEMPTS = 50


@dataclass(frozen=True, eq=False)
class ArmQuery:
    """A start and a goal (eta,) [rad], and the mean paths (F, S, eta) of the families moved to them."""

    start: np.ndarray
    goal: np.ndarray
    mean_paths: np.ndarray

    def plan(self, planner: ReactivePlanner) -> Plan:
        """From rest at the start to the goal, among the planner's obstacles."""
        return planner.plan_configurations(self.start, ConfigurationGoal(self.goal[None], "drawn"))

    def family(self, configurations: np.ndarray) -> int:
        """The family whose mean path the middle half of a motion (n, eta) is nearest to, on average."""
        arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(configurations, axis=0), axis=1)))
        middle = configurations[(arc > 0.25 * arc[-1]) & (arc < 0.75 * arc[-1])]
        return int(np.argmin([cKDTree(path).query(middle)[0].mean() for path in self.mean_paths]))


def draw_query(planner: ReactivePlanner, random: np.random.Generator) -> tuple[ArmQuery, JointReference]:
    """The start of one demonstration and the goal of another, drawn, with the planner's path without obstacles.

    Raises
    ------
    ParameterError : the skill is on the raw sheet, or no start and goal was found between which there is a path.
    """
    sheet, robot = planner.skill.canonical, planner.robot
    if sheet is None:
        raise ParameterError("the skill is on the raw sheet: this experiment wants a canonical one")
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    progress = np.linspace(0.0, 1.0, sheet.configurations.shape[1])
    for _ in range(_ATTEMPTS):
        first, last = random.integers(len(sheet.modes), size=2)
        start = sheet.start_poles[sheet.start_groups[first]] + sheet.start_offsets[first]
        goal = sheet.goal_poles[sheet.goal_groups[last]] + sheet.goal_offsets[last]
        mean_paths = []
        for mode in range(int(sheet.modes.max()) + 1):
            mean = sheet.configurations[sheet.modes == mode].mean(axis=0)
            offsets = JointOffsets.between(robot, mean[[0, -1]], np.stack([start, goal]))
            mean_paths.append(mean + offsets.displacements(mean, progress))
        query = ArmQuery(start, goal, np.array(mean_paths))
        reference = query.plan(planner).reference
        if reference is not None:
            return query, reference
    raise ParameterError(f"no path was found between any of {_ATTEMPTS} starts and goals that were drawn")


def body_spheres(planner: ReactivePlanner, configurations: np.ndarray) -> np.ndarray:
    """Centres (n, S, 3) [m] of those collision spheres that joints move, in configurations (n, eta) [rad]."""
    return planner.collision.positions(planner.robot, configurations)[:, planner.collision.moving]


def distances(planner: ReactivePlanner, bodies: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """Signed distances (n,) [m] of `body_spheres` (n, S, 3) from a sphere at (3,), or each from its own, (n, 1, 3)."""
    radii = planner.collision.radii[planner.collision.moving]
    return np.min(np.linalg.norm(bodies - centre, axis=-1) - radii, axis=1) - radius
