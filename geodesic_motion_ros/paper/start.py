"""Where the program `paper_planner` begins, as `planner` and `twin` do."""

from __future__ import annotations

from geodesic_motion_ros.nodes.start import start


def paper_planner() -> int:
    """Run the paper's planner; returns the exit code."""
    return start(f"{__package__}.paper_node", 0, _answer)


def _answer() -> int | None:
    from geodesic_motion_ros.nodes.usage import answer
    from geodesic_motion_ros.paper.paper_parameters import PROGRAM

    return answer(PROGRAM, None)
