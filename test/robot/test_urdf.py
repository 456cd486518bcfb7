"""A URDF that does not fit is refused, and the message says what is missing and what is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from geodesic_motion_ros.robot.urdf import (
    read_chain,
    read_dynamic_limits,
    read_largest_speed_scale,
    read_position_based_velocity,
)
from geodesic_motion_ros.utils.errors import RobotError

ARM = """<robot name="arm">
  <link name="base"/><link name="upper"/><link name="slide"/><link name="tool"/><link name="camera"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.5" rpy="0 0 0"/><axis xyz="0 0 2"/>
    <limit lower="-1" upper="2" velocity="1.5" effort="1"/></joint>
  <joint name="push" type="prismatic"><parent link="upper"/><child link="slide"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.3" velocity="0.2" effort="1"/></joint>
  <joint name="mount" type="fixed"><parent link="slide"/><child link="tool"/><origin xyz="0.1 0 0"/></joint>
</robot>"""


def write(folder: Path, text: str) -> Path:
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


def test_reads_the_chain_between_two_links(tmp_path: Path) -> None:
    chain = read_chain(write(tmp_path, ARM), "base", "tool")
    assert chain.joint_names == ("turn", "push")
    assert chain.link_names == ("base", "upper", "slide", "tool")
    np.testing.assert_array_equal(chain.joint_index, [0, 1, -1])
    np.testing.assert_array_equal(chain.prismatic, [False, True, False])
    np.testing.assert_array_equal(chain.axes[0], [0, 0, 1])
    np.testing.assert_array_equal(chain.upper, [2, 0.3])


def test_a_continuous_joint_has_no_position_limits(tmp_path: Path) -> None:
    text = ARM.replace('type="revolute"', 'type="continuous"')
    chain = read_chain(write(tmp_path, text), "base", "tool")
    assert chain.lower[0] == -np.inf
    assert chain.upper[0] == np.inf


def test_lower_is_0_where_it_is_not_written(tmp_path: Path) -> None:
    chain = read_chain(write(tmp_path, ARM.replace('lower="0" ', "")), "base", "tool")
    np.testing.assert_array_equal([chain.lower[1], chain.upper[1]], [0.0, 0.3])


def test_all_joints_without_a_limit_are_named(tmp_path: Path) -> None:
    text = ARM.replace('velocity="1.5" ', "").replace('velocity="0.2" ', "")
    with pytest.raises(RobotError, match="no positive limit of velocity is given for turn, push:"):
        read_chain(write(tmp_path, text), "base", "tool")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('velocity="1.5" ', "", ("velocity is given for turn:", "--velocity", "one for each of turn, push")),
        ('<limit lower="-1" upper="2" velocity="1.5" effort="1"/>', "", ("range of positions", "turn:", "lower")),
        ('lower="-1" upper="2" ', "", ("range of positions", "turn:", "lower", "upper", 'type="continuous"')),
        ('lower="-1"', 'lower="nan"', ("turn", "lower", "nan")),
        ('lower="-1"', 'lower="3"', ("turn:", "write lower below upper")),
        ('velocity="1.5"', 'velocity="0"', ("no positive limit of velocity is given for turn:",)),
        ('xyz="0 0 2"', 'xyz="0 0 0"', ("turn", "axis")),
        ('xyz="0 0 0.5"', 'xyz="0 0"', ("turn", "origin xyz", "3 finite numbers")),
        ('type="fixed"', 'type="floating"', ("mount", "floating", "revolute")),
        ("</robot>", "", ("is no URDF: no element found",)),
    ],
)
def test_names_what_is_wrong(tmp_path: Path, old: str, new: str, words: tuple[str, ...]) -> None:
    with pytest.raises(RobotError) as caught:
        read_chain(write(tmp_path, ARM.replace(old, new)), "base", "tool")
    for word in words:
        assert word in str(caught.value)


def test_an_unknown_link_is_answered_with_those_that_exist(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"'flange'.*base, upper, slide, tool"):
        read_chain(write(tmp_path, ARM), "base", "flange")


def test_links_that_no_joints_connect(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"no chain .* from 'base' to 'camera' .*: above 'camera' are no links"):
        read_chain(write(tmp_path, ARM), "base", "camera")
    with pytest.raises(RobotError, match=r"from 'tool' to 'slide' in arm\.urdf: above 'slide' are upper, base"):
        read_chain(write(tmp_path, ARM), "tool", "slide")


@pytest.mark.parametrize(("kind", "old", "new"), [("joint", '"push"', '"turn"'), ("link", '"camera"', '"tool"')])
def test_names_that_stand_twice_are_refused(kind: str, old: str, new: str, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=rf"arm\.urdf has more than one {kind} called {new.strip(chr(34))}"):
        read_chain(write(tmp_path, ARM.replace(f"<{kind} name={old}", f"<{kind} name={new}")), "base", "tool")


def test_a_chain_without_moving_joints(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="no moving joint"):
        read_chain(write(tmp_path, ARM), "slide", "tool")


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"absent\.urdf"):
        read_chain(tmp_path / "absent.urdf", "base", "tool")


@pytest.mark.parametrize("entry", ["{max_acceleration: 1.0}", "{max_acceleration: 1.0, max_jerk: -2}", "3"])
def test_dynamic_limits_must_be_complete_and_positive(tmp_path: Path, entry: str) -> None:
    path = tmp_path / "limits.yaml"
    path.write_text(f"joint_limits:\n  turn: {entry}\n")
    with pytest.raises(RobotError, match=r"(max_jerk|max_acceleration) of joint 'turn'"):
        read_dynamic_limits(path, ("turn",))


APPROACH = {"deceleration": 6.0, "offset": 0.3, "lower": -2.75, "upper": 2.75}


def limits_file(folder: Path, **content: object) -> Path:
    path = folder / "limits.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_limits_towards_stops_are_read_and_those_of_other_joints_are_none(tmp_path: Path) -> None:
    path = limits_file(tmp_path, joint_limits={"turn": {"position_based_velocity": APPROACH}, "slide": {}})
    read = read_position_based_velocity(path, ("turn", "slide"))
    assert read is not None
    downwards, upwards = read.largest_speeds(np.array([[2.0, 1e3]]))
    np.testing.assert_allclose(downwards, [[np.sqrt(12.0 * 4.75) - 0.3, np.inf]])
    np.testing.assert_allclose(upwards, [[np.sqrt(12.0 * 0.75) - 0.3, np.inf]])
    assert read_position_based_velocity(path, ("slide",)) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"deceleration": 0.0}, "has deceleration 0: expected a positive one"),
        ({"offset": -0.1}, "has offset -0.1: expected 0 or a positive one"),
        ({"upper": -3.0}, "has stops -2.75 and -3: expected lower below upper"),
        ({"upper": None}, "expected finite numbers deceleration, offset, lower, upper"),
        ({"upper": float("inf")}, "expected finite numbers deceleration, offset, lower, upper"),
        ({"decelaration": 6.0}, "and nothing else"),
    ],
)
def test_limits_towards_stops_must_be_complete(tmp_path: Path, change: dict[str, object], message: str) -> None:
    path = limits_file(tmp_path, joint_limits={"turn": {"position_based_velocity": APPROACH | change}})
    with pytest.raises(RobotError, match=rf"position_based_velocity of joint 'turn' in limits\.yaml .*{message}"):
        read_position_based_velocity(path, ("turn",))


@pytest.mark.parametrize("scale", [0.0, 1.5, True, "fast"])
def test_the_largest_speed_scale_is_a_share(tmp_path: Path, scale: object) -> None:
    with pytest.raises(RobotError, match=r"max_speed_scale in limits\.yaml is .*: expected a number in \(0, 1\]"):
        read_largest_speed_scale(limits_file(tmp_path, joint_limits={}, max_speed_scale=scale))
    assert read_largest_speed_scale(limits_file(tmp_path, joint_limits={})) == 1.0


def test_dynamic_limits_must_be_a_table(tmp_path: Path) -> None:
    path = tmp_path / "limits.yaml"
    path.write_text("- a list")
    with pytest.raises(RobotError, match="joint_limits"):
        read_dynamic_limits(path, ("turn",))
