import csv

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.column_names import parse_columns
from geodesic_motion_ros.demonstrations.readers import (
    is_of_joints,
    read_demonstrations,
    read_joint_demonstrations,
    read_joint_takes,
)
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import DemonstrationError, RobotError

HEADER = ["demonstration", "t", "px", "py", "pz", "qw", "qx", "qy", "qz"]


@pytest.fixture
def recording() -> np.ndarray:
    """Three demonstrations (3, 40, 7) in centimetres, quaternions exactly unit."""
    rng = np.random.default_rng(3)
    s = np.linspace(0.0, 1.0, 40)
    angle = 0.6 * s
    turn = np.stack([np.cos(angle), np.sin(angle), 0 * s, 0 * s], axis=1)
    path = np.stack([40 + 5 * np.sin(3 * s), -30 + 60 * s, 20 + 10 * s**2], axis=1)
    return np.stack([np.hstack([path + rng.normal(0.0, 2.0, 3), turn]) for _ in range(3)])


def rows_of(recording: np.ndarray) -> list[list]:
    return [
        [f"d{i}", sample / 50.0, *values]
        for i, sheet in enumerate(recording)
        for sample, values in enumerate(sheet)
    ]


def write_csv(path, header, rows):
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([header, *rows])
    return path


def assert_holds(demonstrations, recording):
    assert len(demonstrations) == len(recording)
    np.testing.assert_allclose(demonstrations.positions_array(), 0.01 * recording[..., :3], atol=1e-12)
    np.testing.assert_allclose(demonstrations.quaternions_array(), recording[..., 3:7], atol=1e-12)
    assert demonstrations.has_orientation


def test_npy(tmp_path, recording):
    np.save(tmp_path / "pour.npy", recording)
    demonstrations = read_demonstrations(tmp_path / "pour.npy", "cm", rate_hz=50.0)
    assert demonstrations.has_times
    assert not read_demonstrations(tmp_path / "pour.npy", "cm").has_times
    assert_holds(demonstrations, recording)
    assert [item.name for item in demonstrations] == ["pour_0", "pour_1", "pour_2"]
    np.testing.assert_allclose(demonstrations[0].times, np.arange(40) / 50.0)


def test_a_single_demonstration_may_leave_out_the_first_axis(tmp_path, recording):
    np.save(tmp_path / "pour.npy", recording[0])
    assert_holds(read_demonstrations(tmp_path / "pour.npy", "cm"), recording[:1])


def test_columns_in_any_order_with_times(tmp_path, recording):
    times = np.broadcast_to(np.linspace(1.0, 2.0, 40)[:, None], (3, 40, 1))
    shuffled = np.concatenate([recording[..., 3:], times, recording[..., [2, 1, 0]]], axis=2)
    np.save(tmp_path / "pour.npy", shuffled)
    demonstrations = read_demonstrations(tmp_path / "pour.npy", "cm", columns="qw,qx,qy,qz, t, pz,py,px")
    assert_holds(demonstrations, recording)
    np.testing.assert_allclose(demonstrations[2].times, times[2, :, 0])
    assert demonstrations.has_times


@pytest.mark.parametrize(("units", "scale"), [("m", 0.01), ("cm", 1.0), ("mm", 10.0)])
def test_units(tmp_path, recording, units, scale):
    recording[..., :3] *= scale
    np.save(tmp_path / "pour.npy", recording)
    demonstrations = read_demonstrations(tmp_path / "pour.npy", units)
    np.testing.assert_allclose(demonstrations.positions_array(), 0.01 / scale * recording[..., :3])


def test_npz_named_arrays(tmp_path, recording):
    times = np.linspace(0.0, 2.0, 40)
    np.savez(tmp_path / "pour.npz", positions=recording[..., :3], quaternions=recording[..., 3:], times=times)
    demonstrations = read_demonstrations(tmp_path / "pour.npz", "cm")
    assert_holds(demonstrations, recording)
    np.testing.assert_allclose(demonstrations[1].times, times)


def test_npz_single_array(tmp_path, recording):
    np.savez_compressed(tmp_path / "pour.npz", recording=recording)
    assert_holds(read_demonstrations(tmp_path / "pour.npz", "cm"), recording)


def test_csv_with_columns_in_another_order(tmp_path, recording):
    order = [8, 0, 3, 2, 4, 1, 5, 6, 7]
    rows = [[row[i] for i in order] for row in rows_of(recording)]
    path = write_csv(tmp_path / "pour.csv", [HEADER[i] for i in order], rows)
    demonstrations = read_demonstrations(path, "cm")
    assert_holds(demonstrations, recording)
    assert [item.name for item in demonstrations] == ["d0", "d1", "d2"]
    np.testing.assert_allclose(demonstrations[0].times, np.arange(40) / 50.0)


def test_csv_demonstrations_may_differ_in_length(tmp_path, recording):
    path = write_csv(tmp_path / "pour.csv", HEADER, rows_of(recording)[:-15])
    assert [len(item) for item in read_demonstrations(path, "cm")] == [40, 40, 25]


@pytest.mark.parametrize("columns", ["px,py", "px,py,pz"])
def test_positions_alone(tmp_path, recording, columns):
    count = len(columns.split(","))
    np.save(tmp_path / "letter.npy", recording[..., :count])
    demonstrations = read_demonstrations(tmp_path / "letter.npy", "cm", columns=columns)
    assert not demonstrations.has_orientation
    np.testing.assert_allclose(demonstrations.positions_array()[..., :count], 0.01 * recording[..., :count])
    assert count == 3 or np.all(demonstrations.positions_array()[..., 2] == 0.0)
    np.testing.assert_array_equal(demonstrations.quaternions_array()[..., 0], 1.0)


def test_npz_positions_alone(tmp_path, recording):
    np.savez(tmp_path / "letter.npz", positions=recording[..., :2])
    assert not read_demonstrations(tmp_path / "letter.npz", "cm").has_orientation


def spoil(recording, place, value):
    spoiled = recording.copy()
    spoiled[place] = value
    return spoiled


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda a: spoil(a, (1, 17, 4), np.nan),
            r"pour.npy: demonstration 'pour_1', sample 17, column qx: nan",
        ),
        (lambda a: spoil(a, (2, 3, 0), np.inf), r"demonstration 'pour_2', sample 3, column px: inf"),
        (
            lambda a: spoil(a, (0, 5, slice(3, 7)), 0.0),
            r"'pour_0', sample 5, columns qw,qx,qy,qz: .* is zero",
        ),
        (lambda a: a[:, :1], r"'pour_0' has 1 sample\(s\); a motion needs at least 2"),
        (lambda a: a[..., :6], r"6 columns, but 7 were announced: px,py,pz,qw,qx,qy,qz"),
        (lambda a: a[:0], r"holds no demonstrations"),
        (lambda a: a[0, 0], r"shape \(7,\); needed is \(demonstrations, samples, columns\)"),
        (
            lambda a: spoil(a, (1, 4, 1), 4500.0),
            r"'pour_1', sample 4: read in cm, the tool is .* m from the base",
        ),
        (lambda a: a.astype(complex), r"dtype complex128; real numbers are needed"),
        (lambda a: a.astype(str), r"real numbers are needed"),
        (lambda a: a[..., [3, 4, 5, 6, 0, 1, 2]], r"has length .*right order"),
    ],
)
def test_bad_arrays_are_refused_by_name_and_place(tmp_path, recording, change, message):
    np.save(tmp_path / "pour.npy", change(recording))
    with pytest.raises(DemonstrationError, match=message):
        read_demonstrations(tmp_path / "pour.npy", "cm")


def test_wrong_units_are_recognised(tmp_path, recording):
    np.save(tmp_path / "pour.npy", recording)
    with pytest.raises(
        DemonstrationError, match=r"read in m, .*no arm reaches 3 m; did you mean --units cm\?"
    ):
        read_demonstrations(tmp_path / "pour.npy", "m")
    recording[..., :3] *= 0.01
    np.save(tmp_path / "pour.npy", recording)
    for units in ("cm", "mm"):
        with pytest.raises(DemonstrationError, match=r"moves more than .* mm; did you mean --units m\?"):
            read_demonstrations(tmp_path / "pour.npy", units)
    with pytest.raises(DemonstrationError, match="unknown units 'inch'; use one of m, cm, mm"):
        read_demonstrations(tmp_path / "pour.npy", "inch")


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("px,py,pz,qw,qx,qy,roll", "unknown column 'roll'"),
        ("px,py,pz,qw,qx,qy", "lacks qz"),
        ("px,py,qw,qx,qy,qz", "lacks pz"),
        ("px,px,py", "column px stands more than once"),
        ("px", "lacks py"),
        ("", "unknown column ''"),
    ],
)
def test_bad_column_names_are_refused(columns, message):
    with pytest.raises(DemonstrationError, match=message):
        parse_columns(columns)


@pytest.mark.parametrize("rate", [0.0, -5.0, np.nan, np.inf])
def test_bad_rates_are_refused(tmp_path, rate):
    with pytest.raises(DemonstrationError, match="positive number of samples a second"):
        read_demonstrations(tmp_path / "any.npy", "m", rate_hz=rate)


def test_columns_on_another_axis_are_recognised(tmp_path, recording):
    for axes, place in (((0, 2, 1), 1), ((2, 1, 0), 0)):
        np.save(tmp_path / "turned.npy", recording.transpose(axes))
        with pytest.raises(DemonstrationError, match=f"columns are the last axis: are they axis {place} of"):
            read_demonstrations(tmp_path / "turned.npy", "cm")


def test_pickles_are_refused(tmp_path, recording):
    np.save(tmp_path / "pour.npy", np.array(list(recording) + [None], dtype=object), allow_pickle=True)
    with pytest.raises(DemonstrationError, match="pickled objects are refused"):
        read_demonstrations(tmp_path / "pour.npy", "cm")
    np.savez(tmp_path / "pour.npz", positions=np.array([None, "x"], dtype=object))
    with pytest.raises(DemonstrationError, match="pickled objects are refused"):
        read_demonstrations(tmp_path / "pour.npz", "cm")


def test_missing_foreign_and_damaged_files_are_refused(tmp_path, recording):
    with pytest.raises(DemonstrationError, match=r"missing.npy: cannot be read \(No such file"):
        read_demonstrations(tmp_path / "missing.npy", "cm")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(DemonstrationError, match=r"folder.csv: is a directory without .csv files"):
        read_demonstrations(tmp_path / "folder.csv", "cm")
    with pytest.raises(DemonstrationError, match=r"cannot read '.bag' files, only .npy, .npz, .csv"):
        read_demonstrations(tmp_path / "pour.bag", "cm")
    np.savez(tmp_path / "pour.npz", recording)
    whole = (tmp_path / "pour.npz").read_bytes()
    (tmp_path / "short.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DemonstrationError, match=r"short\.npz"):
        read_demonstrations(tmp_path / "short.npz", "cm")
    for name in ("empty.npy", "empty.npz", "empty.csv"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(DemonstrationError, match=name):
            read_demonstrations(tmp_path / name, "cm")
    (tmp_path / "text.npy").write_text("px,py,pz\n1,2,3\n")
    with pytest.raises(DemonstrationError, match=r"not a \.npy file"):
        read_demonstrations(tmp_path / "text.npy", "cm")
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)))
    with pytest.raises(DemonstrationError, match="not a csv text file"):
        read_demonstrations(tmp_path / "binary.csv", "cm")
    (tmp_path / "zip.npy").write_bytes(whole)
    with pytest.raises(DemonstrationError, match=r"zip.npy: not a \.npy file"):
        read_demonstrations(tmp_path / "zip.npy", "cm")


def test_foreign_npz_contents_are_refused(tmp_path, recording):
    positions = recording[..., :3]
    cases = {
        "needs keys positions": {"a": positions, "b": positions},
        "unknown key 'forces'": {"positions": positions, "forces": positions},
        r"quaternions have shape \(3, 40, 3\); beside the positions: \(3, 40, 4\)": {
            "positions": positions,
            "quaternions": positions,
        },
        r"times have shape \(7,\)": {"positions": positions, "times": np.arange(7.0)},
        r"positions have shape \(40, 3\), not": {"positions": positions[0]},
    }
    for message, content in cases.items():
        np.savez(tmp_path / "odd.npz", **content)
        with pytest.raises(DemonstrationError, match=message):
            read_demonstrations(tmp_path / "odd.npz", "cm")


def edit(row, column, value):
    def change(header, rows):
        rows[row][HEADER.index(column)] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edit(45, "qy", "north"), r"pour.csv, line 47, column qy: 'north' is not a number"),
        (edit(45, "qy", ""), r"line 47, column qy: '' is not a number"),
        (edit(45, "px", "nan"), r"demonstration 'd1', sample 5, column px: nan"),
        (edit(81, "t", 0.0), r"demonstration 'd2', sample 1, column t: 0 s does not come after 0 s"),
        (lambda header, rows: rows[3].pop(), r"line 5: 8 cells under 9 columns"),
        (lambda header, rows: rows.clear(), r"holds no demonstrations"),
        (lambda header, rows: header.__setitem__(8, "yaw"), r"unknown column 'yaw' in the header"),
        (lambda header, rows: header.__setitem__(8, "qy"), r"the header lacks qz"),
    ],
)
def test_bad_csv_is_refused_by_place(tmp_path, recording, change, message):
    header, rows = list(HEADER), rows_of(recording)
    change(header, rows)
    with pytest.raises(DemonstrationError, match=message):
        read_demonstrations(write_csv(tmp_path / "pour.csv", header, rows), "cm")


def test_csv_header_problems_are_named(tmp_path, recording):
    rows = [row[1:] for row in rows_of(recording)]
    with pytest.raises(DemonstrationError, match="the header lacks demonstration"):
        read_demonstrations(write_csv(tmp_path / "a.csv", HEADER[1:], rows), "cm")
    rows = [[*row, 0.0] for row in rows_of(recording)]
    with pytest.raises(DemonstrationError, match="column px stands more than once"):
        read_demonstrations(write_csv(tmp_path / "b.csv", [*HEADER, "px"], rows), "cm")


def test_real_recordings(recordings):
    pouring = read_demonstrations(recordings / "robotasks" / "pouring.npy", "cm")
    assert len(pouring) == 9
    assert pouring.positions_array().shape == (9, 1000, 3)
    turned = pouring.quaternions_array()
    assert np.all(np.sum(turned[:, 1:] * turned[:, :-1], axis=2) > 0.0)
    with pytest.raises(DemonstrationError, match=r"did you mean --units cm\?"):
        read_demonstrations(recordings / "robotasks" / "pouring.npy", "m")


def test_real_letters(recordings):
    letters = read_demonstrations(recordings / "hello_world" / "h.npy", "cm", columns="px,py")
    assert len(letters) == 8
    assert not letters.has_orientation


PANDA = Robot.named("panda")


def joint_arrays(**changes) -> dict[str, np.ndarray]:
    """Two demonstrations of 20 samples as a `.npz` file has them."""
    s = np.linspace(0.0, 0.4, 20)[None, :, None]
    arrays = {
        "configurations": PANDA.ready + s * np.array([1.0, -1.0])[:, None, None],
        "joint_names": np.array(PANDA.joint_names),
    }
    return arrays | changes


def test_joints_in_an_npz(tmp_path):
    np.savez(tmp_path / "reach.npz", **joint_arrays())
    shown = read_joint_demonstrations(tmp_path / "reach.npz", "panda", rate_hz=50.0)
    assert shown.has_times
    assert not read_joint_demonstrations(tmp_path / "reach.npz", "panda").has_times
    assert [item.name for item in shown] == ["reach_0", "reach_1"]
    np.testing.assert_array_equal(shown.configurations_array(), joint_arrays()["configurations"])
    np.testing.assert_allclose(shown[0].times, np.arange(20) / 50.0)
    more = {"names": np.array(["left", "right"]), "robot": np.array("panda"), "times": np.linspace(1.0, 2.0, 20)}
    np.savez(tmp_path / "reach.npz", **joint_arrays(), **more)
    shown = read_joint_demonstrations(tmp_path / "reach.npz", "panda")
    assert [item.name for item in shown] == ["left", "right"]
    np.testing.assert_array_equal(shown[1].times, more["times"])


def test_joints_in_any_order(tmp_path):
    order = [3, 0, 6, 1, 2, 5, 4]
    arrays = joint_arrays()
    shuffled = {"configurations": arrays["configurations"][..., order], "joint_names": arrays["joint_names"][order]}
    np.savez(tmp_path / "reach.npz", **shuffled)
    shown = read_joint_demonstrations(tmp_path / "reach.npz", "panda")
    np.testing.assert_array_equal(shown.configurations_array(), arrays["configurations"])
    names = [PANDA.joint_names[joint] for joint in order]
    rows = [
        [f"d{number}", *values[order], sample / 25.0]
        for number, sheet in enumerate(arrays["configurations"])
        for sample, values in enumerate(sheet)
    ]
    write_csv(tmp_path / "reach.csv", ["demonstration", *names, "t"], rows)
    shown = read_joint_demonstrations(tmp_path / "reach.csv", "panda")
    np.testing.assert_array_equal(shown.configurations_array(), arrays["configurations"])
    np.testing.assert_allclose(shown[1].times, np.arange(20) / 25.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robot": np.array("iiwa")}, "recorded with the robot 'iiwa', not with 'panda'"),
        ({"joint_names": np.array([f"lbr_{n}" for n in range(7)])}, r"are 'lbr_0, .*; expected are those of 'panda'"),
        (
            {"configurations": np.zeros((2, 20, 6)), "joint_names": np.array(PANDA.joint_names[:6])},
            r"its joints are 'panda_joint1, .*panda_joint6'; expected are those of 'panda'",
        ),
        ({"configurations": np.zeros((2, 20, 6))}, r"shape \(2, 20, 6\), not \(N, T, 7\)"),
        ({"configurations": np.zeros((2, 20, 7), dtype=complex)}, "real numbers are needed"),
        (
            {"configurations": np.degrees(joint_arrays()["configurations"])},
            r"'reach_0', sample 0: joint 'panda_joint2' is at -45\.0000 rad",
        ),
        (
            {"configurations": np.full((2, 20, 7), np.nan)},
            "'reach_0', sample 0, column panda_joint1: nan is not a finite number",
        ),
        ({"names": np.array(["same", "same"])}, "1 different names for 2 demonstrations"),
        ({"times": np.zeros((2, 19))}, r"times have shape \(2, 19\)"),
        ({"speeds": np.zeros(2)}, "unknown key 'speeds'; a recording of joints has"),
    ],
)
def test_recordings_of_another_arm_and_bad_joints_are_refused_by_name(tmp_path, changes, message):
    np.savez(tmp_path / "reach.npz", **joint_arrays(**changes))
    with pytest.raises(DemonstrationError, match=f"reach.npz.*{message}"):
        read_joint_demonstrations(tmp_path / "reach.npz", "panda")


def test_what_no_joints_can_be_read_from_is_refused(tmp_path):
    np.savez(tmp_path / "reach.npz", positions=np.zeros((2, 20, 3)))
    with pytest.raises(DemonstrationError, match="lacks configurations"):
        read_joint_demonstrations(tmp_path / "reach.npz", "panda")
    with pytest.raises(DemonstrationError, match=r"cannot read '\.npy' files, only \.npz, \.csv"):
        read_joint_demonstrations(tmp_path / "reach.npy", "panda")
    with pytest.raises(DemonstrationError, match=r"none\.csv: cannot be read"):
        read_joint_demonstrations(tmp_path / "none.csv", "panda")
    with pytest.raises(RobotError, match="robot 'robby' is not known here"):
        read_joint_demonstrations(tmp_path / "reach.npz", "robby")
    header = ["demonstration", "t", *PANDA.joint_names[:-1], "gripper"]
    write_csv(tmp_path / "reach.csv", header, [["d0", 0.0, *PANDA.ready]])
    with pytest.raises(DemonstrationError, match="unknown column 'gripper'"):
        read_joint_demonstrations(tmp_path / "reach.csv", "panda")


def test_a_recording_of_joints_is_known_from_one_of_poses(tmp_path):
    joints, poses = tmp_path / "joints.npz", tmp_path / "poses.npz"
    np.savez(joints, configurations=np.zeros((1, 5, 7)), joint_names=np.array(["a"] * 7))
    np.savez(poses, positions=np.zeros((1, 5, 3)))
    rows, places = tmp_path / "joints.csv", tmp_path / "poses.csv"
    rows.write_text("demonstration,t,panda_joint1\nfirst,0.0,0.1\n")
    places.write_text("demonstration,px,py,pz\nfirst,0.0,0.1,0.2\n")
    assert [is_of_joints(path) for path in (joints, rows, poses, places)] == [True, True, False, False]


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"\xff\xfe\x00"])
@pytest.mark.parametrize("suffix", ["npz", "csv", "npy"])
def test_what_cannot_be_read_is_no_recording_of_joints(content, suffix, tmp_path):
    (tmp_path / f"broken.{suffix}").write_bytes(content)
    assert not is_of_joints(tmp_path / f"broken.{suffix}")
    assert not is_of_joints(tmp_path / f"missing.{suffix}")


class TestFolders:
    """A folder of csv files is one recording."""

    def test_its_files_are_read_by_name(self, tmp_path, recording):
        rows = rows_of(recording)
        for i in (2, 0, 1):
            write_csv(tmp_path / f"part_{i}.csv", HEADER, [row for row in rows if row[0] == f"d{i}"])
        (tmp_path / "notes.txt").write_text("nothing to read")
        (tmp_path / "part_3.csv.part").write_text("half of a")
        demonstrations = read_demonstrations(tmp_path, "cm")
        assert_holds(demonstrations, recording)
        assert [item.name for item in demonstrations] == ["d0", "d1", "d2"]
        assert not is_of_joints(tmp_path)

    def test_its_joints_are_found(self, tmp_path):
        robot = Robot.named("panda")
        rows = [["d", 0.1 * number, *robot.ready] for number in range(3)]
        write_csv(tmp_path / "d.csv", ["demonstration", "t", *robot.joint_names], rows)
        assert is_of_joints(tmp_path)
        assert len(read_joint_demonstrations(tmp_path, "panda")) == 1

    def test_a_demonstration_in_two_files_is_named_by_the_second(self, tmp_path, recording):
        for name in ("one.csv", "two.csv"):
            write_csv(tmp_path / name, HEADER, rows_of(recording[:1]))
        with pytest.raises(DemonstrationError, match=r"two\.csv: another file of the folder has a demonstration 'd0'"):
            read_demonstrations(tmp_path, "cm")

    def test_a_folder_without_any_is_refused(self, tmp_path):
        with pytest.raises(DemonstrationError, match=r"is a directory without \.csv files"):
            read_demonstrations(tmp_path, "cm")


def test_radians_that_are_said_to_be_degrees_are_refused(tmp_path):
    robot = Robot.named("panda")
    path = robot.ready + np.linspace(0.0, 0.4, 50)[:, None] * np.eye(7)[0]
    for unit, rows in (("rad", path), ("deg", np.degrees(path))):
        write_csv(tmp_path / f"{unit}.csv", ["demonstration", *robot.joint_names], [["one", *row] for row in rows])
    with pytest.raises(DemonstrationError, match=r"no joint comes farther than 2\.\d+ deg from 0: are these radians\?"):
        read_joint_takes(tmp_path / "rad.csv", "panda", units="deg")
    # the control
    (said,) = read_joint_takes(tmp_path / "deg.csv", "panda", units="deg")
    (unsaid,) = read_joint_takes(tmp_path / "rad.csv", "panda")
    np.testing.assert_allclose(said.values, unsaid.values, atol=1e-12)
