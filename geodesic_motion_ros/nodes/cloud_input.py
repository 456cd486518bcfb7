"""Hear of point clouds: a thread of its own works out what each shows.

The arm is taken out of a cloud where it was measured at the cloud's stamp, and so is what always stands around it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.geometry.shapes import no_solids
from geodesic_motion_ros.nodes.arm_state import ArmState
from geodesic_motion_ros.nodes.cloud_thread import CloudFigures, CloudThread
from geodesic_motion_ros.nodes.frames import PATIENCE
from geodesic_motion_ros.nodes.listener import Listener
from geodesic_motion_ros.nodes.messages import MessageRefused, frame_of, read_cloud, seconds
from geodesic_motion_ros.nodes.seen_cloud import CloudSettings, SeenCloud, see_cloud
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.self_filter import SelfFilter
from geodesic_motion_ros.utils.errors import RobotError

#: How often a cloud that waits for a joint state, or for a transform, looks for one [s].
_LOOK = 0.005


class CloudInput:
    """The point clouds of a camera, the newest first.

    Attributes
    ----------
    tracking_error : how far the arm may be from where it is taken to be [m]; declared : (b, 16) solids of the declared
        scene, which are taken out of clouds; who knows them sets them.
    figures : of the newest cloud that was used.
    """

    def __init__(
        self,
        listener: Listener,
        arm: ArmState,
        self_filter: SelfFilter,
        held: Callable[[], tuple[HeldObject, ...]],
        guard: Callable[[], AbstractContextManager[Any]],
        take: Callable[[SeenCloud, tuple[float, float], float], bool],
        changed: Callable[[], None],
    ) -> None:
        """arm : tells where the arm was. held : what the hand holds. guard : of a cloud that may be refused.

        take : takes what a cloud shows, when it arrived and its transit [s], and how long what it lacks is remembered
        [s]; False where the cloud was overtaken. changed : called when a cloud has been taken, from the thread that
        did.
        """
        self._listener, self._arm, self._self_filter = listener, arm, self_filter
        self._held, self._guard, self._take, self._changed = held, guard, take, changed
        self.figures, self.tracking_error, self.declared = CloudFigures(), 0.0, no_solids()
        self._seen: SeenCloud | None = None
        self._stopped = threading.Event()
        self._thread = CloudThread(self._see, self._take_seen, self._fail)

    def start(self) -> None:
        """Begin to look at clouds."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread that does so; harmless when it has ended or never began."""
        self._stopped.set()
        self._thread.stop()

    def forget(self) -> None:
        """Forget what was seen, and the cloud that is being looked at."""
        self._thread.forget()
        self._seen = None

    def on_cloud(self, message: PointCloud2) -> None:
        """Take a point cloud."""
        # One that is of no use must not take the place of one that waits.
        listener = self._listener
        if not listener.late.may_come(message.header):
            frame_of(message.header, listener.base_frame, listener.frames)
        moment = listener.time.read()
        heard = moment.running, moment.transit(seconds(message.header.stamp))
        self._thread.put((message, heard[0] - max(0.0, heard[1])), heard)

    def _see(self, heard: tuple[PointCloud2, float]) -> tuple[SeenCloud, CloudFigures] | None:
        """Read a cloud that was taken at a time [s, running]; None where it is refused, or the node ends."""
        (message, taken), listener = heard, self._listener
        parameters, filters = listener.parameters, listener.parameters["self_filter"]
        if not self._wait_for_frame(message.header) or (filters and not self._wait_for_joints(taken)):
            return None
        with self._guard():
            joints = self._joints_at(taken) if filters else None
            began = time.monotonic()
            points, not_finite = read_cloud(message, listener.base_frame, listener.frames)
            # A camera stands in the origin of its frame; of a cloud that somebody has carried nothing is known.
            frame = frame_of(message.header, listener.base_frame, listener.frames)
            viewpoint = frame.origin if np.any(frame.origin) else None
            edge = parameters["obstacle_cloud_voxel"]
            settings = CloudSettings(
                edge, parameters["obstacle_cloud_radius"], parameters["obstacle_cloud_thickness"],
                parameters["self_filter_padding"] + self.tracking_error,
            )  # fmt: skip
            seen = see_cloud(
                points, self._self_filter, joints, self._held(), self.declared, settings, taken, self._seen, viewpoint
            )
            figures = CloudFigures(
                seen.points, not_finite, seen.out_of_reach, seen.of_arm, seen.of_scene, seen.remembered,
                len(seen.clusters), time.monotonic() - began,
            )  # fmt: skip
            if seen.field.edge > edge:
                listener.node.get_logger().warning(
                    f"obstacle_cloud: its points are so far apart that cubes of {seen.field.edge:.3f} m must do, not "
                    f"{edge:g} m: filter the cloud",
                    throttle_duration_sec=5.0,
                )
            return seen, figures
        return None

    def _wait_for_frame(self, header: Header) -> bool:
        """Wait a moment for where a frame stood; False where the node ends meanwhile."""
        begun = time.monotonic()
        while self._listener.late.may_come(header) and time.monotonic() - begun < PATIENCE:
            if self._stopped.wait(_LOOK):
                return False
        return True

    def _wait_for_joints(self, taken: float) -> bool:
        """Wait for a joint state of a time [s, running] or later, as long as the arm moves on without one; False where
        the node ends meanwhile.
        """
        while not self._arm.history.reaches(taken):
            if self._listener.time.running() - taken > self._listener.parameters["state_timeout"]:
                break
            if self._stopped.wait(_LOOK):
                return False
        return True

    def _joints_at(self, taken: float) -> np.ndarray:
        """Interpolate the arm's joints (n,) [rad] at a time [s, running]; refused where they are not known."""
        try:
            return self._arm.history.at(taken, self._listener.parameters["state_timeout"])
        except RobotError as error:
            raise MessageRefused(
                f"where the arm was at its stamp is unknown, and the arm cannot be taken out of it: {error}; stamp "
                "clouds and joint states by one clock, or set self_filter to false where no cloud shows the arm"
            ) from error

    def _take_seen(self, made: tuple[SeenCloud, CloudFigures], heard: tuple[float, float]) -> None:
        """heard : when the cloud arrived, and its transit [s]."""
        seen, figures = made
        # What was an obstacle may be in the hand.
        moment = MOMENT if self._seen is None or seen.held == self._seen.held else 0.0
        if self._take(seen, heard, moment):
            self.figures, self._seen = replace(figures, number=self.figures.number + 1), seen
        self._changed()

    def _fail(self, error: BaseException) -> None:
        with self._guard():
            raise error
