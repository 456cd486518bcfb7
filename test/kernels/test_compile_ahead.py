"""What is compiled ahead is what planners call, and who waits for it hears how far it is."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import geodesic_motion_ros
from geodesic_motion_ros.kernels.compile_ahead import ABOUT, FOLDERS, compile_kernels

#: Prints the kernels that a planner of a skill compiles.
COMPILED = """
import sys
from numba.core import event

class Listener(event.Listener):
    def on_start(self, event):
        pass

    def on_end(self, event):
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith("geodesic_motion_ros."):
            print(function.__module__, function.__name__)

with event.install_listener("numba:compile", Listener()):
    from geodesic_motion_ros.certification.declared_scene import DeclaredScene
    from geodesic_motion_ros.planning.planner import ReactivePlanner
    from geodesic_motion_ros.kernels.loading import load_kernels
    from geodesic_motion_ros.skill.skill import Skill

    load_kernels(ReactivePlanner(Skill.load(sys.argv[1]), scene=DeclaredScene.empty()))
"""

#: In a copy of the package these two kernels are called in the place of all: they compile in seconds.
CALLED = """
def call_kernels() -> None:
    import numpy as np
    from geodesic_motion_ros.manifold.hyperbolic_tangent import tanh
    from geodesic_motion_ros.manifold.radial_basis import radial_basis

    tanh(np.zeros(3))
    radial_basis(np.zeros((1, 2)), np.zeros((3, 2)), 1.0, np.zeros((4, 3)))
"""


@pytest.mark.parametrize("skill", ["panda_insertion", "ur5_reach", "iiwa14_reach_to_grasp"])
def test_planners_of_other_skills_need_no_other_kernels(skill: str) -> None:
    compile_kernels()
    done = subprocess.run([sys.executable, "-c", COMPILED, skill], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


def test_every_folder_with_kernels_of_a_planner_is_looked_at_for_changes() -> None:
    package = Path(geodesic_motion_ros.__path__[0])
    files = [file for file in package.rglob("*.py") if "@numba.njit" in file.read_text()]
    with_kernels = {file.relative_to(package).parts[0] for file in files}
    # The paper's planner compiles its own as it starts.
    assert with_kernels - {"paper"} <= set(FOLDERS) <= {folder.name for folder in package.iterdir()}


@pytest.fixture
def few(tmp_path: Path) -> tuple[list[str], dict[str, str]]:
    """The command that compiles two kernels of a copy of the package, and its environment with an empty cache."""
    source = Path(geodesic_motion_ros.__path__[0])
    package = tmp_path / source.name
    shutil.copytree(source, package, ignore=shutil.ignore_patterns("__pycache__", "*.png"))
    compiler = package / "kernels" / "compiler.py"
    text, end = compiler.read_text().split("\n\nif __name__")
    compiler.write_text(f"{text}{CALLED}\n\nif __name__{end}")
    changes = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    return [sys.executable, "-m", "geodesic_motion_ros.kernels.compile_ahead"], os.environ | changes


def test_progress_is_said_once_and_nothing_where_all_is_there(few, tmp_path: Path) -> None:
    (python, *rest), environment = few

    def said(*options: str) -> list[str]:
        command = [python, *options, *rest]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stderr.splitlines()

    lines = said()
    assert lines[0] == f"compiling kernels, once: 1 of about {ABOUT}"
    assert lines[-1].startswith("compiled 2 kernels in ")
    assert said() == []
    # numba compiles bytecode that lacks a docstring anew, which is said too, and keeps both.
    assert said("-OO")[-1].startswith("compiled 1 kernels in ")
    assert said("-OO") == said() == []
    for file in (tmp_path / "cache").rglob("*.nbi"):
        file.unlink()
    assert said()[-1].startswith("compiled 2 kernels in ")
    # Nothing is said where it is not known that all is there, and it is.
    (tmp_path / "cache" / "kernels.finished").unlink()
    assert said() == []


def test_of_two_programs_one_compiles_and_the_other_waits(few, tmp_path: Path) -> None:
    command, environment = few
    both = [
        subprocess.Popen(command, env=environment, cwd=tmp_path, stderr=subprocess.PIPE, text=True) for _ in range(2)
    ]
    texts = [process.communicate()[1] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert sum("compiled 2 kernels in " in text for text in texts) == 1
    # How many lines the waiting one writes depends on how long the other takes.
    waited = [[line for line in text.splitlines() if "another process compiles the kernels" in line] for text in texts]
    assert sum(text.splitlines() == lines for text, lines in zip(texts, waited, strict=True)) == 1


def test_a_program_begins_where_kernels_cannot_be_compiled_ahead(few, tmp_path: Path) -> None:
    command, environment = few
    file = tmp_path / "geodesic_motion_ros" / "manifold" / "radial_basis.py"
    file.write_text(file.read_text().replace("squared[:] = 0.0", "squared[:] = nothing"))
    for _ in range(2):  # it is tried anew
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert "'nothing'" in done.stderr
        assert done.stderr.endswith("not all kernels could be compiled ahead: the others are where they are called\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_is_ended_while_compiling_exits_cleanly_and_leaves_no_process(few, number, tmp_path: Path) -> None:
    """However signals are blocked where it was started."""
    _, environment = few
    program = "from geodesic_motion_ros.nodes.start import planner; import sys; sys.argv = ['planner']; planner()"
    program = f"import signal; signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGPIPE]); {program}"
    node = subprocess.Popen(
        [sys.executable, "-c", program], env=environment, cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    assert node.stderr.readline() == f"compiling kernels, once: 1 of about {ABOUT}\n"
    assert Path(f"/proc/{node.pid}/task/{node.pid}/children").read_text().split()
    node.send_signal(number)
    rest = node.communicate()[1]  # the compiler has standard error too: it ends with it
    assert node.returncode == 0, rest
    assert "Traceback" not in rest
