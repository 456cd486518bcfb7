"""What a point cloud that shows the arm costs the node that plans, step by step from the message to its distance field.

The scene is a table, a wall, and the arm, which swings, and of which a quarter of the points are; with the noise of a
depth camera whose frame is turned against the base. Each cloud is another one, of another configuration.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointCloud2
from tqdm import tqdm

from geodesic_motion_ros.geometry.quaternions import inverse, normalise, rotate
from geodesic_motion_ros.geometry.shapes import no_solids
from geodesic_motion_ros.nodes.messages import cloud_message, read_cloud
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.seen_cloud import CloudSettings, SeenCloud, see_cloud
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.joint_history import JointHistory
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import SelfFilter
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.benchmarks.stopwatch import Stopwatch, no_garbage_collection, percentiles_ms

STEPS = ("read", "see", "track")
#: Clouds a second of a depth camera, for the share of a core.
RATE = 30.0
#: Joint states a second; noise of the camera [m]; where it stands [m], and how it is turned.
_STATE_RATE, _NOISE = 120.0, 0.003
_ORIGIN, _QUATERNION = np.array([1.2, -0.8, 1.1]), normalise(np.array([0.4, -0.3, 0.8, 0.3]))
#: Share of the points that are of the arm, and of the table; the others are of the wall.
_ARM, _TABLE = 0.25, 0.5
_CAMERA, _BASE = "camera", "base"


class CloudBench:
    """Clouds of one number of points that show a moving arm."""

    def __init__(self, robot: str, count: int, seed: int = 0) -> None:
        self.robot, self._model = Robot.named(robot), CollisionModel.named(robot)
        self.count, self._random = count, np.random.default_rng(seed)
        self._filter = SelfFilter(self.robot, self._model)
        self._values = {parameter.name: parameter.default for parameter in PLANNER}

    def joints(self, time: float) -> np.ndarray:
        """Where the arm is at a time [s]: (eta,) [rad], at one radian a second at most."""
        return self.robot.ready + 0.25 * np.sin(4.0 * time + np.arange(len(self.robot.joint_names)))

    def message(self, time: float) -> PointCloud2:
        """What the camera sees at a time [s], in its frame."""
        centres, radii = self._filter.spheres(self.joints(time), ())
        of_arm, of_table = round(_ARM * self.count), round(_TABLE * self.count)
        spheres = self._random.integers(len(radii), size=of_arm)
        directions = self._random.normal(size=(of_arm, 3))
        directions *= (radii[spheres] / np.linalg.norm(directions, axis=1))[:, None]
        of_wall = self.count - of_arm - of_table
        wall = self._random.uniform([-0.5, -1.0, 0.0], [1.0, -1.0, 1.2], (of_wall, 3))
        table = self._random.uniform([-0.3, -0.7, -0.05], [1.0, 0.7, -0.05], (of_table, 3))
        points = np.concatenate([centres[spheres] + directions, table, wall])
        points += self._random.normal(0.0, _NOISE, points.shape)
        return cloud_message(rotate(inverse(_QUATERNION), points - _ORIGIN), _CAMERA, Time())

    def measure(self, clouds: int, show_progress: bool = True) -> CloudTimes:
        """Play so many clouds, after a few that do not count."""
        watches = {step: Stopwatch() for step in STEPS}
        dropped, remembered, kept = [], [], []
        history, tracker = JointHistory(self.robot), ObstacleTracker()
        seen: SeenCloud | None = None
        settings = CloudSettings(
            *(self._values[f"obstacle_cloud_{name}"] for name in ("voxel", "radius", "thickness")),
            self._values["self_filter_padding"],
        )
        states = itertools.count()
        ahead = 5
        for number in tqdm(range(ahead + clouds), desc=f"{self.count} points", disable=not show_progress):
            time = number / RATE
            message = self.message(time)
            while not history.reaches(time):
                at = next(states) / _STATE_RATE
                history.add(self.joints(at), at)
            with no_garbage_collection():
                with watches["read"]:
                    points, _ = read_cloud(message, _BASE, lambda *_: (_ORIGIN, _QUATERNION))
                joints = history.at(time, self._values["state_timeout"])
                with watches["see"]:
                    seen = see_cloud(points, self._filter, joints, (), no_solids(), settings, time, seen, _ORIGIN)
                with watches["track"]:
                    tracker.replace_cloud(
                        "obstacle_cloud", seen.field, time, clusters=seen.clusters, around=seen.around,
                        sight=seen.memory.sight,
                    )
            dropped.append(seen.of_arm)
            remembered.append(seen.remembered)
            kept.append(seen.points)
        for watch in watches.values():
            del watch.cpu[:ahead], watch.wall[:ahead]
        arm = round(_ARM * self.count)
        return CloudTimes(watches, min(dropped) / arm, float(np.mean(kept)), float(np.mean(remembered)))


@dataclass(frozen=True)
class CloudTimes:
    """What clouds of one size took.

    Attributes
    ----------
    watches : of each of `STEPS`.
    dropped : the fewest points of a cloud that were dropped, over those of the arm; more than 1 where the table is
        within the padding.
    kept, remembered : points that were, on average.
    """

    watches: dict[str, Stopwatch]
    dropped: float
    kept: float
    remembered: float

    @property
    def total(self) -> np.ndarray:
        """Processor time of each cloud [s]."""
        return np.sum([watch.cpu for watch in self.watches.values()], axis=0)

    @property
    def share(self) -> float:
        """Of a core, at `RATE`: the median."""
        return RATE * float(np.median(self.total))


@dataclass(frozen=True)
class CloudReport:
    """By number of points."""

    robot: str
    times: dict[int, CloudTimes]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            "robot": self.robot,
            "clouds": {
                str(count): {
                    "cpu_ms": {step: percentiles_ms(watch.cpu) for step, watch in times.watches.items()},
                    "total_cpu_ms": percentiles_ms(times.total), "share_of_a_core": times.share,
                    "dropped_of_arm": times.dropped, "kept": times.kept, "remembered": times.remembered,
                }
                for count, times in self.times.items()
            },
        }  # fmt: skip

    def table(self) -> str:
        """As plain text."""
        rows = []
        for count, times in self.times.items():
            cells = [percentiles_ms(watch.cpu) for watch in times.watches.values()] + [percentiles_ms(times.total)]
            cpu = [f"{cell['p50']:.2f} / {cell['p99']:.2f}" for cell in cells]
            rows.append([count, *cpu, f"{times.share:.0%}", f"{times.dropped:.1%}", round(times.kept)])
        head = ["points", *STEPS, "in all", f"core at {RATE:.0f} Hz", "dropped / of the arm", "kept"]
        title = f"{self.robot}: a cloud that shows the moving arm, processor time in ms, p50 / p99"
        return "\n".join([title, text_table(head, rows)])


def measure_clouds(robot: str, counts: Sequence[int], clouds: int, show_progress: bool = True) -> CloudReport:
    """Measure clouds of so many points, each size as often as asked.

    robot : its name or folder.
    """
    return CloudReport(robot, {count: CloudBench(robot, count).measure(clouds, show_progress) for count in counts})
