"""The chain: planner and twin over DDS, in one process and as two, with and without avoidance."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest
from bench import PATIENCE
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from std_msgs.msg import Float64, UInt32
from visualization_msgs.msg import MarkerArray

from geodesic_motion_ros.nodes.messages import seconds
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.utils.errors import ParameterError

CONFIG = Path(__file__).resolve().parents[2] / "config"
# A ball in the middle of every demonstration, small enough to be passed on either side.
BALL = "{ball: {kind: static, centre: [0.465, -0.01, 0.34], radius: 0.03}}"


@pytest.fixture
def options(skill_folder):
    """A planner for a busy machine: it waits long before it calls the twin's messages stale."""
    return {
        "skill": str(skill_folder),
        "state_timeout": 5.0,
        "resume_timeout": 60.0,
        "obstacle_timeout": 30.0,
        "tracking_tolerance_joint": 0.3,
        "latency": 0.1,
        "latent_view_rate": 0.0,
    }


def watch(bench) -> None:
    bench.watch_planner()
    bench.listen(PoseStamped, "ee_pose")
    bench.listen(Float64, "twin/clearance")
    bench.listen(UInt32, "twin/contacts")


def arrive(bench, goal: np.ndarray) -> None:
    """Wait until the arm, as the twin measures it, is at the goal."""

    def there() -> bool:
        if not bench.heard["ee_pose"]:
            return False
        point = bench.heard["ee_pose"][-1].pose.position
        return float(np.linalg.norm(np.array([point.x, point.y, point.z]) - goal[:3])) < 0.003

    bench.wait(there, "the arm at the goal")


def test_the_arm_reaches_the_goal_in_one_process(bench, options, skill, start_joints):
    watch(bench)
    bench.add(TwinNode, initial_joint_positions=start_joints.tolist())
    bench.add(PlannerNode, **options)
    bench.wait_for_code("NO_GOAL")
    bench.send_goal(skill.goal_pose)
    arrive(bench, skill.goal_pose)


@pytest.mark.parametrize("avoidance", [False, True], ids=["control: avoidance off", "avoidance on"])
def test_a_ball_on_the_path_is_hit_without_avoidance_and_not_with_it(bench, options, skill, start_joints, avoidance):
    watch(bench)
    bench.add(TwinNode, initial_joint_positions=start_joints.tolist(), spheres=BALL, spawn_at_start=True)
    planner = bench.add(PlannerNode, **options, avoidance=avoidance)
    bench.wait_for_code("NO_GOAL")
    bench.wait(lambda: len(planner.inputs.snapshot().obstacles.radii), "the ball at the planner")
    bench.send_goal(skill.goal_pose)
    if avoidance:
        arrive(bench, skill.goal_pose)
        assert bench.heard["twin/contacts"][-1].data == 0
        assert min(message.data for message in bench.heard["twin/clearance"]) > 0.0
    else:
        bench.wait(lambda: any(count.data for count in bench.heard["twin/contacts"]), "contact with the ball")


@pytest.mark.parametrize(
    ("folder", "scene"),
    [("skill_folder", ""), ("skill_folder", "none"), ("skill_folder", "table"), ("table_skill_folder", "")],
    ids=["control: no scene is declared", "none", "table", "the skill's table"],
)
def test_what_blocks_every_demonstrated_path_is_passed_by_a_detour_once_a_scene_is_declared(
    bench, options, skill, start_joints, request, folder, scene
):
    watch(bench)
    wide = BALL.replace("0.03}", "0.08}")
    declares = {"skill": str(request.getfixturevalue(folder)), "scene": scene}
    bench.add(TwinNode, initial_joint_positions=start_joints.tolist(), spheres=wide, spawn_at_start=True, **declares)
    planner = bench.add(PlannerNode, **options | declares, patience=0.5)
    bench.wait_for_code("NO_GOAL")
    bench.wait(lambda: len(planner.inputs.snapshot().obstacles.radii), "the ball at the planner")
    bench.send_goal(skill.goal_pose)
    if (folder, scene) == ("skill_folder", ""):
        asked = bench.now()
        bench.live(3.0)
        newest = [one for one in bench.heard["planner/status"] if seconds(one.header.stamp) > asked + 0.5]
        # A busy machine may find no time to search to the end.
        allowed = ("NO_FEASIBLE_PATH", "DEADLINE_MISSED")
        assert all(status.status[0].message.startswith(allowed) for status in newest)
        return
    arrive(bench, skill.goal_pose)
    assert bench.heard["twin/contacts"][-1].data == 0
    assert min(message.data for message in bench.heard["twin/clearance"]) > 0.0
    values = [{value.key: value.value for value in status.status[0].values} for status in bench.heard["planner/status"]]
    assert 0.0 < max(float(value["detour_mm"]) for value in values) <= 250.0
    assert max(float(value["deviation"]) for value in values) > 0.0


@pytest.mark.parametrize("seen", [False, True], ids=["control: nothing is seen", "a box is seen"])
def test_where_unseen_is_blocked_a_detour_leads_through_what_is_seen(
    bench, options, skill, start_joints, tmp_path, seen
):
    watch(bench)
    bench.listen(MarkerArray, "planner/markers")
    bench.listen_to_log()
    scene = tmp_path / "scene.yaml"
    scene.write_text("seen: [{name: cell, centre: [0.3, 0.0, 0.6], size: [2.0, 2.0, 1.6]}]" if seen else "{}")
    wide = BALL.replace("0.03}", "0.08}")
    bench.add(TwinNode, initial_joint_positions=start_joints.tolist(), spheres=wide, spawn_at_start=True)
    planner = bench.add(PlannerNode, **options, scene=str(scene), unseen="blocked", patience=0.5)
    bench.wait_for_code("NO_GOAL")
    bench.wait(lambda: len(planner.inputs.snapshot().obstacles.radii), "the ball at the planner")
    bench.send_goal(skill.goal_pose)
    if seen:
        arrive(bench, skill.goal_pose)
        assert any(marker.ns == "seen" for array in bench.heard["planner/markers"] for marker in array.markers)
        assert bench.heard["twin/contacts"][-1].data == 0
        return
    bench.wait(lambda: "the arm would enter what is not seen" in bench.status()["reason"], "why there is no detour")
    bench.wait(lambda: bench.logged("unseen is blocked and the scene lists no boxes as seen"), "a line of the log")


def test_a_word_for_unseen_that_there_is_not_is_named_at_the_start(bench, options):
    with pytest.raises(ParameterError, match=r"parameter unseen = 'open'.* one of free, blocked"):
        bench.add(PlannerNode, **options, unseen="open")


@pytest.mark.parametrize(
    ("scene", "reason"),
    [("nowhere", "give none, table, or a"), ("/nowhere/scene.yaml", "cannot be read"), ("crate.yaml", "did you mean")],
)
def test_a_scene_that_cannot_be_used_is_named_at_the_start(bench, options, tmp_path, monkeypatch, scene, reason):
    monkeypatch.chdir(tmp_path)
    Path("crate.yaml").write_text("boxs: []")
    with pytest.raises(ParameterError, match="parameter scene: ") as error:
        bench.add(PlannerNode, **options, scene=scene)
    assert reason in str(error.value)


@pytest.mark.realtime
def test_a_machine_that_stands_still_for_a_moment_loses_no_goal(bench, options, skill, start_joints):
    """It is where the planner takes it to be: no farther off than by what it moves in a tenth of a second."""
    watch(bench)
    options["tracking_tolerance_joint"] = 0.05
    processes = [
        bench.launch("twin_node", initial_joint_positions=start_joints.tolist()),
        bench.launch("planner_node", **options),
    ]
    bench.wait_for_code("NO_GOAL")
    bench.wait(lambda: bench.status()["commands_received_by"], "a planner that knows of the twin")
    bench.send_goal(skill.goal_pose)
    # It is for three seconds: a busy machine sees it, and in 0.3 s it is farther on than the tolerance.
    bench.wait(lambda: float(bench.status()["speed"]) > 0.2, "an arm in fast motion")
    for process in processes:
        process.send_signal(signal.SIGSTOP)
    stopped = time.monotonic()
    bench.poll(lambda: time.monotonic() > stopped + 0.3, "0.3 s to pass")
    for process in processes:
        process.send_signal(signal.SIGCONT)
    arrive(bench, skill.goal_pose)
    assert "BAD_INPUT" not in {status.status[0].message.split(":")[0] for status in bench.heard["planner/status"]}


@pytest.mark.realtime
def test_a_planner_that_is_interrupted_brakes_before_it_ends(bench, options, skill, start_joints):
    """What was sent leads 2.4 s ahead, and nobody would look at obstacles meanwhile."""
    watch(bench)
    bench.launch("twin_node", initial_joint_positions=start_joints.tolist())
    planner = bench.launch("planner_node", **options)
    bench.wait_for_code("NO_GOAL")
    bench.wait(lambda: bench.status()["commands_received_by"], "a planner that knows of the twin")
    bench.send_goal(skill.goal_pose)
    bench.wait(lambda: float(bench.status()["speed"]) > 0.05, "an arm in motion")
    assert float(bench.status()["time_to_goal"]) > 0.5  # the control: it is far from its goal
    planner.send_signal(signal.SIGINT)
    _, errors = planner.communicate(timeout=PATIENCE)
    assert planner.returncode == 0, errors
    bench.wait(lambda: bench.status()["reason"] == "the planner ends" and bench.at_rest(), "an arm that rests")


@pytest.mark.realtime
def test_two_processes_reach_the_goal_answer_plan_and_exit_cleanly(bench, options, skill, start_joints, make_pose):
    watch(bench)
    processes = [
        bench.launch("twin_node", initial_joint_positions=start_joints.tolist()),
        bench.launch("planner_node", **options),
    ]
    bench.wait_for_code("NO_GOAL")
    bench.send_goal(skill.goal_pose)
    request = GetPlan.Request(start=make_pose(skill.start_pose), goal=make_pose(skill.goal_pose))
    plan = bench.call(GetPlan, "plan", request).plan
    point = plan.poses[-1].pose.position
    np.testing.assert_allclose([point.x, point.y, point.z], skill.goal_pose[:3], atol=1e-3)
    arrive(bench, skill.goal_pose)
    # with plans asked for that are being made, and others that wait
    client = bench.probe.create_client(GetPlan, "plan")
    assert client.wait_for_service(PATIENCE)
    for _ in range(3):
        client.call_async(request)
    for process, number in zip(processes, (signal.SIGINT, signal.SIGTERM), strict=True):
        process.send_signal(number)
    for process in processes:
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, errors
        assert "Traceback" not in errors


@pytest.mark.parametrize("node", ["planner", "twin"])
def test_a_signal_while_starting_ends_cleanly(bench, options, node):
    process = bench.launch(f"{node}_node", **(options if node == "planner" else {}))
    # the node's name appears in the graph before it has loaded its skill or its world
    bench.poll(lambda: node in bench.probe.get_node_names(), f"the node {node}")
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, errors


@pytest.mark.parametrize("namespace", ["", "/left/arm"])
def test_parameter_files_are_read_in_any_namespace(bench, tmp_path, namespace):
    shipped = CONFIG / "planner.yaml"
    changed = tmp_path / "planner.yaml"
    changed.write_text(shipped.read_text().replace("\n    speed: -1.0\n", "\n    speed: 9.0\n"))
    arguments = ["--ros-args", "-r", f"__ns:={namespace or '/'}", "--params-file"]
    process = bench.launch("planner_node", *arguments, str(changed))
    _, errors = process.communicate(timeout=PATIENCE)
    assert "planner: parameter speed = 9.0: expected a float" in errors
    process = bench.launch("planner_node", *arguments, str(shipped), skill="/nowhere/at_all")
    _, errors = process.communicate(timeout=PATIENCE)
    assert "planner: no skill folder '/nowhere/at_all'" in errors


def test_an_unreadable_parameter_file_is_said_in_one_line(bench):
    process = bench.launch("planner_node", "--ros-args", "--params-file", "/nowhere/planner.yaml")
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert "/nowhere/planner.yaml" in errors
    assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("node", "parameters", "reason"),
    [
        ("planner", {"skill": "/nowhere/at_all"}, "no skill folder '/nowhere/at_all'"),
        ("planner", {"rate": "5.0"}, "parameter rate = 5.0: expected a float from 10 to 1000 [Hz]"),
        ("planner", {"spede": "0.1"}, "parameter spede does not exist; did you mean speed?"),
        ("twin", {"spheres": "volcano"}, "there are no spheres 'volcano'"),
        ("twin", {"scene": "two"}, "the parameter `spheres` now"),
    ],
    ids=["missing skill", "out of range", "unknown parameter", "unknown spheres", "old name"],
)
def test_what_prevents_a_start_is_said_in_one_line(bench, node, parameters, reason):
    process = bench.launch(f"{node}_node", **parameters)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    lines = [line for line in errors.splitlines() if line.startswith(f"{node}: ")]
    assert len(lines) == 1
    assert reason in lines[0]
    assert "Traceback" not in errors
