"""The kernels that are compiled ahead are those of the planners, and who waits for them hears how far it is."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import geodesic_motion_ros
from geodesic_motion_ros.planning.kernels import LIST, compile_kernels, listed

#: What a planner of each kind calls from Python, where all that those kernels call is in the cache.
CALLED = """
import json
from geodesic_motion_ros.planning.kernel_list import build_planners, called

build_planners()
print(json.dumps(called()))
"""

#: The program that compiles on one core, with one worker: what that loads costs more than what it compiles.
ON_ONE_CORE = """
import os, runpy
os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
runpy.run_module("geodesic_motion_ros.planning.kernels", run_name="__main__")
"""

#: A package of two listed kernels, whose copies of the modules compile in seconds.
FEW = ("manifold.radial_basis", "manifold.hyperbolic_tangent")


def test_the_list_has_what_planners_call() -> None:
    compile_kernels()
    done = subprocess.run([sys.executable, "-c", CALLED], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    called = {tuple(row) for row in json.loads(done.stdout)}
    assert len(called) > 50
    missing = called - {tuple(row) for row in listed()}
    assert not missing, f"python -m geodesic_motion_ros.planning.kernels --write: {sorted(missing)}"


@pytest.fixture
def few(tmp_path: Path) -> tuple[list[str], dict[str, str]]:
    """The command that compiles two kernels of a copy of the package, and its environment with an empty cache."""
    source = Path(geodesic_motion_ros.__path__[0])
    package = tmp_path / source.name
    shutil.copytree(source, package, ignore=shutil.ignore_patterns("__pycache__", "*.png"))
    rows = [row for row in listed() if row[0] in FEW]
    (package / LIST.relative_to(source)).write_text(json.dumps({"kernels": len(rows), "called": rows}))
    changes = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    return [sys.executable, "-c", ON_ONE_CORE], os.environ | changes


def test_progress_is_said_once_and_nothing_where_all_is_there(few, tmp_path: Path) -> None:
    command, environment = few
    first = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
    lines = first.stderr.splitlines()
    assert lines[0] == "compiling kernels, once: 0 of 2"
    assert lines[-1].startswith("compiled 2 kernels in ")
    # numba compiles optimized bytecode anew, which is said too, and keeps both.
    optimized = subprocess.run(
        [command[0], "-OO", *command[1:]], env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "compiled 2 kernels in " in optimized.stderr
    again = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert again.stderr == ""
    for file in (tmp_path / "cache").rglob("*.nbi"):
        file.unlink()
    lost = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "compiled 2 kernels in " in lost.stderr


def test_of_two_programs_one_compiles_and_the_other_waits(few, tmp_path: Path) -> None:
    command, environment = few
    both = [
        subprocess.Popen(command, env=environment, cwd=tmp_path, stderr=subprocess.PIPE, text=True) for _ in range(2)
    ]
    texts = [process.communicate()[1] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert sum("compiled 2 kernels in " in text for text in texts) == 1
    assert sum(text in ("", "another process compiles the kernels: waiting for it\n") for text in texts) == 1


def test_a_kernel_that_cannot_be_compiled_is_named_and_left(few, tmp_path: Path) -> None:
    command, environment = few
    file = tmp_path / LIST.relative_to(Path(geodesic_motion_ros.__path__[0]).parent)
    content = json.loads(file.read_text())
    content["called"][0][1] = "renamed"
    file.write_text(json.dumps(content))
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert f"not compiled ahead: {content['called'][0][0]}.renamed: " in done.stderr
    assert "compiled 1 kernels in " in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_is_ended_while_compiling_exits_cleanly_and_leaves_no_process(few, number, tmp_path: Path) -> None:
    _, environment = few
    program = "from geodesic_motion_ros.nodes.start import planner; import sys; sys.argv = ['planner']; planner()"
    node = subprocess.Popen(
        [sys.executable, "-c", program], env=environment, cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    assert node.stderr.readline() == "compiling kernels, once: 0 of 2\n"
    workers = Path(f"/proc/{node.pid}/task/{node.pid}/children").read_text().split()
    assert workers
    node.send_signal(number)
    rest = node.communicate()[1]  # the workers have standard error too: it ends with the last of them
    assert node.returncode == 0, rest
    assert "Traceback" not in rest
