"""What becomes of a run: which cases there are, what makes a row fail."""

from __future__ import annotations

import math

import pytest

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.faults.catalogue import FAULTS, chosen
from geodesic_motion_studies.faults.fault import PHASES, SUBJECTS, Fault, Figure, Findings
from geodesic_motion_studies.faults.suite import cases


class Patient(Fault):
    name, criterion, planner = "patient", "it waits", {"state_timeout": 1.0}

    def run(self, *_) -> None: ...


class Plain(Fault):
    name, criterion, phases = "plain", "it is plain", ("motion",)

    def run(self, *_) -> None: ...


def test_faults_have_names_of_their_own_criteria_and_phases() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)
    assert all(fault.criterion and set(fault.phases) <= set(PHASES) and fault.phases for fault in FAULTS)


def test_every_fault_runs_in_each_of_its_phases_with_each_seed() -> None:
    found = [(case.fault.name, case.phase, case.seed) for case in cases([Plain(), Patient()], PHASES, (0, 3))]
    assert found[:2] == [("plain", "motion", 0), ("plain", "motion", 3)]
    assert len(found) == 2 + 6
    assert not cases([Plain()], ["start"], (0,))


def test_cases_with_the_same_nodes_follow_each_other() -> None:
    names = [case.fault.name for case in cases([Plain(), Patient(), Plain()], ["motion"], (0,))]
    assert names == ["plain", "plain", "patient"]


def test_faults_are_chosen_by_name_and_unknown_ones_refused() -> None:
    assert [fault.name for fault in chosen(["state_stops"], False)] == ["state_stops"]
    every = [{fault.name for fault in chosen(None, True, subject)} for subject in SUBJECTS]
    assert set.union(*every) == {fault.name for fault in FAULTS}
    assert "goal_not_finite" in every[0] - every[1]
    assert "offer_not_finite" in every[1] - every[0]
    assert not any(fault.long for fault in chosen(None, False))
    with pytest.raises(ParameterError, match="did you mean state_stops"):
        chosen(["state_stop"], False)


def test_a_figure_beyond_its_limit_is_a_failure_and_so_is_none() -> None:
    findings = Findings()
    findings.at_most("hold after", 0.09, 0.1)
    assert not findings.failures
    findings.at_most("hold after", 0.11, 0.1)
    findings.at_most("hold after", math.nan, 0.1)
    assert len(findings.failures) == 2
    assert findings.measured == ["hold after 0.09 s", "hold after 0.11 s", "hold after nan s"]
    assert findings.figures[1] == Figure("hold after", 0.11, 0.1, "s")
