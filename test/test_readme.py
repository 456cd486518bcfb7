"""The pages are true: their Python runs, and files, sections, commands and codes exist; the README is a page."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from geodesic_motion_ros.contract.status import VerdictCode

REPOSITORY = Path(__file__).resolve().parents[1]
README, TROUBLESHOOTING = REPOSITORY / "README.md", REPOSITORY / "doc" / "troubleshooting.md"
FOLDERS = ("config", "doc", "geodesic_motion_ros", "models", "studies")
PAGES = [*REPOSITORY.glob("*.md"), *(page for name in FOLDERS for page in (REPOSITORY / name).rglob("*.md"))]
#: What people read first, and the pages that it leads to.
FRONT = [README, *sorted((REPOSITORY / "doc").glob("*.md"))]
TEN_MINUTES = REPOSITORY / "doc" / "ten_minutes.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text() + TEN_MINUTES.read_text(), flags=re.DOTALL)
COMMANDS = sorted({name for page in FRONT for name in re.findall(r"geodesic-motion\s+([a-z]+)", page.read_text())})


def anchors(page: Path) -> set[str]:
    """What a link can point at in a page: its headings, as they are written in links."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken(page: Path) -> list[str]:
    """Targets of the links of a page, those to the web left out, that lead nowhere."""
    targets = re.findall(r"\]\((?!http)([^)]+)\)", page.read_text())
    parts = [target.partition("#") for target in targets]
    found = [((page.parent / file).resolve() if file else page, anchor) for file, _, anchor in parts]
    return [
        target
        for target, (file, anchor) in zip(targets, found, strict=True)
        if not file.exists() or (anchor and anchor not in anchors(file))
    ]


@pytest.mark.parametrize("code", BLOCKS, ids=["whole-arm skill", "tool skill", "filter"])
def test_the_python_of_the_tour_runs_and_finds_a_path(code, capsys):
    scope: dict[str, object] = {}
    exec(code, scope)
    assert capsys.readouterr().out.startswith("OK clearance")
    clearance = scope["plan"].verdict.figures.clearance
    assert clearance < 0.1, "the obstacle of the tour is far from the path: it shows nothing"


def test_the_pose_of_the_page_of_conventions_is_that_of_the_tour_s_message(capsys):
    (block,) = re.findall(r"```python\n(.*?)```", (REPOSITORY / "doc" / "conventions.md").read_text(), re.DOTALL)
    exec(block, {})
    position, orientation = capsys.readouterr().out.splitlines()
    assert orientation in TEN_MINUTES.read_text()
    x, y, z = position.strip("[]").split()
    assert f"position: {{x: {x}, y: {y}, z: {z}}}" in TEN_MINUTES.read_text()


def test_the_readme_is_one_page_of_short_sentences():
    text = README.read_text()
    assert len(text.splitlines()) <= 90
    prose = re.sub(r"```.*?```|<!--.*?-->|^[#|].*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    prose = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", prose)
    lengths = [len(one.split()) for one in re.split(r"(?<=[.!?])\s+|\n- |\n\n", prose) if one.strip()]
    assert sum(lengths) / len(lengths) <= 20


@pytest.mark.parametrize("page", sorted(PAGES), ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_every_link_leads_somewhere(page):
    assert broken(page) == []


def test_links_to_no_file_and_to_no_section_are_broken(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Here\n[a](#here) [b](#there) [c](page.md#here) [d](no.md) [e](https://example.org)\n")
    assert broken(page) == ["#there", "no.md"]


def test_every_page_is_in_the_index():
    index = (REPOSITORY / "doc" / "README.md").read_text()
    names = {page.name for page in FRONT[1:]} - {"README.md", "index.md"}
    assert [name for name in sorted(names) if f"({name})" not in index] == []


def test_every_page_is_in_the_site():
    index = (REPOSITORY / "doc" / "index.md").read_text()
    listed = re.findall(r"^[\w./]+$", index, flags=re.MULTILINE)
    pages = {page.stem for page in FRONT[1:]} - {"README", "index"}
    assert sorted(pages) == sorted(name for name in listed if "/" not in name)
    assert all((REPOSITORY / "doc" / f"{name}.md").resolve().is_file() for name in listed)


def site_can_be_made() -> bool:
    """Whether `make doc` has installed what the site needs today."""
    ready, pins = REPOSITORY / ".venv-doc" / ".ready", REPOSITORY / "requirements-doc.txt"
    return ready.exists() and ready.stat().st_mtime >= pins.stat().st_mtime


@pytest.mark.skipif(not site_can_be_made(), reason="`make doc` has not been asked for since its pins changed")
def test_the_site_is_made_without_a_warning(tmp_path):
    sphinx = [REPOSITORY / ".venv-doc/bin/python", "-m", "sphinx", "--quiet", "--fail-on-warning", "-c", "doc"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([*sphinx, ".", tmp_path], cwd=REPOSITORY, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "geodesic_motion_ros" in (tmp_path / "doc" / "index.html").read_text()


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_of_the_pages_exist(command, capsys):
    from geodesic_motion_ros.cli import main

    with pytest.raises(SystemExit) as stopped:
        main([command, "--help"])
    assert stopped.value.code == 0
    assert f"geodesic-motion {command}" in capsys.readouterr().out


def test_the_codes_of_the_verdict_are_described():
    text = TROUBLESHOOTING.read_text()
    rows = re.findall(r"^\| ([A-Z_, ]+) \|", text, flags=re.MULTILINE)
    assert sorted(name for row in rows for name in row.split(", ")) == sorted(code.name for code in VerdictCode)
    symptoms = re.findall(r"^\|.*?\| ([A-Z_, ]+) \|", text, flags=re.MULTILINE)
    assert {name for row in symptoms for name in row.split(", ")} == {code.name for code in VerdictCode}
