"""The demo of a joint-space skill of a redundant arm: a sphere moves to where the elbow would be, far from the hand."""

from __future__ import annotations

from itertools import groupby

import numpy as np

from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.joint_scene import JointScene
from geodesic_motion_ros.planning.arm_clearance import configuration_clearance
from geodesic_motion_ros.robot.swivel import elbow_position, swivel_angle
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle, crossing
from geodesic_motion_ros.trajectory.trajectory import JointReference

#: The sphere: radius [m], speed [m/s], and how far from its place it sets out [m].
RADIUS, SPEED, BEFORE = 0.055, 0.10, 0.45
#: It comes to rest so long [s] after the undisturbed elbow would have been there: the first of them with which that arm
#: goes this deep [m] into it. Its surface is in the path seconds before: the elbow has set out by then, and has time to
#: turn back.
LATE, DEPTH = (1.7, 1.4, 1.1, 0.8, 0.5), 0.02
#: A family counts as taken where its mean path has more than this share; where families begin and end alike, none has.
_TAKEN_SHARE = 0.9


class ElbowScene(JointScene):
    """A sphere comes from outside to where the undisturbed elbow would be swung out furthest, and stays."""

    shown = ("tool", "elbow")
    view = "elbow"

    def _obstacle(self) -> LineObstacle:
        time = self._furthest_out(self.nominal)
        configuration = self.nominal.sample(time)[0]
        robot = self.planner.robot
        elbow, hand = elbow_position(robot, configuration), robot.forward(configuration)[0]
        inwards = _foot(elbow, robot.shoulder, hand) - elbow
        spheres = [crossing(elbow, inwards, time + late, SPEED, RADIUS, BEFORE, after=0.0) for late in LATE]
        return next((sphere for sphere in spheres if self._clearance(sphere) < -DEPTH), spheres[-1])

    def _clearance(self, sphere: LineObstacle) -> float:
        """Smallest signed distance [m] from the undisturbed arm to a sphere."""
        planner, nominal, radius = self.planner, self.nominal, np.array([sphere.radius])
        return min(
            configuration_clearance(planner.collision, planner.robot, position, sphere.position(time)[None], radius)[0]
            for time, position in zip(nominal.times, nominal.positions, strict=True)
        )

    def _furthest_out(self, reference: JointReference) -> float:
        angles = [abs(swivel_angle(self.planner.robot, position)) for position in reference.positions]
        return float(reference.times[np.argmax(angles)])

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
