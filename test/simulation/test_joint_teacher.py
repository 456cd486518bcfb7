"""Whole-arm demonstrations are what the teacher says of them, and the arm can do them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import elbow_position, swivel_angle
from geodesic_motion_ros.simulation import joint_teacher, teacher
from geodesic_motion_ros.simulation.joint_teacher import Guidance, perform, reach_guidances, reach_to_grasp
from geodesic_motion_ros.simulation.tabletop import TabletopWorld
from geodesic_motion_ros.utils.errors import DemonstrationError, ParameterError
from geodesic_motion_studies.tools.similarity import compare

ROBOT = Robot.named("panda")
Shown = tuple[tuple[Guidance, ...], JointDemonstrations]


@pytest.fixture(scope="module")
def connected() -> Shown:
    """Two demonstrations of each of three families."""
    return reach_guidances(2, 3, 3, True), reach_to_grasp(2, 3, families=3, connected=True)


@pytest.fixture(scope="module")
def separated() -> Shown:
    """One demonstration of each of three families."""
    return reach_guidances(1, 3, 3, False), reach_to_grasp(1, 3, families=3, connected=False)


@pytest.fixture(scope="module")
def circles() -> Shown:
    return joint_teacher.circle_guidances(2, 3), joint_teacher.circle(2, 3)


@pytest.fixture(scope="module")
def pourings() -> Shown:
    """One demonstration of each of three pairs."""
    return joint_teacher.pouring_guidances(1, 3), joint_teacher.pouring(1, 3)


@pytest.fixture(params=["connected", "separated"])
def reaching(request: pytest.FixtureRequest) -> Shown:
    return request.getfixturevalue(request.param)


@pytest.fixture(params=["connected", "separated", "circles", "pourings"])
def every(request: pytest.FixtureRequest) -> Shown:
    return request.getfixturevalue(request.param)


def elbows(shown: JointDemonstrations) -> np.ndarray:
    """Elbow of each demonstration at 21 instants equally spaced in time (N, 21, 3) [m]."""
    paths = shown.resample(21, by="time").configurations_array()
    return np.array([[elbow_position(ROBOT, q) for q in path] for path in paths])


def test_the_arm_does_what_it_was_guided_to(every: Shown) -> None:
    guidances, shown = every
    assert [item.name for item in shown] == [guidance.motion.name for guidance in guidances]
    tools = shown.tool_demonstrations(ROBOT)
    for guidance, item, tool in zip(guidances, shown, tools, strict=True):
        np.testing.assert_array_equal(item.times, guidance.motion.times)
        assert np.max(np.linalg.norm(tool.positions - guidance.motion.positions, axis=1)) < 5e-3
        assert np.max(angle_between(tool.quaternions, guidance.motion.quaternions)) < np.radians(1.0)
        swivels = [swivel_angle(ROBOT, q) for q in item.configurations[::10]]
        np.testing.assert_allclose(swivels, guidance.swivels[::10], atol=np.radians(3.0))


def test_joints_stay_inside_their_limits_and_never_leap(every: Shown) -> None:
    for item in every[1]:
        q = item.configurations
        assert np.all((q > ROBOT.lower + 0.05) & (q < ROBOT.upper - 0.05))
        assert np.all(np.abs(np.diff(q, axis=0)) < 0.5 * ROBOT.velocity_limits * 0.01)


def test_connected_families_share_their_ends_and_part_in_the_middle(connected: Shown) -> None:
    _, shown = connected
    where = elbows(shown).reshape(3, 2, 21, 3).mean(axis=1)
    for one, other in ((0, 1), (1, 2)):
        apart = np.linalg.norm(where[one] - where[other], axis=1)
        assert apart[10] > 0.15
        assert max(apart[0], apart[-1]) < 0.06
    starts, ends = (np.array([item.configurations[sample] for item in shown]) for sample in (0, -1))
    assert np.max(np.ptp(starts, axis=0)) < 0.7
    assert np.max(np.ptp(ends, axis=0)) < 0.7


def test_separated_families_never_come_near_one_another(separated: Shown) -> None:
    where = elbows(separated[1])
    for one, other in ((0, 1), (1, 2)):
        assert np.min(np.linalg.norm(where[one] - where[other], axis=1)) > 0.15


def test_the_tool_reaches_half_a_metre_and_turns_by_a_right_angle(reaching: Shown) -> None:
    for tool in reaching[1].tool_demonstrations(ROBOT):
        assert 0.4 < np.linalg.norm(tool.positions[-1] - tool.positions[0]) < 0.65
        assert angle_between(tool.quaternions[0], tool.quaternions[-1]) == pytest.approx(np.pi / 2, abs=0.2)


def test_demonstrations_of_a_family_are_alike_but_not_the_same(connected: Shown) -> None:
    tools = connected[1].resample(100, by="time").tool_demonstrations(ROBOT)
    for first, second in ((0, 1), (2, 3), (4, 5)):
        assert 2e-3 < compare(tools[first].curve, tools[second].curve).dtw < 40e-3


@pytest.mark.parametrize("family", [0, 2])
def test_a_sphere_at_the_elbow_of_an_outer_family_leaves_the_others_free(reaching: Shown, family: int) -> None:
    guidances, shown = reaching
    groups = [guidance.motion.group for guidance in guidances]
    blocked = shown[groups.index(family)].configurations
    middle = blocked[len(blocked) // 2]
    with TabletopWorld(rate_hz=200.0) as world:
        world.set_obstacles({"sphere": (elbow_position(ROBOT, middle), 0.06)})
        for group, item in zip(groups, shown, strict=True):
            nearest = np.inf
            for q in item.configurations[::10]:
                world.reset(q)
                nearest = min(nearest, world.clearance()[0])
            assert (nearest < 0.0) == (group == family)


def test_a_circle_ends_where_it_began_and_is_one(circles: Shown) -> None:
    for item, tool in zip(circles[1], circles[1].tool_demonstrations(ROBOT), strict=True):
        assert np.linalg.norm(tool.positions[-1] - tool.positions[0]) < 0.03
        assert np.max(np.abs(item.configurations[-1] - item.configurations[0])) < 0.2
        # around once: the radius turns by 360 degrees, and stays about 12 cm
        arm = tool.positions - 0.5 * (tool.positions.min(axis=0) + tool.positions.max(axis=0))
        turned = np.unwrap(np.arctan2(arm[:, 1], -arm[:, 2]))
        assert turned[-1] - turned[0] == pytest.approx(2.0 * np.pi, abs=0.3)
        np.testing.assert_allclose(np.linalg.norm(arm[:, 1:], axis=1), 0.12, atol=0.03)
        assert np.ptp(tool.positions[:, 0]) < 0.02
        assert np.max(np.ptp(item.configurations, axis=0)) > 0.3


def test_each_bottle_is_brought_to_its_cup_and_tilted(pourings: Shown) -> None:
    guidances, shown = pourings
    for guidance, tool in zip(guidances, shown.tool_demonstrations(ROBOT), strict=True):
        pair = guidance.motion.group
        bottle = teacher.BOTTLE_REGION.at(np.array(joint_teacher.BOTTLE_PLACES[pair]))
        cup = teacher.CUP_REGION.at(np.array(joint_teacher.CUP_PLACES[pair]))
        assert np.linalg.norm(tool.positions[0, :2] - bottle) < 0.03
        assert np.linalg.norm(tool.positions[-1, :2] - cup) < 0.12
        assert angle_between(tool.quaternions[0], tool.quaternions[-1]) > np.radians(90.0)


def test_the_paths_of_the_pairs_cross(pourings: Shown) -> None:
    """The order of the pairs from near to far is the opposite at the cups of what it is at the bottles."""
    tools = pourings[1].tool_demonstrations(ROBOT)
    starts, goals = (np.array([tool.positions[sample] for tool in tools]) for sample in (0, -1))
    assert np.all(np.diff(starts[:, 0]) > 0.0)
    assert np.all(np.diff(goals[:, 0]) < 0.0)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        between = tools[one].positions[:, None, :2] - tools[other].positions[None, :, :2]
        assert np.min(np.linalg.norm(between, axis=2)) < 0.01


def test_the_picture_shows_the_paths(circles: Shown) -> None:
    guidances, shown = circles
    with_paths = joint_teacher.picture(guidances, shown, width=160, height=120)
    assert with_paths.shape == (120, 160, 3)
    still = replace(shown, items=tuple(shortened(item) for item in shown))
    assert np.sum(np.any(with_paths != joint_teacher.picture(guidances, still, width=160, height=120), axis=2)) > 50


def shortened(item: JointDemonstration) -> JointDemonstration:
    """The end of a demonstration alone: the arm is where it was, the path is not."""
    return JointDemonstration(item.configurations[-3:], item.times[-3:], item.name)


def test_the_same_seed_gives_the_same_arrays_and_another_seed_others(circles: Shown) -> None:
    first, again, other = circles[1], joint_teacher.circle(2, 3), joint_teacher.circle(1, 8)
    for before, after in zip(first, again, strict=True):
        np.testing.assert_array_equal(before.configurations, after.configurations)
        np.testing.assert_array_equal(before.times, after.times)
    assert np.max(np.abs(first[0].configurations[0] - other[0].configurations[0])) > 1e-3


def test_one_family_has_its_elbow_up() -> None:
    (guidance,) = reach_guidances(1, 1, families=1, connected=False)
    assert np.max(np.abs(guidance.swivels)) < np.radians(8.0)


def test_counts_below_one_are_refused() -> None:
    with pytest.raises(ParameterError, match="count_per_family is 0"):
        reach_to_grasp(0, 1)
    with pytest.raises(ParameterError, match="families is 0"):
        reach_to_grasp(1, 1, families=0)
    with pytest.raises(ParameterError, match="count is 0"):
        joint_teacher.circle(0, 1)
    with pytest.raises(ParameterError, match="count_per_pair is -1"):
        joint_teacher.pouring(-1, 1)


def moved(guidance: Guidance, by: list[float]) -> Guidance:
    return replace(guidance, motion=replace(guidance.motion, positions=guidance.motion.positions + by))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (lambda g: moved(g, [0.4, 0.0, 0.0]), "'family_0_0' cannot be performed: .*remain"),
        (lambda g: moved(g, [0.0, 0.0, -0.2]), "'family_0_0', sample .* and 'table' are -?"),
        (lambda g: replace(g, swivels=g.swivels + 0.05 * np.sin(60.0 * g.motion.times)), "sample .* velocity limit"),
    ],
    ids=["out of reach", "into the table", "too fast"],
)
def test_what_the_arm_could_not_show_is_refused_with_the_reason(changed, message: str) -> None:
    (guidance,) = reach_guidances(1, 1, families=1, connected=True)
    with TabletopWorld(rate_hz=200.0) as world, pytest.raises(DemonstrationError, match=message):
        perform(world, changed(guidance))


def test_an_arm_that_cannot_follow_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """With its targets kept back, the arm is behind."""
    (guidance,) = reach_guidances(1, 1, families=1, connected=True)
    monkeypatch.setattr(joint_teacher, "FOLLOWING_ERROR", 1e-5)
    with TabletopWorld(rate_hz=200.0) as world, pytest.raises(DemonstrationError, match="rad behind"):
        perform(world, guidance)
