"""Whole-arm demonstrations are what the teacher says of them, and the arm can do them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.similarity import compare
from geodesic_motion_ros.errors import DemonstrationError, ParameterError
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import swivel_angle
from geodesic_motion_ros.simulation import joint_teacher
from geodesic_motion_ros.simulation.joint_teacher import Guidance, perform, reach_guidances, reach_to_grasp
from geodesic_motion_ros.simulation.tabletop import TabletopWorld

ROBOT = Robot.panda()
ELBOW = 4  # of the frames of the chain
Shown = tuple[tuple[Guidance, ...], JointDemonstrations]


@pytest.fixture(scope="module")
def connected() -> Shown:
    """Two demonstrations of each of three families."""
    return reach_guidances(2, 3, 3, True), reach_to_grasp(2, 3, families=3, connected=True)


@pytest.fixture(scope="module")
def separated() -> Shown:
    return reach_guidances(2, 3, 3, False), reach_to_grasp(2, 3, families=3, connected=False)


@pytest.fixture(params=["connected", "separated"])
def every(request: pytest.FixtureRequest) -> Shown:
    return request.getfixturevalue(request.param)


def elbows(shown: JointDemonstrations) -> np.ndarray:
    """Elbow of each demonstration at 21 instants equally spaced in time (N, 21, 3) [m]."""
    paths = shown.resampled(21, by="time").configurations_array()
    return np.array([[ROBOT.link_frames(q)[1][ELBOW] for q in path] for path in paths])


def test_the_arm_does_what_it_was_guided_to(every: Shown) -> None:
    guidances, shown = every
    tools = shown.tool_demonstrations(ROBOT)
    for guidance, item, tool in zip(guidances, shown, tools, strict=True):
        np.testing.assert_array_equal(item.times, guidance.times)
        assert np.max(np.linalg.norm(tool.positions - guidance.positions, axis=1)) < 5e-3
        assert np.max(angle_between(tool.quaternions, guidance.quaternions)) < np.radians(1.0)
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
    where = elbows(separated[1]).reshape(3, 2, 21, 3).mean(axis=1)
    for one, other in ((0, 1), (1, 2)):
        assert np.min(np.linalg.norm(where[one] - where[other], axis=1)) > 0.15


def test_the_tool_reaches_half_a_metre_and_turns_by_a_right_angle(every: Shown) -> None:
    for tool in every[1].tool_demonstrations(ROBOT):
        assert 0.4 < np.linalg.norm(tool.positions[-1] - tool.positions[0]) < 0.65
        assert angle_between(tool.quaternions[0], tool.quaternions[-1]) == pytest.approx(np.pi / 2, abs=0.2)


def test_demonstrations_of_a_family_are_alike_but_not_the_same(every: Shown) -> None:
    tools = every[1].tool_demonstrations(ROBOT)
    for first, second in ((0, 1), (2, 3), (4, 5)):
        assert 2e-3 < compare(tools[first].curve, tools[second].curve).dtw < 40e-3


@pytest.mark.parametrize("family", [0, 2])
def test_a_sphere_at_the_elbow_of_an_outer_family_leaves_the_others_free(every: Shown, family: int) -> None:
    shown = every[1]
    middle = shown[2 * family].configurations[len(shown[2 * family]) // 2]
    with TabletopWorld(rate_hz=200.0) as world:
        world.set_obstacles({"sphere": (ROBOT.link_frames(middle)[1][ELBOW], 0.06)})
        for number, item in enumerate(shown):
            nearest = np.inf
            for q in item.configurations[::10]:
                world.reset(q)
                nearest = min(nearest, world.clearance()[0])
            assert (nearest < 0.0) == (number // 2 == family)


def test_the_same_seed_gives_the_same_arrays_and_another_seed_others() -> None:
    first, again, other = (reach_to_grasp(1, seed, families=2) for seed in (7, 7, 8))
    assert [item.name for item in first] == ["family_0_0", "family_1_0"]
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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (lambda g: {"positions": g.positions + [0.4, 0.0, 0.0]}, "'family_0_0' cannot be shown: .*remain"),
        (lambda g: {"swivels": g.swivels + np.radians(3.0) * np.sin(60.0 * g.times)}, "'family_0_0', sample .* limit"),
        (lambda g: {"positions": g.positions - [0.0, 0.0, 0.2]}, "'family_0_0', sample .* and the table are -?"),
    ],
    ids=["out of reach", "too fast", "into the table"],
)
def test_what_the_arm_could_not_show_is_refused_with_the_reason(changes, message: str) -> None:
    (guidance,) = reach_guidances(1, 1, families=1, connected=True)
    with TabletopWorld(rate_hz=200.0) as world, pytest.raises(DemonstrationError, match=message):
        perform(world, replace(guidance, **changes(guidance)))


def test_an_arm_that_cannot_follow_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """With its targets held back, the arm is behind."""
    (guidance,) = reach_guidances(1, 1, families=1, connected=True)
    monkeypatch.setattr(joint_teacher, "FOLLOWING_ERROR", 1e-5)
    with TabletopWorld(rate_hz=200.0) as world, pytest.raises(DemonstrationError, match="rad behind"):
        perform(world, guidance)
