"""The demo in a browser: planner, twin and page, until a user has seen enough."""

from __future__ import annotations

import time
from pathlib import Path

from geodesic_motion_ros.demo.demo_run import Processes, isolated_environment

#: How often the processes are looked at [s].
_GLANCE = 0.2
#: How often the planner shows its path [Hz]: soon after a user has dragged something into it.
_PATHS = 10.0


def show(skill: str, declared: str, out: Path, domain: int) -> None:
    """Run the three nodes, whose arm goes to the goal of a skill again and again; ends by KeyboardInterrupt alone.

    skill, declared : the parameters `skill` and `scene` of the nodes. out : folder of their logs. domain : of ROS.

    Raises
    ------
    GeodesicMotionError : viser is not installed. DemoError : a node has ended; says which one.
    """
    # Before anything starts: its library is an extra, and it says what brings that.
    import geodesic_motion_ros.view.page  # noqa: F401

    with Processes(out / "view", isolated_environment(domain)) as processes:
        print("starting twin, planner and page", flush=True)
        processes.start("twin", {"skill": skill, "scene": declared})
        processes.start("planner", {"skill": skill, "scene": declared, "path_rate": _PATHS})
        processes.start("view", {"skill": skill, "control": True, "repeat": True})
        while "ready: " not in processes.log("view"):
            processes.check()
            time.sleep(_GLANCE)
        ready = processes.log("view").rpartition("ready: ")[2].partition(";")[0]
        print(f"{ready}, drag the red sphere into the path of the arm; Ctrl-C ends it", flush=True)
        while True:
            processes.check()
            time.sleep(_GLANCE)
