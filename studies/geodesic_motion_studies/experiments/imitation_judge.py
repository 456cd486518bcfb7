"""Predictions of held-out demonstrations, measured for the table of `imitation`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.demonstrations.canonical import offsets_between
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.curves import Pose, PoseCurve
from geodesic_motion_ros.geometry.quaternions import angle_between, continuous_signs
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.encoder import TaskSpaceEncoder
from geodesic_motion_ros.manifold.transport import faded
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.skill.sheet import METRES_PER_RADIAN
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.experiments.baselines import PREDICTORS, Prediction
from geodesic_motion_studies.experiments.imitation_report import Measurement, Values
from geodesic_motion_studies.tools.similarity import COMPARED_POINTS, compare, distance_to_closest

EVERY_END = PlannerSettings(maximum_offset=10.0, maximum_offset_angle=math.pi)
"""Held-out ends lie off the manifold by design; how far is a figure of the table, not a reason to refuse."""


class Judge:
    """Measures predictions for held-out demonstrations against these and the training demonstrations."""

    def __init__(self, shown: Demonstrations, has_orientation: bool) -> None:
        self.shown = shown
        self.has_orientation = has_orientation
        self._shown_curves = [item.curve for item in shown]

    def baselines(self, index: int, held_out: Demonstration) -> list[Measurement]:
        """The rows that need no training, and the distance of a person's motion to the closest one shown."""
        start, goal = held_out.curve.start, held_out.curve.goal
        measured = [
            Measurement(row, index, None, self._values(predict(self.shown, start, goal), held_out))
            for row, predict in PREDICTORS.items()
        ]
        closest = {"to_closest_mm": 1e3 * distance_to_closest(held_out.curve, self._shown_curves)}
        return [*measured, Measurement("people", index, None, closest)]

    def on_canonical_sheet(
        self, skill: Skill, held_out: Iterable[tuple[int, Demonstration]], seed: int
    ) -> list[Measurement]:
        """The rows of one skill with a canonical sheet."""
        planners = {
            "geodesic_conditioned": PosePathPlanner(skill, EVERY_END),
            "geodesic_ridge": PosePathPlanner(skill, replace(EVERY_END, query_conditioning=False)),
            "geodesic_canonical": PosePathPlanner(skill, replace(EVERY_END, ridge_strength=0.0)),
        }
        measured = []
        for index, item in held_out:
            for row, planner in planners.items():
                measured.append(self._geodesic(row, index, item, planner, seed)[0])
            mean = Prediction.between(conditional_mean(skill, *_ends(item)), *_ends(item))
            oracle = sheet_oracle(planners["geodesic_ridge"], item)
            measured.append(Measurement("conditional_mean", index, seed, self._values(mean, item)))
            if oracle is not None:
                measured.append(Measurement("sheet_oracle", index, seed, self._compared(oracle, item)))
        return measured

    def on_raw_sheet(
        self, skill: Skill, held_out: Iterable[tuple[int, Demonstration]], seed: int
    ) -> list[Measurement]:
        """The rows of one skill with a raw sheet."""
        planner = PosePathPlanner(skill, EVERY_END)
        measured = []
        for index, item in held_out:
            geodesic, path = self._geodesic("geodesic_raw", index, item, planner, seed)
            line: Values = {}
            if isinstance(path, PosePath):
                ends = path.latent[[0, -1]]
                straight = ends[0] + np.linspace(0.0, 1.0, len(path.latent))[:, None] * (ends[1] - ends[0])
                line = self._latent_line(skill, straight, item)
            measured.append(geodesic)
            measured.append(Measurement("latent_line", index, seed, line, geodesic.refusal))
            measured.append(Measurement("reconstruction", index, seed, self._reconstruction(skill, item)))
        return measured

    def _geodesic(
        self, row: str, index: int, held_out: Demonstration, planner: PosePathPlanner, seed: int
    ) -> tuple[Measurement, PosePath | Refusal]:
        path = planner.plan(*held_out.curve.start, *held_out.curve.goal)
        if isinstance(path, Refusal):
            return Measurement(row, index, seed, {"off_manifold": _left_support(path)}, path.sentence), path
        figures = path.figures
        values = self._compared(path, held_out) | self._ends(path, held_out, "after")
        if planner.skill.canonical is None:
            values["endpoint_before_mm"] = 500.0 * (figures.start_offset + figures.goal_offset)
            values["endpoint_before_deg"] = self._degrees([figures.start_offset_angle, figures.goal_offset_angle])
        else:
            values["endpoint_before_mm"] = 1e3 * figures.end_correction
        values["off_manifold"] = _off_manifold(planner.skill, path.latent)
        return Measurement(row, index, seed, values), path

    def _latent_line(self, skill: Skill, latent: np.ndarray, held_out: Demonstration) -> Values:
        prediction = Prediction.between(_decoded(skill, latent), held_out.curve.start, held_out.curve.goal)
        return self._values(prediction, held_out) | {"off_manifold": _off_manifold(skill, latent)}

    def _reconstruction(self, skill: Skill, held_out: Demonstration) -> Values:
        curve = held_out.curve.resample(200)
        latent = TaskSpaceEncoder.from_arrays(skill.encoder_arrays).encode(curve.positions, curve.quaternions)
        decoded = _decoded(skill, latent)
        values = self._compared(decoded, held_out) | self._ends(decoded, held_out, "before")
        return values | {"off_manifold": _off_manifold(skill, latent)}

    def _values(self, prediction: Prediction, held_out: Demonstration) -> Values:
        return (
            self._compared(prediction.corrected, held_out)
            | self._ends(prediction.uncorrected, held_out, "before")
            | self._ends(prediction.corrected, held_out, "after")
        )

    def _compared(self, curve: PoseCurve, held_out: Demonstration) -> Values:
        found = compare(curve, held_out.curve)
        return {
            "dtw_mm": 1e3 * found.dtw,
            "frechet_mm": 1e3 * found.frechet,
            "orientation_deg": self._degrees([found.orientation]),
            "to_closest_mm": 1e3 * distance_to_closest(curve, self._shown_curves),
        }

    def _ends(self, curve: PoseCurve, held_out: Demonstration, when: str) -> Values:
        """Mean distance [mm] and angle [deg] of both ends from the demanded poses."""
        pairs: list[tuple[Pose, Pose]] = [
            (curve.start, held_out.curve.start),
            (curve.goal, held_out.curve.goal),
        ]
        distances = [float(np.linalg.norm(reached[0] - requested[0])) for reached, requested in pairs]
        angles = [float(angle_between(reached[1], requested[1])) for reached, requested in pairs]
        return {
            f"endpoint_{when}_mm": 1e3 * float(np.mean(distances)),
            f"endpoint_{when}_deg": self._degrees(angles),
        }

    def _degrees(self, angles: list[float]) -> float:
        """Mean in degrees; NaN for recordings without orientation."""
        return math.degrees(float(np.mean(angles))) if self.has_orientation else math.nan


def people(demonstrations: Demonstrations) -> Values:
    """How far apart people's own demonstrations are: means over all pairs."""
    pairs = [compare(first.curve, second.curve) for first, second in combinations(demonstrations, 2)]
    turned = float(np.mean([pair.orientation for pair in pairs]))
    return {
        "dtw_mm": 1e3 * float(np.mean([pair.dtw for pair in pairs])),
        "frechet_mm": 1e3 * float(np.mean([pair.frechet for pair in pairs])),
        "orientation_deg": math.degrees(turned) if demonstrations.has_orientation else math.nan,
    }


def conditional_mean(skill: Skill, start: Pose, goal: Pose) -> PoseCurve:
    """What a canonical skill's demonstrations predict for a query with no manifold: their weighted mean, carried."""
    sheet = skill.canonical
    assert sheet is not None
    offsets = [
        offsets_between(mean, pose[0][None], pose[1][None])[0]
        for mean, pose in ((skill.start_pose, start), (skill.goal_pose, goal))
    ]
    positions, quaternions = sheet.mean_curves(sheet.weights(*offsets, conditioned=True))
    tau = faded(np.linspace(0.0, 1.0, positions.shape[1]), skill.fade)[:, None]
    # The mode that most demonstrations belong to.
    largest = int(np.argmax(np.bincount(sheet.modes)))
    blend = (1.0 - tau) * offsets[0] + tau * offsets[1]
    return PoseCurve(*carried(positions[largest], continuous_signs(quaternions[largest]), blend))


def sheet_oracle(planner: PosePathPlanner, held_out: Demonstration) -> PoseCurve | None:
    """The nearest supported pose of the sheet, carried to a demonstration's ends, to each pose of the demonstration.

    None where the sheet cannot be carried there.
    """
    query = planner.query(*held_out.curve.start, *held_out.curve.goal)
    if isinstance(query, Refusal):
        return None
    wanted = held_out.curve.resample(COMPARED_POINTS)
    features = np.concatenate([query.graph.positions, METRES_PER_RADIAN * 2.0 * query.graph.quaternions], axis=1)
    tree = cKDTree(np.concatenate([features, features * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0]]))
    requested = np.concatenate([wanted.positions, METRES_PER_RADIAN * 2.0 * wanted.quaternions], axis=1)
    nearest = tree.query(requested)[1] % len(features)
    return PoseCurve(query.graph.positions[nearest], continuous_signs(query.graph.quaternions[nearest]))


def _ends(demonstration: Demonstration) -> tuple[Pose, Pose]:
    return demonstration.curve.start, demonstration.curve.goal


def _decoded(skill: Skill, latent: np.ndarray) -> PoseCurve:
    decoded = skill.decoder.decode(latent)
    return PoseCurve(decoded.positions, continuous_signs(decoded.quaternions))


def _off_manifold(skill: Skill, latent: np.ndarray) -> float:
    """1 where any point (n, d) of a path lies outside the support, else 0."""
    sigma, _ = skill.decoder.uncertainty(latent)
    return float(np.max(rms_sigma(sigma)) > skill.sigma_limit)


def _left_support(refusal: Refusal) -> float:
    """1 or 0 where a path was found and refused, NaN where there was none to judge."""
    figures = refusal.figures
    return float(not figures.in_support) if math.isfinite(figures.energy_per_edge) else math.nan
