"""Shipped files are found in each kind of installation, and what is missing is named with every place."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from geodesic_motion_ros.utils.errors import GeodesicMotionError
from geodesic_motion_ros.utils.shared_files import PACKAGE, SharedFileError, find_shared

REPOSITORY = Path(__file__).resolve().parents[2]
MARKER = Path("share", "ament_index", "resource_index", "packages", PACKAGE)


def install(prefix: Path, relative: str, content: str, *, marker: bool = True) -> Path:
    """Lay one shared file under a prefix as an installation does."""
    file = prefix / "share" / PACKAGE / relative
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(content)
    if marker:
        (prefix / MARKER).parent.mkdir(parents=True)
        (prefix / MARKER).touch()
    return file


def test_source_tree_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert find_shared("package.xml") == REPOSITORY / "package.xml"


def test_interpreter_prefix_comes_before_the_source_tree(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    file = install(tmp_path, "package.xml", "installed", marker=False)
    assert find_shared("package.xml") == file


def test_sourced_workspace_comes_first_and_its_order_counts(monkeypatch, tmp_path) -> None:
    overlay, underlay = tmp_path / "overlay", tmp_path / "underlay"
    install(tmp_path / "environment", "config/a.yaml", "environment", marker=False)
    expected = install(overlay, "config/a.yaml", "overlay")
    below = install(underlay, "config/b.yaml", "underlay")
    install(underlay, "config/a.yaml", "underlay", marker=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "environment"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(map(str, (overlay, underlay))))
    assert find_shared("config/a.yaml") == expected
    assert find_shared(Path("config", "b.yaml")) == below


def test_workspace_without_this_package_is_passed_over(monkeypatch, tmp_path) -> None:
    install(tmp_path, "package.xml", "a leftover, not registered in the index", marker=False)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "nothing"))
    assert find_shared("package.xml") == REPOSITORY / "package.xml"


def test_missing_file_names_every_place(monkeypatch, tmp_path) -> None:
    install(tmp_path / "workspace", "config/a.yaml", "")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "workspace"))
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "environment"))
    with pytest.raises(SharedFileError) as caught:
        find_shared("models/no_such_skill")
    for place in (
        tmp_path / "workspace" / "share" / PACKAGE,
        tmp_path / "environment" / "share" / PACKAGE,
        REPOSITORY,
    ):
        assert str(place / "models" / "no_such_skill") in str(caught.value)
    assert isinstance(caught.value, GeodesicMotionError)


@pytest.mark.parametrize("path", ["/etc/passwd", "../package.xml", "models/../../secret"])
def test_paths_that_leave_the_share_folder_are_refused(path: str) -> None:
    with pytest.raises(SharedFileError, match="not a path inside the share folder"):
        find_shared(path)


def test_finding_files_needs_no_ros() -> None:
    code = (
        "import sys; from geodesic_motion_ros.utils.shared_files import find_shared; find_shared('package.xml'); "
        "print(*(m for m in ('rclpy', 'ament_index_python') if m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == ""
