"""The commands that measure, which the studies add to `geodesic-motion`.

As in `geodesic_motion_ros.cli`, a command's libraries are imported when it runs.
"""

from __future__ import annotations

from geodesic_motion_ros.cli import CommandSet
from geodesic_motion_studies.cli import benchmark, evaluate, experiment, faults, hardware, judge, measured_train, timing

#: An entry point of this distribution leads here.
STUDIES = CommandSet(
    {
        "train": measured_train, "evaluate": evaluate, "experiment": experiment, "timing": timing,
        "benchmark": benchmark, "judge": judge, "faults": faults, "hardware": hardware,
    },
    (
        "evaluate --demos pouring.npy --units cm --folds 0,3,6/1,4,7/2,5,8 --json out/pouring.json",
        "experiment geodesics --skill skills/pouring",
        "timing --quick",
        "benchmark --scenes 2",
        "judge --scenes scenes.npz --motions mine.csv",
        "faults --only state_stops",
        "hardware --runs 10 --faults",
    ),
    "`evaluate` measures how well a skill predicts demonstrations it has not seen; `experiment`, `timing`,\n"
    "`benchmark`, `judge`, `faults` and `hardware` measure the planner.\n",
)  # fmt: skip
