"""Every example runs by itself, ends well, states its verdict, and draws the picture that the gallery shows."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from math import inf
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PAGE = ROOT / "doc/examples.md"
#: What each prints, and between what the number in it lies. Where something is avoided, the control is not clear of it.
PRINTED = {
    "plan": {
        r"without avoidance: OK, clearance (\S+) mm": (-inf, -5), r"with avoidance: OK, clearance (\S+) mm": (0, 50),
    },
    "stream": {
        r"without avoidance: (\S+) cm": (-inf, -1), r"with avoidance: (\S+) cm": (0.5, inf),
        r"with avoidance: .*, (\S+) cm from the goal": (0, 1),
    },
    "teach_from_csv": {
        r"demonstrations, (\S+) mm off": (0, 10), r"free: OK, clearance (\S+) mm": (inf, inf),
        r"around a sphere: OK, clearance (\S+) mm": (0, inf),
    },
    "teach_from_a_bag": {r"(\d+) demonstrations in the bag; planned: OK": (5, 5)},
    "own_arm": {
        r"(\d+) spheres, \d+ pairs": (6, 100), r"(\S+) s  NO_FEASIBLE_PATH: .* goes .* m into": (0, 1),
        r"OK: a detour: it leaves what was demonstrated by (\S+) cm": (5, 25),
    },
    "obstacles_from_a_cloud": {
        r"points in (\d+) cubes": (100, 2000), r"without avoidance: OK, clearance (\S+) mm": (-inf, -5),
        r"with avoidance: OK, clearance (\S+) mm": (0, 50),
    },
    "filter_a_policy": {
        r"policy alone: (\S+) cm": (-inf, -1), r"(\S+) s  NO_FEASIBLE_PATH": (0, 8),
        r"with the filter: (\S+) cm": (0.5, inf), r"with the filter: .* at the end (\S+) rad off": (0, 0.001),
    },
    "filter_a_step_loop": {
        r"actions alone: (\S+) cm": (-inf, -1), r"(\S+) s  NO_FEASIBLE_PATH": (0, 10),
        r"with the filter: (\S+) cm": (0.1, inf),
    },
    "rounds": {r"(\S+) s  OK: round 2 of 3": (1, 5), r"(\S+) s  OK: round 3 of 3": (4, 9)},
    "paper_in_200_lines": {},
}  # fmt: skip
#: Arguments of those that have some.
GIVEN = {"paper_in_200_lines": ["--steps", "60", "--out", "paper_in_200_lines.png"]}


def shown_picture(name: str) -> Path:
    """The picture of an example on the page."""
    found = re.search(rf"\]\((\S*{name}\.png)\)", PAGE.read_text())
    assert found is not None, f"{PAGE.name} shows no {name}.png"
    return PAGE.parent / found[1]


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_runs_and_draws_what_the_gallery_shows(file: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(file), *GIVEN.get(file.stem, [])],
        cwd=tmp_path, env=os.environ | {"MPLBACKEND": "Agg"}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for pattern, (lowest, highest) in PRINTED[file.stem].items():
        found = re.search(pattern, done.stdout)
        assert found is not None, f"no {pattern!r} in {done.stdout}"
        assert lowest <= float(found[1]) <= highest, found[0]
    drawn, shown = (matplotlib.image.imread(path) for path in (tmp_path / f"{file.stem}.png", shown_picture(file.stem)))
    assert drawn.shape[:2] == shown.shape[:2]
    assert np.ptp(drawn[..., :3]) > 0.5


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_stands_on_the_page_with_title_code_and_a_small_picture(file: Path) -> None:
    page = PAGE.read_text()
    title = file.read_text().split("\n")[1] if file.stem != "paper_in_200_lines" else "The paper in 200 lines"
    assert f"\n## {title}\n" in page
    assert f"{{literalinclude}} ../examples/{file.name}\n" in page
    assert shown_picture(file.stem).stat().st_size < 110_000
