"""Blank lines, comments and docstrings are no code."""

from __future__ import annotations

from geodesic_motion_studies.benchmarks.code_lines import code_lines

SOURCE = '''"""A module."""

# a comment
import math  # another one


def twice(
    x: float,
) -> float:
    """Of a number.

    Twice.
    """
    text = """
    a string is code
    """
    return 2 * x + len(text)
'''


def test_code_is_counted_and_nothing_else() -> None:
    assert code_lines(SOURCE) == 1 + 3 + 3 + 1
    assert code_lines("") == 0
