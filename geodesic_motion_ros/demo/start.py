"""Where the program `demo` begins, as `planner` and `twin` do."""

from __future__ import annotations

from collections.abc import Sequence

from geodesic_motion_ros.nodes.start import start


def demo(arguments: Sequence[str] | None = None) -> int:
    """Run the demo with arguments, by default those of this process; returns the exit code."""
    own = [] if arguments is None else [arguments]
    return start("geodesic_motion_ros.demo.demo_node", 130, lambda: _parse(arguments), *own)


def _parse(arguments: Sequence[str] | None) -> None:
    from geodesic_motion_ros.demo.demo_options import parsed

    parsed(arguments)  # it leaves by SystemExit where it has answered
