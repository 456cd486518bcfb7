"""Runs faults one after the other, each in its phases and with several seeds, and makes rows of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geodesic_motion_ros.utils.errors import GeodesicMotionError
from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import PLANNER, Fault, FaultSkipped, Findings, Row


@dataclass(frozen=True)
class Case:
    """A fault in one phase with one seed."""

    fault: Fault
    phase: str
    seed: int


def cases(faults: Sequence[Fault], phases: Sequence[str], seeds: Sequence[int]) -> list[Case]:
    """Every fault in every phase that it has with every seed; those with the same nodes side by side."""
    every = [
        Case(fault, phase, seed) for fault in faults for phase in fault.phases if phase in phases for seed in seeds
    ]
    configurations = [(dict(case.fault.planner), dict(case.fault.twin)) for case in every]
    return sorted(every, key=lambda case: configurations.index((dict(case.fault.planner), dict(case.fault.twin))))


def run_cases(
    skill: str,
    folder: Path,
    domain: int,
    todo: Sequence[Case],
    begun: Callable[[Case], None] = lambda case: None,
    output: str = "joint_trajectory",
    subject: str = PLANNER,
) -> Iterator[Row]:
    """Run cases on the two nodes of a skill; one row each, as soon as it is there.

    Parameters
    ----------
    folder : parameter files and logs of the nodes go there. begun : receives each case before it runs.
    output : what commands the arm, joint_trajectory or target_pose. subject : as of `Bench`.
    """
    with Bench(skill, folder, domain, output=output, subject=subject) as bench:
        for case in todo:
            begun(case)
            yield run_case(bench, case)


def run_case(bench: Bench, case: Case) -> Row:
    """Run one case; what goes wrong while it runs is a failure of it."""
    fault, findings = case.fault, Findings()
    random = np.random.default_rng(case.seed)
    passed: bool | None
    try:
        bench.prepare(fault.planner, fault.twin, fault.fresh)
        bench.reach(case.phase, fault, random)
        fault.run(bench, case.phase, random, findings)
        bench.judge(findings)
        if fault.fresh:
            bench.stop_nodes()
        passed = not findings.failures
    except FaultSkipped as skipped:
        findings.note(f"skipped: {skipped}")
        passed = None
    except GeodesicMotionError as error:
        findings.require(False, str(error))
        bench.stop_nodes()
        passed = False
    wrong = [f"NOT: {failure}" for failure in findings.failures]
    measured = "; ".join([*wrong, *findings.measured])
    return Row(fault.name, case.phase, case.seed, fault.criterion, measured, passed, tuple(findings.figures))
