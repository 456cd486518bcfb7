"""Text with any header, or none: columns by a mapping, everything else passed over or refused by its place."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.column_names import is_of_poses, parse_mapping
from geodesic_motion_ros.demonstrations.mapped_tables import read_mapped_tables
from geodesic_motion_ros.demonstrations.readers import read_demonstrations, read_joint_demonstrations, read_pose_takes
from geodesic_motion_ros.utils.errors import DemonstrationError

ROWS = [(0.0, 0.1, 0.2, 0.3, 9.0), (0.1, 0.2, 0.2, 0.3, 9.0), (0.2, 0.3, 0.2, 0.3, 9.0)]
HEADER = ("stamp", "x", "y", "z", "force")
MAPPING = "t=stamp,px=x,py=y,pz=z"


def text(separator: str, header=HEADER, rows=ROWS) -> str:
    lines = [separator.join(map(str, row)) for row in rows]
    return "\n".join([*([separator.join(header)] if header else []), *lines, ""])


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", ", "])
@pytest.mark.parametrize("comment", ["", "# "])
def test_columns_are_mapped_and_others_passed_over(separator, comment, tmp_path) -> None:
    path = tmp_path / "log.txt"
    path.write_text(comment + text(separator))
    (name, table), = read_mapped_tables(path, MAPPING).tables.items()
    assert (name, sorted(table)) == ("log", ["px", "py", "pz", "t"])
    read = np.stack([table[key] for key in ("t", "px", "py", "pz")], axis=1)
    np.testing.assert_array_equal(read, np.array(ROWS)[:, :4])
    np.testing.assert_array_equal(read_pose_takes(path, "m", "x,y,z")[0].values, read[:, 1:])


def test_numbers_without_a_header_are_in_the_order_of_the_mapping(tmp_path) -> None:
    path = tmp_path / "log.txt"
    path.write_text(text(" ", header=None, rows=[row[:4] for row in ROWS]))
    take, = read_pose_takes(path, "m", "t,px,py,pz")
    np.testing.assert_array_equal(take.values, np.array(ROWS)[:, 1:4])
    with pytest.raises(DemonstrationError, match=r"no header, and 4 columns; --columns names 3: px, py, pz"):
        read_pose_takes(path, "m", "px,py,pz")


def test_a_column_may_say_which_demonstration_a_sample_belongs_to(tmp_path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text(",", (*HEADER, "trial"), [(*row, name) for name in ("one", "two") for row in ROWS]))
    shown = read_demonstrations(path, "m", f"demonstration=trial,{MAPPING}")
    assert [item.name for item in shown] == ["one", "two"]


def test_joints_are_mapped_by_their_names(tmp_path) -> None:
    path = tmp_path / "arm.txt"
    path.write_text(text(" ", ("q1", "q0"), [(0.1, 0.2), (0.3, 0.4)]))
    table = read_mapped_tables(path, "shoulder=q0,elbow=q1", ("shoulder", "elbow")).tables["arm"]
    np.testing.assert_array_equal(table["shoulder"], [0.2, 0.4])
    with pytest.raises(DemonstrationError, match="elbow are not mapped; ours are demonstration, elbow, nanosec"):
        read_mapped_tables(path, "shoulder=q0", ("shoulder", "elbow"))
    with pytest.raises(DemonstrationError, match=r"panda_joint1, .* are not mapped; ours are demonstration"):
        read_joint_demonstrations(path, "panda")
    assert not is_of_poses(parse_mapping("t=stamp,panda_joint1=q0"))
    assert is_of_poses(parse_mapping(MAPPING))


@pytest.mark.parametrize("columns", ["", "t=", "=x", "px=x,px=y", "px=x,,py=y"])
def test_what_is_no_mapping_is_refused(columns) -> None:
    with pytest.raises(DemonstrationError, match="give our names and those of the file, each once"):
        parse_mapping(columns)


@pytest.mark.parametrize(
    ("content", "columns", "message"),
    [
        (text(","), "px=a,py=y,pz=z", r"log.csv: column 'a' is not there; there are 'stamp, x, y, z, force'"),
        (text(",", ("x", "x", "y", "z", "t")), "px=x,py=y,pz=z", r"column 'x' is more than once there"),
        (text(","), "speed=x,px=x,py=y", "'speed' is none of ours; ours are demonstration, matrix, nanosec, pitch"),
        (text(","), "px=x,pz=z", r"lacks py"),
        (text(",") + "0.3,0.4\n", MAPPING, r"log.csv, line 5: 2 cells under 5 columns"),
        (text(",") + "0.3,high,0.2,0.3,1\n", MAPPING, r"log.csv, line 5, column px: 'high' is not a number"),
        (text(",", rows=[("", "nan", 0.2, 0.3, 1)]), MAPPING, r"no row has a number in each of t, px, py, pz"),
        ("", MAPPING, "holds no demonstrations"),
        (200_000 * "x", MAPPING, "line 1: longer than"),
    ],
)
def test_what_cannot_be_read_is_refused_by_its_place(content, columns, message, tmp_path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(content)
    with pytest.raises(DemonstrationError, match=message):
        read_pose_takes(path, "m", columns)


def test_what_is_no_text_is_refused(tmp_path) -> None:
    (tmp_path / "log.txt").write_bytes(b"\xff\xfe\x00")
    for name, message in (("log.txt", "not a text file"), ("none.txt", "cannot be read")):
        with pytest.raises(DemonstrationError, match=message):
            read_pose_takes(tmp_path / name, "m", MAPPING)
