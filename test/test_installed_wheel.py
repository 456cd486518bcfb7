"""The product's wheel works by itself: train, plan, nodes and demo, where there is neither the repository nor a study.

What the wheel needs, the test environment lends, library by library; compiled kernels are copied from there, for to
compile them would take minutes.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import geodesic_motion_ros
from geodesic_motion_ros.contract.status import VerdictCode

REPOSITORY = Path(__file__).resolve().parents[1]
PACKAGE = "geodesic_motion_ros"
LIBRARIES = Path(sysconfig.get_path("purelib")).relative_to(sys.prefix)
#: Folders of an environment into which a wheel may write: of their own here, what lies in them is lent.
OWN = {LIBRARIES, Path("lib"), Path("share"), *(Path("share/ament_index", *below) for below in
       ((), ("resource_index",), ("resource_index", "packages")))}  # fmt: skip
#: This package and what belongs to it, which is not lent.
OURS = ("geodesic_motion", "__editable__")
#: A node has started, or the demo has ended, after so long [s] on a busy machine.
PATIENCE = 300.0


def lend(source: Path, target: Path, folder: Path) -> None:
    """Make a folder of an environment whose entries are links to those of another one."""
    (target / folder).mkdir(parents=True, exist_ok=True)
    for entry in (source / folder).iterdir():
        place = folder / entry.name
        if place in OWN or any(place in own.parents for own in OWN):
            lend(source, target, place)
        elif not entry.name.startswith(OURS) and not (target / place).exists():
            (target / place).symlink_to(entry)


class Installation:
    """An environment with the wheel, and programs that run in it, far from the repository."""

    def __init__(self, folder: Path) -> None:
        self.bin, self.home = folder / "bin", folder / "home"
        self.home.mkdir()
        removed = {"PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
        kept = {name: value for name, value in os.environ.items() if name not in removed}
        self.environment = kept | {"PATH": f"{self.bin}:{os.environ['PATH']}"}

    def run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self.bin / program, *arguments], cwd=self.home, env=self.environment, capture_output=True, text=True,
            timeout=PATIENCE,
        )  # fmt: skip

    @contextmanager
    def running(self, program: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
        """A program that runs until it is interrupted, which must end it well."""
        with (self.home / f"{program}.log").open("w") as log:
            process = subprocess.Popen(
                [self.bin / program, *arguments], cwd=self.home, env=self.environment, stdout=log, stderr=log
            )
            try:
                yield process
            finally:
                process.send_signal(signal.SIGINT)
                code = process.wait(PATIENCE)
        assert code == 0, (self.home / f"{program}.log").read_text()


@pytest.fixture(scope="module")
def installation(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    if shutil.which("git") is None or not (REPOSITORY / ".git").exists():
        pytest.skip("what the repository tracks is known to git alone")
    folder = tmp_path_factory.mktemp("wheel")
    tree = folder / "tree"
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    for name in filter(None, tracked.stdout.split("\0")):
        if (REPOSITORY / name).is_file() and not name.startswith(("studies/", "test/")):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(REPOSITORY / name, tree / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    options = ["--quiet", "--no-deps", "--no-index"]
    wheel = [*pip, "wheel", *options, "--no-build-isolation", "--wheel-dir", str(folder), str(tree)]
    done = subprocess.run(wheel, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    environment = folder / "environment"
    venv.create(environment, symlinks=True, with_pip=False)
    for place in ("lib", "share"):
        lend(Path(sys.prefix), environment, Path(place))
    (file,) = folder.glob("*.whl")
    install = [*pip, "--python", str(environment / "bin" / "python"), "install", *options, str(file)]
    done = subprocess.run(install, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shutil.rmtree(tree)
    _copy_kernels(environment / LIBRARIES / PACKAGE)
    return Installation(environment)


def _copy_kernels(package: Path) -> None:
    """Copy what is kept beside modules, which numba takes for that of a file of the same age and length."""
    here = Path(geodesic_motion_ros.__path__[0])
    for module in package.rglob("*.py"):
        source = here / module.relative_to(package)
        if source.read_bytes() == module.read_bytes():
            os.utime(module, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
    for kept in here.rglob("__pycache__/*"):
        place = package / kept.relative_to(here)
        if kept.is_file() and not kept.name.endswith(".pyc") and place.parents[1].is_dir():
            place.parent.mkdir(exist_ok=True)
            shutil.copy2(kept, place)


def test_the_command_line_has_the_product_s_commands_and_says_what_brings_the_others(installation) -> None:
    done = installation.run("geodesic-motion", "--help")
    assert done.returncode == 0, done.stderr
    assert "train" in done.stdout
    assert "benchmark" not in done.stdout
    done = installation.run("geodesic-motion", "experiment", "all")
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("geodesic-motion: 'experiment' is a command of the studies, which are not installed: pip ")
    place = installation.run("python", "-c", f"import {PACKAGE}; print({PACKAGE}.__path__[0])").stdout.strip()
    assert Path(place).is_relative_to(installation.bin.parent)
    assert installation.run("python", "-c", "import geodesic_motion_studies").returncode == 1


#: Plans with a shipped skill and with one that was hardly trained, and says what comes of it: of that, or why nothing.
PLAN = """
from geodesic_motion_ros import ReactivePlanner, Skill
from geodesic_motion_ros.utils.errors import SkillError

def code(name):
    skill = Skill.load(name)
    try:
        planner = ReactivePlanner(skill)
    except SkillError as error:
        return "SkillError"
    ends = (part for pose in (skill.start_pose, skill.goal_pose) for part in (pose[:3], pose[3:]))
    return planner.plan(*ends).verdict.code.name

print(code("panda_pouring"), code("mine"))
"""


def test_it_trains_a_skill_and_plans(installation) -> None:
    share = np.linspace(0.0, 1.0, 60)[:, None]
    ends = np.array([[0.45, -0.28, 0.32], [0.48, 0.26, 0.36]])
    lines = [ends[0] + share * (ends[1] - ends[0]) + bulge * np.sin(np.pi * share) * [0.5, 0.0, 1.0]
             for bulge in (-0.05, -0.02, 0.02, 0.05)]  # fmt: skip
    turned = np.tile([0.0, 1.0, 0.0, 0.0], (len(share), 1))
    np.save(installation.home / "mine.npy", [np.concatenate([line, turned], axis=1) for line in lines])
    given = ["--demos", "mine.npy", "--units", "m", "--out", "mine", "--steps", "60", "--kernels", "60"]
    done = installation.run("geodesic-motion", "train", *given)
    assert done.returncode in (0, 1), done.stderr  # 1: it has no motion, which so few steps may come to
    done = installation.run("python", "-c", PLAN)
    assert done.returncode == 0, done.stderr
    shipped, mine = done.stdout.split()
    assert shipped == "OK"
    assert mine in {*VerdictCode.__members__, "SkillError"}


def test_its_nodes_reach_a_goal(installation) -> None:
    patient = ["-p", "state_timeout:=5.0", "-p", "resume_timeout:=60.0", "-p", "latency:=0.1"]
    patient += ["-p", "tracking_tolerance_joint:=1.0", "-p", "latent_view_rate:=0.0"]
    skill = ["--ros-args", "-p", "skill:=panda_pouring"]
    with installation.running("twin", *skill), installation.running("planner", *skill, *patient):
        done = installation.run("geodesic-motion", "goal", "panda_pouring")
    assert done.returncode == 0, done.stderr
    assert "arrived" in done.stdout + done.stderr


@pytest.mark.realtime
def test_its_demo_passes(installation) -> None:
    given = ["--skill", "panda_pouring", "--no-pictures", "--out", "demo", "--domain", os.environ["ROS_DOMAIN_ID"]]
    done = installation.run("geodesic-motion", "demo", *given)
    assert done.returncode == 0, done.stderr
    assert json.loads((installation.home / "demo" / "summary.json").read_text())["passed"]
