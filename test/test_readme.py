"""The front door is true: its Python runs, its files exist, its topics are those of the node."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from geodesic_motion_ros.verdict import VerdictCode

REPOSITORY = Path(__file__).resolve().parents[1]
TEXT = (REPOSITORY / "README.md").read_text()


@pytest.mark.parametrize(
    "code", re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL), ids=["tool skill", "whole-arm skill"]
)
def test_the_python_of_the_tour_runs_and_finds_a_path(code, capsys):
    scope: dict[str, object] = {}
    exec(code, scope)
    assert capsys.readouterr().out.startswith("OK clearance")
    assert scope["plan"].verdict.clearance < 0.1, "the obstacle of the tour is far from the path: it shows nothing"


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\((?!http)([^)#]+)\)", TEXT))))
def test_what_the_readme_links_to_is_there(target):
    assert (REPOSITORY / target).exists()


@pytest.mark.parametrize("command", sorted(set(re.findall(r"geodesic-motion (\w+)", TEXT))))
def test_the_commands_of_the_readme_exist(command, capsys):
    from geodesic_motion_ros.cli import main

    with pytest.raises(SystemExit) as stopped:
        main([command, "--help"])
    assert stopped.value.code == 0
    assert f"geodesic-motion {command}" in capsys.readouterr().out


def test_the_codes_of_the_verdict_are_told():
    told = re.findall(r"^\| ([A-Z_, ]+) \|", TEXT, flags=re.MULTILINE)
    assert sorted(name for names in told for name in names.split(", ")) == sorted(code.name for code in VerdictCode)
