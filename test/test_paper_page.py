"""The page that puts the paper beside the code is true: its names, tests and commands exist."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from geodesic_motion_studies.experiments.registry import STUDIES

PAGE = Path(__file__).resolve().parents[1] / "doc" / "paper_in_code.md"
TEXT = PAGE.read_text()
#: Text and target of every link but those to the web.
LINKS = sorted(set(re.findall(r"\[([^\]]+)\]\((?!http)([^)]+)\)", TEXT)))
#: Names that a file is said to define: a function, a class, or Class.method.
NAMED = [(text.strip("`"), target) for text, target in LINKS if re.fullmatch(r"`[A-Za-z_][\w.]*`", text)]
COMMANDS = sorted(set(re.findall(r"geodesic-motion\s+experiment\s+([a-z][\w-]*)", TEXT)))


@cache
def definitions(file: Path) -> set[str]:
    """Functions and classes of a module, and the methods of these as Class.method."""
    names = set()
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{part.name}" for part in node.body if isinstance(part, ast.FunctionDef)}
    return names


def test_the_page_is_read():
    tests = [name for name, _ in NAMED if name.startswith("test_")]
    assert len(tests) > 20
    assert len(NAMED) - len(tests) > 30
    assert len(COMMANDS) >= 12


@pytest.mark.parametrize(("name", "target"), NAMED)
def test_every_name_is_defined_in_its_file(name, target):
    assert name in definitions((PAGE.parent / target).resolve())


@pytest.mark.parametrize("name", COMMANDS)
def test_every_experiment_is_a_command(name):
    assert name in STUDIES


def test_every_formula_has_a_test_or_says_that_it_has_none():
    sections = TEXT.split("## Experiments and figures")[0]
    rows = [row for row in re.findall(r"^\| .+ \|$", sections, flags=re.MULTILINE) if "| formula |" not in row]
    assert rows
    for row in rows:
        tests = re.split(r"(?<!\\) \| ", row.strip("| "))[-1]
        assert "`test_" in tests or tests == "none of its own here", row
