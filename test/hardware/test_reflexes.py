"""Reflexes in plain words."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from geodesic_motion_ros.hardware.reflexes import ENOUGH, REFLEXES, errors_of, explained, late_commands


def test_each_is_named_with_what_happened_and_what_to_do() -> None:
    for name, (what, remedy) in REFLEXES.items():
        assert explained([name]) == f"{name}: {what}; {remedy}"


def test_one_that_is_unknown_is_named_all_the_same() -> None:
    assert explained(["instability_of_tomorrow"]).startswith("instability_of_tomorrow: ")
    assert "does not say why" in explained([])


def test_those_that_are_set_are_found() -> None:
    errors = SimpleNamespace(joint_reflex=True, cartesian_reflex=False, power_limit_violation=True)
    assert errors_of(errors) == ["joint_reflex", "power_limit_violation"]


def test_commands_that_were_late_are_a_cause_that_is_named_with_how_many() -> None:
    assert "18 of 100 commands did not reach it in time" in late_commands(0.82)
    assert late_commands(ENOUGH) == ""


def test_all_that_are_explained_are_errors_of_the_library() -> None:
    library = pytest.importorskip("pylibfranka", reason="pylibfranka is not installed: `make robot-server`")
    assert set(REFLEXES) <= set(dir(library.Errors))
