"""One training, for `trainings`, which starts this file as a program with the code of any revision: numbers in a line.

Its arguments are a file of demonstrations, their kind, and settings as JSON. What it imports, revisions have had since
`learning.workload`; what a training takes they say since later.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from geodesic_motion_ros.demonstrations.readers import read_demonstrations, read_joint_demonstrations
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.learning.workload import Workload


def main(path: str, kind: str, given: str) -> None:
    """Say what the training takes, then train: prints what was said, seconds (or null) and bytes, as JSON."""
    of_poses = kind == "poses"
    demonstrations: Any = read_demonstrations(path, "m") if of_poses else read_joint_demonstrations(path, "panda")
    settings: Any = (TrainingSettings if of_poses else JointTrainingSettings)(**json.loads(given))
    workload = Workload.of(len(demonstrations), settings, 2 if of_poses else 1)
    seconds = workload.measure_seconds() if hasattr(workload, "measure_seconds") else None
    train_skill(demonstrations, settings, kind)
    print(json.dumps([seconds, workload.memory]))


if __name__ == "__main__":
    main(*sys.argv[1:])
