"""Numbers of the paper's sections, equations and figures are those of its list, wherever one is cited."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = REPOSITORY / "doc" / "paper_in_code.md"
#: Of what a number is, by the word before it.
KINDS = {"eq": "Equations", "equation": "Equations", "section": "Sections", "fig": "Figures", "figure": "Figures"}
MENTION = re.compile(
    r"\b(eq|equation|section|fig|figure)s?\.?[ (]+(\d+(?:\.\d+)*\b(?:(?:,| and| to) \d+(?:\.\d+)*\b)*)", re.IGNORECASE
)
#: Works with numbers of their own.
OTHERS = re.compile("Mardia and Jupp|[Ll]icen[cs]e")


def listed() -> dict[str, dict[str, str]]:
    """Subjects by number, by kind, of the list at the end of the page."""
    found = {}
    for kind, text in re.findall(r"- \*\*(\w+):\*\* (.+?)(?=\n-|\Z)", PAGE.read_text(), flags=re.DOTALL):
        entries = text.split(".\n")[0].split(". ")[0].rstrip(".").split(";")
        found[kind] = dict(" ".join(entry.split()).split(" ", 1) for entry in entries)
    return found


LISTED = listed()


def cited(text: str) -> list[tuple[str, str, str]]:
    """Kind, number and the paragraph or row around it, of every number of the paper that a text cites."""
    rows = re.sub(r"^([|#].*)$", r"\n\1\n", text, flags=re.MULTILINE)
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", rows)]
    return [
        (KINDS[kind.lower()], number, paragraph)
        for paragraph in paragraphs if not OTHERS.search(paragraph)
        for kind, numbers in MENTION.findall(paragraph)
        for number in expanded(numbers)
    ]  # fmt: skip


def expanded(numbers: str) -> list[str]:
    """Single numbers of "5, 6 and 8", and of "18 to 20"."""
    if (ends := re.fullmatch(r"(\d+) to (\d+)", numbers)) is not None:
        return [str(number) for number in range(int(ends[1]), int(ends[2]) + 1)]
    return re.findall(r"\d+(?:\.\d+)*", numbers)


def wrong(text: str) -> list[str]:
    """What a text cites that is not in the list, or whose subject does not stand beside it, word by word."""
    found = []
    for kind, number, paragraph in cited(text):
        subject = LISTED[kind].get(number)
        # A word may be inflected: its first letters have to be there.
        words = re.findall(r"[a-z-]{4,}", (subject or "").lower())
        if subject is None or not all(word[:6] in paragraph.lower() for word in words):
            found.append(f"{kind} {number} ({subject}): {paragraph}")
    return found


def test_the_list_is_whole():
    assert list(LISTED["Equations"]) == [str(number) for number in range(1, 34)]
    assert list(LISTED["Figures"]) == [str(number) for number in range(1, 20)]
    assert [number for number in LISTED["Sections"] if "." not in number] == [str(number) for number in range(1, 7)]


def test_every_number_that_is_cited_is_the_papers():
    folders = ("geodesic_motion_ros", "examples", "doc", "models", "config")
    patterns = [f"{folder}/**/*.{kind}" for folder in folders for kind in ("py", "md", "yaml")]
    texts = {str(file): file.read_text() for pattern in ("README.md", *patterns) for file in REPOSITORY.glob(pattern)}
    found = {name: wrong(text) for name, text in texts.items()}
    assert {name: lines for name, lines in found.items() if lines} == {}
    assert sum(len(cited(text)) for text in texts.values()) > 50


@pytest.mark.parametrize(
    "text",
    [
        "the ambient metric (eq. 30)", "lengths by the metric (eqs. 5, 6)",
        "terms of the metric of poses (Eqs. 21 to 25)",
        "learning in task space (section 3.1)", "Figures 12 and 14: a chain, circles", "Mardia and Jupp, section 9.3.2",
        "no figures, 30 mm", "equation (27): the volume",
    ],
)  # fmt: skip
def test_a_right_number_passes(text):
    assert wrong(text) == []


@pytest.mark.parametrize(
    "text",
    [
        "the ambient metric (eq. 34)", "the ambient metric (eq. 31)", "equation (26): the volume",
        "(eqs. 5, 7): lengths",
        "learning in task space (section 4.1)", "learning in task space (section 3.1.2)", "a chain (Fig. 11)",
        "the volume\n\neq. 27", "| the volume |\n| (eq. 27) |", "(eqs. 17 to 19): weighted bound, terms of positions",
    ],
)  # fmt: skip
def test_a_wrong_number_is_found(text):
    """The control."""
    assert wrong(text)
