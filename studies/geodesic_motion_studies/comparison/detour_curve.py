"""How far the tool may leave what was demonstrated, and what that wins among spheres that stand.

    python -m geodesic_motion_studies.comparison.detour_curve --skill panda_pouring --scenes 20 --seed 850

Scenes are those of the benchmark with all of the arm guarded, and judged as there; each is played with every reach of
detours. Intervals are Wilson's.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Outcome, Stage
from geodesic_motion_studies.comparison.families import Family
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.report import wilson
from geodesic_motion_studies.comparison.scene import draw_scene
from geodesic_motion_studies.comparison.scene_table import print_scene_table

#: Reaches of detours [m].
REACHES = (0.0, 0.05, 0.10, 0.15, 0.20, 0.25)
#: Families whose spheres stand.
FAMILIES: tuple[Family, ...] = ("static", "elbow")


def measured(arena: Arena, count: int, seed: int) -> str:
    """So many scenes of each family, played with every reach: a table of successes, by how many demonstrations are
    free.
    """
    stage, rows = Stage(arena), []
    scenes = [draw_scene(arena, family, number, seed) for family in FAMILIES for number in range(count)]
    for reach in REACHES:
        method = Geodesics(arena, planner=PlannerSettings(detour=reach))
        outcomes = [stage.play(scene, method)[0] for scene in scenes]
        free = [outcome for outcome in outcomes if outcome.mostly_free]
        fewer = [outcome for outcome in outcomes if not outcome.mostly_free]
        touched = sum(bool(outcome.contact) for outcome in outcomes)
        rows.append([f"{100 * reach:.0f} cm", *_success(free), *_success(fewer), touched])
    head = [arena.skill.name, "half or more free", "95 %", "fewer", "95 %", "touched"]
    return text_table(head, rows)


def _success(outcomes: Sequence[Outcome]) -> tuple[str, str]:
    """How many of some scenes were a success, and the interval of that share [%]."""
    reached = sum(outcome.success for outcome in outcomes)
    low, high = wilson(reached, len(outcomes))
    return f"{reached}/{len(outcomes)}", f"{100 * low:.0f}..{100 * high:.0f}"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    return print_scene_table("detour_curve", __doc__, measured, argv)


if __name__ == "__main__":
    sys.exit(main())
