"""The page of the filter: its block of Python runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from test.filtering.conftest import BEGIN, DURATION, offered

PAGE = Path(__file__).resolve().parents[2] / "doc" / "filter.md"


def test_the_block_of_the_page_runs() -> None:
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    times = np.linspace(0.0, DURATION, 76)
    given = {
        "q": BEGIN, "times": times, "positions": offered(times)[0], "centres": np.array([[0.0, 0.0, 2.0]]),
        "radii": np.array([0.05]), "velocities": np.zeros((1, 3)),
    }  # fmt: skip
    exec(block, given)
    assert given["verdict"].ok
    assert given["plan"].verdict.ok
    np.testing.assert_allclose(given["plan"].reference.positions[-1], given["positions"][-1], atol=1e-9)
