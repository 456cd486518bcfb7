"""A process that compiles the kernels of the planners for `compile_ahead`: numba's cache has them afterwards.

It prints the name of each kernel that has been compiled, a line each, and in the end the folders of numba's cache.
"""

from __future__ import annotations

import gc
import signal
import sys

from numba.core import event
from numba.core.dispatcher import Dispatcher

PACKAGE = __package__.partition(".")[0]
#: A shipped skill of each kind, and one of an arm whose speeds are limited towards its stops.
SKILLS = "panda_pouring", "panda_reach_to_grasp", "fr3_reach_to_grasp"


class _Printer(event.Listener):
    """Prints the name of each kernel of this package at the end of its compilation."""

    def on_start(self, event: event.Event) -> None:
        """Print nothing yet."""

    def on_end(self, event: event.Event) -> None:
        """Print the name."""
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith(PACKAGE):
            print(f"{function.__module__}.{function.__name__}", flush=True)


def call_kernels() -> None:
    """Call the kernels of planners of all kinds, and of a filter."""
    # Kernels with a signature are compiled where their module is imported.
    from geodesic_motion_ros.certification.declared_scene import DeclaredScene
    from geodesic_motion_ros.contract.settings import PlannerSettings
    from geodesic_motion_ros.filtering.motion_filter import MotionFilter
    from geodesic_motion_ros.kernels.loading import load_filter_kernels, load_kernels
    from geodesic_motion_ros.planning.planner import ReactivePlanner
    from geodesic_motion_ros.skill.skill import Skill

    for name in SKILLS:
        planner = ReactivePlanner(Skill.load(name), PlannerSettings(unseen="blocked"), scene=DeclaredScene.empty())
        load_kernels(planner)
    load_filter_kernels(MotionFilter("panda", DeclaredScene.empty(), recover="detour"))


def main() -> None:
    """Compile what the cache lacks."""
    ends = signal.SIGINT, signal.SIGPIPE  # end without a word where nobody waits any more
    for number in ends:
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ends)  # the process that started this one may have blocked them
    gc.disable()  # collections take a seventh of the time, for a process that soon ends
    with event.install_listener("numba:compile", _Printer()):
        call_kernels()
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(PACKAGE)]
    kernels = [kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)]
    print(*sorted({folder for kernel in kernels if (folder := kernel.stats.cache_path)}), sep="\n")


if __name__ == "__main__":
    main()
