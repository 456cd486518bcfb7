"""The inputs and the outputs of one cycle of a node that commands an arm. Knows nothing of ROS."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.filtering.offer import OfferRequest
from geodesic_motion_ros.obstacles.tracker import ObstacleSet
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.trajectory.trajectory import JointReference

PoseArrays = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class CycleInputs:
    """The inputs of one cycle, as they are known when it begins.

    Attributes
    ----------
    measured : the configuration (eta,) [rad] of the newest joint state; None before the first.
    state_age : [s] since that joint state was taken.
    state_fault : what is wrong with the newest joint states; "" where nothing is.
    drive : the configuration (eta,) [rad] that the drive of the arm says it commands; None where it has said nothing.
    drive_age : [s] since it commanded that.
    transit : the longest that messages of the arm have lately taken to here [s].
    unarmed : why nothing is to be commanded, but planned and shown; "" where the planner is armed.
    goal : the newest requested goal, or offered trajectory, or the refusal of its message; None before the first.
    goal_number : grows with every requested goal. withdrawn : the number of a goal that is not wanted any more, and
        why; 0: of none.
    obstacles : those that exist now.
    silent_sources : obstacle topics that have fallen silent, with for how long [s]; empty where that does
        not matter.
    late_sources : obstacle topics that tell of what is too long ago, with how long [s]; likewise.
    unusable_sources : obstacle topics of which nothing is known though something should be, with the reason.
    hold : whether a hold was requested.
    task_frame : where the frame that the skill was demonstrated in stands now, position (3,) [m] and quaternion (4,).
    publishers : names of the nodes that publish the commands; more than one and the arm must not move.
    subscribers : names of the nodes that receive them; None: that is not known yet.
    now : time of the clock that trajectories are stamped with, since the node began and without its jumps [s].
    heard : time of the clock that obstacles are heard by [s], which is never set.
    simulated : whether both are of a simulation, which may stand, run slowly or fast.
    has_clock : whether that clock shows a time already. clock_stood : for how long it has shown the same, where it is
        simulated, of real time [s].
    set_by : sum of all jumps of that clock so far [s].
    held : the objects in the hand. held_refused : why it is not known what is in it; "" where it is.
    other_arm : why the arm is not that of the skill; "" where it is, or that is not known.
    """

    measured: np.ndarray | None
    state_age: float
    goal: GoalRequest | OfferRequest | Refusal | None
    goal_number: int
    obstacles: ObstacleSet
    silent_sources: dict[str, float] = field(default_factory=dict)
    late_sources: dict[str, float] = field(default_factory=dict)
    unusable_sources: dict[str, str] = field(default_factory=dict)
    hold: bool = False
    task_frame: PoseArrays | None = None
    publishers: tuple[str, ...] = ()
    subscribers: tuple[str, ...] | None = None
    now: float = 0.0
    heard: float = 0.0
    simulated: bool = False
    has_clock: bool = True
    clock_stood: float = 0.0
    set_by: float = 0.0
    held: tuple[HeldObject, ...] = ()
    held_refused: str = ""
    other_arm: str = ""
    state_fault: str = ""
    drive: np.ndarray | None = None
    drive_age: float = 0.0
    transit: float = 0.0
    unarmed: str = ""
    withdrawn: tuple[int, str] = (0, "")

    @property
    def figures(self) -> dict[str, float]:
        """Ages of the inputs that reasons speak of [s], by name."""
        ages = {"joint_states": self.state_age} if self.measured is not None else {}
        return {f"age_{name}": age for name, age in (ages | self.silent_sources | self.late_sources).items()}

    def without(self, labels: Collection[str]) -> CycleInputs:
        """Return the inputs where obstacles of these labels do not count."""
        if not labels:
            return self
        silent, late = (
            {name: age for name, age in sources.items() if name not in labels}
            for sources in (self.silent_sources, self.late_sources)
        )
        return replace(self, obstacles=self.obstacles.without(labels), silent_sources=silent, late_sources=late)


@dataclass(frozen=True)
class CycleOutput:
    """The outputs of one cycle: commands, verdict and figures for the status.

    Attributes
    ----------
    verdict : of this cycle; goal_verdict : of the newest requested goal. When that is a refusal, the motion still
        serves the goal before. goal_served : the number of the goal that it serves; 0: none.
    commanded : pose to be at now, from a planner of poses; None from all others, before anything is known, and while an
        arm that was lost does not rest.
    trajectory : joint reference to play in the place of the one before, and the time of its first knot [s]; None from a
        planner of poses, and where the one before stays.
    reference : the path to the goal, with an OK verdict, or of a planner that is not armed. time_to_goal : until it
        ends [s], nan without.
    configuration : commanded (eta,) [rad], from a planner of configurations.
    speed : of the fastest joint [rad/s], from a planner of poses of the tool [m/s].
    mode : what the arm does (`contract.mode`); "" from planners that have no modes.
    news : what a person should know besides, as it happens; "" for nothing.
    disarms : what has happened, after which the arm must not move before a person has seen to it; "" for nothing.
    """

    verdict: Verdict
    goal_verdict: Verdict
    commanded: PoseArrays | None = None
    trajectory: tuple[JointReference, float] | None = None
    reference: Any = None
    time_to_goal: float = np.nan
    configuration: np.ndarray | None = None
    speed: float = 0.0
    mode: str = ""
    news: str = ""
    disarms: str = ""
    goal_served: int = 0

    @property
    def is_goal_refused(self) -> bool:
        """Whether the newest goal was refused."""
        return not (self.goal_verdict.ok or self.goal_verdict.code is VerdictCode.NO_GOAL)
