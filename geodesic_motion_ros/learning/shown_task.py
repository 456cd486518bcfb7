"""Demonstrations of one task as a training reads them: curves of poses, or of configurations, on either sheet."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Literal

import numpy as np

from geodesic_motion_ros.demonstrations.canonical import (
    CanonicalForm,
    ConfigurationForm,
    PoseForm,
    mean_ends,
    sample_configurations,
    sample_poses,
)
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.modes import blend_weights
from geodesic_motion_ros.demonstrations.rounds import close_rounds
from geodesic_motion_ros.learning.autoencoder import Means, OrientationModel
from geodesic_motion_ros.learning.likelihoods import ConfigurationLikelihood, Likelihood, PoseLikelihood
from geodesic_motion_ros.learning.settings import CommonSettings, JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.robot.body_points import end_effector_poses, place_body_points
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.sheet import DemonstratedEnds

#: Samples of a demonstration whose codes a skill keeps, equally spaced along its arc.
CODE_SAMPLES = 100
#: Arrays (N, T, ...) of positions [m] and quaternions, or of configurations [rad] alone.
Curves = tuple[np.ndarray, ...]


class ShownTask(ABC):
    """The demonstrations that a skill is learned from: what differs between the two output spaces.

    Attributes
    ----------
    space : its name in skills.
    names : of the demonstrations; frame : that their tool poses are expressed in.
    robot : that is to do the task: the name of a shipped one, or the path of a folder.
    orientation_model : of the skill.
    likelihood : of samples of the space.
    """

    space: ClassVar[Literal["task", "joint"]]
    settings: CommonSettings
    names: list[str]
    frame: str
    robot: str
    orientation_model: OrientationModel
    likelihood: Likelihood
    _form: CanonicalForm | None

    def learned_curves(self, members: np.ndarray | None = None) -> Curves:
        """Make the curves that are learned; on the canonical sheet blends of demonstrations are among them.

        members : (n,) indices of the demonstrations that are learned from; None: all.
        """
        if self._form is None:
            curves = self._raw_curves(self.settings.samples)
            return curves if members is None else tuple(values[members] for values in curves)
        sheet = self._form.sheet(self.settings.samples)
        members = np.arange(len(sheet.modes)) if members is None else members
        blends = blend_weights(sheet.modes[members], self.settings.blends, self.settings.seed)
        weights = np.zeros((len(blends), len(sheet.modes)))
        weights[:, members] = blends
        own = (values[members] for values in sheet.curves)
        return tuple(map(np.concatenate, zip(own, sheet.mean_curves(weights), strict=True)))

    def shown_curves(self) -> Curves:
        """Make the curves of the demonstrations alone, as many samples of each as are learned."""
        samples = self.settings.samples
        return self._raw_curves(samples) if self._form is None else self._form.sheet(samples).curves

    def coded_curves(self) -> tuple[Curves, DemonstratedEnds | None]:
        """Make the curves whose codes a skill keeps, and the sheet that holds them, unrolled where they are rounds;
        None on the raw one.
        """
        if self._form is None:
            return self._raw_code_curves(), None
        sheet = self._form.sheet(CODE_SAMPLES)
        # A round may begin anywhere on it: where it begins does not choose between demonstrations.
        return sheet.curves, sheet.unrolled() if self.settings.closed else sheet.with_regression()

    def opposite(self, curves: Curves) -> Curves | None:
        """Write the same curves with the other signs of their quaternions; None where these say nothing."""
        return None

    @abstractmethod
    def ends(self, curves: Curves) -> tuple[np.ndarray, np.ndarray]:
        """Choose the mean first and last tool pose (7,) of the task; on the raw sheet of its coded curves."""

    def progress_length(self, curves: Curves) -> float:
        """Choose what the whole of the progress counts in the metric [m]: a share of how far the tool moves in coded
        curves; 0 on the raw sheet.
        """
        if not self.settings.progress_numbers:
            return 0.0
        positions, _ = self.tool_poses(curves)
        positions = positions.reshape(*curves[0].shape[:2], 3)
        return self.settings.progress_share * float(
            np.linalg.norm(np.diff(positions, axis=1), axis=-1).sum(axis=1).mean()
        )

    @abstractmethod
    def tool_poses(self, values: Curves | Means) -> tuple[np.ndarray, np.ndarray]:
        """Find the tool's positions (..., 3) [m] and quaternions (..., 4) in points of the space."""

    @abstractmethod
    def compared_points(self, values: Curves | Means) -> np.ndarray:
        """Place the points (n, K, 3) [m] by whose distances points (n in all) of the space are compared."""

    @staticmethod
    @abstractmethod
    def energies(graph: Any) -> np.ndarray:
        """Measure the squared lengths (m,) of a graph's edges where nothing is carried and no obstacle is near."""

    @abstractmethod
    def _raw_curves(self, samples: int) -> Curves: ...

    def _raw_code_curves(self) -> Curves:
        return self._raw_curves(CODE_SAMPLES)


class ShownPoses(ShownTask):
    """Poses of a tool. Orientations of the raw sheet are learned with both signs, unless the recordings have none."""

    space = "task"

    def __init__(
        self, demonstrations: Demonstrations, settings: TrainingSettings | None = None, robot: str | None = None
    ) -> None:
        self.settings = settings or TrainingSettings()
        if self.settings.closed:
            demonstrations = close_rounds(demonstrations, self.settings.rotation_length)
        self._demonstrations = demonstrations.align_hemispheres()
        self.names, self.frame = [item.name for item in demonstrations], demonstrations.frame
        self.robot = robot or DEFAULT_ROBOT
        self.likelihood = PoseLikelihood(self.settings)
        # Recordings without orientation are learned with one sign only: there are no two clusters.
        self.orientation_model = self.settings.orientation_model if demonstrations.has_orientation else "sign_blind"
        canonical = self.settings.sheet == "canonical"
        length, closed = self.settings.rotation_length, self.settings.closed
        self._form = PoseForm(self._demonstrations, length, closed=closed) if canonical else None

    def learned_curves(self, members: np.ndarray | None = None) -> Curves:
        curves = super().learned_curves(members)
        other = self.opposite(curves)
        return curves if other is None else tuple(map(np.concatenate, zip(curves, other, strict=True)))

    def opposite(self, curves: Curves) -> Curves | None:
        both = self._form is None and self._demonstrations.has_orientation
        return (curves[0], -curves[1]) if both else None

    def ends(self, curves: Curves) -> tuple[np.ndarray, np.ndarray]:
        return mean_ends(*curves) if self._form is None else (self._form.start, self._form.goal)

    def tool_poses(self, values: Curves | Means) -> tuple[np.ndarray, np.ndarray]:
        positions, quaternions = map(np.asarray, values[:2])
        return positions, quaternions

    def compared_points(self, values: Curves | Means) -> np.ndarray:
        """The tool's origin, and a point on each of its axes at the length that a radian counts: a turn moves these."""
        positions, quaternions = (np.asarray(part).reshape(-1, part.shape[-1]) for part in values[:2])
        points = np.concatenate([np.zeros((1, 3)), self.settings.rotation_length * np.eye(3)])
        return tool_points(positions, quaternions, points)

    @staticmethod
    def energies(graph: PoseGraph) -> np.ndarray:
        return graph.transported(Offsets.none(graph.mean_path_count), np.zeros((1, 3))).energies()

    def _raw_curves(self, samples: int) -> Curves:
        """The arc counts turning as well (`curves.pose_arc_length`): with positions alone, a tool that turns nearly on
        the spot would leave gaps of ten degrees and more between neighbouring samples.
        """
        return sample_poses(self._demonstrations, samples, self.settings.rotation_length)

    def _raw_code_curves(self) -> Curves:
        even = self._demonstrations.resample(CODE_SAMPLES)
        return even.positions_array(), even.quaternions_array()


class ShownConfigurations(ShownTask):
    """Configurations of an arm, which is the one that they were recorded with."""

    space = "joint"
    orientation_model = "none"

    def __init__(
        self,
        demonstrations: JointDemonstrations,
        settings: JointTrainingSettings | None = None,
        robot: str | None = None,
    ) -> None:
        self.settings = settings or JointTrainingSettings()
        if self.settings.closed:
            demonstrations = close_rounds(demonstrations, 0.0)
        self._demonstrations = demonstrations
        self.robot = robot or demonstrations.robot
        self._arm = Robot.named(self.robot)
        self.names, self.frame = [item.name for item in demonstrations], self._arm.base_link
        self.likelihood = ConfigurationLikelihood(self.settings, self._arm)
        canonical = self.settings.sheet == "canonical"
        metric, closed = self.settings.metric, self.settings.closed
        self._form = ConfigurationForm(demonstrations, self._arm, metric, closed=closed) if canonical else None

    def ends(self, curves: Curves) -> tuple[np.ndarray, np.ndarray]:
        if self._form is None:
            ends = [curves[0][:, end].mean(axis=0) for end in (0, -1)]
        else:
            ends = [self._form.start_poles[0], self._form.goal_poles[0]]
        start, goal = (np.concatenate(self._arm.forward(end)) for end in ends)
        return start, goal

    def tool_poses(self, values: Curves | Means) -> tuple[np.ndarray, np.ndarray]:
        configurations = np.asarray(values[0])
        return end_effector_poses(configurations.reshape(-1, configurations.shape[-1]), self._arm.chain)

    def compared_points(self, values: Curves | Means) -> np.ndarray:
        """The body points that the metric sees."""
        configurations, body = np.asarray(values[0]), self.settings.metric.body_points(self._arm)
        flat = np.ascontiguousarray(configurations.reshape(-1, configurations.shape[-1]))
        return place_body_points(flat, body.frames, body.offsets, self._arm.chain)

    @staticmethod
    def energies(graph: ConfigurationGraph) -> np.ndarray:
        return graph.transported(JointOffsets.none(graph.robot, graph.mean_path_count)).energies()

    def _raw_curves(self, samples: int) -> Curves:
        return sample_configurations(self._demonstrations, self._arm, self.settings.metric, samples)
