"""The report of a skill: a whole page with every section, that needs nothing from elsewhere."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from geodesic_motion_ros.certification.certificate_scope import COUNTED, NOT_COUNTED
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.takes import Take
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization import skill_report
from geodesic_motion_ros.visualization.plots import BLUE
from geodesic_motion_ros.visualization.skill_report import held_out_section, recordings_section, report_page

VOID = {"meta", "img", "br", "hr", "link"}
SECTIONS = ("skill", "recordings", "latent", "tubes", "held-out", "spheres", "certificate")


class Page(HTMLParser):
    """A page read: its text, ids, what it refers to; fails on a tag that is not closed or closed twice."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.tags: set[str] = set()
        self.words = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        named = dict(attributes)
        self.ids += [named["id"]] if "id" in named else []
        self.references += [named[name] for name in ("href", "src") if name in named]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data

    @property
    def pictures(self) -> list[np.ndarray]:
        """Pixels of the pictures that the page holds."""
        encoded = (text.removeprefix("data:image/png;base64,") for text in self.references if text.startswith("data:"))
        return [np.asarray(Image.open(BytesIO(base64.b64decode(text))).convert("RGB")) for text in encoded]


def png() -> bytes:
    stream = BytesIO()
    Image.new("RGB", (8, 8), "white").save(stream, "PNG")
    return stream.getvalue()


def made(skill: Skill, recording: Recording | None = None) -> str:
    return report_page(ReactivePlanner(skill, scene=DeclaredScene.empty()), png(), recording)


@pytest.fixture(scope="module", autouse=True)
def _few_places():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(skill_report, "PLACES", 3)
        yield


@pytest.fixture(scope="module")
def text() -> str:
    """The page of a shipped skill."""
    return made(Skill.load("panda_pouring"))


def takes(spoiled: bool) -> list[Take]:
    """Four motions of a tool at 50 Hz; spoiled: the second has a spike, the third stops halfway."""
    share = (0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 100)))[:, None]
    found = []
    for number in range(4):
        bulge = (0.04 * number - 0.06) * np.sin(np.pi * share) * [0.8, 0.0, 0.6]
        values = np.array([0.45, -0.28, 0.32]) + share * [0.03, 0.54, 0.04] + bulge
        if spoiled and number == 1:
            values[50] += 0.3
        if spoiled and number == 2:
            values = values[:60]
        found.append(Take(f"reach_{number}", 0.02 * np.arange(len(values)), values, ("px", "py", "pz")))
    return found


def test_a_page_is_whole_and_needs_nothing_from_elsewhere(text: str) -> None:
    page = Page(text)
    assert text.startswith("<!DOCTYPE html>")
    assert page.ids == list(SECTIONS)
    assert all(reference.startswith(("#", "data:image/png;base64,")) for reference in page.references)
    assert {reference[1:] for reference in page.references if reference.startswith("#")} == set(SECTIONS)
    assert page.tags.isdisjoint({"script", "link", "iframe"})
    assert not re.search(r"url\(|@import", text)


def test_a_page_shows_the_skill_its_tube_and_its_spheres(text: str) -> None:
    page, skill = Page(text), Skill.load("panda_pouring")
    for words in (skill.name, "pouring_8", skill.provenance["source"], "learning_rate", "metric.sigma_weight", "0.002"):
        assert words in page.words
    _, tube, spheres = page.pictures
    blue = np.array([int(BLUE[i : i + 2], 16) for i in (1, 3, 5)])
    for picture in (tube, spheres):
        assert np.sum(np.abs(picture.astype(int) - blue).max(axis=2) < 45) > 300
    for share in ("5 %", "50 %", "95 %"):
        assert share in page.words


def test_the_same_skill_has_the_same_page(text: str) -> None:
    assert made(Skill.load("panda_pouring")) == text


def test_limits_of_the_certificate_are_those_that_planning_states(text: str) -> None:
    words = Page(text).words
    for subject, what in (*COUNTED, *NOT_COUNTED):
        assert subject in words
        assert what.replace("`", "") in words


def test_without_its_recording_a_page_says_so(text: str) -> None:
    assert "The recording is not beside the skill" in Page(text).words


def test_a_skill_of_the_whole_arm_has_a_page(reach_skill: Skill) -> None:
    words = Page(made(reach_skill)).words
    assert "A skill of the whole arm of a panda, learned from 8 demonstrations" in words
    assert "4, 4 demonstrations" in words


def test_a_skill_without_a_motion_has_a_page_that_says_why(canonical_fan_skill: Skill) -> None:
    far = canonical_fan_skill.goal_pose + np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    words = Page(made(replace(canonical_fan_skill, goal_pose=far))).words
    assert words.count("The planner has no motion from the mean start to the mean goal: ") == 2


def test_what_was_found_in_a_recording_is_listed_with_its_demonstration_and_time(canonical_fan_skill: Skill) -> None:
    learned = replace(canonical_fan_skill, provenance={"demonstrations": ["reach_0", "reach_1"]})
    recording = Recording.of_files(takes(spoiled=True))
    page = Page(recordings_section(learned, recording))
    assert [flaw.demonstration for flaw in recording.flaws] == ["reach_1", "reach_2"]
    for flaw in recording.flaws:
        for words in (flaw.what, flaw.action.value, f"{flaw.time:.2f}"):
            assert words in page.words
    rows = re.findall(r"<tr>.*?</tr>", recordings_section(learned, recording))
    done = [re.findall(r"<td>([^<]*)</td>", row)[-1] for row in rows[1:5]]
    assert done == ["kept", "repaired", "left out", "held out"]
    assert len(page.pictures) == 1


def test_a_refused_recording_states_it(canonical_fan_skill: Skill) -> None:
    still = [replace(take, values=np.tile(take.values[0], (len(take), 1))) for take in takes(spoiled=False)[:1]]
    words = Page(recordings_section(canonical_fan_skill, Recording.of_files([*still, *takes(False)[1:]]))).words
    assert "does not move" in words
    assert "refused: take it out" in words


def test_a_clean_recording_lists_no_flaw(canonical_fan_skill: Skill) -> None:
    """The control."""
    learned = replace(canonical_fan_skill, provenance={"demonstrations": [f"reach_{number}" for number in range(4)]})
    page = Page(recordings_section(learned, Recording.of_files(takes(spoiled=False))))
    assert "Nothing was found in them." in page.words
    assert not re.search(r"repaired|left out|refused|held out", page.words)
    assert page.pictures == []


def test_held_out_figures_stand_beside_human_variation_and_baselines(canonical_fan_skill: Skill) -> None:
    quality = {
        "held_out": [1], "held_out_dtw_mm": 12.345, "held_out_orientation_deg": 2.5, "people_dtw_mm": 34.5,
        "promp_dtw_mm": 15.25, "held_out_unanswered": 2,
    }  # fmt: skip
    words = Page(held_out_section(replace(canonical_fan_skill, quality=quality))).words
    assert "unanswered counts in no mean" in words
    for figure in ("12.3", "34.5", "15.2", "people among themselves", "ProMP"):
        assert figure in words
    assert "not computed" not in words


def test_without_held_out_figures_the_commands_that_measure_them_are_named(text: str) -> None:
    words = Page(text).words
    assert "They were not computed" in words
    assert "--held-out 0,3" in words
    assert "geodesic-motion evaluate --demos pouring.npy" in words


def test_text_from_files_is_text(canonical_fan_skill: Skill) -> None:
    page = made(replace(canonical_fan_skill, name="<script>alert('x')</script> & co"))
    assert "script" not in Page(page).tags
    assert "<script>alert('x')</script> & co" in Page(page).words
