"""Faults of what the nodes are started with: parameters, skills, and where the arm stands."""

from __future__ import annotations

import shutil
import time
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from geodesic_motion_ros.nodes.newest_goal import PREPARING
from geodesic_motion_ros.nodes.parameter_tables import TWIN
from geodesic_motion_ros.utils.shared_files import find_shared
from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import PLANNER_ALONE, START, Fault, Findings, NotSeenError
from geodesic_motion_studies.faults.goal_faults import require_unchanged

#: The first joint is turned by so much from where anybody has shown a start [rad].
_TURNED = 1.2
#: What stands has moved by no more than this [rad], [m].
_STILL = 0.01
_READY = next(parameter.default for parameter in TWIN if parameter.name == "initial_joint_positions")


class Refused(Fault):
    """A planner that is started with something wrong ends with exit code 1 and one line that says what."""

    phases = (START,)
    texts: tuple[str, ...]

    @abstractmethod
    def parameters(self, bench: Bench) -> Mapping[str, Any]:
        """What it is started with."""

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        parameters = dict(self.parameters(bench))
        code, said = bench.attempt(parameters)
        line = said.strip().splitlines()[-1] if said.strip() else "nothing"
        findings.note(f"exit code {code}: {line}")
        findings.require(code == 1, f"exit code {code}, expected 1")
        findings.require("Traceback" not in said, "a traceback was printed")
        for text in (*self.texts, *([parameters["skill"]] if "skill" in parameters else [])):
            findings.require(text in line, f"{text!r} is not said")


class BadParameterAtStart(Refused):
    name = "bad_parameter_at_start"
    criterion = "a parameter out of its range at start: refused by name and range, exit code 1"
    texts = ("state_timeout", "from 0.01 to 10")

    def parameters(self, bench: Bench) -> Mapping[str, Any]:
        return {"state_timeout": -1.0}


class SkillMissing(Refused):
    subjects = PLANNER_ALONE
    name = "skill_missing"
    criterion = "no skill there: refused, path and reason"
    texts = ("no skill folder",)

    def parameters(self, bench: Bench) -> Mapping[str, Any]:
        return {"skill": str(bench.folder / "nowhere" / "skill")}


class DamagedSkill(Refused):
    """A copy of the skill with something changed."""

    subjects = PLANNER_ALONE
    def parameters(self, bench: Bench) -> Mapping[str, Any]:
        shipped = Path(bench.skill_name)
        folder = shipped if shipped.is_dir() else find_shared(f"models/{bench.skill_name}")
        copy = bench.folder / "skills" / self.name
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(folder, copy)
        self.damage(copy)
        return {"skill": str(copy)}

    @abstractmethod
    def damage(self, folder: Path) -> None:
        """Change what is in the folder."""


class SkillTruncated(DamagedSkill):
    name = "skill_truncated"
    criterion = "a skill whose weights are cut off: refused, path and reason"
    texts = ("weights.safetensors", "truncated or altered")

    def damage(self, folder: Path) -> None:
        weights = folder / "weights.safetensors"
        weights.write_bytes(weights.read_bytes()[:-100])


class SkillAltered(DamagedSkill):
    name = "skill_altered"
    criterion = "a skill with one byte altered: refused, path and reason"
    texts = ("latent.npz", "truncated or altered")

    def damage(self, folder: Path) -> None:
        arrays = folder / "latent.npz"
        content = bytearray(arrays.read_bytes())
        content[len(content) // 2] ^= 1
        arrays.write_bytes(content)


class OtherDescription(DamagedSkill):
    """A skill that says something else of itself."""

    changes: Mapping[str, Any]

    def damage(self, folder: Path) -> None:
        file = folder / "skill.yaml"
        file.write_text(yaml.safe_dump(yaml.safe_load(file.read_text()) | dict(self.changes)))


class SkillOfOtherRobot(OtherDescription):
    name = "skill_of_other_robot"
    criterion = "a skill of a robot that is not known: refused, path and reason"
    changes = {"robot": "walle"}  # noqa: RUF012
    texts = ("walle",)


class SkillOfNewerFormat(OtherDescription):
    name = "skill_of_newer_format"
    criterion = "a skill of a newer format: refused, path and reason"
    changes = {"format_version": 999}  # noqa: RUF012
    texts = ("999", "this release reads")


class BadParameterRunning(Fault):
    name = "bad_parameter_running"
    criterion = "a parameter out of its range at run time: refused by name and range, all old values kept"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        before, since = bench.asks.parameter("planner", "state_timeout"), time.monotonic()
        result = bench.asks.set_parameters("planner", state_timeout=2.0, obstacle_timeout=-1.0)
        findings.note(result.reason)
        findings.require(not result.successful, "it was accepted")
        for text in ("obstacle_timeout", "0.02", "3600"):
            findings.require(text in result.reason, f"{text!r} is not said")
        after = bench.asks.parameter("planner", "state_timeout")
        findings.require(after == before, f"state_timeout is {after} now, not {before}")
        require_unchanged(bench, findings, phase, since)
        bench.finish(findings)


class StartFar(Fault):
    subjects = PLANNER_ALONE
    name = "start_far"
    criterion = "the arm stands where nobody has shown a start: START_OUT_OF_SUPPORT, or a certified bridge; no snap"
    phases = (START,)

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        elsewhere = bench.seen.configuration.copy()
        elsewhere[0] += _TURNED * (1.0 if elsewhere[0] < 0.0 else -1.0)
        try:
            bench.asks.set_parameters("twin", initial_joint_positions=elsewhere.tolist())
            bench.asks.trigger("twin/reset")
            bench.spend(0.2)
            bench.verdict("NO_GOAL")
            since = time.monotonic()
            bench.asks.send_goal()
            bench.wait(
                lambda: bench.seen.status.sent > since + 0.5 and bench.seen.status.values["goal_reason"] != PREPARING,
                "a verdict on the goal",
            )
            status = bench.seen.status
            findings.note(f"{status.code}: {status.reason}")
            if status.code == "OK":
                bench.arrive()
            else:
                findings.require(status.code == "START_OUT_OF_SUPPORT", f"the planner said {status.code}")
                self._require_still(bench, elsewhere, findings)
        finally:
            result = bench.asks.set_parameters("twin", initial_joint_positions=_READY)
            if not result.successful:
                raise NotSeenError(f"the twin refuses its own default: {result.reason}")

    def _require_still(self, bench: Bench, elsewhere: np.ndarray, findings: Findings) -> None:
        """The arm has not been moved."""
        findings.at_most("moved", float(np.max(np.abs(bench.seen.configuration - elsewhere))), _STILL, "rad")


START_FAULTS = (
    BadParameterAtStart, BadParameterRunning, SkillMissing, SkillTruncated, SkillAltered, SkillOfOtherRobot,
    SkillOfNewerFormat, StartFar,
)  # fmt: skip
