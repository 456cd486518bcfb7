"""Files as other programs write them: the same motion out of each, or a refusal that names what is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.mapped_tables import read_mapped_tables
from geodesic_motion_ros.demonstrations.readers import read_joint_takes, read_pose_takes
from geodesic_motion_ros.demonstrations.takes import Action
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.utils.errors import DemonstrationError

JOINTS = ("a", "b")
NO_TIMES = "has no times, as --columns names none"
TIMES = 0.05 * np.arange(40)
ANGLES = np.stack([np.linspace(0.1, 0.9, 40), np.linspace(-0.5, 0.5, 40) ** 2], axis=1)
QUATERNIONS = np.stack([np.cos(TIMES), np.sin(TIMES), 0.0 * TIMES, 0.0 * TIMES], axis=1)
PLACES = np.stack([0.3 + 0.1 * TIMES, 0.2 - 0.05 * TIMES, 0.4 + 0.0 * TIMES], axis=1)


def written(path, header, rows, separator=",", end="") -> None:
    lines = [separator.join(map(str, row)) + end for row in ([header] if header else []) + [*rows]]
    path.write_text("\n".join(lines) + "\n")


def rows_of(*columns) -> list[tuple]:
    return list(zip(*columns, strict=True))


def check_joints(path, columns, times=TIMES, angles=ANGLES) -> list[str]:
    """The joints are those that were written; returns what was found."""
    read = read_mapped_tables(path, columns, JOINTS)
    (table,) = read.tables.values()
    np.testing.assert_allclose(np.stack([table[name] for name in JOINTS], axis=1), angles, atol=1e-9)
    if times is not None:
        np.testing.assert_allclose(table["t"], times, atol=2e-6)
    return [flaw.what for flaw in read.found]


SPREADSHEETS = {
    "semicolons and decimal commas": ("Zeit;q1;q2", ";", lambda x: f"{x:.9f}".replace(".", ",")),
    "semicolons at the end of each line": ("Zeit;q1;q2;", ";", lambda x: f"{x:.9f}"),
    "tabs": ("Zeit\tq1\tq2", "\t", lambda x: f"{x:.9f}"),
    "quoted": ('"Zeit","q1","q2"', ",", lambda x: f'"{x:.9f}"'),
    "exponents": ("Zeit q1 q2", " ", lambda x: f"{x:.12e}"),
    "a name of the separator before it": ("sep=;\nZeit;q1;q2", ";", lambda x: f"{x:.9f}"),
    "a title and remarks before it": ("Arm 3, lab B\n# operator: x\n\nZeit,q1,q2", ",", lambda x: f"{x:.9f}"),
    "units in the header": ("Zeit [s],q1 [rad],q2 (rad)", ",", lambda x: f"{x:.9f}"),
    "units below the header": ("Zeit,q1,q2\n[s],[rad],[rad]", ",", lambda x: f"{x:.9f}"),
}


@pytest.mark.parametrize("kind", SPREADSHEETS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_text_of_spreadsheets(kind, encoding, tmp_path) -> None:
    header, separator, form = SPREADSHEETS[kind]
    end = separator if header.endswith(separator) else ""
    lines = [separator.join(map(form, row)) + end for row in np.column_stack([TIMES, ANGLES])]
    (tmp_path / "log.csv").write_text("\r\n".join([header, *lines]), encoding=encoding)
    assert check_joints(tmp_path / "log.csv", "t=Zeit,a=q1,b=q2") == []


def test_a_header_in_the_encoding_of_windows(tmp_path) -> None:
    lines = [f"{t:.9f};{a:.9f};{b:.9f}" for t, a, b in np.column_stack([TIMES, np.degrees(ANGLES)])]
    (tmp_path / "log.csv").write_text("\n".join(["t;q1 [°];q2 [°]", *lines]), encoding="cp1252")
    assert read_mapped_tables(tmp_path / "log.csv", "t,a=q1,b=q2", JOINTS).unit == "deg"


@pytest.mark.parametrize(
    ("unit", "factor", "first"),
    [
        ("ms", 1e3, 0.0), ("us", 1e6, 0.0), ("ns", 1e9, 0.0),
        ("ms", 1e3, 1.79e9), ("us", 1e6, 1.79e9), ("d", 1 / 86400, 4e9),
    ],
)  # fmt: skip
def test_units_of_times_are_known_by_their_steps(unit, factor, first, tmp_path) -> None:
    stamps = (first + TIMES) * factor
    text = [repr(float(stamp)) if unit == "d" else str(round(stamp)) for stamp in stamps]
    written(tmp_path / "log.csv", ("stamp", "q1", "q2"), rows_of(text, *ANGLES.T))
    assert check_joints(tmp_path / "log.csv", "t=stamp,a=q1,b=q2") == [f"has times in {unit}"]


@pytest.mark.parametrize("header", ["time_ms", "time [ms]", "time (msec)"])
def test_units_of_times_are_known_by_their_name(header, tmp_path) -> None:
    """Also where the steps would say otherwise: at 2 kHz they are half a millisecond."""
    written(tmp_path / "log.csv", (header, "q1", "q2"), rows_of(10.0 * TIMES, *ANGLES.T))
    found = check_joints(tmp_path / "log.csv", f"t={header},a=q1,b=q2", times=0.01 * TIMES)
    assert found == ["has times in ms"]


def test_seconds_are_left_as_they_are_and_late_ones_counted_from_the_first(tmp_path) -> None:
    for first in (0.0, 3.5, 1.79e9):
        written(tmp_path / "log.csv", ("stamp", "q1", "q2"), rows_of(first + TIMES, *ANGLES.T))
        begin = 0.0 if first > 1e6 else first
        assert check_joints(tmp_path / "log.csv", "t=stamp,a=q1,b=q2", times=begin + TIMES) == []


@pytest.mark.parametrize("form", ["2026-11-26 23:59:{:09.6f}", "2026-11-26T23:59:{:09.6f}Z", "12:59:{:09.6f}"])
def test_dates_and_times_of_day(form, tmp_path) -> None:
    written(tmp_path / "log.csv", ("stamp", "q1", "q2"), rows_of([form.format(t) for t in TIMES], *ANGLES.T))
    read = read_mapped_tables(tmp_path / "log.csv", "t=stamp,a=q1,b=q2", JOINTS)
    (table,) = read.tables.values()
    np.testing.assert_allclose(table["t"] - table["t"][0], TIMES, atol=2e-6)


def test_stamps_in_two_columns_without_a_header(tmp_path) -> None:
    """As `ros2 topic echo --csv` writes them: columns that are none of ours are passed over."""
    now = 1_790_000_000_950_000_000 + (1e9 * TIMES).astype(int)
    rows = rows_of(now // 10**9, now % 10**9, ["base"] * 40, *PLACES.T, *QUATERNIONS[:, [1, 2, 3, 0]].T)
    written(tmp_path / "echo.csv", None, rows)
    (take,) = read_pose_takes(tmp_path / "echo.csv", "m", "sec,nanosec,frame,px,py,pz,qx,qy,qz,qw")
    np.testing.assert_allclose(take.times, TIMES, atol=1e-6)
    np.testing.assert_allclose(take.values, np.hstack([PLACES, QUATERNIONS]), atol=1e-12)
    assert take.in_one_go
    with pytest.raises(DemonstrationError, match=r"no header, and 10 columns; --columns names 9"):
        read_pose_takes(tmp_path / "echo.csv", "m", "sec,nanosec,px,py,pz,qx,qy,qz,qw")


def test_columns_of_a_pattern_and_the_index_of_a_table(tmp_path) -> None:
    header = ("", "/joint_states/b/position", "__time", "/joint_states/a/position")
    written(tmp_path / "log.csv", header, rows_of(range(40), ANGLES[:, 1], TIMES, ANGLES[:, 0]))
    assert check_joints(tmp_path / "log.csv", "t=__time,*=/joint_states/*/position") == []


def test_rows_of_other_topics_are_passed_over_and_lost_values_stated(tmp_path) -> None:
    """An export of several topics has a row for each message of any of them."""
    rows = []
    for number, (t, a, b) in enumerate(np.column_stack([TIMES, ANGLES])):
        rows += [(t, a, "nan" if number == 7 else b, ""), (t + 0.01, "", "", 9.0)]
    written(tmp_path / "log.csv", ("t", "q1", "q2", "force"), rows)
    kept = np.arange(40) != 7
    found = check_joints(tmp_path / "log.csv", "t,a=q1,b=q2", TIMES[kept], ANGLES[kept])
    assert found == ["has 1 of 40 rows without a number in each column, first in line 16"]


@pytest.mark.parametrize("called", ["demonstration", "demo_id", "episode_index", "Trial", "take"])
def test_a_column_of_demonstrations_is_found(called, tmp_path) -> None:
    numbers = np.repeat([0, 1], 20)
    written(tmp_path / "log.csv", ("t", "q1", "q2", called, "phase"), rows_of(TIMES, *ANGLES.T, numbers, numbers))
    read = read_mapped_tables(tmp_path / "log.csv", "t,a=q1,b=q2", JOINTS)
    assert (list(read.tables), read.in_one_go) == (["0", "1"], False)
    np.testing.assert_array_equal(read.tables["1"]["a"], ANGLES[20:, 0])


def test_times_that_begin_again_begin_a_demonstration(tmp_path) -> None:
    """The control: one time that falls is a wrong one."""
    times = np.tile(TIMES[:20], 2)
    written(tmp_path / "log.csv", ("t", "q1", "q2"), rows_of(times, *ANGLES.T))
    read = read_mapped_tables(tmp_path / "log.csv", "t,a=q1,b=q2", JOINTS)
    assert (list(read.tables), read.in_one_go) == (["log_0", "log_1"], False)
    assert [flaw.what for flaw in read.found] == ["has times that begin again 1 times"]
    wrong = np.where(np.arange(40) == 9, 0.0, TIMES)
    written(tmp_path / "log.csv", ("t", "q1", "q2"), rows_of(wrong, *ANGLES.T))
    assert read_mapped_tables(tmp_path / "log.csv", "t,a=q1,b=q2", JOINTS).in_one_go


def test_degrees_by_the_header_or_as_it_is_said(tmp_path) -> None:
    from geodesic_motion_ros.robot.kinematics import Robot

    robot = Robot.named("panda")
    angles = robot.ready + np.linspace(0.0, 0.2, 40)[:, None]
    columns = ",".join(f"{name}=q{number}" for number, name in enumerate(robot.joint_names))
    for unit, said in (("", "deg"), (" [deg]", None), (" [deg]", "deg"), ("", None), (" [rad]", "deg")):
        header = [f"q{number}{unit}" for number in range(7)]
        written(tmp_path / "log.csv", header, np.degrees(angles))
        if unit == " [rad]":
            with pytest.raises(DemonstrationError, match="columns are in rad, by their names; --units says deg"):
                read_joint_takes(tmp_path / "log.csv", "panda", columns=columns, units=said)
            continue
        (take,) = read_joint_takes(tmp_path / "log.csv", "panda", columns=columns, units=said)
        np.testing.assert_allclose(take.values, np.degrees(angles) if not (unit or said) else angles, atol=1e-12)


def test_rotation_vectors_are_orientations_without_jumps(tmp_path) -> None:
    """About half a turn a vector and its opposite are nearly the same orientation."""
    turns = np.linspace(np.pi - 0.3, np.pi + 0.3, 40)
    axis = np.array([0.6, 0.8, 0.0])
    vectors = np.where((turns > np.pi)[:, None], (turns - 2.0 * np.pi)[:, None] * axis, turns[:, None] * axis)
    written(tmp_path / "ur.csv", [f"p{number}" for number in range(6)], rows_of(*PLACES.T, *vectors.T), " ")
    (take,) = read_pose_takes(tmp_path / "ur.csv", "m", "px=p0,py=p1,pz=p2,rotvec_x=p3,rotvec_y=p4,rotvec_z=p5")
    expected = np.column_stack([np.cos(turns / 2), np.sin(turns / 2)[:, None] * axis])
    np.testing.assert_allclose(np.abs(np.sum(take.values[:, 3:] * expected, axis=1)), 1.0, atol=1e-12)
    assert np.abs(np.diff(take.values[:, 3:], axis=0)).max() < 0.02
    assert [flaw.what for flaw in take.found] == ["has rotation vectors", NO_TIMES]


@pytest.mark.parametrize("order", ["rows", "columns"])
def test_matrices_in_rows_or_in_columns(order, tmp_path) -> None:
    matrices = np.tile(np.eye(4), (40, 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = to_rotation(QUATERNIONS).as_matrix(), PLACES
    cells = (matrices if order == "rows" else matrices.transpose(0, 2, 1)).reshape(40, 16)
    header = ("time", *(f"O_T_EE[{number}]" for number in range(16)))
    written(tmp_path / "franka.csv", header, rows_of(1e3 * TIMES, *cells.T))
    (take,) = read_pose_takes(tmp_path / "franka.csv", "m", "t=time,matrix=O_T_EE")
    np.testing.assert_allclose(take.values[:, :3], PLACES, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(take.values[:, 3:] * QUATERNIONS, axis=1)), 1.0, atol=1e-9)
    assert [flaw.what for flaw in take.found] == ["has times in ms", "has matrices"]
    matrices[:, :3, 0] *= -1.0
    written(tmp_path / "franka.csv", header, rows_of(1e3 * TIMES, *matrices.reshape(40, 16).T))
    with pytest.raises(DemonstrationError, match="sample 0: its matrix is a left-handed frame"):
        read_pose_takes(tmp_path / "franka.csv", "m", "t=time,matrix=O_T_EE")


def test_positions_alone_are_read_with_a_word_on_orientation(tmp_path) -> None:
    written(tmp_path / "log.csv", ("x", "y", "z"), PLACES)
    (take,) = read_pose_takes(tmp_path / "log.csv", "m", "x,y,z")
    assert [flaw.what for flaw in take.found] == ["has positions alone", NO_TIMES]
    assert {flaw.action for flaw in take.found} == {Action.READ}


@pytest.mark.parametrize(
    ("header", "columns", "message"),
    [
        ("x_mm,y_mm,z_mm", "px=x_mm,py=y_mm,pz=z_mm", "columns are in mm, by their names; --units says m"),
        ("x_mm,y_cm,z_mm", "px=x_mm,py=y_cm,pz=z_mm", "the columns are in cm and in mm: use one unit"),
        ("x,y,z", "px=x,py=y,pz=z,euler_x=x", "'euler_x' is none of ours.*roll,pitch,yaw are read, about fixed axes"),
        ("x,y,z", "px=x,py=y,pz=z,roll=x,pitch=y", "lacks yaw"),
        ("x,y,z", "px=x,py=y,pz=z,qx=x,qy=y,qz=z", "lacks qw.*rotvec_x.* rotation vector.* roll,pitch,yaw"),
        ("x,y,z", "px=x,py=y,pz=z,qw=x,roll=y", "qw,qx,qy,qz and roll,pitch,yaw: name one orientation"),
        ("x,y,z", "px=x,py=y,pz=z,matrix=x", "column 'x' is 1 columns; matrix needs 16"),
        ("x,y,z", "sec=x,px=x,py=y,pz=z", "lacks nanosec"),
        ("x,y,z", "px=x,py=y,pz=height", "column 'height' is not there; there are 'x, y, z'"),
    ],
)
def test_what_contradicts_itself_is_refused(header, columns, message, tmp_path) -> None:
    written(tmp_path / "log.csv", header.split(","), PLACES)
    with pytest.raises(DemonstrationError, match=message):
        read_pose_takes(tmp_path / "log.csv", "m", columns)


@pytest.mark.parametrize(("vector", "kind"), [((90.0, 0.0, 45.0), "degrees, or"), ((3.1, 0.5, 2.0), "roll, pitch")])
def test_angles_that_are_no_rotation_vectors_are_refused(vector, kind, tmp_path) -> None:
    written(tmp_path / "log.csv", ("x", "y", "z", "a", "b", "c"), [(*place, *vector) for place in PLACES])
    with pytest.raises(DemonstrationError, match=f"sample 0: the rotation vector is .* are these {kind}"):
        read_pose_takes(tmp_path / "log.csv", "m", "x,y,z,rotvec_x=a,rotvec_y=b,rotvec_z=c")
    if vector[0] > 7.0:
        with pytest.raises(DemonstrationError, match=r"sample 0: roll is 90, .* as in roll \[deg\]"):
            read_pose_takes(tmp_path / "log.csv", "m", "x,y,z,roll=a,pitch=b,yaw=c")


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_this_order(unit, tmp_path) -> None:
    turns = np.stack([0.3 * TIMES - 1.0, 0.2 * TIMES, 2.0 - 0.5 * TIMES], axis=1)
    header = ("x", "y", "z", *(f"{name} [{unit}]" for name in ("roll", "pitch", "yaw")))
    numbers = np.degrees(turns) if unit == "deg" else turns
    written(tmp_path / "log.csv", header, rows_of(*PLACES.T, *numbers.T))
    (take,) = read_pose_takes(tmp_path / "log.csv", "m", "x,y,z,roll,pitch,yaw")
    for (roll, pitch, yaw), quaternion in zip(turns, take.values[:, 3:], strict=True):
        (c, s), (e, f), (g, h) = ((np.cos(angle), np.sin(angle)) for angle in (roll, pitch, yaw))
        about_x, about_y = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), np.array([[e, 0, f], [0, 1, 0], [-f, 0, e]])
        about_z = np.array([[g, -h, 0], [h, g, 0], [0, 0, 1]])
        expected = about_z @ about_y @ about_x
        np.testing.assert_allclose(to_rotation(quaternion).as_matrix(), expected, atol=1e-9)
    assert [flaw.what for flaw in take.found] == ["has angles of roll, pitch and yaw about fixed axes", NO_TIMES]


@pytest.mark.parametrize("header", [("x", "y", "z", "rx", "ry", "rz"), None])
def test_what_may_be_a_rotation_vector_or_angles_is_refused_until_it_is_said(header, tmp_path) -> None:
    """The two differ by half a radian here, and neither jumps. The control: said, each is read."""
    turns = np.stack([1.0 + 0.1 * TIMES, 0.5 - 0.1 * TIMES, 1.0 - 0.2 * TIMES], axis=1)
    written(tmp_path / "log.csv", header, rows_of(*PLACES.T, *turns.T))
    vector, angles = "rotvec_x=rx,rotvec_y=ry,rotvec_z=rz", "roll=rx,pitch=ry,yaw=rz"
    with pytest.raises(DemonstrationError, match=f"as of UR.? Then say {vector}.* Then say {angles}"):
        read_pose_takes(tmp_path / "log.csv", "m", "x,y,z,rx,ry,rz")
    said = [read_pose_takes(tmp_path / "log.csv", "m", f"x,y,z,{each}")[0].values[:, 3:] for each in (vector, angles)]
    assert np.abs(np.sum(said[0] * said[1], axis=1)).max() < np.cos(0.1)


def test_joints_may_be_called_like_angles(tmp_path) -> None:
    joints = ("roll", "pitch", "yaw")
    angles = np.column_stack([ANGLES, ANGLES[:, 0]])
    written(tmp_path / "log.csv", ("q1 [deg]", "q2 [deg]", "q3 [deg]"), np.degrees(angles))
    read = read_mapped_tables(tmp_path / "log.csv", "roll=q1,pitch=q2,yaw=q3", joints)
    (table,) = read.tables.values()
    np.testing.assert_allclose(np.stack([table[name] for name in joints], axis=1), np.degrees(angles), atol=1e-9)
    assert read.unit == "deg"


def glued(tmp_path, labels, times=None, offset=0.54) -> str:
    """A file of two motions over half a metre, one after the other; the name of its column of labels is unknown."""
    path = tmp_path / "log.csv"
    places = np.vstack([PLACES, PLACES[::-1] + [0.0, offset, 0.0]])
    times = 0.05 * np.arange(80) if times is None else times
    written(path, ("t", "x", "y", "z", "run", "mode"), rows_of(times, *places.T, labels, ["a"] * 80))
    return path


def test_a_column_of_another_name_that_changes_where_the_motion_jumps_is_asked_about(tmp_path) -> None:
    """The controls: said, it names them; without a jump, or changing elsewhere too, it is passed over."""
    halves, columns = np.repeat([7, 8], 40), "t,x,y,z"
    path = glued(tmp_path, halves)
    said = "between line 41 and line 42, where column 'run' changes.* say demonstration=run in --columns"
    with pytest.raises(DemonstrationError, match=said):
        read_pose_takes(path, "m", columns)
    assert [take.name for take in read_pose_takes(path, "m", f"{columns},demonstration=run")] == ["7", "8"]
    for labels, offset in ((halves, 0.0), (np.arange(80) // 20, 0.54), (np.arange(80), 0.54), (np.zeros(80), 0.54)):
        (take,) = read_pose_takes(glued(tmp_path, labels, offset=offset), "m", columns)
        assert take.in_one_go


def test_a_column_that_changes_where_nothing_was_recorded_is_asked_about(tmp_path) -> None:
    times = 0.05 * np.arange(80) + np.repeat([0.0, 1.5], 40)
    path = glued(tmp_path, np.repeat(["a", "b"], 40), times, offset=0.0)
    with pytest.raises(DemonstrationError, match="where column 'run' changes"):
        read_pose_takes(path, "m", "t,x,y,z")


def test_decimal_commas_beside_points_are_refused(tmp_path) -> None:
    (tmp_path / "log.csv").write_text("q1;q2\n0,5;1.234,5\n0,6;0,7\n")
    with pytest.raises(DemonstrationError, match=r"decimal commas, and '1\.234,5': write one kind"):
        read_mapped_tables(tmp_path / "log.csv", "a=q1,b=q2", JOINTS)
