"""The paper's planner: the cycle of its node, and the paper's model of the same task.

Nothing is removed near obstacles, predicted or certified; x is the tool's origin or the arm's points, r the radius of
the sphere alone, and nothing else that is declared is known. Every tick ends where the node's deadline would end it, by
processor time. One thing is added: where a path ends, and to that extent before, it is moved to the goal, which the
paper leaves where a node decodes to, centimetres beside it.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, replace

import numpy as np

from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.nodes.cycle import CycleInputs
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.obstacles.tracker import ObstacleSet
from geodesic_motion_ros.paper.follower import TimedPath
from geodesic_motion_ros.paper.paper_cycle import PaperCycle
from geodesic_motion_ros.paper.paper_planner import STRENGTH_OF_POSES, PaperPlanner, PaperSettings
from geodesic_motion_ros.paper.streams import PoseStream, TrajectoryStream
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.method import TICK, Answer
from geodesic_motion_studies.comparison.scene import Scene

#: The paper's models of tasks that shipped skills have, and zeta, as config/paper.yaml has it.
MODELS = {"panda_reach_to_grasp": ("paper_reach", 1e3), "panda_pouring": ("paper_pouring", STRENGTH_OF_POSES)}
#: As the planner node has them by default [s].
_TIMEOUTS, _LATENCY = (0.25, 1.0), 0.03


class PapersPlanner:
    """The paper's planner as a row of the comparison."""

    def __init__(self, arena: Arena) -> None:
        """ParameterError: no model of the paper's is shipped for the arena's skill."""
        if arena.skill.name not in MODELS:
            raise ParameterError(
                f"there is no paper's model of '{arena.skill.name}': the row paper is of {', '.join(MODELS)}"
            )
        name, strength = MODELS[arena.skill.name]
        settings = PaperSettings(strength)
        self._arena, self._planner = arena, _EndsMoved(Skill.load(name), settings)
        self.settings = {"model": name, **asdict(settings)}

    def reset(self, scene: Scene) -> None:
        """Forget all that was before."""
        self._goal, self._version, self._path = GoalRequest(Pose(*scene.goal_pose)), 0, None
        # However it follows, nothing is too far from where it was sent: of poses only where the arm begins counts.
        self._measured = scene.start
        self._planner.clear_goal()
        stream: PoseStream | TrajectoryStream
        if self._arena.whole_arm:
            self._planner.goal = scene.goal
            stream = TrajectoryStream(self._planner, math.inf, _LATENCY)
        else:
            self._planner.goal = np.concatenate(scene.goal_pose)
            stream = PoseStream(self._planner, (math.inf, math.inf))
        self._cycle = PaperCycle(self._planner, stream, *_TIMEOUTS, (math.inf, math.inf), time.thread_time)

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """As the node's cycle, of an arm that is where it was sent."""
        self._version += 1
        count = len(obstacles.radii)
        seen = ObstacleSet(
            obstacles.centres, obstacles.radii, tuple(map(str, range(count))), self._version, np.zeros((count, 3)),
            np.zeros(count), np.full(count, now),
        )  # fmt: skip
        inputs = CycleInputs(self._measured, 0.0, self._goal, 1, seen, now=now, heard=now)
        output = self._cycle.run(inputs, TICK)
        refusal = "" if output.verdict.ok else output.verdict.sentence
        if output.configuration is not None:
            self._measured = output.configuration
        if output.trajectory is not None:
            return Answer.playing(*output.trajectory, refusal)
        if output.commanded is None:
            return Answer(refusal=refusal)
        before, self._path = self._path, self._planner.path
        return Answer(pose=output.commanded, refusal=refusal, planned=self._path is not before)


class _EndsMoved(PaperPlanner):
    """The paper's planner whose paths end at a goal, a place (p,) as of `TimedPath`."""

    goal: np.ndarray

    def _decoded(self, latent: np.ndarray) -> TimedPath:
        path = super()._decoded(latent)
        goal, end = self.goal.copy(), path.places[-1]
        if self.skill.space == "task" and goal[3:] @ end[3:] < 0.0:
            goal[3:] *= -1.0
        return replace(path, places=path.places + np.linspace(0.0, 1.0, len(path.places))[:, None] * (goal - end))
