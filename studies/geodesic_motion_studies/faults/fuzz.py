"""Messages full of nonsense: fields at random, of the kinds that have broken programs before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped
from sensor_msgs.msg import JointState, PointCloud2, PointField
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.messages import fill_pose

_NUMBERS = (0.0, -0.0, 1.0, -1.0, 0.3, 1e-320, 1e300, -1e300, float("nan"), float("inf"), -float("inf"), 1000.1)
_FRAMES = ("panda_link0", "", "nowhere", "task_frame", "/panda_link0", "ä\u2028")
_NAMES = (*(f"panda_joint{number}" for number in range(1, 8)), "", "panda_finger_joint1", "joint")
_DATATYPES = (0, PointField.INT8, PointField.FLOAT32, PointField.FLOAT64, 99)
_MOST = 12


class Fuzzer:
    """Makes messages by a seeded generator; the same seed makes the same ones."""

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random

    def _one(self, values: tuple) -> Any:
        return values[self._random.integers(len(values))]

    def _number(self) -> float:
        return float(self._one(_NUMBERS) if self._random.uniform() < 0.5 else self._random.normal())

    def _header(self, message: Any) -> Any:
        message.header.frame_id = _FRAMES[0] if self._random.uniform() < 0.7 else self._one(_FRAMES)
        message.header.stamp.sec = int(self._one((0, 1, 2**31 - 1, -(2**31), 1_700_000_000)))
        message.header.stamp.nanosec = int(self._one((0, 999_999_999, 2**32 - 1)))
        return message

    def pose(self) -> PoseStamped:
        message = self._header(PoseStamped())
        numbers = np.array([self._number() for _ in range(7)])
        fill_pose(message.pose, numbers[:3], numbers[3:])
        return message

    def joints(self) -> JointState:
        message = self._header(JointState())
        if self._random.uniform() < 0.5:
            message.name = list(_NAMES[:7])
        else:
            message.name = [self._one(_NAMES) for _ in range(self._random.integers(_MOST))]
        sizes = [len(message.name) if self._random.uniform() < 0.7 else int(self._random.integers(_MOST)) for _ in "pv"]
        message.position, message.velocity = ([self._number() for _ in range(size)] for size in sizes)
        return message

    def trajectory(self) -> JointTrajectory:
        message = self._header(JointTrajectory())
        message.joint_names = self.joints().name
        sizes = [len(message.joint_names) if self._random.uniform() < 0.8 else int(self._random.integers(_MOST))] * 2
        for _ in range(self._random.integers(_MOST)):
            point = JointTrajectoryPoint()
            point.positions, point.velocities = ([self._number() for _ in range(size)] for size in sizes)
            if self._random.uniform() < 0.7:
                point.velocities = []
            point.time_from_start.sec = int(self._one((0, 1, -1, 2**31 - 1)))
            point.time_from_start.nanosec = int(self._random.integers(10**9))
            message.points.append(point)
        return message

    def marker(self) -> Marker:
        message = self._header(Marker())
        message.ns, message.id = self._one(("", "a", "ß" * 50)), int(self._one((0, 1, -(2**31), 2**31 - 1)))
        message.type, message.action = int(self._random.integers(-1, 13)), int(self._random.integers(-1, 5))
        numbers = np.array([self._number() for _ in range(7)])
        fill_pose(message.pose, numbers[:3], numbers[3:])
        message.scale.x, message.scale.y, message.scale.z = (self._number() for _ in "xyz")
        message.lifetime.sec = int(self._one((0, 1, -1, 2**31 - 1)))
        return message

    def markers(self) -> MarkerArray:
        return MarkerArray(markers=[self.marker() for _ in range(self._random.integers(4))])

    def point(self) -> PointStamped:
        message = self._header(PointStamped())
        message.point.x, message.point.y, message.point.z = (self._number() for _ in "xyz")
        return message

    def cloud(self) -> PointCloud2:
        message = self._header(PointCloud2())
        names = ("x", "y", "z") if self._random.uniform() < 0.7 else ("x", "rgb", "")
        offsets = (0, 4, 8) if self._random.uniform() < 0.7 else (0, 4, 2**32 - 1)
        kind = PointField.FLOAT32 if self._random.uniform() < 0.7 else self._one(_DATATYPES)
        message.fields = [
            PointField(name=name, offset=offset, datatype=kind, count=1)
            for name, offset in zip(names, offsets, strict=True)
        ]
        width = int(self._random.integers(_MOST))
        message.height, message.width = int(self._one((0, 1, 2, 2**32 - 1))), width
        message.point_step, message.row_step = int(self._one((12, 0, 13))), int(self._one((12 * width, 0, 2**32 - 1)))
        numbers = np.array([self._number() for _ in range(3 * width)])
        with np.errstate(over="ignore"):
            message.data = numbers.astype(np.float32).tobytes()[: self._one((None, 5))]
        message.is_bigendian = bool(self._random.integers(2))
        return message


#: What makes the messages of each input.
INPUTS: Mapping[str, Callable[[Fuzzer], Any]] = MappingProxyType({
    "joint_states": Fuzzer.joints, "goal_pose": Fuzzer.pose, "goal_joints": Fuzzer.joints, "task_frame": Fuzzer.pose,
    "obstacles": Fuzzer.markers, "obstacle_marker": Fuzzer.marker, "obstacle_point": Fuzzer.point,
    "obstacle_cloud": Fuzzer.cloud,
})  # fmt: skip
#: The same of what is offered to a filter.
OFFERS: Mapping[str, Callable[[Fuzzer], Any]] = MappingProxyType({
    "joint_trajectory": Fuzzer.trajectory, "joint_target": Fuzzer.joints,
})  # fmt: skip
