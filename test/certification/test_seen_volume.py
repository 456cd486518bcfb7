"""What is seen: spheres inside and outside of it, and detours that stay in it, or are not made."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.certification.seen_volume import BASE_ALLOWANCE, SeenVolume, first_unseen, seen_depth
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Verdict, VerdictCode
from geodesic_motion_ros.geometry.quaternions import from_rotation
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import PlanningError

PANDA, ARM = Robot.named("panda"), CollisionModel.named("panda")
SKILLS = ("panda_pouring", "panda_reach_to_grasp")


def boxes_alone(listed: list[dict[str, Any]]) -> SeenVolume:
    """Of a scene file's list, where no sphere passes anywhere."""
    return SeenVolume(False, DeclaredScene.of({"seen": listed}).seen, np.empty((1, 0, 3)))


def depth_in(entry: dict[str, Any], centre: np.ndarray, radius: float) -> float:
    """How far [m] a sphere is inside of one box: by the distances from its sides."""
    w, x, y, z = entry["quaternion"]
    along = Rotation.from_quat([x, y, z, w]).inv().apply(centre - np.array(entry["centre"]))
    return float(np.min(0.5 * np.array(entry["size"]) - np.abs(along))) - radius


def test_a_sphere_is_inside_where_one_box_holds_all_of_it() -> None:
    random = np.random.default_rng(5)
    listed = [
        {"name": f"box {number}", "centre": random.uniform(-0.3, 0.3, 3).tolist(),
         "size": random.uniform(0.1, 0.8, 3).tolist(), "quaternion": turn.tolist()}
        for number, turn in enumerate(from_rotation(Rotation.random(4, random)))
    ]  # fmt: skip
    seen, inside = boxes_alone(listed), 0
    for centre in random.uniform(-0.5, 0.5, (2000, 3)):
        radius = random.uniform(0.01, 0.1)
        wanted = max(depth_in(entry, centre, radius) for entry in listed)
        found = seen_depth(*centre, 0, radius, seen, 1.0)
        assert (found >= 0.0) == (wanted >= 0.0)
        if wanted >= 0.0:
            assert found == pytest.approx(wanted, abs=1e-9)
            inside += 1
    assert 100 < inside < 1900


def test_a_sphere_across_two_boxes_is_outside() -> None:
    halves = [{"name": name, "centre": [x, 0.0, 0.0], "size": [1.0] * 3} for name, x in (("a", -0.5), ("b", 0.5))]
    seen = boxes_alone(halves)
    assert seen_depth(0.2, 0.0, 0.0, 0, 0.1, seen, 1.0) == pytest.approx(0.1)
    assert seen_depth(0.0, 0.0, 0.0, 0, 0.1, seen, 1.0) == pytest.approx(-0.1)


def test_a_sphere_is_inside_where_it_passes_along_the_base_path() -> None:
    direction = np.array([1.0, 0.3, 0.0, -0.2, 0.0, 0.5, 0.0])
    base, between = (PANDA.ready + np.linspace(-0.5, 0.5, count)[:, None] * direction for count in (9, 333))
    seen = SeenVolume.of_base_path(base, DeclaredScene.empty().seen, PANDA, ARM)
    placed, spheres = ARM.positions(PANDA, between), range(len(ARM))
    depths = [seen_depth(*body[s], s, ARM.radii[s], seen, 1.0) for body in placed for s in spheres]
    assert min(depths) > 0.7 * BASE_ALLOWANCE
    hand = int(np.argmax(np.linalg.norm(placed[-1] - placed[0], axis=1)))
    above = placed[100, hand] + [0.0, 0.0, 0.03]
    assert seen_depth(*above, hand, ARM.radii[hand], seen, 1.0) < 0.0


@pytest.mark.parametrize(("gap", "found"), [(0.0, (-1, -1)), (0.004, (1, 0))], ids=["control", "gap"])
def test_a_motion_that_leaves_the_boxes_between_two_knots_is_found(gap: float, found: tuple[int, int]) -> None:
    """From one box straight into another, which overlap by the sphere and 4 mm, or by the sphere alone."""
    seen = boxes_alone([
        {"name": "a", "centre": [-0.398, 0.0, 0.0], "size": [1.0 - gap, 1.0, 1.0]},
        {"name": "b", "centre": [0.398, 0.0, 0.0], "size": [1.0 - gap, 1.0, 1.0]},
    ])  # fmt: skip
    placed = np.array([[-0.3, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.2, 0.0, 0.0], [0.3, 0.0, 0.0]])[:, None]
    assert first_unseen(placed, np.zeros((3, 1)), np.array([0.1]), np.array([0]), seen) == found


def test_what_a_sphere_may_leave_its_segments_by_is_counted() -> None:
    seen = boxes_alone([{"name": "a", "centre": [0.0, 0.0, 0.0], "size": [1.0, 1.0, 1.0]}])
    placed = np.array([[-0.3, 0.0, 0.0], [0.3, 0.0, 0.0]])[:, None]
    for bulge, found in ((0.09, (-1, -1)), (0.11, (0, 0))):
        assert first_unseen(placed, np.full((1, 1), bulge), np.array([0.1]), np.array([0]), seen) == found


@cache
def free_planner(name: str) -> ReactivePlanner:
    """Where nothing is unseen."""
    return ReactivePlanner(Skill.load(name), scene=DeclaredScene.empty())


def blocked_planner(name: str, *seen: dict[str, Any]) -> ReactivePlanner:
    scene = DeclaredScene.of({"seen": list(seen)})
    return ReactivePlanner(free_planner(name).skill, PlannerSettings(unseen="blocked"), scene=scene)


def planned(planner: ReactivePlanner, obstacles: Obstacles) -> tuple[JointReference | None, Verdict]:
    """Between the skill's mean start and goal."""
    planner.take_obstacles(obstacles)
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    plan = planner.plan(start[:3], start[3:], goal[:3], goal[3:])
    return plan.reference, plan.verdict


def found(planner: ReactivePlanner, obstacles: Obstacles) -> JointReference:
    reference, verdict = planned(planner, obstacles)
    assert reference is not None, verdict
    return reference


def blocker(name: str, radius: float = 0.06) -> Obstacles:
    """A sphere where the hand is halfway."""
    planner = free_planner(name)
    nominal = found(planner, Obstacles.none())
    posture = nominal.sample(0.5 * nominal.duration)[0]
    return Obstacles.of_spheres(planner.robot.forward(posture)[0][None], np.array([radius]))


def centres_along(planner: ReactivePlanner, reference: JointReference, count: int) -> np.ndarray:
    """Of the spheres that are kept from obstacles, (count, k, 3)."""
    postures = reference.samples(np.linspace(0.0, reference.duration, count))[0]
    return planner.collision.positions(planner.robot, np.ascontiguousarray(postures))[:, planner.collision.moving]


def box_around(planner: ReactivePlanner, detour: JointReference, base: JointReference) -> dict[str, Any]:
    """As a scene lists it: what a detour takes the arm through where its spheres do not pass along the base path."""
    radii = planner.collision.radii[planner.collision.moving]
    along, passed = centres_along(planner, detour, 300), centres_along(planner, base, 300)
    apart = np.min(np.linalg.norm(along[:, None] - passed[None], axis=-1), axis=1)
    left = np.nonzero(apart > 0.4 * BASE_ALLOWANCE)
    reach = radii[left[1], None] + 0.02
    lower, upper = np.min(along[left] - reach, axis=0), np.max(along[left] + reach, axis=0)
    return {"name": "beside", "centre": (0.5 * (lower + upper)).tolist(), "size": (upper - lower).tolist()}


def excursion(
    planner: ReactivePlanner, reference: JointReference, base: JointReference, entry: dict[str, Any] | None
) -> float:
    """How far [m] a motion takes spheres out of a box, and beyond what is allowed beside a base path."""
    radii = planner.collision.radii[planner.collision.moving]
    along, passed = centres_along(planner, reference, 400), centres_along(planner, base, 1500)
    beyond = np.full(along.shape[:2], np.inf)
    if entry is not None:
        beyond = radii - np.min(0.5 * np.array(entry["size"]) - np.abs(along - entry["centre"]), axis=2)
    worst = 0.0
    for s in range(len(radii)):
        out = beyond[:, s] > 0.0
        apart = cKDTree(passed[:, s]).query(along[out, s])[0]
        worst = max(worst, np.max(np.minimum(beyond[out, s], apart - BASE_ALLOWANCE), initial=0.0))
    return worst


@pytest.mark.parametrize("name", SKILLS)
def test_a_detour_stays_in_what_is_seen(name: str) -> None:
    """The box is around the detour that is made where nothing is unseen: the control."""
    free, obstacles = free_planner(name), blocker(name)
    base, control = found(free, Obstacles.none()), found(free, obstacles)
    assert excursion(free, control, base, None) > 0.05
    entry = box_around(free, control, base)
    blocked = blocked_planner(name, entry)
    reference, verdict = planned(blocked, obstacles)
    assert reference is not None, verdict
    assert verdict.figures.displacement > 0.05
    # Paths of the skill are played within 3 mm of the base path that a detour is searched beside.
    assert excursion(blocked, reference, base, entry) <= 0.003


@pytest.mark.parametrize("name", SKILLS)
def test_where_a_detour_does_not_fit_into_what_is_seen_another_one_is_made_or_none(name: str) -> None:
    """The same box, six centimetres shorter on one side: the control leaves it on most."""
    free, obstacles = free_planner(name), blocker(name)
    base, control = found(free, Obstacles.none()), found(free, obstacles)
    entry = box_around(free, control, base)
    left = 0
    for shift in np.concatenate([-0.03 * np.eye(3), 0.03 * np.eye(3)]):
        size, centre = np.array(entry["size"]) - 2.0 * np.abs(shift), np.array(entry["centre"]) + shift
        smaller = {"name": "smaller", "centre": centre.tolist(), "size": size.tolist()}
        left += excursion(free, control, base, smaller) > 0.01
        reference, verdict = planned(blocked_planner(name, smaller), obstacles)
        if reference is None:
            assert "not seen" in verdict.reason
        else:
            assert excursion(free, reference, base, smaller) <= 0.003
    assert left >= 4


@pytest.mark.parametrize("name", SKILLS)
def test_where_nothing_is_seen_there_is_no_detour_and_it_says_why(name: str) -> None:
    free, blocked, obstacles = free_planner(name), blocked_planner(name), blocker(name)
    assert planned(free, obstacles)[1].ok
    _, verdict = planned(blocked, obstacles)
    assert verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "no detour of up to 25 cm: the arm would enter what is not seen" in verdict.reason
    # Where there were none either if all was seen, that is not the reason.
    for planner in (free, blocked):
        assert planner.set_detour(0.05).ok
        assert "no detour of up to 5 cm: the hand cannot pass" in planned(planner, blocker(name, 0.08))[1].reason
        assert planner.set_detour(0.25).ok


def test_what_was_demonstrated_need_not_be_seen() -> None:
    one, other = (found(planner(SKILLS[0]), Obstacles.none()) for planner in (free_planner, blocked_planner))
    np.testing.assert_array_equal(one.positions, other.positions)


def test_what_the_hand_holds_is_kept_in_what_is_seen_as_well() -> None:
    """A rod that reaches out of a box in which there is a detour without it."""
    free, obstacles = free_planner(SKILLS[0]), blocker(SKILLS[0])
    blocked = blocked_planner(SKILLS[0], box_around(free, found(free, obstacles), found(free, Obstacles.none())))
    assert planned(blocked, obstacles)[1].ok
    rod = HeldObject("rod", "box", (0.02, 0.02, 0.3), (0.0, 0.0, 0.15))
    for planner, detours in ((free, True), (blocked, False)):
        assert planner.hold([rod]).ok
        _, verdict = planned(planner, obstacles)
        assert verdict.ok is detours, verdict
        assert planner.hold([]).ok


def test_a_word_that_is_neither_is_refused() -> None:
    with pytest.raises(PlanningError, match="setting unseen is 'seen', must be one of free, blocked"):
        PlannerSettings(unseen="seen")
