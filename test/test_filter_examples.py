"""The examples of the filter: what they move touches nothing, and the same motion alone does."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import VerdictCode

#: The filter's own `obstacle_margin` [m].
MARGIN = PlannerSettings().obstacle_margin
EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_policy_that_looks_at_nothing_comes_to_its_goal_untouched(capsys) -> None:
    """The control: played alone it meets the sphere."""
    policy = example("filter_a_policy")
    alone, filtered = (policy.play(filtered) for filtered in (False, True))
    assert np.min(alone[1]) < 0.0
    # It waits where the sphere, as predicted, keeps the margin.
    assert np.min(filtered[1]) > MARGIN
    for joint, _ in (alone, filtered):
        assert joint[-1] == pytest.approx(policy.GOAL[0], abs=1e-3)
    assert "NO_FEASIBLE_PATH" in capsys.readouterr().out


def test_a_step_loop_is_stopped_before_what_stands_in_its_path() -> None:
    """The control: the same actions alone lead into the sphere."""
    loop = example("filter_a_step_loop")
    touched = {}
    for avoid in (False, True):
        arm, clearances = loop.CertifiedArm(avoid), []
        joints, _ = arm.reset()
        for _ in range(300):
            joints, _, _, _, info = arm.step(joints + 0.1 * (np.arange(7) == 0))
            clearances.append(info["clearance"])
        touched[avoid] = min(clearances) < 0.0
        if avoid:
            assert info["verdict"].code is VerdictCode.NO_FEASIBLE_PATH
    assert touched == {False: True, True: False}
