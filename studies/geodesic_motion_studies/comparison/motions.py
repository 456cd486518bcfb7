"""Motions as tables of joint positions: judged as a method's are, without the method.

A file of motions is a recording of joints (`read_joint_demonstrations`) with a demonstration FAMILY-NUMBER for each
scene, as `crossing-3`: it begins at time 0 at the scene's start, and the arm stands where it ends. It is judged as it
is given, without physics, interpolated linearly at the judge's steps; spheres that chase move towards the arm of the
table. The jerk that is reported is that of the interpolated table, which means nothing of tables with fewer samples
than the judge has steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration
from geodesic_motion_ros.demonstrations.readers import read_joint_demonstrations
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.execution import Effort, Judge
from geodesic_motion_studies.comparison.guard import GuardedArm
from geodesic_motion_studies.comparison.results import Played
from geodesic_motion_studies.comparison.scene import Scene
from geodesic_motion_studies.comparison.scene_file import SceneFile
from geodesic_motion_studies.experiments.moving_spheres import STEP

#: How far a motion may begin from the scene's start [rad], and how much faster than the arm's limits it may be.
START, FASTER = 0.01, 1.1


class TableMotion:
    """A table of joint positions as a source of motion (`execution.Motion`)."""

    def __init__(self, table: JointDemonstration) -> None:
        self._table = table

    def reset(self, scene: Scene) -> None:
        self._steps, self.effort = 0, Effort()

    def tick(self, now: float, obstacles: Obstacles) -> None:
        """A table knows of no obstacles."""

    def step(self) -> None:
        self._steps += 1

    @property
    def joint_positions(self) -> np.ndarray:
        return self._at(self._steps)

    @property
    def joint_velocities(self) -> np.ndarray:
        """In the last step."""
        return (self._at(self._steps) - self._at(self._steps - 1)) / STEP

    @property
    def commanded_positions(self) -> np.ndarray:
        return self.joint_positions

    def _at(self, step: int) -> np.ndarray:
        times, configurations = self._table.times, self._table.configurations
        return np.array([np.interp(step * STEP, times, joint) for joint in configurations.T])


def judged(scenes: SceneFile, path: Path, row: str) -> Iterator[Played]:
    """The outcome of a file of motions in every scene, as those of a row.

    Raises
    ------
    DemonstrationError : the file is no recording of the arm's joints.
    ParameterError : it lacks a scene, has one more, or a motion of it is none that begins at the scene's start.
    """
    tables = {item.name: item for item in read_joint_demonstrations(path, scenes.robot)}
    names = {f"{scene.family}-{scene.number}": scene for scene in scenes.scenes}
    for some, others, said in ((names, tables, "lacks a motion for"), (tables, names, "has a motion for no scene:")):
        missing = [name for name in some if name not in others]
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            raise ParameterError(
                f"{path}: {said} {missing[0]}{more}; it needs one for each scene: where a method refuses, its start"
            )
    arm = GuardedArm.named(scenes.robot, scenes.guard)
    for name, scene in names.items():
        _check(tables[name], scene, arm.robot, path)
    judge = Judge(arm)
    for name, scene in names.items():
        outcome, _ = judge.judge(scene, TableMotion(tables[name]))
        yield Played(row, scene.family, scene.number, {}, outcome)


def _check(table: JointDemonstration, scene: Scene, robot: Robot, path: Path) -> None:
    """ParameterError: the table does not begin at the scene's start, or jumps."""
    if table.times[0] != 0.0:
        raise ParameterError(f"{path}: {table.name} begins at {table.times[0]:g} s; it must begin at 0")
    off = float(np.max(np.abs(table.configurations[0] - scene.start)))
    if off > START:
        raise ParameterError(f"{path}: {table.name} begins {off:.3g} rad from the scene's start; at most {START:g}")
    speeds = np.abs(np.diff(table.configurations, axis=0)) / np.diff(table.times)[:, None]
    sample, joint = np.unravel_index(np.argmax(speeds / robot.velocity_limits), speeds.shape)
    if speeds[sample, joint] > FASTER * robot.velocity_limits[joint]:
        raise ParameterError(
            f"{path}: {table.name}, {table.times[sample]:.3f} s: joint {joint + 1} moves with "
            f"{speeds[sample, joint]:.3g} rad/s; the arm's limit is {robot.velocity_limits[joint]:.3g}"
        )
