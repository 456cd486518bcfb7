"""The paper's planner on its shipped skills, made once a session."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.paper.paper_planner import PaperPlanner, PaperSettings
from geodesic_motion_ros.skill.skill import Skill

#: Skill, grid and zeta by the space; in joint space coarse, the whole grid takes seconds and a gigabyte.
CASES = {"task": ("paper_pouring", (100, 100), 1e9), "joint": ("paper_reach", (16, 16, 16), 1e3)}


def literal_planner(space: str) -> PaperPlanner:
    name, shape, strength = CASES[space]
    return PaperPlanner(Skill.load(name), PaperSettings(strength=strength), shape)


@pytest.fixture(scope="session")
def planners() -> dict[str, PaperPlanner]:
    """By the space."""
    return {space: literal_planner(space) for space in CASES}


@pytest.fixture(params=list(CASES))
def shared(request, planners) -> PaperPlanner:
    """One planner of each space; a test that changes it sets it up first."""
    return planners[request.param]
