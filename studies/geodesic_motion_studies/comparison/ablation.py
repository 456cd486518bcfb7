"""What a constant of the planner is worth: the same scenes with it, and with another value in its place.

    python -m geodesic_motion_studies.comparison.ablation EVASION_DISPLACED=0 SEARCH_PERIOD=0.05 \\
        --skill panda_pouring --scenes 14 --seed 862

Constants are those of `contract/settings.py` that are one number. Scenes are those of the benchmark's families among
what moves, with all of the arm guarded, and judged as there; times, jerk and DTW are of the scenes that both reach.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Outcome, Stage
from geodesic_motion_studies.comparison.families import Family
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.scene import Scene, draw_scene

#: Families whose spheres move.
FAMILIES: tuple[Family, ...] = ("crossing", "chasing", "gate", "crowd")
_HEAD = ("constant", "reached", "won", "lost", "moving", "standing", "time [s]", "jerk", "DTW")


def parsed(texts: Sequence[str]) -> dict[str, float]:
    """Values by constant, of texts NAME=VALUE; ParameterError for what is no constant, or no number."""
    values = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not (name.isupper() and isinstance(getattr(constants, name, None), int | float)):
            raise ParameterError(f"'{name}': give a constant of contract/settings.py that is one number")
        try:
            values[name] = type(getattr(constants, name))(value)
        except ValueError:
            raise ParameterError(f"{name} cannot be '{value}': a number like {getattr(constants, name)}") from None
    return values


@contextmanager
def replaced(name: str, value: float) -> Iterator[None]:
    """Another value in the place of a constant, for every planner."""
    before = getattr(constants, name)
    setattr(constants, name, value)
    try:
        yield
    finally:
        setattr(constants, name, before)


def measured(arena: Arena, count: int, seed: int, values: Mapping[str, float]) -> str:
    """So many scenes of each family, played with the constants as they are, and with each of the values."""
    stage = Stage(arena)
    scenes = [draw_scene(arena, family, number, seed) for family in FAMILIES for number in range(count)]
    before = _played(stage, arena, scenes)
    rows = [_row("as they are", before, before)]
    for name, value in values.items():
        with replaced(name, value):
            rows.append(_row(f"{name}={value:g}", before, _played(stage, arena, scenes)))
    return text_table(_HEAD, rows)


def _played(stage: Stage, arena: Arena, scenes: Sequence[Scene]) -> list[Outcome]:
    method = Geodesics(arena)
    return [stage.play(scene, method)[0] for scene in scenes]


def _row(name: str, before: Sequence[Outcome], after: Sequence[Outcome]) -> list[Cell]:
    pairs = list(zip(before, after, strict=True))
    both = [(one, other) for one, other in pairs if one.success and other.success]

    def mean(figure: str, number: int) -> float:
        return float(np.mean([getattr(pair[number], figure) for pair in both])) if both else math.nan

    def change(figure: str) -> str:
        return f"{100.0 * (mean(figure, 1) / mean(figure, 0) - 1.0):+.0f} %"

    return [
        name, f"{sum(outcome.success for outcome in after)}/{len(after)}",
        sum(other.success and not one.success for one, other in pairs),
        sum(one.success and not other.success for one, other in pairs),
        sum(outcome.touched_moving for outcome in after), sum(outcome.contact == "standing" for outcome in after),
        f"{mean('duration', 1) - mean('duration', 0):+.2f}", change("jerk"), change("dtw"),
    ]  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("values", nargs="+", metavar="NAME=VALUE", help="a constant, and its value")
    parser.add_argument("--skill", default="panda_reach_to_grasp", help="its folder, or the name of a shipped one")
    parser.add_argument("--scenes", type=int, default=14, metavar="N", help="of each family (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the scenes (default: %(default)s)")
    arguments = parser.parse_args(argv)
    try:
        values = parsed(arguments.values)
        if arguments.scenes < 1:
            raise ParameterError(f"--scenes {arguments.scenes}: at least 1 of each family is needed")
        print(measured(Arena.of(Skill.load(arguments.skill), "arm"), arguments.scenes, arguments.seed, values))
    except GeodesicMotionError as error:
        print(f"ablation: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
