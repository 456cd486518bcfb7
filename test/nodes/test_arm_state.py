"""Where the arm is, out of joint states as drivers send them, at times of the test's own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from geodesic_motion_ros.nodes import arm_state
from geodesic_motion_ros.nodes.arm_state import ArmState
from geodesic_motion_ros.nodes.node_time import Moment
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.robot.kinematics import Robot

ROBOT = Robot.named("panda")
NAMES, READY = ROBOT.joint_names, ROBOT.ready
#: The ROS clock when the steady one shows 0 [s].
EPOCH = 1000.0
#: [rad/s] of every joint of an arm in motion.
SPEED = 0.2


class Driver:
    """Sends messages of an arm in uniform motion, and looks at the state that comes of them."""

    def __init__(self, robot: Robot = ROBOT, prefix: str = "") -> None:
        self.warnings: list[str] = []
        self.refusals = RefusalLog(self.warnings.append, quiet=0.0)
        self.state = ArmState(robot.prefixed(prefix), self.refusals, prefix)
        self.now = 1.0

    def go(self, duration: float) -> None:
        self.now = round(self.now + duration, 9)

    def at(self, time: float) -> np.ndarray:
        """Where the arm is at a time [s]."""
        return READY + SPEED * (time - 1.0)

    def send(self, names: Sequence[str] = NAMES, positions: Any = None, stamp: float | None = None, **fields: Any):
        """Publish joints of the arm as it is now; stamp : of the ROS clock [s], as it is now where None."""
        if positions is None:
            positions = [self.at(self.now)[NAMES.index(name)] for name in names]
        at = round(1e9 * (EPOCH + self.now if stamp is None else stamp))
        header = Header(stamp=Time(sec=at // 10**9, nanosec=at % 10**9))
        message = JointState(header=header, name=list(names), position=[float(value) for value in positions], **fields)
        arrival = Moment(self.now, self.now, False, 0.0, round(1e9 * (EPOCH + self.now)))
        self.state.receive(serialize_message(message), arrival)

    def fault(self) -> str:
        return self.state.fault(self.now)

    @property
    def age(self) -> float:
        return self.now - self.state.taken


@pytest.fixture
def driver() -> Driver:
    return Driver()


def test_a_whole_state_is_taken_with_its_stamp(driver):
    driver.send(stamp=EPOCH + driver.now - 0.03)
    driver.state.update()
    np.testing.assert_allclose(driver.state.joints, READY, atol=1e-12)
    assert driver.age == pytest.approx(0.03, abs=1e-6)
    assert driver.fault() == ""


class TestParts:
    """Joints that come in several messages."""

    @pytest.mark.parametrize("apart", [0.0, 0.004])
    @pytest.mark.parametrize("stamps_differ", [True, False])
    def test_are_merged_at_the_time_of_the_oldest_joint(self, driver, apart, stamps_differ):
        for _ in range(20):
            stamp = None if stamps_differ else EPOCH + driver.now
            measured = driver.at(driver.now)
            driver.send(NAMES[:4], positions=measured[:4], stamp=stamp)
            driver.go(apart)
            measured = driver.at(driver.now) if stamps_differ else measured
            driver.send(NAMES[4:], positions=measured[4:], stamp=stamp)
            driver.state.update()
            driver.go(0.008 - apart)
            driver.state.update()
        # of the first part the next message is not there yet: what is known is of the stamp of that part
        expected = driver.now - 0.008
        assert driver.state.taken == pytest.approx(expected, abs=1e-6)
        np.testing.assert_allclose(driver.state.joints, driver.at(expected), atol=1e-6)
        assert (driver.refusals.counts, driver.fault()) == ({}, "")

    def test_a_part_alone_makes_no_state_and_is_named(self, driver):
        driver.send((*NAMES[:6], "finger"), positions=[*READY[:6], 0.02])
        driver.state.update()
        assert driver.state.joints is None
        assert driver.fault() == "no message has panda_joint7"
        driver.send(NAMES[6:])
        driver.state.update()
        assert driver.state.joints is not None

    def test_the_part_that_falls_silent_makes_the_state_old_and_is_named(self, driver):
        driver.send()
        for _ in range(50):
            driver.go(0.01)
            driver.send(NAMES[:5])
            driver.state.update()
        assert driver.age == pytest.approx(0.5, abs=1e-6)
        np.testing.assert_allclose(driver.state.joints, READY, atol=1e-9)
        assert driver.fault() == "nothing new is heard of panda_joint6, panda_joint7"

    def test_a_wrong_part_is_refused_and_does_not_count(self, driver):
        driver.send()
        driver.state.update()
        driver.go(0.01)
        driver.send(NAMES[3:4], positions=[math.nan])
        driver.state.update()
        assert driver.fault() == "the newest message was refused: joint panda_joint4 holds nan; " + (
            "finite numbers are needed"
        )
        np.testing.assert_array_equal(driver.state.joints, READY)


class TestOthers:
    """Messages about other joints, or without positions, are passed over."""

    @pytest.mark.parametrize(
        "others",
        [
            {"names": ("finger_left", "finger_right"), "positions": (0.02, 0.02)},
            {"names": ("finger",), "positions": (math.nan,)},
            {"names": ("", ""), "positions": (0.0, 0.0)},
            {"names": (), "positions": ()},
            {"positions": (), "effort": [1.0] * 7},
            {"positions": (), "velocity": [math.nan] * 7},
        ],
        ids=["gripper", "NaN of a gripper", "empty names", "nothing", "effort alone", "velocity alone"],
    )
    def test_they_are_no_fault_and_no_news(self, driver, others):
        for _ in range(10):
            driver.go(0.01)
            driver.send()
            driver.state.update()
            driver.go(0.001)
            driver.send(**others)
            driver.state.update()
        assert driver.age == pytest.approx(0.001, abs=1e-6)
        assert (driver.refusals.counts, driver.fault()) == ({}, "")
        driver.go(1.0)
        driver.send(**others)
        driver.state.update()
        assert driver.age == pytest.approx(1.001, abs=1e-6)
        assert driver.fault().startswith("since then messages name " if others.get("names", NAMES) else "")

    def test_before_the_first_state_the_reason_has_what_they_hold(self, driver):
        driver.send(positions=(), effort=[1.0] * 7)
        driver.state.update()
        assert driver.fault() == "the messages about the arm hold no positions"

    def test_a_whole_cell_on_one_topic(self, driver):
        others = [f"left_joint{number}" for number in range(7)]
        driver.send((*others, *reversed(NAMES), *others), positions=[0.0] * 7 + [*reversed(READY)] + [math.nan] * 7)
        driver.state.update()
        np.testing.assert_array_equal(driver.state.joints, READY)
        assert driver.refusals.counts == {}

    def test_NaN_velocities_and_efforts_are_of_no_interest(self, driver):
        driver.send(velocity=[math.nan] * 7, effort=[math.inf] * 3)
        driver.state.update()
        np.testing.assert_array_equal(driver.state.joints, READY)


class TestNames:
    def test_that_have_a_prefix_are_named_with_the_remedy(self, driver):
        driver.send([f"left_{name}" for name in NAMES], positions=READY)
        driver.state.update()
        fault = driver.fault()
        assert fault.startswith("the messages name left_panda_joint1, left_panda_joint2,")
        assert f"expected {', '.join(NAMES)}: set the parameter joint_prefix to 'left_'" in fault

    def test_that_do_not_fit_are_a_remark_as_soon_as_it_is_certain(self, driver):
        """The log has STALE_STATE as it begins alone, when nothing may have arrived yet."""

        def after_a_second() -> dict[str, str]:
            driver.go(1.0)
            driver.send([f"left_{name}" for name in NAMES], positions=READY)
            driver.state.update()
            return driver.state.remarks(driver.now, 0.25)

        assert after_a_second() == {}
        assert after_a_second() == {"names": f"joint_states: {driver.fault()}"}
        driver.send()
        driver.state.update()
        assert driver.state.remarks(driver.now, 0.25) == {}

    def test_without_the_prefix_that_is_set(self):
        driver = Driver(prefix="left_")
        driver.send(NAMES, positions=READY)
        driver.state.update()
        assert driver.fault().endswith("expected " + ", ".join(f"left_{name}" for name in NAMES) + (
            ": set the parameter joint_prefix to ''"
        ))
        driver.send([f"left_{name}" for name in NAMES], positions=READY)
        driver.state.update()
        np.testing.assert_array_equal(driver.state.joints, READY)

    def test_of_another_arm(self, driver):
        driver.send(["shoulder_pan_joint", "elbow_joint"], positions=[0.0, 0.0])
        driver.state.update()
        fault = driver.fault()
        assert fault.startswith("the messages name shoulder_pan_joint, elbow_joint; expected panda_joint1")
        assert "remap joint_states" in fault


    @pytest.mark.parametrize("was_refused", [False, True])
    def test_that_change_while_it_runs_are_named(self, driver, was_refused):
        driver.send(stamp=EPOCH + driver.now + 0.4)
        driver.state.update()
        if was_refused:
            driver.send(positions=[math.nan] * 7)
            driver.state.update()
        for _ in range(300):
            driver.go(0.01)
            driver.send([f"left_{name}" for name in NAMES], positions=READY)
            driver.state.update()
        fault = driver.fault()
        assert fault.startswith("since then messages name left_panda_joint1, ")
        assert fault.endswith("alone: set the parameter joint_prefix to 'left_'")
        # what was wrong before is over
        assert driver.state.remarks(driver.now, 0.25) == {}


class TestRates:
    def test_of_a_fast_driver_no_more_is_read_than_is_needed(self, driver, monkeypatch):
        read = []
        original = arm_state.parse_joint_state
        monkeypatch.setattr(arm_state, "parse_joint_state", lambda *a: read.append(1) or original(*a))
        for _ in range(100):
            for _ in range(10):
                driver.go(0.001)
                driver.send()
            driver.state.update()
            assert driver.age == pytest.approx(0.0, abs=1e-6)
        assert len(read) == 100
        assert driver.state.remarks(driver.now, 0.25) == {}

    def test_a_bad_message_behind_a_good_one_does_not_hide_it(self, driver):
        driver.send()
        driver.send(positions=[math.nan] * 7)
        driver.state.update()
        assert driver.fault().startswith("the newest message was refused: joint panda_joint1 holds nan")
        np.testing.assert_array_equal(driver.state.joints, READY)

    @pytest.mark.parametrize(("rate", "is_named"), [(5, True), (10, False), (37, False), (120, False)])
    def test_a_slow_driver_is_named(self, driver, rate, is_named):
        remarks = []
        for _ in range(4):
            for _ in range(rate):
                driver.go(1.0 / rate)
                driver.send()
                driver.state.update()
            remarks.append(driver.state.remarks(driver.now, 0.25).get("rate", ""))
        # not before it is certain
        assert remarks[0] == ""
        assert [bool(remark) for remark in remarks[2:]] == [is_named] * 2
        if is_named:
            assert "states come 5 times a second, state_timeout is 0.25 s" in remarks[-1]
            assert "set state_timeout to 0.4 or more" in remarks[-1]


class TestClocks:
    """Of a driver whose clock is not the node's."""

    @pytest.mark.parametrize("ahead", [3600.0, 0.4])
    def test_a_stamp_of_the_future_counts_from_the_arrival(self, driver, ahead):
        for number in range(200):
            driver.go(0.01)
            stamp = EPOCH + driver.now + ahead
            if number >= 100:
                # half of the messages take 20 ms longer than the others
                stamp -= 0.02 * (number % 2)
            driver.send(stamp=stamp, positions=READY)
            driver.state.update()
            assert 0.0 <= driver.age < 0.0301
        assert driver.state.remarks(driver.now, 0.25)["clock"].startswith(
            f"joint_states: the stamps are {ahead:.2f} s ahead of the clock of this node: the clocks differ; "
        )
        driver.go(0.3)
        driver.state.update()
        assert driver.age == pytest.approx(0.3 + 0.02, abs=0.0201)

    @pytest.mark.parametrize("ahead", [3600.0, 0.4, 0.0, -0.05])
    def test_a_state_that_is_sent_again_is_not_fresh(self, driver, ahead):
        stamp = EPOCH + driver.now + ahead
        for _ in range(500):
            driver.send(stamp=stamp)
            driver.state.update()
            driver.go(0.01)
        assert driver.age == pytest.approx(5.0 - min(0.0, ahead), abs=1e-3)

    @pytest.mark.parametrize("behind", [3600.0, 0.4])
    def test_a_stamp_of_the_past_is_old_and_the_difference_is_named(self, driver, behind):
        for _ in range(100):
            driver.go(0.01)
            driver.send(stamp=EPOCH + driver.now - behind)
            driver.state.update()
        assert driver.age == pytest.approx(behind, abs=1e-3)
        assert driver.fault() == (
            f"the stamps are {behind:.2f} s behind the clock of this node: the clocks differ, or its messages are "
            "late; synchronise them"
        )

    def test_a_clock_that_is_set_back_far_is_named_beside_the_refusal(self, driver):
        driver.send()
        driver.state.update()
        for _ in range(6):
            driver.go(1.0)
            driver.send(stamp=EPOCH + driver.now - 3600.0)
            driver.state.update()
        assert driver.fault().startswith("the newest message was refused: its stamp is ")
        assert "the stamps are 3600.00 s behind the clock of this node" in driver.fault()

    def test_stamps_of_a_simulation(self, driver):
        driver.send(stamp=EPOCH + driver.now - 2e6)
        driver.state.update()
        assert "one of them is of a simulation: set use_sim_time alike" in driver.fault()

    def test_zero_stamps_count_from_the_arrival(self, driver):
        for _ in range(10):
            driver.go(0.01)
            driver.send(stamp=0.0)
            driver.state.update()
            assert driver.age == pytest.approx(0.0, abs=1e-6)
        assert driver.state.remarks(driver.now, 0.25) == {}

    def test_a_clock_that_is_set_right_is_right_a_moment_later(self, driver):
        for ahead in (3600.0, 0.0):
            for _ in range(10):
                driver.go(0.01)
                driver.send(stamp=EPOCH + driver.now + ahead)
                driver.state.update()
        assert driver.age == pytest.approx(0.0, abs=1e-6)

    def test_without_a_simulated_clock_nothing_is_taken(self, driver):
        message = JointState(name=list(NAMES), position=READY.tolist())
        driver.state.receive(serialize_message(message), Moment(0.0, driver.now, True, 0.0, 0))
        driver.state.update()
        assert driver.state.joints is None
        assert "nothing has been received on /clock" in driver.fault()


class TestTurns:
    """Of joints without an end, which drivers report in [-pi, pi)."""

    @pytest.fixture
    def driver(self, endless_robot) -> Driver:
        return Driver(endless_robot)

    def test_a_turn_is_no_jump(self, driver):
        for number in range(40):
            driver.go(0.01)
            angle = math.pi - 0.01 + 0.0005 * number
            wrapped = (READY + angle + math.pi) % (2.0 * math.pi) - math.pi
            for places in (slice(0, 4), slice(4, 7)):
                driver.send(NAMES[places], positions=wrapped[places])
                driver.state.update()
            off = driver.state.joints - wrapped
            np.testing.assert_allclose(off - 2.0 * math.pi * np.round(off / (2.0 * math.pi)), 0.0, atol=1e-9)
        assert driver.refusals.counts == {}

    def test_between_two_parts_it_is_interpolated_over_the_shorter_angle(self, driver):
        driver.send(positions=[3.13] * 7)
        driver.go(0.01)
        driver.send(NAMES[:4], positions=[-3.13] * 4)
        driver.go(0.005)
        driver.send(NAMES[4:], positions=[3.14] * 3, stamp=EPOCH + driver.now - 0.01)
        driver.state.update()
        expected = -3.13 - 0.5 * (2.0 * math.pi - 6.26)
        np.testing.assert_allclose(driver.state.joints[:4], expected, atol=1e-6)
