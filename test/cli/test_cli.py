"""The command line as a person meets it: help, one line for an error, exit status."""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.cli import build_parser, main
from geodesic_motion_ros.cli.arguments import needing, writable
from geodesic_motion_ros.cli.inspect import describe
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = "geodesic_motion_ros"
READ = ("--demos", "{reach}", "--units", "cm")
COMMANDS = ("demonstrate", "train", "evaluate", "inspect", "demo", "goal", "experiment", "timing", "faults")


def module(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "geodesic_motion_ros", *arguments]


def test_help_names_every_command_and_gives_examples() -> None:
    done = subprocess.run(module("--help"), cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 0
    assert all(f"\n    {command}" in done.stdout for command in COMMANDS)
    assert "geodesic-motion train --demos" in done.stdout


def node(program: str, folder: str = "nodes") -> list[str]:
    return [sys.executable, "-c", f"import sys; from {PACKAGE}.{folder}.start import {program} as run; sys.exit(run())"]


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize(
    ("command", "statuses"),
    [
        (module("faults", "--list"), {128 + signal.SIGPIPE}),
        # argparse itself overlooks that its text cannot be written
        (module("benchmark", "--help"), {128 + signal.SIGPIPE, 0}),
        ([*node("twin"), "--help"], {128 + signal.SIGPIPE}),
        ([*node("demo", "demo"), "--help"], {128 + signal.SIGPIPE, 0}),
    ],
    ids=["list", "help", "twin", "demo"],
)
def test_a_reader_that_has_seen_enough_is_no_error(command, statuses, unbuffered) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        command, cwd=REPOSITORY, stdout=writing, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
    )  # fmt: skip
    os.close(writing)
    assert done.stderr == ""
    assert done.returncode in statuses


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize(
    ("command", "program"),
    [(module("faults", "--list"), "__main__.py"), ([*node("twin"), "--help"], "-c")],
    ids=["list", "twin"],
)
def test_a_full_disk_under_the_output_is_said_in_one_line(command, program, unbuffered) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            command, cwd=REPOSITORY, stdout=full, stderr=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    assert done.stderr == f"{program}: standard output cannot be written: No space left on device\n"
    assert done.returncode == 2


WITHOUT = """
import sys
from importlib.abc import MetaPathFinder

library = sys.argv.pop(1)


class Missing(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] == library:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Missing())
from geodesic_motion_ros.__main__ import main
sys.exit(main())
"""


@pytest.mark.parametrize(
    ("library", "arguments", "extra"),
    [
        ("torch", ("train", "--demos", "{reach}", "--units", "cm", "--out", "{tmp}/skill"), "ros[learn]"),
        ("pybullet", ("demonstrate", "reach-to-grasp", "--out", "{tmp}/reach.npz"), "ros[simulation]"),
    ],
)
def test_a_library_that_is_not_installed_is_named_with_the_command_that_brings_it(
    library, arguments, extra, recording, tmp_path
) -> None:
    given = [argument.format(reach=recording, tmp=tmp_path) for argument in arguments]
    command = [sys.executable, "-c", WITHOUT, library, *given]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    said = f"geodesic-motion: '{given[0]}' needs {library}, which is not installed: "
    assert done.stderr.splitlines()[-1] == f"{said}pip install 'geodesic_motion_{extra}'"
    assert "Traceback" not in done.stderr
    assert done.returncode == 2
    assert list(tmp_path.glob("skill*")) == list(tmp_path.glob("reach.npz*")) == []


def test_a_library_that_no_extra_brings_is_no_request_that_is_refused() -> None:
    with pytest.raises(ModuleNotFoundError), needing("'this' needs"):
        raise ModuleNotFoundError("No module named 'nothing'", name="nothing")


def test_the_reason_of_an_error_is_stated_where_nobody_reads_the_output(tmp_path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = module("inspect", str(tmp_path / "nothing"))
    done = subprocess.run(command, cwd=REPOSITORY, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert done.returncode == 2
    assert done.stderr.startswith("geodesic-motion: ")


# Interrupts its own process at the very moment when a library of the commands is looked for.
INTERRUPTED = """
import os, signal, sys

interrupting = sys.argv.pop(1)

class Interrupter:
    def find_spec(self, name, path=None, target=None):
        if name == interrupting:
            os.kill(os.getpid(), signal.SIGINT)
        return None

sys.meta_path.insert(0, Interrupter())
from geodesic_motion_ros.__main__ import main
sys.exit(main())
"""


@pytest.mark.parametrize("library", ["geodesic_motion_ros.cli", "argparse", "numba"])
def test_an_interrupt_while_the_commands_or_their_libraries_load_ends_without_a_traceback(library) -> None:
    command = [sys.executable, "-c", INTERRUPTED, library, "inspect", "ur5_reach"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "geodesic-motion: interrupted\n")


@pytest.mark.parametrize("command", [command for command in COMMANDS if command != "demo"])
def test_help_of_a_command_gives_an_example_that_its_parser_understands(command, capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main([command, "--help"])
    assert left.value.code == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    examples = [line[1:] for line in lines if line[:2] == ["geodesic-motion", command] and "..." not in line]
    assert examples
    for example in examples:
        # Some examples say behind the command what it does.
        words = example[:2] if command == "inspect" and "by" in example else example
        assert build_parser().parse_args(words).command == command


def parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """A parser, and those of all its commands."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from parsers(below)


def test_help_shows_defaults_as_they_are_typed() -> None:
    said = [" ".join(parser.format_help().split()) for parser in parsers(build_parser())]
    assert any("(default: start,motion,goal)" in text for text in said)
    assert any("(default: 0.0 0.0 0.0)" in text for text in said)
    assert not [text for text in said if re.search(r"default: [(\[{]", text)]


def test_faults_that_do_not_begin_leave_the_figures_of_before(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("geodesic_motion_ros.nodes.running.go_first", lambda: None)
    files = {"--json": tmp_path / "faults.json", "--markdown": tmp_path / "faults.md"}
    for file in files.values():
        file.write_text("of before")
    given = [str(word) for option in files.items() for word in option]
    assert main(["faults", "--skill", "no_such_skill", "--out", str(tmp_path), *given]) == 2
    assert "no skill 'no_such_skill'" in capsys.readouterr().err
    assert [file.read_text() for file in files.values()] == ["of before", "of before"]


def test_a_file_for_figures_is_not_there_before_there_are_figures(tmp_path) -> None:
    file = tmp_path / "new" / "figures.json"
    writable(file)
    assert list(file.parent.iterdir()) == []
    file.write_text("of before")
    writable(file)
    assert file.read_text() == "of before"
    for wrong in (tmp_path, file / "figures.json"):
        with pytest.raises(ParameterError, match="cannot be written"):
            writable(wrong)


def test_help_loads_no_heavy_library() -> None:
    code = (
        "import sys\nfrom geodesic_motion_ros.cli import build_parser\nbuild_parser().format_help()\n"
        "print(*{name.split('.')[0] for name in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not set(done.stdout.split()) & {"torch", "rclpy", "pybullet", "matplotlib", "numba"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["inspect", "no_such_skill"], "no skill 'no_such_skill'"),
        (["train", "--demos", "{tmp}/none.npy", "--units", "cm", "--out", "{tmp}/skill"], "none.npy: cannot be read"),
        (["train", "--demos", "{reach}", "--units", "m", "--out", "{tmp}/skill"], "did you mean --units cm?"),
        (["train", *READ, "--out", "{full}"], "choose another --out"),
        (["train", *READ, "--out", "{reach}/deep/skill"], "choose another --out"),
        (["train", "--demos", "{still}", "--units", "cm", "--out", "{tmp}/s"], "demonstration 'still_1' does not move"),
        (["goal", "no_such_skill"], "no skill 'no_such_skill'"),
        (["train", *READ, "--out", "{tmp}/s", "--steps", "0"], "must be positive"),
        (["train", *READ, "--out", "{tmp}/s", "--held-out", "4"], "numbered 0 to 3"),
        (["evaluate", *READ, "--folds", "0/9"], "there is no demonstration 9"),
        (["evaluate", *READ, "--json", "{reach}/x.json"], "cannot be written"),
        (["experiment", "geodesics", "--skill", "{full}"], "no skill folder"),
        (["experiment", "avoidance", *READ, "--radii", "0,1", "--out", "{tmp}"], "all positive"),
        (["experiment", "crossing", *READ, "--demos", "{reach}", "{reach}", "--out", "{tmp}"], "same file name"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_said_in_one_line(arguments, said, recording, tmp_path, capsys) -> None:
    full = tmp_path / "full"
    full.mkdir()
    (full / "letter.txt").write_text("keep me")
    still = np.load(recording)
    still[1] = still[1, 0]
    np.save(tmp_path / "still.npy", still)
    places = {"tmp": tmp_path, "reach": recording, "full": full, "still": tmp_path / "still.npy"}
    assert main([argument.format(**places) for argument in arguments]) == 2
    err = capsys.readouterr().err
    lines = [line for line in err.splitlines() if line.startswith("geodesic-motion: ")]
    assert len(lines) == 1
    assert said in lines[0]
    assert "Traceback" not in err
    assert (full / "letter.txt").read_text() == "keep me"


@pytest.mark.parametrize(
    "arguments",
    [
        [], ["fly"], ["train"], ["train", *READ, "--out", "s", "--seed", "-1"],
        ["evaluate", "--demos", "x.npy", "--units", "inch"],
    ],
)  # fmt: skip
def test_a_wrong_command_line_ends_with_status_2(arguments, capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main(arguments)
    assert left.value.code == 2
    assert "usage:" in capsys.readouterr().err


def test_ctrl_c_ends_a_training_without_a_traceback(recording, tmp_path) -> None:
    command = module("train", "--demos", str(recording), "--units", "cm", "--out", str(tmp_path / "skill"))
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, cwd=REPOSITORY, env=environment, stderr=subprocess.PIPE) as process:
        seen = b""
        while b"means" not in seen:  # the first stage is running
            piece = process.stderr.read1()
            assert piece, seen.decode()
            seen += piece
        process.send_signal(signal.SIGINT)
        seen += process.stderr.read()
        assert process.wait() == 130
    assert b"interrupted" in seen
    assert b"Traceback" not in seen
    assert not (tmp_path / "skill").exists()


def test_numbers_in_a_list_are_read_or_refused(capsys) -> None:
    parse = build_parser().parse_args
    given = ["experiment", "avoidance", "--demos", "a.npy", "--units", "m"]
    assert parse(given).radii == (0.02, 0.04, 0.08)
    assert parse([*given, "--radii", "0.1", "--seeds", "3,4"]).seeds == (3, 4)
    with pytest.raises(SystemExit):
        parse([*given, "--radii", "wide"])
    assert "'wide' is not a list of numbers like 0.02,0.04" in capsys.readouterr().err


def test_a_sphere_where_the_tool_is_halfway_is_in_its_path() -> None:
    skill = Skill.load("ur5_reach")
    halfway = describe(skill)["motion"]["halfway_position"]
    planner = ReactivePlanner(skill, PlannerSettings(avoidance=False))
    start, goal = skill.start_pose, skill.goal_pose
    # the control: far beside it
    for centre, hit in ((np.array(halfway), True), (np.array(halfway) + [0.0, 0.6, 0.0], False)):
        planner.set_obstacles(centre[None], np.array([0.04]))
        plan = planner.plan(start[:3], start[3:], goal[:3], goal[3:])
        assert (plan.verdict.figures.clearance < 0.0) == hit
