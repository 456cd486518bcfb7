"""The joint-space planner's tick on a skill: its stages, each by the functions that the tick itself calls, and whole.

mark         what the search needs to know of the obstacles, and of where they will be within the prediction
search       the cheapest path through the latent graph
refine       that path made a continuous one
curve        resample and smooth it, decode it, carry it to start and goal, smooth it there
time law     the reference along it, from rest
certificate  its clearance from the moving obstacles and from itself
message      the JointTrajectory message, where ROS is installed
tick         `ReactivePlanner.tick` with a new place of the sphere each time, a hundred times a second along a motion

and no stage of it

kinematics   all solutions of a tool pose for one position of the last joint, found numerically (`robot.solutions`)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geodesic_motion_ros.certification.certificate import ArmCertifier
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.kernels.loading import load_kernels
from geodesic_motion_ros.manifold.geodesic_refinement import refined
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationQueryBuilder
from geodesic_motion_ros.queries.path_smoothing import resample_latent, smooth_latent
from geodesic_motion_ros.queries.search import cheapest_path
from geodesic_motion_ros.robot.solutions import STARTS, numerical_solutions, spread
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.benchmarks.engine import SearchProblem, mark
from geodesic_motion_studies.benchmarks.scenes import PERIOD, RATE, Scene
from geodesic_motion_studies.benchmarks.stopwatch import Stopwatch

#: Smoothing width of the planner's first attempt, in grid steps.
_WIDTH = 2.0


class SkillBench:
    """A planner on a joint-space skill, and its search from the start to the goal of the first demonstration.

    Attributes
    ----------
    planner, query, problem : the planner, its query, and that search.

    Parameters
    ----------
    shape : grid of the skill's graph; None: the skill's own.
    """

    def __init__(self, skill: Skill, shape: tuple[int, ...] | None = None) -> None:
        if skill.space != "joint":
            raise ParameterError(f"skill '{skill.name}' is of task space: the stages are those of a joint-space skill")
        self.planner = planner = ReactivePlanner(skill, PlannerSettings(grid_shape=shape))
        load_kernels(planner)
        ends = planner.graph.decoder.configurations(skill.codes[0, [0, -1]])
        self._start, self._goal = np.clip(ends, planner.limits.lower, planner.limits.upper)
        model = planner.collision
        self._certifier = ArmCertifier(planner.robot, model)
        queries = ConfigurationQueryBuilder(skill, planner.graph, planner.settings, planner.robot, model)
        choice = queries.goal_by_configuration(self._goal, TaskFrame.identity())
        query = choice if isinstance(choice, Refusal) else queries.build(self._start, choice)
        if isinstance(query, Refusal):
            raise ParameterError(f"skill '{skill.name}' has no path along its first demonstration: {query.reason}")
        self.query = query
        source = next(
            int(node) for node in planner.graph.nodes_near(query.start_latent, 3) if np.isfinite(query.to_goal[node])
        )
        tool = planner.graph.body.names.index(planner.robot.tool_link)
        self.problem = SearchProblem.between(
            skill.name, planner.graph.adjacency, query.graph, query.body, tool, source, query.goal_node,
            planner.settings, query.cost_limit,
        )  # fmt: skip

    def stages(self, scene: Scene, ticks: int) -> dict[str, Stopwatch]:
        """Every stage of planning from rest; those after the search run where there is a path."""
        planner, query = self.planner, self.query
        message = _message_of()
        names = ("mark", "search", "refine", "curve", "time law", "certificate", *(("message",) if message else ()))
        watches = {name: Stopwatch() for name in names}
        for tick in range(ticks):
            obstacles = scene.at(tick)
            with watches["mark"]:
                evaluation = mark(self.problem, obstacles.swept(planner.settings.prediction))
            with watches["search"]:
                found = cheapest_path(
                    planner.graph, query, query.start_latent, evaluation, planner.settings.obstacle_margin
                )
            if isinstance(found, Refusal):
                continue
            with watches["refine"]:
                curve = refined(query.field, evaluation, planner.settings.obstacle_margin, found.polyline)
            with watches["curve"]:
                path, latent = self._curve(curve)
            with watches["time law"]:
                reference = timed_joint_reference(path, latent, planner.limits)
            if reference is None:
                continue
            with watches["certificate"]:
                self._certifier.certify(reference, obstacles, planner.settings.prediction)
            if message:
                with watches["message"]:
                    message(planner.robot.joint_names, reference)
        return watches

    def _curve(self, polyline: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Configurations (m, eta) along a latent polyline (p, d), and their latent points (m, d)."""
        graph = self.planner.graph
        latent = smooth_latent(resample_latent(polyline, graph.grid.step), _WIDTH)
        carried = self.query.offsets.carried(graph.decoder.configurations(latent), *graph.progress_map(latent))
        return smooth_latent(carried, _WIDTH), latent

    def ticks(self, scene: Scene, ticks: int) -> Stopwatch:
        """The planner's own ticks; the motion begins anew each time the sphere has come round."""
        planner, watch = self.planner, Stopwatch()
        for tick in range(ticks):
            now = tick / RATE
            if tick % PERIOD == 0:
                planner.stand_at(self._start, now)
                planner.set_goal_configuration(self._goal)
            obstacles = scene.at(tick)
            with watch:
                planner.take_obstacles(obstacles)
                planner.tick(now)
        return watch


    def kinematics(self, count: int) -> Stopwatch:
        """Numerical inverse kinematics of so many poses, drawn within the joints' limits."""
        robot, watch = self.planner.robot, Stopwatch()
        starts = spread(robot, STARTS)
        for configuration in robot.sample(count, np.random.default_rng(0)):
            pose = robot.forward(configuration)
            last = float(configuration[-1]) if len(configuration) == 7 else None
            with watch:
                numerical_solutions(robot, *pose, last, starts)
        return watch


def _message_of() -> Callable[[tuple[str, ...], JointReference], object] | None:
    """Makes the JointTrajectory message of a reference; None without ROS."""
    try:
        from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
    except ImportError:
        return None

    def message(names: tuple[str, ...], reference: JointReference) -> object:
        return joint_trajectory_bytes(
            names, reference.times, reference.positions, reference.velocities, reference.accelerations, 0
        )

    return message
