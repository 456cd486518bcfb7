from __future__ import annotations

import json
import math
import os

import numpy as np
import pytest

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


def test_a_file_is_whole_or_as_it_was_before(tmp_path) -> None:
    path = write_json(tmp_path / "file.json", {"of": "before"})
    link = tmp_path / "link.json"
    link.symlink_to(path)
    with pytest.raises(TypeError):
        write_json(link, {"of": object()})
    assert json.loads(path.read_text()) == {"of": "before"}
    write_json(link, {"of": "now"})
    assert json.loads(path.read_text()) == {"of": "now"}
    assert link.is_symlink()
    assert {entry.name for entry in tmp_path.iterdir()} == {"file.json", "link.json"}


def test_json_is_written_into_a_pipe(tmp_path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_json(pipe, [1])
    assert json.loads(os.read(reading, 100)) == [1]
    os.close(reading)
    assert pipe.is_fifo()
