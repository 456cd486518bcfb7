"""A closed skill: a goal where the arm stands is a round, and a periodic motion goes on round after round.

The skill is of circles, learned in a few steps: what the network lacks of them the sheet corrects.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import ROUND_RIDGE, SEARCH_PERIOD, PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.planning import arbiter
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import PlanningError, SkillError
from geodesic_motion_ros.visualization.plots import training_report

TICK, CENTRE, RADIUS = 0.02, np.array([0.5, 0.0, 0.4]), 0.1
DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def circles() -> Demonstrations:
    """Clockwise, from the far side of the base on, the tool down; two are wider, two are narrower."""
    angle = -2.0 * np.pi * np.linspace(0.0, 1.0, 150)
    shape = np.stack([np.cos(angle), np.sin(angle), np.zeros(150)], axis=1)
    items = [
        Demonstration(CENTRE + share * RADIUS * shape, np.tile(DOWN, (150, 1)), np.linspace(0.0, 3.0, 150), f"{share}")
        for share in (0.85, 0.95, 1.05, 1.15)
    ]
    return Demonstrations(tuple(items), frame="panda_link0")


@pytest.fixture(scope="module")
def skill() -> Skill:
    return train_skill(circles(), TrainingSettings(closed=True, steps=400, precision_iterations=60), "circles")


def on_circle(share: float) -> np.ndarray:
    """Where a round has come to (3,) [m] after a share of it."""
    angle = -2.0 * np.pi * share
    return CENTRE + RADIUS * np.array([np.cos(angle), np.sin(angle), 0.0])


@dataclass
class Arm:
    """One that plays what its planner hands out, and the record of that."""

    planner: ReactivePlanner
    now: float = 0.0
    places: list[np.ndarray] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)

    @classmethod
    def at(cls, skill: Skill, share: float, scene: DeclaredScene | None = None, **settings: object) -> Arm:
        planner = ReactivePlanner(skill, PlannerSettings(**settings), scene=scene)
        assert planner.stand_at(solve(planner.robot, on_circle(share), DOWN), 0.0).verdict.ok
        return cls(planner)

    def play(self, until: Callable[[Arm], bool], longest: float = 40.0) -> Arm:
        """Tick until something is so; the test fails where it is not in time."""
        for _ in range(round(longest / TICK)):
            plan = self.planner.tick(self.now)
            self.reasons.append(plan.verdict.reason)
            configuration, velocity, _ = self.planner.commanded_state(self.now)
            self.places.append(self.planner.robot.forward(configuration)[0])
            self.speeds.append(float(np.abs(velocity).max()))
            self.now += TICK
            if until(self):
                return self
        raise AssertionError(f"not in {longest} s: {self.reasons[-1]}")

    @property
    def turned(self) -> float:
        """How many rounds the tool has made about the centre."""
        x, y, _ = (np.array(self.places) - CENTRE).T
        return float(-np.diff(np.unwrap(np.arctan2(y, x))).sum() / (2.0 * np.pi))


def rests(arm: Arm) -> bool:
    """Whether it has moved, and stood for a second."""
    still = np.array(arm.speeds[-round(1.0 / TICK) :]) == 0.0
    return len(arm.speeds) > len(still) and bool(np.all(still)) and max(arm.speeds) > 0.0


def test_a_goal_where_the_arm_stands_is_one_round_and_no_other_when_it_is_requested_again(skill: Skill) -> None:
    arm = Arm.at(skill, 0.0)
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    assert arm.play(rests).turned == pytest.approx(1.0, abs=0.01)
    assert not any("at the goal" in reason for reason in arm.reasons[: arm.speeds.index(max(arm.speeds))])
    np.testing.assert_allclose(arm.places[-1], on_circle(0.0), atol=1e-3)
    assert arm.planner.round == 1
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    arm.play(lambda arm: arm.now > 30.0)
    assert arm.turned == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("start", "goal", "turned"), [(0.0, 0.25, 0.25), (0.0, 0.75, 0.75), (0.5, 0.25, 0.75)])
def test_a_goal_elsewhere_is_reached_the_direction_that_was_shown(
    skill: Skill, start: float, goal: float, turned: float
) -> None:
    arm = Arm.at(skill, start)
    assert arm.planner.set_goal(on_circle(goal), DOWN).ok
    assert arm.play(rests).turned == pytest.approx(turned, abs=0.01)
    np.testing.assert_allclose(arm.places[-1], on_circle(goal), atol=1e-3)


def test_a_periodic_motion_does_not_rest_between_its_rounds_and_ends_after_the_last(skill: Skill) -> None:
    arm = Arm.at(skill, 0.0, periodic=True, rounds=3)
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    assert arm.play(rests).turned == pytest.approx(3.0, abs=0.01)
    assert arm.planner.round == 3
    moves = np.flatnonzero(np.array(arm.speeds) > 0.0)
    assert np.all(np.diff(moves) == 1)
    assert any("round 2 of 3" in reason for reason in arm.reasons)


def test_a_join_with_a_jolt_is_tried_again_now_and_then_and_made_in_the_end(skill: Skill, monkeypatch) -> None:
    tried = []
    monkeypatch.setattr(arbiter, "_begins_smoothly", lambda _: bool(tried.append(arm.now)))
    arm = Arm.at(skill, 0.0, periodic=True, rounds=2)
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    arm.play(lambda arm: arm.planner.round == 2)
    assert len(tried) > 1
    assert np.all(np.diff(tried) > SEARCH_PERIOD - 0.5 * TICK)
    assert 0.75 < arm.turned < 1.0
    assert arm.speeds[-1] > 0.0


def test_a_skill_that_is_not_closed_makes_no_periodic_motion() -> None:
    # Nothing of an arm that is asked for rounds would say why it makes none.
    open_skill = Skill.load("panda_pouring")
    with pytest.raises(PlanningError, match="closed skill alone"):
        ReactivePlanner(open_skill, PlannerSettings(periodic=True))
    refused = ReactivePlanner(open_skill).change_settings(periodic=True)
    assert (refused.code, "closed skill alone" in refused.reason) == (VerdictCode.BAD_INPUT, True)


def test_a_periodic_motion_goes_on_until_it_is_not_to_and_ends_with_the_round(skill: Skill) -> None:
    arm = Arm.at(skill, 0.0, periodic=True)
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    arm.play(lambda arm: arm.turned > 3.2)
    assert arm.planner.change_settings(periodic=False).ok
    assert arm.play(rests).turned == pytest.approx(4.0, abs=0.01)


def test_an_arm_that_is_started_again_at_its_goal_makes_no_other_round(skill: Skill) -> None:
    """Where its drive was begun anew. The control: a new goal there is a round."""
    arm = Arm.at(skill, 0.0)
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    arm.play(rests)
    configuration, _, _ = arm.planner.commanded_state(arm.now)
    assert arm.planner.stand_at(configuration, arm.now).verdict.ok
    later = arm.now + 5.0
    assert arm.play(lambda arm: arm.now > later).turned == pytest.approx(1.0, abs=0.01)
    arm.planner.clear_goal()
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    assert arm.play(lambda arm: arm.turned > 1.99 and rests(arm)).turned == pytest.approx(2.0, abs=0.01)


def test_a_goal_that_trembles_and_a_task_frame_that_moves_are_no_new_rounds(skill: Skill) -> None:
    """As what tracks an object publishes them. The control is a goal that is dropped and requested again."""
    arm = Arm.at(skill, 0.0)
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    arm.play(rests)
    for number in range(1, 6):
        assert arm.planner.set_goal(on_circle(0.0) + [2e-4 * number, 0.0, 0.0], DOWN).ok
        later = arm.now + 0.6
        arm.play(lambda arm, later=later: arm.now > later)
    assert arm.turned == pytest.approx(1.0, abs=0.02)
    assert arm.planner.set_task_frame(np.array([0.0, 0.01, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])).ok
    later = arm.now + 4.0
    assert arm.play(lambda arm: arm.now > later).turned == pytest.approx(1.0, abs=0.04)


def test_an_arm_that_is_held_goes_on_in_the_same_round(skill: Skill) -> None:
    arm = Arm.at(skill, 0.0)
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    arm.play(lambda arm: arm.turned > 0.6)
    for _ in range(100):
        arm.planner.stop(arm.now, Refusal(VerdictCode.HOLD_REQUESTED, "held"))
        arm.now += TICK
    assert arm.turned < 0.8
    assert arm.play(rests).turned == pytest.approx(1.0, abs=0.01)


def test_an_arm_that_made_room_at_its_goal_goes_back_to_it_and_makes_no_round(skill: Skill) -> None:
    arm = Arm.at(skill, 0.0, DeclaredScene.empty())
    goal, velocity = on_circle(0.0), np.array([0.0, -0.3, 0.0])
    assert arm.planner.set_goal(goal, DOWN).ok
    arm.play(rests)
    begun, centre = arm.now, goal + [0.0, 0.9, 0.0]
    left = len(arm.places)
    while arm.now < begun + 6.0:
        there = centre + (arm.now - begun) * velocity
        assert arm.planner.set_obstacles(there[None], np.array([0.05]), velocity[None], time=arm.now).ok
        arm.play(lambda arm: True)
    assert np.max(np.linalg.norm(np.array(arm.places[left:]) - goal, axis=1)) > 0.02
    assert arm.planner.set_obstacles(np.empty((0, 3)), np.empty(0), time=arm.now).ok
    later = arm.now + 6.0
    arm.play(lambda arm: arm.now > later)
    np.testing.assert_allclose(arm.places[-1], goal, atol=1e-3)
    assert arm.turned == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("beside", "is_moved"), [(0.025, True), (0.06, False)])
def test_a_round_that_begins_beside_those_shown_is_moved_as_a_whole_but_not_far(
    skill: Skill, beside: float, is_moved: bool
) -> None:
    """Beside, along the round: further off than that it begins where the round passes."""
    start = on_circle(0.0) - [0.0, beside, 0.0]
    planned = tool_path(ReactivePlanner(skill, PlannerSettings()), start)
    middle = 0.5 * (planned.min(axis=0) + planned.max(axis=0))
    assert (CENTRE[1] - middle[1] > 0.5 * beside) == is_moved


def test_rounds_are_drawn_more_strongly_to_their_mean_than_other_motions(skill: Skill) -> None:
    pose = Pose(on_circle(0.0), DOWN)
    query = ReactivePlanner(skill, PlannerSettings(ridge_strength=0.5)).arm.queries.transport(pose, [pose])
    assert not isinstance(query, Refusal)
    paths = query.along_mean_paths.mean_paths
    assert paths is not None
    expected = paths.conformal_factors(query.decoded.latent, 0.5 * ROUND_RIDGE)
    np.testing.assert_array_equal(query.along_mean_paths.conformal, expected)
    assert expected.mean() > paths.conformal_factors(query.decoded.latent, 0.5).mean()


def tool_path(planner: ReactivePlanner, start: np.ndarray) -> np.ndarray:
    """Positions (m, 3) [m] of the planned round from a place back to it."""
    plan = planner.plan(start, DOWN, start, DOWN)
    assert plan.reference is not None
    return np.array([planner.robot.forward(each)[0] for each in plan.reference.positions])


def test_where_rounds_cross_themselves_the_one_that_begins_there_is_made() -> None:
    """An eight that begins at its crossing: the lobe that was shown first is the first, also from beside it."""
    angle = 2.0 * np.pi * np.linspace(0.0, 1.0, 150)
    shape = np.stack([0.5 * np.sin(2.0 * angle), np.sin(angle), np.zeros(150)], axis=1)
    items = [
        Demonstration(CENTRE + share * RADIUS * shape, np.tile(DOWN, (150, 1)), 0.6 * angle, f"{share}")
        for share in (0.85, 0.95, 1.05, 1.15)
    ]
    settings = TrainingSettings(closed=True, steps=400, precision_iterations=60)
    planner = ReactivePlanner(train_skill(Demonstrations(tuple(items), frame="panda_link0"), settings, "eights"))
    for beside in ([0.0, 0.0, 0.0], [-0.004, -0.004, 0.0], [0.004, -0.004, 0.0]):
        plan = planner.plan(CENTRE + beside, DOWN, CENTRE + beside, DOWN)
        assert plan.verdict.reason == "1.00 rounds"
        across = np.array([planner.robot.forward(one)[0] for one in plan.reference.positions])[:, 1]
        assert np.argmax(across) < np.argmin(across)
        assert (across.max(), across.min()) == (pytest.approx(RADIUS, abs=0.03), pytest.approx(-RADIUS, abs=0.03))


def test_what_stands_on_the_round_is_kept_clear_of_and_the_rounds_go_on_when_it_is_removed(skill: Skill) -> None:
    arm = Arm.at(skill, 0.0, periodic=True, rounds=2, detour=0.0)
    centre, radius = on_circle(0.5) - [0.0, 0.0, 0.02], 0.03
    assert arm.planner.set_obstacles(centre[None], np.array([radius]), time=0.0).ok
    assert arm.planner.set_goal(on_circle(0.0), DOWN).ok
    arm.play(lambda arm: arm.now > 8.0)
    clearances = [np.linalg.norm(place - centre) - radius for place in arm.places]
    assert min(clearances) > 0.0
    nothing = np.empty((0, 3)), np.empty(0)
    assert arm.planner.set_obstacles(*nothing, time=arm.now).ok
    arm.play(lambda arm: arm.turned > 1.99 and rests(arm))
    assert arm.turned == pytest.approx(2.0, abs=0.01)


def test_a_closed_skill_is_saved_with_its_rounds_and_decodes_the_same_a_round_later(skill: Skill, tmp_path) -> None:
    loaded = Skill.load(skill.save(tmp_path / "circles"))
    assert loaded.period == skill.period
    np.testing.assert_array_equal(loaded.codes, skill.codes)
    graph = loaded.graph()
    number = graph._number
    side = round(loaded.period / graph.grid.spacing[0])
    here, later = number[:-side].ravel(), number[side:].ravel()
    both = (here >= 0) & (later >= 0)
    np.testing.assert_array_equal(here >= 0, later >= 0)
    np.testing.assert_allclose(
        graph.decoded.positions[here[both]], graph.decoded.positions[later[both]], rtol=0.0, atol=1e-12
    )
    # the pieces that hold rounds lead from one to the next
    nodes = [graph.node_near(code, np.ones(len(graph.latent), bool), 5) for code in loaded.codes[0, [0, -1]]]
    assert graph.component[nodes[0]] == graph.component[nodes[1]]


def test_a_closed_skill_is_drawn_on_its_cylinder(skill: Skill, tmp_path) -> None:
    training_report(skill, tmp_path / "report.png")
    assert (tmp_path / "report.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"canonical": None}, "a closed skill has a canonical sheet"),
        ({"latent_upper": 3.0}, "rounds are 18"),
        ({"codes": slice(0, -1)}, "must lead through 3 rounds of 6"),
    ],
)  # fmt: skip
def test_a_closed_skill_on_disk_that_has_no_rounds_is_refused_by_name(skill: Skill, tmp_path, changes, match) -> None:
    if isinstance(changes.get("codes"), slice):
        sheet = skill.canonical
        cut = {name: getattr(sheet, name)[:, :-1] for name in ("positions", "quaternions", "times")}
        changes = {"codes": skill.codes[:, :-1], "canonical": replace(sheet, **cut)}
    if "latent_upper" in changes:
        changes = {"latent_upper": skill.latent_upper + [3.0, 0.0]}
    folder = replace(skill, **changes).save(tmp_path / "skill")
    with pytest.raises(SkillError, match=match):
        Skill.load(folder)
