"""The demo of a skill with elbows on either side: a sphere moves to where the elbow would be, far from the hand."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np

from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.joint_scene import JointScene
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import elbow_position, has_swivel, swivel_angle
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle, crossing
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference

#: The sphere: radius [m], speed [m/s], and how far from its place it sets out [m].
RADIUS, SPEED, BEFORE = 0.055, 0.10, 0.45
#: It comes to rest so long [s] after the undisturbed elbow would have been there: the first of them that is fair. Its
#: surface is in the path seconds before: the elbow has set out by then, and has time to turn back.
LATE = (1.7, 1.4, 1.1, 0.8, 0.5)
#: A family counts as taken where its mean path has more than this share; where families begin and end alike, none has.
_TAKEN_SHARE = 0.9
#: An elbow is out on a side where it swings farther than this [rad].
_SWUNG = 0.3


class ElbowScene(JointScene):
    """A sphere comes from outside to where the undisturbed elbow would be swung out furthest, and stays."""

    shown = ("tool", "elbow")
    view = "elbow"

    @staticmethod
    def suits(skill: Skill) -> bool:
        """Whether families of a skill's demonstrations have the elbow on different sides."""
        robot = Robot.named(skill.robot)
        if skill.space != "joint" or skill.canonical is None or not has_swivel(robot):
            return False
        modes, configurations = skill.canonical.modes, skill.canonical.configurations
        means = [configurations[modes == mode].mean(axis=0) for mode in np.unique(modes)]
        swung = [[swivel_angle(robot, position) for position in mean] for mean in means]
        furthest = [max(angles, key=abs) for angles in swung]
        return min(furthest) < -_SWUNG and max(furthest) > _SWUNG

    def _obstacles(self) -> Iterator[LineObstacle]:
        time = self._furthest_out(self.nominal)
        configuration = self.nominal.sample(time)[0]
        robot = self.planner.robot
        elbow, hand = elbow_position(robot, configuration), robot.forward(configuration)[0]
        inwards = _foot(elbow, robot.shoulder, hand) - elbow
        for late in LATE:
            yield crossing(elbow, inwards, time + late, SPEED, RADIUS, BEFORE, after=0.0)

    def _furthest_out(self, reference: JointReference) -> float:
        angles = [abs(swivel_angle(self.planner.robot, position)) for position in reference.positions]
        return float(reference.times[np.argmax(angles)])

    def _leaves_a_path(self, sphere: LineObstacle) -> bool:
        # The family of the other side does; where the sphere rests the arm may have begun.
        return True

    def families(self, recording: Recording) -> list[int] | None:
        if self.planner.graph.mean_path_count == 0:
            return None
        shares = self.planner.graph.mean_path_shares[self.nodes_along(recording)]
        taken = np.argmax(shares, axis=1)[np.max(shares, axis=1) > _TAKEN_SHARE]
        return [int(family) for family, _ in groupby(taken)]

    def positions(self, part: str, configurations: np.ndarray) -> np.ndarray:
        if part == "tool":
            return super().positions(part, configurations)
        return np.array([elbow_position(self.planner.robot, configuration) for configuration in configurations])


def _foot(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Where the perpendicular from a point (3,) meets the line through two others."""
    along = (end - start) / np.linalg.norm(end - start)
    return start + ((point - start) @ along) * along
