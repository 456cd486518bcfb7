"""The shipped skills answer alike on every machine: same verdicts, same costs, same references.

answers/ holds what each skill answered to 100 queries, a file for each skill. `python -m pytest --remake
test/test_answers.py` draws the queries again and records the answers of the machine that it runs on.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import rotate_by
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries import search
from geodesic_motion_ros.skill.skill import Skill

ANSWERS = Path(__file__).parent / "answers"
SKILLS = ("panda_bottle2shelf", "panda_pouring", "panda_reach_to_grasp")
QUERIES = 100
SPHERES = 3
SAMPLES = 25
#: Relative, of the cost of a path.
COST = 1e-9
#: [m], [rad], [s], and of quaternions.
REFERENCE = 1e-6


@dataclass
class Answer:
    """Verdict code; cost and nodes of the path that was found last, nan and none where there was no search; and samples
    of the reference at even times, each with its time [s], none without a reference.
    """

    code: int
    cost: float
    nodes: np.ndarray
    samples: np.ndarray


class Asked:
    """A planner on a shipped skill that keeps the searches of what it is asked."""

    def __init__(self, name: str) -> None:
        self.skill = Skill.load(name)
        self.planner = ReactivePlanner(self.skill)
        self._search = search.shortest_path_from_both_ends
        self._found: list = []

    def _searched(self, *arguments, **options):
        self._found.append(self._search(*arguments, **options))
        return self._found[-1]

    def answer(self, ends: np.ndarray, spheres: np.ndarray) -> Answer:
        """To a query: start and goal pose (2, 7), and spheres (SPHERES, 4), centre and radius [m]; nan where fewer."""
        spheres = spheres[np.isfinite(spheres[:, 3])]
        assert self.planner.set_obstacles(spheres[:, :3], spheres[:, 3]).ok
        self._found.clear()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(search, "shortest_path_from_both_ends", self._searched)
            plan = self.planner.plan(ends[0, :3], ends[0, 3:], ends[1, :3], ends[1, 3:])
        cost, nodes = (self._found[-1].cost, self._found[-1].nodes) if self._found else (np.nan, np.empty(0, dtype=int))
        return Answer(int(plan.verdict.code), cost, nodes, self._samples(plan.reference))

    def _samples(self, reference) -> np.ndarray:
        if reference is None:
            return np.empty((0, 0))
        times = np.linspace(0.0, reference.duration, SAMPLES)
        return np.column_stack([times, reference.samples(times)[0]])

    def _drawn_end(self, random: np.random.Generator, end: str) -> np.ndarray:
        """A pose (7,) of the tool at an end of one demonstration, or between two, carried up to 2 cm from there."""
        sheet = self.skill.canonical
        offsets = getattr(sheet, f"{end}_offsets")
        first, second = random.integers(len(offsets), size=2)
        if self.skill.space == "joint":
            pole = getattr(sheet, f"{end}_poles")[getattr(sheet, f"{end}_groups")[first]]
            position, quaternion = self.planner.robot.forward(pole + offsets[first])
        else:
            pose, offset = getattr(self.skill, f"{end}_pose"), 0.5 * (offsets[first] + offsets[second])
            position, quaternion = pose[:3] + offset[:3], rotate_by(offset[3:], pose[3:])
        return np.concatenate([position + random.uniform(-0.02, 0.02, 3), quaternion])

    def drawn(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """A query, see `answer`: with 0 to SPHERES spheres near the path without them; every tenth has a goal that is
        far from what was shown.
        """
        random = np.random.default_rng(number)
        ends = np.stack([self._drawn_end(random, "start"), self._drawn_end(random, "goal")])
        spheres = np.full((SPHERES, 4), np.nan)
        samples = self.answer(ends, spheres).samples
        if number % 10 == 9:
            ends[1, :3] += [0.0, 0.0, 0.3]
        for row in range(number % (SPHERES + 1) if len(samples) else 0):
            at = samples[random.integers(SAMPLES // 5, SAMPLES - SAMPLES // 5), 1:]
            origins = self.planner.robot.link_frames(at)[1]
            spheres[row, :3] = origins[random.integers(4, len(origins))] + random.normal(scale=0.1, size=3)
            spheres[row, 3] = random.uniform(0.01, 0.04)
        return ends, spheres


def record(asked: Asked, file: Path) -> None:
    queries = [asked.drawn(number) for number in range(QUERIES)]
    answers = [asked.answer(*query) for query in queries]
    samples = np.full((QUERIES, SAMPLES, max(answer.samples.shape[-1] for answer in answers)), np.nan)
    for row, answer in zip(samples, answers, strict=True):
        if len(answer.samples):
            row[:] = answer.samples
    np.savez_compressed(
        file, ends=[query[0] for query in queries], spheres=[query[1] for query in queries],
        codes=[answer.code for answer in answers], costs=[answer.cost for answer in answers],
        nodes=np.concatenate([answer.nodes for answer in answers]),
        lengths=[len(answer.nodes) for answer in answers], samples=samples,
    )  # fmt: skip


@pytest.mark.parametrize("name", SKILLS)
def test_a_shipped_skill_answers_as_it_did_where_its_answers_were_recorded(name: str, pytestconfig) -> None:
    """Where another path costs the same, rounding may have chosen that one."""
    asked, file = Asked(name), ANSWERS / f"{name}.npz"
    if pytestconfig.getoption("--remake"):
        record(asked, file)
    with np.load(file) as archive:
        recorded = dict(archive)
    nodes = np.split(recorded["nodes"], np.cumsum(recorded["lengths"])[:-1])
    # The queries are of use: many have a reference, some have none.
    assert 0.3 < np.mean(recorded["codes"] == 0) < 0.9
    for number, query in enumerate(zip(recorded["ends"], recorded["spheres"], strict=True)):
        answer = asked.answer(*query)
        assert answer.code == recorded["codes"][number], number
        np.testing.assert_allclose(answer.cost, recorded["costs"][number], rtol=COST, err_msg=str(number))
        if answer.code == 0 and np.array_equal(answer.nodes, nodes[number]):
            np.testing.assert_allclose(
                answer.samples, recorded["samples"][number], rtol=0.0, atol=REFERENCE, err_msg=str(number)
            )
