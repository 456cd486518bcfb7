"""The node `record`: takes of a guided arm become a skill; what cannot be recorded is refused and said."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from bench import PATIENCE
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.demonstrations.readers import read_joint_takes
from geodesic_motion_ros.nodes import hand_guide
from geodesic_motion_ros.nodes.messages import joint_state_message, pose_message
from geodesic_motion_ros.nodes.record_node import RecordNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

NAMES, READY, BASE = Robot.named("panda").joint_names, Robot.named("panda").ready, Robot.named("panda").base_link


@pytest.fixture
def recorder(bench, tmp_path):
    """A bench with the node alone, and a driver of the test's own to be driven by `drive`."""
    bench.folder = tmp_path / "takes"
    bench.add(RecordNode, folder=str(bench.folder))
    bench.listen_to_log()
    return bench


def ask(bench, service: str) -> Trigger.Response:
    return bench.call(Trigger, f"record/{service}", Trigger.Request())


def drive(bench, path: np.ndarray, names: tuple[str, ...] = NAMES, stamp=None):
    """Publish configurations (T, 7) [rad] one after the other at 100 Hz, then the last one; returns the timer, whose
    `sent` counts them."""
    publisher = bench.publisher(JointState, "joint_states")

    def send() -> None:
        row = path[min(timer.sent, len(path) - 1)]
        now = stamp or bench.probe.get_clock().now().to_msg()
        publisher.publish(joint_state_message(names, row, np.zeros(len(row)), now))
        timer.sent += 1

    if bench.clock is not None:
        bench.clock.length = 0.01
    timer = bench.repeat(0.01, send)
    timer.sent = 0
    return timer


def swing(samples: int = 200) -> np.ndarray:
    share = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, samples))
    path = np.tile(READY, (samples, 1))
    path[:, 0] += 0.8 * share
    return path


def record_all(bench, path: np.ndarray, **how) -> Trigger.Response:
    """A take that is begun before a path and ended after it."""
    rest = drive(bench, path[:1], **how)
    bench.wait(lambda: ask(bench, "begin").success, "a take to begin")
    bench.probe.destroy_timer(rest)
    timer = drive(bench, path, **how)
    bench.wait(lambda: timer.sent > len(path) + 10, "the end of the path")
    answer = ask(bench, "end")
    bench.probe.destroy_timer(timer)
    return answer


@pytest.mark.usefixtures("brief_training")
def test_takes_of_a_guided_arm_are_recorded_read_and_learned(bench, skill, skill_folder, tmp_path, capsys):
    folder, out = tmp_path / "takes", tmp_path / "learned"
    bench.add(TwinNode, skill=str(skill_folder))
    bench.add(RecordNode, folder=str(folder))
    lines = []
    by_the_clock = ["-p", "use_sim_time:=true"]
    guide = partial(hand_guide.guide, skill, 3, duration=3.0, record=True, ros_arguments=by_the_clock)
    assert bench.during(lambda: guide(shown=lines.append)) == 3, lines
    for number, line in enumerate(lines, 1):
        assert line.startswith(f"path {number}: kept take_00{number}: ")
    assert "mm from the nearest other" in lines[2]
    assert main(["inspect", str(folder), "--picture", str(tmp_path / "takes.png")]) == 0
    assert capsys.readouterr().out.count("take_00") >= 3
    train = ["train", "--demos", str(folder), "--out", str(out), "--steps", "30", "--kernels", "20"]
    # what so few steps learn may be without a motion
    assert main([*train, "--latent-dimension", "2"]) in (0, 1)
    learned = Skill.load(out)
    assert learned.provenance["demonstrations"] == ["take_001", "take_002", "take_003"]
    np.testing.assert_allclose(learned.start_pose[:3], skill.start_pose[:3], atol=0.04)


def test_without_joint_states_nothing_begins(recorder):
    answer = ask(recorder, "begin")
    assert not answer.success
    assert answer.message == (
        "no joint states have arrived yet (/joint_states is published by nobody: start the driver)"
    )
    assert not ask(recorder, "end").success
    # the control: with a driver it begins
    drive(recorder, swing()[:1])
    recorder.wait(lambda: ask(recorder, "begin").success, "a take to begin")


def test_joint_states_of_another_arm_are_named(recorder):
    drive(recorder, swing()[:1], names=(*NAMES[:6], "elbow"))
    recorder.wait(lambda: "no message has panda_joint7" in ask(recorder, "begin").message, "the refusal")


def test_stamps_that_stand_still_are_named(recorder):
    drive(recorder, swing()[:1], stamp=recorder.probe.get_clock().now().to_msg())

    def refused() -> bool:
        answer = ask(recorder, "begin")
        if answer.success:  # until they have stood for a while
            ask(recorder, "end")
        return "stand still at" in answer.message

    recorder.wait(refused, "the refusal")


def test_a_good_take_is_kept_and_can_be_deleted_and_one_that_jumps_is_refused(recorder):
    path = swing()
    answer = record_all(recorder, path)
    assert answer.success, answer.message
    assert answer.message.startswith("kept take_001: ")
    (take,) = read_joint_takes(recorder.folder, "panda")
    assert np.abs(take.values[-1] - path[-1]).max() < 0.005
    spoiled = path.copy()
    spoiled[100:, 1] += 0.6
    answer = record_all(recorder, spoiled)
    assert not answer.success
    assert "'take_002' jumps" in answer.message
    assert "samples are lost" in answer.message
    assert answer.message.endswith("nothing of take_002 is written")
    assert [file.name for file in recorder.folder.iterdir()] == ["take_001.csv"]
    assert ask(recorder, "delete_last").success
    assert list(recorder.folder.iterdir()) == []


def test_joint_states_that_end_in_a_take_refuse_it(recorder):
    timer = drive(recorder, swing())
    recorder.wait(lambda: ask(recorder, "begin").success, "a take to begin")
    recorder.wait(lambda: timer.sent > 50, "half a path")
    recorder.probe.destroy_timer(timer)
    recorder.wait(lambda: recorder.logged("samples; no joint states for"), "the warning of the silence")
    answer = ask(recorder, "end")
    assert not answer.success
    assert answer.message.startswith("no joint states for")
    assert not recorder.folder.exists()


@pytest.mark.realtime
def test_a_take_that_is_not_ended_is_dropped_and_said(bench, tmp_path):
    folder = tmp_path / "takes"
    process = bench.launch("record_node", folder=str(folder))
    drive(bench, swing())
    bench.poll(lambda: ask(bench, "begin").success, "a take to begin")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, errors
    assert "take_001 had not ended" in errors
    assert "nothing of it was written; 0 takes stand in" in errors
    assert "Traceback" not in errors
    assert not folder.exists()


@pytest.mark.realtime
def test_keys_of_a_terminal_begin_end_delete_and_quit(bench, tmp_path):
    folder = tmp_path / "takes"
    keyboard, terminal = pty.openpty()
    command = [sys.executable, "-m", "geodesic_motion_ros.nodes.record_node", "--ros-args", "-p", f"folder:={folder}"]
    process = subprocess.Popen(command, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        bench.listen_to_log()
        rest = drive(bench, swing()[:1])
        bench.wait(lambda: bench.logged("ready: takes of"), "the node")
        bench.poll(lambda: rest.sent > 20, "joint states")
        os.write(keyboard, b" ")
        bench.wait(lambda: bench.logged("recording take_001"), "the take to begin")
        bench.probe.destroy_timer(rest)
        timer = drive(bench, swing())
        bench.poll(lambda: timer.sent > 220, "the end of the path")
        os.write(keyboard, b"\n")
        bench.wait(lambda: bench.logged("kept take_001"), "the take")
        os.write(keyboard, b"d")
        bench.wait(lambda: bench.logged("deleted"), "its end")
        os.write(keyboard, b"q")
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, errors
        assert list(folder.iterdir()) == []
    finally:
        process.kill()
        process.communicate()
        os.close(keyboard)
        os.close(terminal)


def test_a_hand_is_refused_where_no_twin_runs(skill, monkeypatch):
    monkeypatch.setattr(hand_guide, "PATIENCE", 2.0)
    with pytest.raises(hand_guide.GuideError, match="nobody offers /twin/free_drive: start the node `twin` first"):
        hand_guide.guide(skill, 1)


def test_a_hand_is_refused_where_nothing_records_and_leaves_the_arm_to_its_motors(bench, skill, skill_folder):
    bench.add(TwinNode, skill=str(skill_folder))
    bench.listen_to_log()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hand_guide, "PATIENCE", 12.0)
        with pytest.raises(hand_guide.GuideError, match="start the node `record` first"):
            bench.during(lambda: hand_guide.guide(skill, 1, record=True, ros_arguments=["-p", "use_sim_time:=true"]))
    hand = pose_message(*Robot.named("panda").forward(READY), BASE, Time())
    bench.publisher(PoseStamped, "twin/hand_pose").publish(hand)
    bench.wait(lambda: bench.logged("the arm is not in free drive"), "the refusal of a hand")


def test_a_free_arm_refuses_commands_until_its_motors_hold_it(bench, skill, skill_folder, make_pose):
    bench.add(TwinNode, skill=str(skill_folder))
    bench.listen_to_log()
    target = skill.start_pose + np.array([0.0, 0.05, 0.0, 0, 0, 0, 0])
    publisher = bench.publisher(PoseStamped, "target_pose")
    assert bench.call(SetBool, "twin/free_drive", SetBool.Request(data=True)).success
    bench.repeat(0.02, lambda: publisher.publish(make_pose(target)))
    bench.wait(lambda: bench.logged("refused a message on target_pose: the arm is in free drive"), "the refusal")
    assert bench.call(SetBool, "twin/free_drive", SetBool.Request(data=False)).success
    bench.listen(PoseStamped, "ee_pose")
    near = lambda: abs(bench.heard["ee_pose"][-1].pose.position.y - target[1]) < 5e-3  # noqa: E731
    bench.wait(lambda: bench.heard["ee_pose"] and near(), "the arm at its target")
