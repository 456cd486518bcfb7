from __future__ import annotations

import json
import math

import numpy as np

from geodesic_motion_ros.utils.tables import text_table, write_json


def test_columns_stand_under_their_names() -> None:
    table = text_table(["what", "mm"], [["line", 1.0], ["a longer one", None], ["n", 7], ["far", 2.5e7]], digits=1)
    assert table.splitlines() == [
        "what               mm",
        "---------------------",
        "line              1.0",
        "a longer one        -",
        "n                   7",
        "far           2.5e+07",
    ]


def test_columns_of_text_stand_to_the_left() -> None:
    table = text_table(["what", "n", "said"], [["a", 1, "yes"], ["b", 20, "certainly"]], left=(0, 2))
    assert table.splitlines()[2:] == ["a      1  yes", "b     20  certainly"]


def test_json_is_valid_whatever_the_numbers_are(tmp_path) -> None:
    content = {"nan": math.nan, "list": (np.float64(1.5), np.inf, np.int64(3)), "array": np.array([[1.0, np.nan]])}
    path = write_json(tmp_path / "new" / "file.json", content | {2: True, "text": "ü"})
    found = json.loads(path.read_text())
    assert found == {"nan": None, "list": [1.5, None, 3], "array": [[1.0, None]], "2": True, "text": "ü"}
