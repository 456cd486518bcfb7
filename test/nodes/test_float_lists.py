"""Lists that mix integers and floats, as people write them, become lists that ROS reads."""

from __future__ import annotations

from pathlib import Path

import pytest
import rclpy
import yaml

from geodesic_motion_ros.nodes.float_lists import arguments_with_floats, with_floats

FILE = """# [1, 0.5] m
/**:
  planner:
    ros__parameters:
      rate: 100
      tool_spheres: [0, 0, -0.05,
                     0.06]   # x, y, z, radius
      skill: "a [1, b]"
"""


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("[0, 0.5]", "[0.0, 0.5]"), ("[-1,+2, .5, 1e-3]", "[-1.0, +2.0, .5, 1e-3]"), ("[0, 1]", "[0, 1]"),
        ("[0.0, 1.0]", "[0.0, 1.0]"), ("[a, 1, 0.5]", "[a, 1, 0.5]"), ("[]", "[]"), ("[1, , 0.5]", "[1, , 0.5]"),
        ("x: 1", "x: 1"),
    ],
)  # fmt: skip
def test_the_integers_of_a_list_with_floats_are_written_as_floats(text, written):
    assert with_floats(text) == written


def test_a_file_is_written_anew_where_it_has_to_be_and_only_its_lists_change(tmp_path):
    mixed, plain = tmp_path / "mixed.yaml", tmp_path / "plain.yaml"
    mixed.write_text(FILE)
    plain.write_text(FILE.replace("[0, 0, -0.05", "[0.0, 0.0, -0.05").replace("[1, 0.5]", ""))
    given = ["planner", "--ros-args", "--params-file", str(mixed), "--params-file", str(plain), "--log-level", "warn"]
    (tmp_path / "new").mkdir()
    changed = arguments_with_floats(given, tmp_path / "new")
    assert [after for before, after in zip(given, changed, strict=True) if before != after] == [changed[3]]
    assert mixed.read_text() == FILE
    values = yaml.safe_load(Path(changed[3]).read_text())["/**"]["planner"]["ros__parameters"]
    assert values["tool_spheres"] == [0.0, 0.0, -0.05, 0.06]
    assert (values["rate"], values["skill"]) == (100, "a [1, b]")


def test_what_is_no_file_is_left_to_ros(tmp_path):
    given = ["--ros-args", "--params-file", str(tmp_path / "none.yaml"), "--params-file"]
    assert arguments_with_floats(given, tmp_path) == given


def test_ros_reads_what_is_written(tmp_path):
    file = tmp_path / "mixed.yaml"
    file.write_text(FILE)
    given = ["--ros-args", "--params-file", str(file), "-p", "task_frame:=[0, 0, 0.5]"]
    context = rclpy.Context()
    rclpy.init(args=arguments_with_floats(given, tmp_path), context=context)
    node = rclpy.create_node("planner", context=context, automatically_declare_parameters_from_overrides=True)
    try:
        assert list(node.get_parameter("tool_spheres").value) == [0.0, 0.0, -0.05, 0.06]
        assert list(node.get_parameter("task_frame").value) == [0.0, 0.0, 0.5]
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)
