"""The demo on the robot server: what cannot be shown there is refused before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from geodesic_motion_ros.demo.demo_node import main
from geodesic_motion_ros.demo.demo_options import SERVED_SKILL, SKILL, parsed
from geodesic_motion_ros.demo.server_probe import FOLDER


def test_the_skill_is_one_of_the_arm_that_is_shown() -> None:
    assert parsed(["--robot-server"]).skill == SERVED_SKILL
    assert parsed([]).skill == SKILL
    assert parsed(["--robot-server", "--skill", "mine"]).skill == "mine"


@pytest.mark.parametrize(
    ("installed", "given", "reason"),
    [
        (False, [], f"no simulated arm is installed in {FOLDER}: run `make robot-server`"),
        (True, ["--skill", "panda_pouring"], "is of a panda, the simulated arm is an fr3"),
    ],
)
def test_what_cannot_be_shown_is_named(
    monkeypatch, tmp_path: Path, capsys, installed: bool, given: list[str], reason: str
) -> None:
    monkeypatch.chdir(tmp_path)
    if installed:
        FOLDER.mkdir()
        (FOLDER / ".ready").touch()
    assert main(["--robot-server", "--out", str(tmp_path / "out"), *given]) == 2
    assert reason in capsys.readouterr().err
    assert not list((tmp_path / "out").iterdir())
