"""The command line: `python -m geodesic_motion_ros` or `geodesic-motion`.

It has the product's commands and those that measure. As in `cli`, a command's libraries are imported when it runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from geodesic_motion_ros import cli
from geodesic_motion_ros.cli import demo, demonstrate, goal, guide, inspect, robot
from geodesic_motion_ros.studies.cli import benchmark, evaluate, experiment, faults, judge, measured_train, timing

_DESCRIPTION = """\
Reactive robot motion learned from demonstrations: a skill is a latent space whose shortest paths are the motion.

The steps: record a few demonstrations, or let a simulated arm `demonstrate` or `guide` it; `train` a skill, look at
it with `inspect`, measure with `evaluate` how well it predicts demonstrations it has not seen, and run `demo` to see an
arm do it around an obstacle.
"""
_EXAMPLES = (
    "demonstrate reach-to-grasp --out reach.npz",
    "train --demos pouring.npy --units cm --out skills/pouring",
    "inspect skills/pouring",
    "evaluate --demos pouring.npy --units cm --folds 0,3,6/1,4,7/2,5,8 --json out/pouring.json",
    "experiment geodesics --skill skills/pouring",
    "demo",
    "goal skills/pouring",
    "timing --quick",
    "benchmark --scenes 2",
    "judge --scenes scenes.npz --motions mine.csv",
    "faults --only state_stops",
)
COMMANDS: tuple[cli.Command, ...] = (
    demonstrate, guide, measured_train, evaluate, inspect, demo, goal, robot,
    experiment, timing, benchmark, judge, faults,
)  # fmt: skip


def build_parser() -> argparse.ArgumentParser:
    """The parser with all commands."""
    return cli.build_parser(COMMANDS, _DESCRIPTION, _EXAMPLES)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status. argparse leaves by SystemExit on a wrong command line and on --help."""
    return cli.main(argv, build_parser())
