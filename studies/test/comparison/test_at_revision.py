"""Scenes played with the code of a git revision, in a work tree that leaves nothing behind."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison import execution
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.at_revision import (
    FORMER_MODULES,
    JUDGE,
    at_former_paths,
    main,
    play_at,
)
from geodesic_motion_studies.comparison.scene import draw_scene
from geodesic_motion_studies.comparison.scene_file import SceneFile

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")

#: Where studies stand now, and where they stood before they were a distribution.
NOW, THEN = "studies/geodesic_motion_studies", "geodesic_motion_ros/studies"
#: A package whose command writes which version it is, and the options that it was given.
COMMAND = """
import json, sys
from pathlib import Path
options = dict(zip(sys.argv[2::2], sys.argv[3::2]))
if {fails}:
    sys.exit(2)
judges = (Path(__file__).parents[1] / "{judges}" / "execution.py").read_text()
Path(options["--json"]).write_text(json.dumps(["{version}", sys.argv[1], options, judges]))
"""


def git(repository: Path, *arguments: str) -> str:
    identity = ["-c", "user.name=nobody", "-c", "user.email=nobody@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(["git", "-C", str(repository), *identity, *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three revisions: tags old and new, from before and after studies were a distribution, and one that fails."""
    repository = tmp_path_factory.mktemp("repository")
    package = repository / "geodesic_motion_ros"
    package.mkdir()
    git(repository, "init", "--quiet")
    (package / "__init__.py").touch()
    for version in ("old", "broken", "new"):
        judges = f"{NOW if version == 'new' else THEN}/comparison"
        (repository / judges).mkdir(parents=True, exist_ok=True)
        (repository / judges / "execution.py").write_text("the judge of the revision")
        main = COMMAND.format(version=version, fails=version == "broken", judges=judges)
        (package / "__main__.py").write_text(main)
        git(repository, "add", ".")
        git(repository, "commit", "--quiet", "--message", version)
        git(repository, "tag", version)
    return repository


@pytest.fixture(scope="module")
def scenes(reach_skill: Skill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    arena = Arena.of(reach_skill)
    path = tmp_path_factory.mktemp("scenes") / "scenes.npz"
    SceneFile.of(reach_skill, arena.guard, 0, [draw_scene(arena, "none", 0, 0)]).write(path)
    return path


def test_the_code_of_the_revision_plays_the_scenes_and_the_judge_of_this_one_judges(
    repository, scenes, reach_skill, tmp_path
) -> None:
    for revision in ("old", "new"):
        play_at(revision, scenes, tmp_path / "x.json", tmp_path / "out", ["--methods", "replay"], repository)
        version, command, options, judge = json.loads((tmp_path / "x.json").read_text())
        assert (version, command) == (revision, "benchmark")
        here = Path(execution.__file__).read_text()
        then = here.replace("geodesic_motion_studies", "geodesic_motion_ros.studies")
        assert judge == (here if version == "new" else then)
        commit = git(repository, "rev-parse", revision)
        given = {"--skill": reach_skill.name, "--guard": "arm", "--scenes-from": str(scenes), "--methods": "replay"}
        assert options == given | {"--json": str(tmp_path / "x.json"), "--out": str(tmp_path / "out" / commit)}
    assert len(git(repository, "worktree", "list").splitlines()) == 1


def test_a_revision_that_fails_or_is_none_is_refused(repository, scenes, tmp_path) -> None:
    for revision, said in (("broken", "does not play"), ("never", "give a tag, branch or commit of")):
        with pytest.raises(ParameterError, match=said):
            play_at(revision, scenes, tmp_path / "x.json", tmp_path / "out", repository=repository)
    assert len(git(repository, "worktree", "list").splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_what_is_no_file_of_scenes_is_said_in_a_line(tmp_path, capsys) -> None:
    assert main(["HEAD", str(tmp_path / "none.npz"), "--json", str(tmp_path / "x.json")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "none.npz: cannot be read" in line


@pytest.mark.parametrize("module", JUDGE)
def test_a_judge_finds_what_it_imports_before_studies_stood_apart(module: str) -> None:
    source = at_former_paths((Path(execution.__file__).parent / module).read_text())
    for now in FORMER_MODULES:
        assert f"from {now} import" not in source
    assert "geodesic_motion_studies" not in source
