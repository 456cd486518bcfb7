"""The command line: `python -m geodesic_motion_ros` or `geodesic-motion`.

One file per command. A command's libraries (torch, matplotlib, rclpy) are imported when it runs, not before, so that
`--help` answers at once.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence

from geodesic_motion_ros.cli import (
    bench,
    benchmark,
    demo,
    demonstrate,
    evaluate,
    experiment,
    faults,
    goal,
    inspect,
    judge,
    train,
)
from geodesic_motion_ros.cli.arguments import HelpFormatter
from geodesic_motion_ros.errors import GeodesicMotionError
from geodesic_motion_ros.kernels import compile_kernels

_DESCRIPTION = """\
Reactive robot motion learned from demonstrations: a skill is a latent space whose shortest paths are the motion.

The way through: record a few demonstrations, or let a simulated arm `demonstrate`; `train` a skill on them, look at
it with `inspect`, measure with `evaluate` how well it predicts demonstrations it has not seen, and run `demo` to see an
arm do it around an obstacle.
"""
_EPILOG = """\
examples:
  geodesic-motion demonstrate reach-to-grasp --out reach.npz
  geodesic-motion train --demos pouring.npy --units cm --out skills/pouring
  geodesic-motion inspect skills/pouring
  geodesic-motion evaluate --demos pouring.npy --units cm --folds 0,3,6/1,4,7/2,5,8 --json out/pouring.json
  geodesic-motion experiment geodesics --skill skills/pouring
  geodesic-motion demo
  geodesic-motion goal skills/pouring
  geodesic-motion bench --quick
  geodesic-motion benchmark --scenes 2
  geodesic-motion judge --scenes scenes.npz --motions mine.csv
  geodesic-motion faults --only state_stops

`geodesic-motion COMMAND --help` explains a command. Exit status: 0 done, 2 something asked for is not possible (one
line on standard error says what, and what would be), 130 interrupted.
"""


def build_parser() -> argparse.ArgumentParser:
    """The parser with all commands; each sets `run`, a function of the parsed arguments."""
    parser = argparse.ArgumentParser(
        prog="geodesic-motion", description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for command in (demonstrate, train, evaluate, inspect, demo, goal, experiment, bench, benchmark, judge, faults):
        command.add_command(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status. argparse leaves by SystemExit on a wrong command line and on --help."""
    arguments = build_parser().parse_args(argv)
    try:
        compile_kernels()
        status = arguments.run(arguments) or 0
        sys.stdout.flush()
        return status
    except GeodesicMotionError as error:
        print(f"geodesic-motion: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("geodesic-motion: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Whoever reads has seen enough, as `head` has; what is left to be written at the end goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
