"""One term, one meaning: words that the project has replaced (doc/glossary.md) do not come back, in code or pages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
FOLDERS = ("geodesic_motion_ros", "test", "studies", "config", "doc", "launch", "models", "examples")
#: A path is no "way"; obstacles are published, goals requested, not "told"; an optimistic search is not "trusting".
REPLACED = ("told", "gone", "trusting", "distrusted", "in vain", "whoever", "giving way", "gives way", "aside", "ways?")
#: Words of their own, parts of names with underscores, and parts of names with capitals.
PATTERN = re.compile(
    rf"(?<![a-zA-Z])(?:{'|'.join(REPLACED)})(?![a-z])"
    rf"|(?<=[a-z])(?:{'|'.join(word.capitalize() for word in REPLACED if ' ' not in word)})(?![a-z])",
    re.MULTILINE,
)


def replaced(text: str) -> list[str]:
    """The replaced words of a text."""
    small = re.sub(r"\b[A-Z][A-Z_]+\b", lambda found: found.group().lower(), text)
    return PATTERN.findall(re.sub(r"\b[A-Z](?=[a-z])", lambda found: found.group().lower(), small))


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_replaced_word_is_used(folder: str) -> None:
    files = [file for kind in ("py", "md", "yaml") for file in (REPOSITORY / folder).rglob(f"*.{kind}")]
    files += list(REPOSITORY.glob("*.md")) if folder == "doc" else []
    found = {str(file): replaced(file.read_text()) for file in files if file != Path(__file__)}
    assert {name: words for name, words in found.items() if words} == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("The way there.", ["way"]), ("tool_way = 1", ["way"]), ("class TubeWay:", ["Way"]), ("FREE_WAY", ["way"]),
        ("searched in vain", ["in vain"]), ("Told once", ["told"]), ("always, waypoints, halfway, laws", []),
    ],
)  # fmt: skip
def test_a_replaced_word_is_found(text: str, words: list[str]) -> None:
    """The control: words that only contain one."""
    assert replaced(text) == words
