from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import DemonstrationError

ROBOT = Robot.named("panda")


def arrays(samples: int = 50) -> dict[str, np.ndarray]:
    """A bent path through joint space from the ready posture, sampled unevenly in time."""
    s = np.linspace(0.0, 1.0, samples)[:, None]
    far = np.array([0.5, 0.3, -0.4, 0.2, 0.1, 0.3, -0.2])
    return {
        "configurations": ROBOT.ready + s * far + 0.2 * np.sin(np.pi * s) * far[::-1],
        "times": 0.5 + s[:, 0] + s[:, 0] ** 2,
    }


def demonstration(samples: int = 50, **changes) -> JointDemonstration:
    return JointDemonstration(**(arrays(samples) | {"name": "reach_1"} | changes))


def task(*items: JointDemonstration) -> JointDemonstrations:
    return JointDemonstrations(items, ROBOT.joint_names, "panda")


def spoiled(name: str, index: tuple[int, ...], value: float) -> dict[str, np.ndarray]:
    array = arrays()[name].copy()
    array[index] = value
    return {name: array}


def test_arrays_are_copied_and_cannot_be_written_to():
    given = arrays()
    shown = JointDemonstration(**given, name="reach_1")
    given["configurations"][0] = 9.0
    np.testing.assert_array_equal(shown.configurations[0], ROBOT.ready)
    for array in (shown.configurations, shown.times):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 9.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (spoiled("configurations", (7, 2), np.nan), "'reach_1', sample 7, column joint 3: nan is not a finite number"),
        (spoiled("times", (9,), np.inf), "'reach_1', sample 9, column t: inf"),
        (spoiled("times", (12,), 0.0), r"sample 12, column t: 0 s does not come after .*strictly increasing"),
        ({"times": np.arange(49.0)}, "'reach_1' has 50 configurations and 49 times"),
        ({"configurations": np.zeros(50)}, r"shape \(50,\) cannot hold joint 1"),
        ({"configurations": np.zeros((1, 7)), "times": [0.0]}, r"'reach_1' has 1 sample\(s\)"),
    ],
)
def test_bad_input_is_refused_by_name_and_place(changes, message):
    with pytest.raises(DemonstrationError, match=message):
        demonstration(**changes)


def test_length_is_that_of_the_path_through_joint_space():
    corner = demonstration(configurations=[[0.0, 0.0], [0.3, 0.4], [0.3, 1.4]], times=[0.0, 1.0, 2.0])
    assert corner.length == pytest.approx(0.5 + 1.0)


def test_resampling_by_arc_length_spaces_samples_equally_in_joint_space():
    even = demonstration(400).resample(80)
    steps = np.linalg.norm(np.diff(even.configurations, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps.mean(), rtol=1e-3)
    np.testing.assert_allclose(even.configurations[[0, -1]], demonstration(400).configurations[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(even.times[[0, -1]], [0.5, 2.5])


def test_resampling_by_time_spaces_times_equally_and_stays_on_the_path():
    shown = demonstration(400)
    even = shown.resample(30, by="time")
    np.testing.assert_allclose(np.diff(even.times), 2.0 / 29.0)
    for time, configuration in zip(even.times, even.configurations, strict=True):
        nearest = np.argmin(np.abs(shown.times - time))
        np.testing.assert_allclose(configuration, shown.configurations[nearest], atol=0.01)


def test_a_pause_of_the_arm_takes_no_arc_length():
    configurations = np.repeat([[0.0], [0.5], [1.0]], [1, 30, 1], axis=0)
    paused = demonstration(configurations=configurations, times=np.arange(32.0)).resample(5)
    np.testing.assert_allclose(paused.configurations[:, 0], [0.0, 0.25, 0.5, 0.75, 1.0])
    assert np.all(np.diff(paused.times) > 0.0)


def test_bad_resampling_is_refused():
    with pytest.raises(DemonstrationError, match="at least 2"):
        demonstration().resample(1)
    with pytest.raises(DemonstrationError, match="'arc_length' or 'time'"):
        demonstration().resample(10, by="phase")
    still = demonstration(configurations=np.full((50, 7), 0.3))
    with pytest.raises(DemonstrationError, match=r"'reach_1' moves 0 rad in all.*resample by 'time'"):
        still.resample(10)
    assert len(still.resample(10, by="time")) == 10


def test_a_task_counts_stacks_and_splits_its_demonstrations():
    shown = task(*(demonstration(50 + number, name=str(number)) for number in range(4)))
    assert len(shown) == 4
    assert [item.name for item in shown] == ["0", "1", "2", "3"]
    with pytest.raises(DemonstrationError, match="between 50 and 53 samples: resample them first"):
        shown.configurations_array()
    assert shown.resample(40).configurations_array().shape == (4, 40, 7)
    train, held_out = shown.split([2, 0])
    assert [item.name for item in train] == ["1", "3"]
    assert [held_out[0].name, held_out[1].name] == ["2", "0"]
    assert train.joint_names == held_out.joint_names == ROBOT.joint_names
    assert train.robot == "panda"
    with pytest.raises(DemonstrationError, match="cannot hold out demonstration 4"):
        shown.split([4])


def test_a_task_needs_demonstrations_of_the_joints_it_names():
    with pytest.raises(DemonstrationError, match="at least one"):
        task()
    with pytest.raises(DemonstrationError, match="'reach_1' has 6 joints; 7 are named: panda_joint1"):
        task(demonstration(configurations=np.zeros((50, 6))))


def test_the_tool_goes_where_forward_kinematics_says():
    shown = demonstration()
    (tool,) = task(shown).tool_demonstrations(ROBOT)
    for sample in (0, 20, 49):
        position, quaternion = ROBOT.forward(shown.configurations[sample])
        np.testing.assert_allclose(tool.positions[sample], position, atol=1e-15)
        assert abs(tool.quaternions[sample] @ quaternion) == pytest.approx(1.0)
    assert np.all(np.sum(tool.quaternions[1:] * tool.quaternions[:-1], axis=1) > 0.0)
    np.testing.assert_array_equal(tool.times, shown.times)
    assert tool.name == shown.name
    assert task(shown).tool_demonstrations(ROBOT).frame == "panda_link0"


def test_another_robot_and_its_limits_are_refused_by_name():
    other = JointDemonstrations((demonstration(),), tuple(f"arm_{number}" for number in range(7)), "arm")
    with pytest.raises(DemonstrationError, match=r"joints arm_0, .*; the robot has panda_joint1"):
        other.tool_demonstrations(ROBOT)
    outside = task(demonstration(**spoiled("configurations", (5, 3), 0.5)))
    with pytest.raises(DemonstrationError, match=r"'reach_1', sample 5: joint 'panda_joint4' is at 0\.5000 rad"):
        outside.tool_demonstrations(ROBOT)
