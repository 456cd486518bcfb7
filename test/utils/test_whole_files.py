"""A file is whole or as it was before."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from geodesic_motion_ros.utils.whole_files import written_whole


def test_what_is_written_takes_the_place_of_the_old_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "takes.csv"
    path.write_text("old")
    with written_whole(path) as part:
        part.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("old", [None, "old"])
def test_what_fails_halfway_leaves_what_was_there(tmp_path: Path, old: str | None) -> None:
    path = tmp_path / "takes.csv"
    if old is not None:
        path.write_text(old)

    def fail() -> None:
        with written_whole(path) as part:
            part.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert [file.read_text() for file in tmp_path.iterdir()] == ([] if old is None else [old])


def test_a_link_stays_one_and_a_device_is_written_to(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    link.symlink_to(target)
    with written_whole(link) as part:
        part.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    with written_whole(Path(os.devnull)) as part:
        part.write_text("away")
    assert not Path(os.devnull).is_file()
