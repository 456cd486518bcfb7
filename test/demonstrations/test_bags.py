"""Bags of every kind: the same samples as were written, by name, in the clock that is set; what cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.bags import Source, choose_source, is_bag, read_take, read_topics
from geodesic_motion_ros.geometry.quaternions import multiply, rotate, rotate_by
from geodesic_motion_ros.utils.errors import DemonstrationError

NAMES = ("left", "right", "wrist")
KINDS = ("sqlite3", "storage.mcap", "old.bag")
TIMES = 1_700_000_000.0 + 0.01 * np.arange(60)
VALUES = np.stack([np.linspace(0.0, 1.0, 60), np.linspace(1.0, -1.0, 60), np.sin(np.arange(60) / 9.0)], axis=1)
TURN = rotate_by(np.array([[0.1, 0.2, 0.3]]), np.array([[1.0, 0.0, 0.0, 0.0]]))[0]


def joint_messages(received=TIMES, stamps=TIMES, values=VALUES, names=NAMES) -> list:
    return [
        (when, stamp, dict(zip(names, row, strict=True)))
        for when, stamp, row in zip(received, stamps, values, strict=True)
    ]


def joints_of(path: Path, **more):
    return read_take(path, choose_source(path, None)[0], NAMES, **more)


@pytest.mark.parametrize("kind", KINDS)
def test_joints_are_read_by_name_whatever_their_order_and_what_is_beside_them(kind, bag, tmp_path) -> None:
    messages = []
    random = np.random.default_rng(0)
    for number, (when, stamp, row) in enumerate(joint_messages()):
        mixed = [*row.items(), ("finger", 0.04)]
        random.shuffle(mixed)
        messages.append((when, stamp, dict(mixed)))
        if number % 7 == 0:  # the gripper publishes on the same topic
            messages.append((when + 0.001, stamp + 0.001, {"finger": 0.02}))
    path = bag.write(tmp_path / kind, {"/joint_states": messages, "/mark": [(TIMES[0], 0.0, None)]})
    assert is_bag(path)
    read = joints_of(path)
    np.testing.assert_array_equal(read.take.values, VALUES)
    np.testing.assert_allclose(read.take.times, TIMES - TIMES[0], atol=1e-6)
    assert read.take.names == NAMES
    assert read.flaws == ()
    assert [(topic.name, topic.count) for topic in read_topics(path)] == [("/joint_states", 69), ("/mark", 1)]


@pytest.mark.parametrize("kind", KINDS)
def test_poses_are_read_scalar_first_and_continuous(kind, bag, tmp_path) -> None:
    poses = [np.append([0.4, 0.01 * number, 0.3], TURN * (-1) ** number) for number in range(60)]
    messages = [(time, time, ("base", pose)) for time, pose in zip(TIMES, poses, strict=True)]
    path = bag.write(tmp_path / kind, {"/pose": messages})
    take = read_take(path, choose_source(path, None)[0]).take
    np.testing.assert_allclose(take.values[:, :3], np.array(poses)[:, :3], atol=1e-12)
    np.testing.assert_allclose(take.values[:, 3:], np.tile(TURN, (60, 1)), atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_transforms_are_composed_through_the_frames_between(kind, bag, tmp_path) -> None:
    moving = [np.append([0.0, 0.0, 0.01 * number], TURN) for number in range(60)]
    messages = [(time, time, [("base", "link", pose), ("base", "other", pose)])
                for time, pose in zip(TIMES, moving, strict=True)]
    static = [(TIMES[0], TIMES[0], [("link", "tool", np.append([0.0, 0.0, 0.1], TURN))])]
    path = bag.write(tmp_path / kind, {"/tf": messages, "/tf_static": static})
    take = read_take(path, choose_source(path, "/tf:base:tool")[0]).take
    reached = np.array([pose[:3] + rotate(TURN, np.array([0.0, 0.0, 0.1])) for pose in moving])
    np.testing.assert_allclose(take.values[:, :3], reached, atol=1e-9)
    np.testing.assert_allclose(np.abs(take.values[:, 3:] @ multiply(TURN, TURN)), 1.0, atol=1e-9)
    with pytest.raises(DemonstrationError, match=r"no transforms lead from 'base' to 'hand'.*base.*link.*other.*tool"):
        read_take(path, Source.parse("/tf:base:hand"))


def test_static_transforms_of_the_topics_own_namespace_count_before_the_others(bag, tmp_path) -> None:
    """Latched ones are recorded again for each node that joins: once more changes nothing."""
    moving = [(time, time, [("base", "flange", np.append([0.0, 0.0, 0.01 * number], TURN))])
              for number, time in enumerate(TIMES)]
    for height, topic in ((0.1, "/left/tf_static"), (0.1, "/tf_static"), (0.0, "/right/tf_static")):
        static = [(TIMES[place], TIMES[place], [("flange", "tool", np.append([0.0, 0.0, height], TURN))])
                  for place in (0, 30)]
        wrong = [(TIMES[0], TIMES[0], [("flange", "tool", np.append([0.0, 0.0, 9.0], TURN))])]
        beside = {"/tf_static": wrong} if topic == "/left/tf_static" else {}
        path = bag.write(tmp_path / topic.replace("/", "_"), {"/left/tf": moving, topic: static, **beside})
        source = Source.parse("/left/tf:base:tool")
        if height == 0.0:
            with pytest.raises(DemonstrationError, match="none has the child 'tool'"):
                read_take(path, source)
            continue
        take = read_take(path, source).take
        reached = np.array([poses[0][2][:3] for _, _, poses in moving]) + rotate(TURN, np.array([0.0, 0.0, height]))
        np.testing.assert_allclose(take.values[:, :3], reached, atol=1e-9)


def test_a_frame_with_two_parents_is_refused(bag, tmp_path) -> None:
    pose = np.append([0.1, 0.0, 0.0], TURN)
    rows = [(time, time, [("left" if number % 2 else "right", "tool", pose), ("base", "left", pose)])
            for number, time in enumerate(TIMES)]
    with pytest.raises(DemonstrationError, match="frame 'tool' is placed in 'right and in left'"):
        read_take(bag.write(tmp_path / "parents", {"/tf": rows}), Source.parse("/tf:base:tool"))


@pytest.mark.parametrize(
    ("unusable", "found"),
    [
        ((20, 21, "nan"), "has 1 of 60 messages without a finite position of each of the joints, at 0.20 s"),
        ((0, 3, "nan"), "has 3 of 60 messages without a finite position of each of the joints, at -0.03 s"),
        ((20, 60, "cut"), "has 40 of 60 messages without a finite position of each of the joints, at 0.20 s"),
        ((20, 60, "renamed"), None),
    ],
)
def test_messages_that_do_not_count_are_stated_and_the_others_are_read(unusable, found, bag, tmp_path) -> None:
    first, last, how = unusable
    rows = joint_messages()
    for number in range(first, last):
        when, stamp, row = rows[number]
        altered = {
            "nan": row | {"right": float("nan")}, "cut": {"left": row["left"]},
            "renamed": {f"new_{name}": value for name, value in row.items()},
        }  # fmt: skip
        rows[number] = (when, stamp, altered[how])
    read = joints_of(bag.write(tmp_path / how, {"/joint_states": rows}))
    np.testing.assert_array_equal(read.take.values, np.delete(VALUES, np.arange(first, last), axis=0))
    # 0.4 s of others alone are those of a gripper that publishes between
    assert [str(flaw).removeprefix(f"'{how}' ").partition(";")[0] for flaw in read.flaws] == ([found] if found else [])


def in_parts(late: float, stamped_apart: float = 0.0) -> list:
    """The joints in two messages, the second `late` [s] and of a clock `stamped_apart` [s]; between them a finger's."""
    messages = []
    for when, stamp, row in joint_messages():
        wrist = {"wrist": float(np.interp(when + late, TIMES, VALUES[:, 2]))}
        messages += [(when, stamp, {"right": row["right"], "left": row["left"]}), (when, stamp, {"finger": 0.04})]
        messages.append((when + late, stamp + late + stamped_apart, wrist))
    return messages


@pytest.mark.parametrize("stamped_apart", [0.0, 60.0])
def test_joints_in_several_messages_are_merged_by_joint_and_time(stamped_apart, bag, tmp_path) -> None:
    """Each joint lies on the straight line between its own samples, whatever the others do."""
    read = joints_of(bag.write(tmp_path / "parts", {"/joint_states": in_parts(0.004, stamped_apart)}))
    np.testing.assert_allclose(read.take.times, TIMES[1:] - TIMES[0], atol=1e-6)
    np.testing.assert_array_equal(read.take.values[:, :2], VALUES[1:, :2])
    sent = TIMES - TIMES[0] + 0.004
    np.testing.assert_allclose(
        read.take.values[:, 2], np.interp(read.take.times, sent, np.interp(sent, TIMES - TIMES[0], VALUES[:, 2])),
        atol=1e-6,
    )  # fmt: skip
    clocks = ["has headers whose clocks differ by 60.00 s"] if stamped_apart else []
    assert [flaw.what for flaw in read.flaws] == [*clocks, "has its joints in several messages: 'left, right | wrist'"]


def test_nothing_is_made_up_where_one_of_several_messages_is_lost(bag, tmp_path) -> None:
    messages = [message for message in in_parts(0.004) if "wrist" not in message[2] or not 0.2 < message[0] % 100 < 0.4]
    read = joints_of(bag.write(tmp_path / "lost", {"/joint_states": messages}))
    step = int(np.argmax(np.diff(read.take.times)))
    assert read.take.times[step : step + 2] == pytest.approx([0.194, 0.404], abs=1e-6)


def test_joints_that_never_come_at_one_time_are_refused(bag, tmp_path) -> None:
    rows = [*joint_messages(values=VALUES[:, :2], names=NAMES[:2]),
            *joint_messages(TIMES + 9.0, TIMES + 9.0, VALUES[:, 2:], NAMES[2:])]
    with pytest.raises(DemonstrationError, match=r"several messages: 'left, right | wrist'; they never come at one"):
        joints_of(bag.write(tmp_path / "apart", {"/joint_states": rows}))


def test_a_clock_that_begins_again_goes_on_by_the_recorders(bag, tmp_path) -> None:
    """As of a simulation that is reset. The control: messages that come late, in another order, are no such thing."""
    stamps = np.concatenate([2.0 + 0.1 * np.arange(30)] * 2)
    received = 1e9 + 0.1 * np.arange(60) + np.where(np.arange(60) < 30, 0.0, 1.5)
    read = joints_of(bag.write(tmp_path / "reset", {"/joint_states": joint_messages(received, stamps)}))
    np.testing.assert_allclose(read.take.times, received - received[0], atol=1e-6)
    (flaw,) = read.flaws
    assert (flaw.what, flaw.time) == ("has stamps that begin again, at 2.00 s", pytest.approx(4.5, abs=1e-6))
    assert read.breaks == pytest.approx([4.5], abs=1e-6)
    late = TIMES.copy()
    late[20] -= 50.0
    assert joints_of(bag.write(tmp_path / "late", {"/joint_states": joint_messages(stamps=late)})).breaks == ()


@pytest.mark.parametrize("part", ["beginning", "middle", "end"])
def test_joints_that_change_their_names_midway_are_stated(part, bag, tmp_path) -> None:
    """The control: a gripper's messages among those of the arm are none of that."""
    times, lost = 0.1 * np.arange(60), {"beginning": (0, 20), "middle": (20, 40), "end": (40, 60)}[part]
    rows = joint_messages(times + 1e9, times + 1e9)
    gripper = [(when + 0.05, stamp + 0.05, {"finger": 0.04}) for when, stamp, _ in rows]
    assert joints_of(bag.write(tmp_path / "control", {"/joint_states": sorted(rows + gripper)})).flaws == ()
    for number in range(*lost):
        when, stamp, row = rows[number]
        rows[number] = (when, stamp, {f"new_{name}": value for name, value in row.items()})
    (flaw,) = joints_of(bag.write(tmp_path / part, {"/joint_states": rows})).flaws
    lasting = "2.10" if part == "middle" else "2.00"
    assert flaw.what == f"has for {lasting} s only messages of other joints: 'new_left, new_right, new_wrist'"


def test_a_message_that_is_damaged_is_named_with_its_time(bag, tmp_path) -> None:
    path = bag.write(tmp_path / "damaged.bag", {"/joint_states": joint_messages()})
    content = path.read_bytes()
    # the length of the list of names, in the message that has this number
    stamp = (1_700_000_000).to_bytes(4, "little") + round(0.3e9).to_bytes(4, "little")
    at = content.rindex(stamp, 0, content.rindex(b"left")) + len(stamp) + 4
    path.write_bytes(content[:at] + b"\xff\xff\xff\x7f" + content[at + 4 :])
    with pytest.raises(DemonstrationError, match=r"a message on /joint_states, 0\.30 s after the bag begins, is damag"):
        joints_of(path)


def test_poses_of_several_frames_are_refused_with_the_time_of_the_change(bag, tmp_path) -> None:
    pose = np.append([0.4, 0.0, 0.3], TURN)
    rows = [(time, time, ("base" if time < TIMES[30] else "camera", pose)) for time in TIMES]
    path = bag.write(tmp_path / "moved", {"/pose": rows})
    with pytest.raises(DemonstrationError, match=r"the poses are in 'base', and from 0\.30 s on in 'camera'"):
        read_take(path, Source("/pose"))
    assert read_take(bag.write(tmp_path / "still", {"/pose": rows[:30]}), Source("/pose")).frame == "base"


def test_without_stamps_the_times_of_the_recorder_are_used_and_it_is_stated(bag, tmp_path) -> None:
    read = joints_of(bag.write(tmp_path / "zeros", {"/joint_states": joint_messages(stamps=0.0 * TIMES)}))
    np.testing.assert_allclose(read.take.times, TIMES - TIMES[0], atol=1e-6)
    assert [flaw.what for flaw in read.flaws] == ["has headers without stamps"]


def test_stamps_count_before_the_times_at_which_messages_came(bag, tmp_path) -> None:
    late = TIMES + 5.0 + np.random.default_rng(1).uniform(0.0, 0.2, len(TIMES))
    order = np.argsort(late)
    path = bag.write(tmp_path / "late", {"/joint_states": [joint_messages(received=late)[index] for index in order]})
    np.testing.assert_allclose(np.sort(joints_of(path).take.times), np.sort(TIMES - TIMES[order[0]]), atol=1e-6)


def test_marks_have_times_of_the_clock_of_the_samples(bag, tmp_path) -> None:
    marks = [(TIMES[10] + 100.0, 0.0, "reach"), (TIMES[40] + 100.0, 0.0, "")]
    messages = {"/joint_states": joint_messages(received=TIMES + 100.0), "/mark": marks}
    read = joints_of(bag.write(tmp_path / "marked", messages), marker="/mark")
    assert [value for _, value in read.markers] == ["reach", ""]
    np.testing.assert_allclose([time for time, _ in read.markers], [0.1, 0.4], atol=1e-6)


def test_what_is_missing_is_named_beside_what_is_there(bag, tmp_path) -> None:
    several = {"/joint_states": joint_messages(), "/other": joint_messages(), "/mark": [(TIMES[0], 0.0, True)]}
    path = bag.write(tmp_path / "several", several)
    listed = r"/joint_states \(sensor_msgs/JointState, 60\), /mark \(std_msgs/Bool, 1\), /other"
    for requested, message in (
        (None, rf"several topics of joint states or poses; say which with --topic.*{listed}"),
        ("/joints", rf"has no topic /joints\. The bag has {listed}"),
        ("/mark", r"/mark has messages of type std_msgs/msg/Bool; needed is sensor_msgs/JointState or geometry_msgs"),
        ("/joint_states:base:tool", r"needed is tf2_msgs/TFMessage"),
        ("/joint_states:base", r"give a topic, as /joint_states, or for transforms /tf:BASE_FRAME:TOOL_FRAME"),
    ):
        with pytest.raises(DemonstrationError, match=message):
            choose_source(path, requested)
    with pytest.raises(DemonstrationError, match=r"no message has elbow; the joints there are 'left, right, wrist'"):
        read_take(path, Source("/other"), ("left", "elbow"))
    with pytest.raises(DemonstrationError, match="are they those of another robot"):
        read_take(path, Source("/other"), ("elbow",))
    with pytest.raises(DemonstrationError, match=rf"has no topic /begin; it has {listed}"):
        read_take(path, Source("/other"), NAMES, "/begin")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_a_file_that_is_cut_short_is_read_as_far_as_it_goes_or_refused_in_one_line(kind, share, bag, tmp_path) -> None:
    path = bag.write(tmp_path / kind, {"/joint_states": joint_messages()})
    (file,) = [path] if path.is_file() else [each for each in path.iterdir() if each.suffix in (".db3", ".mcap")]
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    reasons = []
    try:
        read = joints_of(path)
        np.testing.assert_array_equal(read.take.values, VALUES[: len(read.take)])
    except DemonstrationError as error:
        reasons.append(str(error))
    assert all(reason.startswith(str(path)) and len(reason.splitlines()) == 1 for reason in reasons)
    assert all("perhaps it can be saved: " in reason for reason in reasons)


def test_a_bag_without_metadata_is_read_by_its_files(bag, tmp_path) -> None:
    path = bag.write(tmp_path / "killed.mcap", {"/joint_states": joint_messages()})
    (path / "metadata.yaml").unlink()
    np.testing.assert_array_equal(joints_of(path).take.values, VALUES)


def test_what_is_no_bag_is_refused(tmp_path) -> None:
    (tmp_path / "text.bag").write_text("no bag")
    (tmp_path / "empty").mkdir()
    (tmp_path / "part.db3.zstd").touch()
    for name, message in (
        ("text.bag", "no readable bag"), ("none.mcap", "No such file"), ("empty", "is no bag"),
        ("part.db3.zstd", rf"is a compressed file of a bag: give its folder, {tmp_path}"),
    ):  # fmt: skip
        with pytest.raises(DemonstrationError, match=message):
            read_topics(tmp_path / name)
    assert not is_bag(tmp_path / "empty")
