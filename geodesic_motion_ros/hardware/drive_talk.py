"""What a node and the process that commands its arm say to each other."""

from __future__ import annotations

from typing import NamedTuple

from geodesic_motion_ros.hardware.drive_state import DriveMode
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints


class Request(NamedTuple):
    """What the node asks for: `arm`, `disarm`, `recover`, or `trajectory` with waypoints and begin [s] or None.

    number : of the answer; 0 where none is waited for.
    """

    kind: str
    number: int = 0
    waypoints: JointWaypoints | None = None
    begin: float | None = None


class Notice(NamedTuple):
    """What the node hears: with a number what came of that request, `done` or `failed`; with number 0 an event:
    `info`, `warning`, `error`, or `refused`, which is a trajectory. mode : that the text explains, where it does.
    """

    kind: str
    text: str
    number: int = 0
    mode: DriveMode | None = None
