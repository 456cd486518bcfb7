"""Plays a file of scenes with the code of a git revision: what another version of the planner does in the same scenes.

    geodesic-motion benchmark --skill panda_pouring --guard arm --scenes 20 --save-scenes out/scenes.npz
    python -m geodesic_motion_studies.comparison.at_revision baseline-10 out/scenes.npz --json out/baseline.json

The revision is checked out into a work tree of its own in the folder for temporary files, which is removed at the end;
its kernels are compiled there first (a minute or two). The methods are those of the revision; what judges, keeps and
reports outcomes is this version's: its modules (`JUDGE`) replace those of the revision in the work tree, so that both
are judged alike. Results are kept in a folder of the revision's commit, so that a play that was interrupted goes on.
The revision must have `benchmark --scenes-from`, these modules must import what it has, and its skill must be the one
that the scenes were drawn for; Python and libraries are those of this interpreter.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import geodesic_motion_ros
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_studies.comparison.scene_file import SceneFile

PACKAGE = Path(geodesic_motion_ros.__path__[0]).resolve()
REPOSITORY = PACKAGE.parent
REVISION = "baseline-10"
#: Modules of this folder that judge, keep and report outcomes, whichever revision plays.
JUDGE = ("chasing.py", "execution.py", "results.py", "report.py", "figures.py")
#: Where that folder was in the package: before studies were a distribution of their own, and before they stood apart.
BEFORE_APART, BEFORE_STUDIES = "studies/comparison", "comparison"
#: What the judges import, as it is named now, and within the package as it was named before studies stood apart.
FORMER_MODULES = {
    "geodesic_motion_ros.geometry.curves": "demonstrations.curves",
    "geodesic_motion_ros.geometry.quaternions": "quaternions",
    "geodesic_motion_ros.obstacles.obstacles": "obstacles",
    "geodesic_motion_studies.comparison.chasing": "comparison.chasing",
    "geodesic_motion_studies.comparison.execution": "comparison.execution",
    "geodesic_motion_studies.comparison.families": "comparison.families",
    "geodesic_motion_studies.comparison.guard": "comparison.guard",
    "geodesic_motion_studies.comparison.method": "comparison.method",
    "geodesic_motion_studies.comparison.report": "comparison.report",
    "geodesic_motion_studies.comparison.results": "comparison.results",
    "geodesic_motion_studies.comparison.scene": "comparison.scene",
    "geodesic_motion_studies.experiments.moving_spheres": "experiments.moving_spheres",
    "geodesic_motion_studies.tools.collision_geometry": "simulation.collision_geometry",
    "geodesic_motion_studies.tools.similarity": "demonstrations.similarity",
    "geodesic_motion_ros.trajectory.trajectory": "joint_reference",
    "geodesic_motion_ros.utils.errors": "errors",
    "geodesic_motion_ros.utils.tables": "tables",
    "geodesic_motion_ros.visualization.plots": "plots",
}


@contextmanager
def work_tree(commit: str, repository: Path) -> Iterator[Path]:
    """A temporary work tree of a commit."""
    with tempfile.TemporaryDirectory(prefix="revision_") as folder:
        tree = Path(folder) / "tree"
        _git(repository, "worktree", "add", "--detach", str(tree), commit)
        try:
            yield tree
        finally:
            _git(repository, "worktree", "remove", "--force", str(tree))


def play_at(
    revision: str, scenes: Path, json: Path, out: Path, options: Sequence[str] = (), repository: Path = REPOSITORY
) -> None:
    """Play a file of scenes at a revision, judged as they are at this version.

    Parameters
    ----------
    json, out : what `benchmark --json` writes, and the folder in which results are kept, by commit.
    options : further ones of `benchmark`.

    Raises
    ------
    FileError : it is no file of scenes.
    ParameterError : there is no such revision, no git repository, or the revision does not play them.
    """
    file = SceneFile.read(scenes)
    commit = commit_of(revision, repository)
    command = [sys.executable, "-m", "geodesic_motion_ros", "benchmark", "--skill", file.skill, "--guard", file.guard]
    command += ["--scenes-from", str(scenes.resolve()), "--json", str(json.resolve())]
    command += ["--out", str((out / commit).resolve()), *options]
    with work_tree(commit, repository) as tree:
        _judge_as_here(tree)
        done = subprocess.run(command, cwd=tree, env=environment_of(tree), check=False)
    if done.returncode:
        raise ParameterError(f"the revision '{revision}' does not play {scenes} (see above)")


def commit_of(revision: str, repository: Path) -> str:
    """The commit that a tag, branch or commit names; ParameterError where there is none."""
    try:
        return _git(repository, "rev-parse", "--verify", f"{revision}^{{commit}}")
    except ParameterError as error:
        raise ParameterError(f"{error}: give a tag, branch or commit of {repository}") from None


def environment_of(tree: Path) -> dict[str, str]:
    """Environment of a command that imports the packages of a work tree in which Python starts, and its studies."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    return environment | {"PYTHONPATH": os.pathsep.join([str(tree), str(tree / "studies")])}


def _judge_as_here(tree: Path) -> None:
    """Replace what judges in a revision's work tree; where that has no benchmark there is nothing to replace."""
    here = Path(__file__).resolve().parent
    package = tree / PACKAGE.name
    for module in JUDGE:
        source = (here / module).read_text()
        if (folder := tree / here.relative_to(REPOSITORY)).is_dir():
            (folder / module).write_text(source)
        elif (folder := package / BEFORE_APART).is_dir():
            apart = source.replace("from geodesic_motion_studies.", f"from {PACKAGE.name}.studies.")
            (folder / module).write_text(apart)
        elif (folder := package / BEFORE_STUDIES).is_dir():
            (folder / module).write_text(at_former_paths(source))


def at_former_paths(source: str) -> str:
    """The source of a judge for a revision from before studies stood apart: it imports by the paths of then."""
    for now, then in FORMER_MODULES.items():
        source = source.replace(f"from {now} import ", f"from {PACKAGE.name}.{then} import ")
    return source


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", nargs="?", default=REVISION, help="a tag, branch or commit")
    parser.add_argument("scenes", type=Path, help="file of benchmark --save-scenes")
    parser.add_argument("--methods", default="ours", metavar="NAME;NAME")
    parser.add_argument("--processes", type=int, default=1, help="that play scenes")
    parser.add_argument("--json", type=Path, required=True, metavar="FILE", help="for tables and outcomes")
    parser.add_argument("--out", type=Path, default=Path("out/revisions"), metavar="FOLDER", help="for results")
    arguments = parser.parse_args(argv)
    try:
        options = ["--methods", arguments.methods, "--processes", str(arguments.processes)]
        play_at(arguments.revision, arguments.scenes, arguments.json, arguments.out, options)
    except GeodesicMotionError as error:
        print(f"at_revision: {error}", file=sys.stderr)
        return 2
    return 0


def _git(repository: Path, *arguments: str) -> str:
    """What git writes, in a line."""
    done = subprocess.run(["git", "-C", str(repository), *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise ParameterError(f"git {' '.join(arguments)} failed: {' '.join(done.stderr.split())}")
    return " ".join(done.stdout.split())


if __name__ == "__main__":
    raise SystemExit(main())
