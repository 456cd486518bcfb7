"""`timing` as a person meets it: refused in one line, ended by Ctrl-C without a traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from geodesic_motion_ros.cli import main

REPOSITORY = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["--skill", "no_such_skill"], "no skill 'no_such_skill'"),
        (["--skill", "panda_pouring"], "joint-space skill"),
        (["--skill", "panda_pouring", "panda_reach_to_grasp"], "one skill without --moving"),
        (["--moving", "0,-1"], "cannot be negative"),
        (["--detours", "1,0"], "must be positive"),
        (["--clouds", "1000,0"], "must be positive"),
        (["--trainings", "16,0"], "must be positive"),
        (["--trainings", "--revision", "never"], "give a tag, branch or commit of"),
        (["--trainings", "--skill", "panda_pouring"], "not with --trainings"),
        (["--revision", "HEAD"], "only with --trainings"),
        (["--moving", "0", "--skill", "no_such_skill"], "no skill 'no_such_skill'"),
        (["--json", "{file}/x.json"], "cannot be written"),
    ],
)
def test_what_cannot_be_done_is_reported_in_one_line(arguments, reported, tmp_path, capsys) -> None:
    file = tmp_path / "file"
    file.touch()
    assert main(["timing", *(argument.format(file=file) for argument in arguments)]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("geodesic-motion: ")]
    assert reported in line


def test_ctrl_c_ends_it_without_a_traceback(tmp_path) -> None:
    arguments = ["timing", "--quick", "--json", str(tmp_path / "timing.json")]
    command = [sys.executable, "-m", "geodesic_motion_ros", *arguments]
    with subprocess.Popen(
        command, cwd=REPOSITORY, env=os.environ | {"PYTHONUNBUFFERED": "1"}, stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:  # fmt: skip
        seen = b""
        while b"row" not in seen:  # a process of its own has begun to measure
            piece = process.stderr.read1()
            assert piece, seen.decode()
            seen += piece
        # As a terminal does: to the whole group.
        os.killpg(process.pid, signal.SIGINT)
        seen += process.stderr.read()
        assert process.wait() == 130
    assert b"interrupted" in seen
    assert b"Traceback" not in seen
    assert b"Warning" not in seen
    assert list(tmp_path.iterdir()) == []
