"""Trainings of many demonstrations, each in a process of its own (`one_training`): its time, and its memory.

Motions of the simulated teacher, before an arm makes them: `poses`, bottles brought from anywhere to cups anywhere, and
`joints`, reaches of the whole arm with the elbow up. Of fewer demonstrations they are the first ones of more.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.demonstrations.writers import save_demonstrations, save_joint_demonstrations
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.joint_teacher import Guidance, configurations, reach_guidances
from geodesic_motion_ros.simulation.teacher import Motion, multi_goal_motions
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.benchmarks import one_training
from geodesic_motion_studies.comparison.at_revision import REPOSITORY, commit_of, environment_of, work_tree

KINDS = ("poses", "joints")
SAMPLES, SEED, ROBOT = 300, 0, "panda"
#: Demonstrations and settings of the first training in a work tree, which compiles kernels: no measured one does.
_BEFORE, BRIEFLY = 4, {"steps": 20, "kernels": 20, "precision_iterations": 5}
#: Units in which the system says the most memory of a process [bytes].
_BYTES = 1 if sys.platform == "darwin" else 1024


@dataclass(frozen=True)
class TrainingRow:
    """One training.

    Attributes
    ----------
    code : of this version, or the revision that trained.
    seconds, cpu_seconds : from the first to the last of the process, and its processor time, the system's as well [s].
    memory : the most that it had at once [GB].
    said_seconds, said_memory : what was said beforehand, the time None if nothing; the memory is that of the largest
        arrays alone.
    """

    kind: str
    demonstrations: int
    code: str
    seconds: float
    cpu_seconds: float
    memory: float
    said_seconds: float | None
    said_memory: float


@dataclass(frozen=True)
class TrainingsReport:
    """All rows, and how many processes waited for a processor before and after [load of a minute]."""

    rows: tuple[TrainingRow, ...]
    load: tuple[float, float]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        rows = [asdict(row) | {"over_before": self.over_before(row)} for row in self.rows]
        return {"samples": SAMPLES, "load": self.load, "rows": rows}

    def over_before(self, row: TrainingRow) -> float | None:
        """Divide the time of a training by that of the next fewer of its kind and code; None of the fewest."""
        fewer = [
            other for other in self.rows
            if (other.kind, other.code) == (row.kind, row.code) and other.demonstrations < row.demonstrations
        ]  # fmt: skip
        return row.seconds / max(fewer, key=lambda other: other.demonstrations).seconds if fewer else None

    def table(self) -> str:
        """As plain text."""
        head = (
            "of", "demonstrations", "code", "s", "said", "cpu s", "GB", "of arrays, said", "over the row before",
        )  # fmt: skip
        rows = [
            (
                row.kind, row.demonstrations, row.code, row.seconds, row.said_seconds, row.cpu_seconds, row.memory,
                row.said_memory, self.over_before(row),
            )
            for row in self.rows
        ]  # fmt: skip
        before, after = self.load
        title = f"trainings of {SAMPLES} samples a demonstration; load {before:.2f} before, {after:.2f} after"
        return "\n".join([title, text_table(head, rows, left=(0, 2))])


def measure_trainings(
    counts: Sequence[int],
    revision: str | None = None,
    settings: Mapping[str, int] | None = None,
    kinds: Sequence[str] = KINDS,
    show_progress: bool = True,
) -> TrainingsReport:
    """Train on so many demonstrations of each kind, one training after the other.

    Parameters
    ----------
    revision : of this package's repository, which trains on the fewest as well.
    settings : of the trainings; without it the defaults.

    Raises
    ------
    ParameterError : there is no such revision, or a training fails.
    """
    counts, before, rows = sorted(set(counts)), os.getloadavg()[0], []
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="trainings_")))
        trees = [("this", REPOSITORY, counts)]
        if revision is not None:
            commit = commit_of(revision, REPOSITORY)
            trees.append((revision, stack.enter_context(work_tree(commit, REPOSITORY)), counts[:1]))
        total = len(kinds) * sum(len(trained) for *_, trained in trees)
        bar = stack.enter_context(tqdm(total=total, unit="training", disable=not show_progress))
        for kind in kinds:
            bar.set_description(f"{kind}: demonstrations")
            files = write_files(kind, [_BEFORE, *counts], folder)
            for code, tree, trained in trees:
                bar.set_description(f"{kind}: kernels")
                _train(kind, files[_BEFORE], tree, BRIEFLY)
                for count in trained:
                    bar.set_description(f"{kind}: {count}")
                    row = TrainingRow(kind, count, code, *_train(kind, files[count], tree, settings or {}))
                    bar.set_postfix_str(f"{row.seconds:.1f} s, {row.cpu_seconds:.1f} s of cpu, {row.memory:.2f} GB")
                    bar.update()
                    rows.append(row)
    return TrainingsReport(tuple(rows), (before, os.getloadavg()[0]))


def write_files(kind: str, counts: Sequence[int], folder: Path) -> dict[int, Path]:
    """Write files of so many demonstrations of a kind to a folder; returns them by their number."""
    files = {count: folder / f"{kind}_{count}.npz" for count in counts}
    if kind == "poses":
        motions = [_thinned(motion) for motion in multi_goal_motions(max(counts), SEED)]
        poses = [Demonstration(each.positions, each.quaternions, each.times, each.name) for each in motions]
        for count, file in files.items():
            save_demonstrations(Demonstrations(tuple(poses[:count])), file)
        return files
    robot = Robot.named(ROBOT)
    guidances = [
        Guidance(_thinned(each.motion), each.swivels[_kept(len(each.swivels))])
        for each in reach_guidances(max(counts), SEED, families=1, connected=True)
    ]
    joints = [
        JointDemonstration(configurations(robot, each), each.motion.times, each.motion.name) for each in guidances
    ]  # fmt: skip
    for count, file in files.items():
        save_joint_demonstrations(JointDemonstrations(tuple(joints[:count]), robot.joint_names, ROBOT), file)
    return files


def _kept(samples: int) -> np.ndarray:
    """Indices of `SAMPLES` of so many samples, evenly chosen."""
    return np.linspace(0, samples - 1, SAMPLES).astype(int)


def _thinned(motion: Motion) -> Motion:
    kept = _kept(len(motion.times))
    return replace(
        motion, times=motion.times[kept], positions=motion.positions[kept], quaternions=motion.quaternions[kept]
    )


def _train(kind: str, demonstrations: Path, tree: Path, settings: Mapping[str, int]) -> tuple[float, ...]:
    """Train with the code of a work tree; the figures of `TrainingRow`, in their order."""
    program = Path(one_training.__file__).read_text()
    command = [sys.executable, "-c", program, str(demonstrations), kind, json.dumps(settings)]
    begun = time.perf_counter()
    with subprocess.Popen(
        command, cwd=tree, env=environment_of(tree), stdout=subprocess.PIPE, text=True
    ) as process:  # fmt: skip
        assert process.stdout is not None
        said = process.stdout.read()
        # The one call that says what this child used, and no other one.
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    elapsed = time.perf_counter() - begun
    if process.returncode:
        raise ParameterError(f"the training on {demonstrations.name} fails (see above)")
    seconds, memory = json.loads(said)
    return elapsed, used.ru_utime + used.ru_stime, 1e-9 * _BYTES * used.ru_maxrss, seconds, 1e-9 * memory
