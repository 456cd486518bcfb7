"""The programs end cleanly when they are interrupted while their libraries load."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

#: Where the programs begin.
FOLDERS = {
    **dict.fromkeys(("planner", "filter", "twin", "record"), "nodes"), "paper_planner": "paper", "demo": "demo",
}  # fmt: skip
# Interrupts its own process at the very moment when a library of the node is looked for.
INTERRUPTED = """
import os, signal, sys

class Interrupter:
    def find_spec(self, name, path=None, target=None):
        if name == {library!r}:
            os.kill(os.getpid(), signal.{signal})
        return None

sys.meta_path.insert(0, Interrupter())
from geodesic_motion_ros.{folder}.start import {program}
print("loading", flush=True)
sys.exit({program}())
"""


@pytest.mark.parametrize(("program", "code"), [*((program, 130 if program == "demo" else 0) for program in FOLDERS)])
@pytest.mark.parametrize("signal", ["SIGINT", "SIGTERM"])
def test_an_interrupt_while_loading_ends_without_a_traceback(program: str, code: int, signal: str) -> None:
    script = INTERRUPTED.format(library="scipy", signal=signal, program=program, folder=FOLDERS[program])
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    assert done.stdout == "loading\n"
    assert done.stderr == ""


# Makes of the interrupt what compiled code makes of it.
COMPILED = """
import signal, sys, threading
from geodesic_motion_ros.nodes.running import run_node
from geodesic_motion_ros.nodes.usage import PROGRAMS

def create():
    try:
        # to this thread: to the process, any thread of DDS may get it, and Python's handler runs later
        signal.pthread_kill(threading.get_ident(), {number})
    except KeyboardInterrupt:
        pass
    raise SystemError("returned a result with an exception set")

sys.exit(run_node(PROGRAMS["twin"], create, []))
"""


@pytest.mark.parametrize(("number", "code"), [("signal.SIGINT", 0), ("signal.SIGTERM", 0), ("0", 1)])
def test_only_an_interrupt_excuses_what_compiled_code_raises_while_starting(number: str, code: int) -> None:
    done = subprocess.run([sys.executable, "-c", COMPILED.format(number=number)], capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    assert ("SystemError" in done.stderr) == (code == 1)


# Takes a node down whose only deed is to tell on how many cores the threads of its process may run by then.
TAKEN_DOWN = """
import os, threading
from geodesic_motion_ros.nodes import running, usage

class Node(running.LoopingNode):
    def _build(self):
        threading.Thread(target=threading.Event().wait, daemon=True).start()

    def _introduction(self):
        return "ready"

    def start(self):
        self.failure.set()

    def stop(self):
        pass

    def destroy_node(self):
        threads = [int(name) for name in os.listdir("/proc/self/task")]
        print(len(threads) > 1, len(set().union(*map(os.sched_getaffinity, threads))))
        super().destroy_node()

running.run_node(usage.PROGRAMS["twin"], lambda: Node("idle"), [])
"""


def test_a_node_is_taken_down_by_threads_that_share_one_core() -> None:
    """Fast DDS may wait for good for a callback that runs on another core."""
    done = subprocess.run([sys.executable, "-c", TAKEN_DOWN], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["True 1"], done.stderr


# Ends a node that moves something: it rests after so many looks, if at all.
BRAKING = """
import os, signal, threading, time
from geodesic_motion_ros.nodes import running, usage

running._BRAKING, running._SAME = {patience}, 0.2
main, looks = threading.get_ident(), 0

class Node(running.LoopingNode):
    def _build(self):
        pass

    def _introduction(self):
        return "ready"

    def start(self):
        signal.pthread_kill(main, signal.SIGINT)

    def brake(self):
        print("brake", flush=True)

    @property
    def is_at_rest(self):
        global looks
        looks += 1
        if looks == {insists}:
            time.sleep(0.3)  # longer than a signal that is the same
            signal.pthread_kill(main, signal.SIGINT)
        return looks == {rests}

    def stop(self):
        if looks:
            print("stop", looks, flush=True)

raise SystemExit(running.run_node(usage.PROGRAMS["twin"], lambda: Node("moving"), []))
"""
NEVER, FOR_EVER = -1, 1e9


@pytest.mark.parametrize(
    ("patience", "rests", "insists", "looks"),
    [(FOR_EVER, 3, NEVER, 3), (FOR_EVER, NEVER, 5, 5), (-1.0, NEVER, NEVER, 1)],
    ids=["until it rests", "until a second signal", "for so long at most"],
)  # fmt: skip
def test_a_node_that_is_to_end_brakes_before(patience: float, rests: int, insists: int, looks: int) -> None:
    script = BRAKING.format(patience=patience, rests=rests, insists=insists)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = done.stdout.splitlines()
    assert said[:2] == ["brake", f"stop {looks}"], done.stdout


# What a program has imported when it has answered.
LOADED = """
import sys
from {module} import {function}
sys.argv = ["program", "--help"]
try:
    {function}()
except SystemExit:
    pass
print(*sorted({{name.split(".")[0] for name in sys.modules}} & {{"numba", "scipy", "torch"}}), file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("module", "function", "allowed"),
    [*((f"geodesic_motion_ros.{folder}.start", name, set()) for name, folder in FOLDERS.items()),
     ("geodesic_motion_ros.cli", "main", {"scipy"})],
)  # fmt: skip
def test_help_waits_for_no_library_that_takes_seconds(module: str, function: str, allowed: set[str]) -> None:
    script = LOADED.format(module=module, function=function)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("usage: ")
    assert set(done.stderr.split()) <= allowed


@pytest.mark.parametrize("program", [["geodesic_motion_ros", "demo"], ["geodesic_motion_ros.demo.demo_node"]])
def test_a_demo_of_a_skill_that_is_not_there_is_refused_as_help_says(program: list[str], tmp_path: Path) -> None:
    command = [sys.executable, "-m", *program, "--skill", "nosuch", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines()[-1].startswith("demo: no skill 'nosuch'")
