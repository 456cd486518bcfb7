"""The node `planner` by itself: its states, services, parameters, pictures. The arm is joint states at rest."""

from __future__ import annotations

import math
import threading
from operator import attrgetter

import numpy as np
import pytest
from bench import PATIENCE
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.contract.settings import TOOL_LIMITS
from geodesic_motion_ros.nodes import messages
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError, SkillError

BASE = "panda_link0"


class TestStates:
    def test_says_what_it_lacks(self, bench, planner_options, start_joints, skill):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options)
        bench.wait_for_code("STALE_STATE", "joint_states: none has arrived")
        assert not bench.heard["target_pose"]
        bench.send_joint_states(start_joints)
        bench.wait_for_code("NO_GOAL")
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")

    def test_holds_where_the_arm_is_until_there_is_a_goal(self, ready, start_joints):
        position, _ = Robot.named("panda").forward(start_joints)
        target = ready.wait(lambda: ready.heard["target_pose"], "a target pose")[-1]
        assert target.header.frame_id == BASE
        point = target.pose.position
        np.testing.assert_allclose([point.x, point.y, point.z], position, atol=1e-9)

    def test_stream_reaches_the_goal_without_jumps_or_sign_flips(self, moving, skill):
        moving.wait(moving.at_goal, "rest at the goal")
        heard = list(moving.heard["target_pose"])
        poses = [message.pose for message in heard]
        positions = np.array([[p.position.x, p.position.y, p.position.z] for p in poses])
        quaternions = np.array([[p.orientation.w, p.orientation.x, p.orientation.y, p.orientation.z] for p in poses])
        last = moving.commanded().pose.position
        np.testing.assert_allclose([last.x, last.y, last.z], skill.goal_pose[:3], atol=1e-3)
        times = np.array([messages.seconds(message.header.stamp) for message in heard])
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        assert np.all(steps < TOOL_LIMITS.speed * 1.2 * np.diff(times) + 1e-3)
        assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.99)
        np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-9)
        moving.listen_to_log()
        (line,) = moving.wait(lambda: moving.logged("at the goal after"), "the arrival in the log")
        assert line.endswith("0.0 mm and 0.0 deg from it")

    def test_stops_when_joint_states_stop_and_resumes_when_they_return(self, moving):
        moving.probe.destroy_timer(moving.joint_states)
        moving.wait_for_code("STALE_STATE", "joint_states: the newest state is older")
        moving.send_joint_states(moving.arm)
        moving.wait_for_code("OK")

    def test_an_arm_that_was_moved_waits_for_the_goal_to_be_sent_again(
        self, bench, planner_options, start_joints, skill
    ):
        bench.watch_planner()
        tolerances = {"tracking_tolerance": 0.05, "tracking_tolerance_angle": 0.35, "tracking_tolerance_joint": 0.05}
        bench.add(PlannerNode, **planner_options | tolerances)
        timer = bench.send_joint_states(start_joints, follows=False)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("BAD_INPUT", "the arm is")  # it stands still, whatever it is sent
        bench.probe.destroy_timer(timer)
        moved = start_joints + np.array([0.03, 0, 0, 0, 0, 0, 0])
        bench.send_joint_states(moved, follows=False)
        bench.wait_for_code("NO_GOAL", "goal dropped: the arm was")
        expected, _ = Robot.named("panda").forward(moved)
        heard = len(bench.heard["target_pose"])
        bench.wait(lambda: len(bench.heard["target_pose"]) > heard + 20, "further target poses")
        point = bench.heard["target_pose"][-1].pose.position
        np.testing.assert_allclose([point.x, point.y, point.z], expected, atol=1e-9)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")

    def test_a_second_publisher_of_target_poses_is_named(self, moving):
        other = moving.probe.create_publisher(PoseStamped, "target_pose", 1)
        moving.wait_for_code("CONFLICT", "/planner and /probe")
        assert moving.heard["planner/status"][-1].status[0].level == DiagnosticStatus.ERROR
        moving.probe.destroy_publisher(other)
        moving.wait_for_code("NO_GOAL", "goal dropped")

    def test_hold_and_release(self, moving):
        assert moving.call(SetBool, "planner/hold", SetBool.Request(data=True)).success
        moving.wait_for_code("HOLD_REQUESTED")
        assert moving.call(SetBool, "planner/hold", SetBool.Request(data=False)).success
        moving.wait_for_code("OK")


    def test_the_status_has_the_terms_of_the_clearance_that_is_asked(self, bench, planner_options, start_joints):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options | {"obstacle_margin": 0.004, "obstacle_position_error": 0.02})
        bench.send_joint_states(start_joints)
        bench.wait_for_code("NO_GOAL")
        names = "obstacle_margin", "tracking_error", "tracking_lag"
        assert [float(bench.status()[name]) for name in names] == [0.004, 0.0, 0.0]
        names = "obstacle_position_error", "obstacle_velocity_error"
        assert [float(bench.status()[name]) for name in names] == [0.02, 0.0]


class TestPlanService:
    def request(self, make_pose, start, end, frame=BASE) -> GetPlan.Request:
        return GetPlan.Request(start=make_pose(start, frame), goal=make_pose(end, frame))

    def test_answers_while_the_loop_runs(self, moving, skill, make_pose):
        ticks = len(moving.heard["planner/status"])
        plan = moving.call(GetPlan, "plan", self.request(make_pose, skill.start_pose, skill.goal_pose)).plan
        assert plan.header.frame_id == BASE
        first, last = plan.poses[0].pose.position, plan.poses[-1].pose.position
        np.testing.assert_allclose([first.x, first.y, first.z], skill.start_pose[:3], atol=1e-3)
        np.testing.assert_allclose([last.x, last.y, last.z], skill.goal_pose[:3], atol=1e-3)
        moving.wait(lambda: len(moving.heard["planner/status"]) > ticks + 10, "further cycles")
        assert moving.status()["code"] == "OK"

    def test_joint_states_are_heard_however_long_an_answer_takes(self, moving, skill, make_pose, monkeypatch):
        planner = moving.planner.planner
        plan = planner.plan

        def slowly(*ends):
            # longer than a joint state may be old
            moving.live(2.5)
            return plan(*ends)

        monkeypatch.setattr(planner, "plan", slowly)
        heard = len(moving.heard["planner/status"])
        for _ in range(2):
            assert moving.call(GetPlan, "plan", self.request(make_pose, skill.start_pose, skill.goal_pose)).plan.poses
        said = [message.status[0].message for message in moving.heard["planner/status"][heard:]]
        # On a busy machine the bench's clock may stand for a second of real time, which is said, too.
        stale = [text for text in said if text.startswith("STALE_STATE") and "/clock has stood" not in text]
        assert said
        assert not stale

    def test_a_node_that_stops_finishes_one_plan_and_drops_those_that_wait(self, moving, skill, make_pose, monkeypatch):
        planner, begun, release = moving.planner.planner, threading.Semaphore(0), threading.Event()
        plan, plans = planner.plan, []

        def waiting(*ends):
            begun.release()
            assert release.wait(PATIENCE)
            plans.append(plan(*ends))
            return plans[-1]

        monkeypatch.setattr(planner, "plan", waiting)
        client = moving.probe.create_client(GetPlan, "plan")
        assert client.wait_for_service(PATIENCE)
        for _ in range(3):
            client.call_async(self.request(make_pose, skill.start_pose, skill.goal_pose))
        assert begun.acquire(timeout=PATIENCE)
        threading.Timer(0.1, release.set).start()
        moving.planner.stop()
        assert len(plans) == 1
        assert not [thread for thread in threading.enumerate() if thread.name.startswith("plan_")]

    def test_is_empty_when_there_is_no_path(self, ready, skill, make_pose, wall):
        ready.send_spheres(wall)
        ready.wait(lambda: len(ready.planner.inputs.snapshot().obstacles.radii), "the obstacle")
        ticks = ready.planner.loop.ticks
        ready.wait(lambda: ready.planner.loop.ticks > ticks + 1, "a cycle that has begun with it")
        assert not ready.call(GetPlan, "plan", self.request(make_pose, skill.start_pose, skill.goal_pose)).plan.poses
        ready.wait(lambda: ready.status()["plan"].startswith("NO_FEASIBLE_PATH: "), "the reason in the status")

    def test_is_empty_for_another_frame(self, ready, skill, make_pose):
        request = self.request(make_pose, skill.start_pose, skill.goal_pose, frame="map")
        assert not ready.call(GetPlan, "plan", request).plan.poses
        refused = "BAD_INPUT: start: frame 'map' is unknown here"
        ready.wait(lambda: ready.status()["plan"].startswith(refused), "the reason in the status")


class TestFaults:
    """Errors that nobody expected are reported, and the node goes on."""

    def test_in_a_callback(self, moving, start_joints, monkeypatch):
        def fail(*arguments):
            raise ZeroDivisionError

        with monkeypatch.context() as patch:
            patch.setattr(moving.planner.inputs.arm.plausible, "check", fail)
            moving.wait(lambda: moving.status()["refused_input"], "a refusal")
            assert "joint_states: internal error, see the log: ZeroDivisionError()" in moving.status()["refused_input"]
        assert int(moving.status()["refused_joint_states"]) > 0
        moving.wait_for_code("OK")

    def test_in_a_timer(self, moving, monkeypatch):
        failed = []

        def fail(*arguments):
            failed.append(0)
            raise ZeroDivisionError

        monkeypatch.setattr(moving.planner.outputs, "publish_diagnostics", fail)
        moving.wait(lambda: len(failed) > 1, "the timer to fail twice")
        moving.wait(lambda: int(moving.status().get("refused_/diagnostics", 0)) > 0, "the failure among those counted")
        assert moving.status()["code"] == "OK"

    @pytest.mark.parametrize(
        ("kind", "service", "part", "inside"),
        [(SetBool, "hold", "inputs", "request_hold"), (Trigger, "clear_obstacles", "inputs.obstacles", "clear")],
    )
    def test_in_a_service(self, ready, monkeypatch, kind, service, part, inside):
        def fail(*arguments):
            raise ZeroDivisionError

        with monkeypatch.context() as patch:
            patch.setattr(attrgetter(part)(ready.planner), inside, fail)
            answer = ready.call(kind, f"planner/{service}", kind.Request())
        assert not answer.success
        assert answer.message == "internal error, see the log: ZeroDivisionError()"
        assert ready.call(kind, f"planner/{service}", kind.Request()).success
        ready.wait(lambda: ready.status().get(f"refused_~/{service}") == "1", "the failure among those counted")

    def test_before_a_cycle(self, moving, monkeypatch):
        def fail():
            raise ZeroDivisionError

        with monkeypatch.context() as patch:
            patch.setattr(moving.planner.inputs, "snapshot", fail)
            moving.wait_for_code("BAD_INPUT", "internal error, see the log: ZeroDivisionError()")
        moving.wait_for_code("OK")
        assert not moving.planner.failure.is_set()


class TestPictures:
    def test_the_latent_view_is_drawn_for_a_subscriber(self, bench, planner_options, start_joints, skill, monkeypatch):
        node = bench.add(PlannerNode, **planner_options | {"latent_view_rate": 5.0, "latent_view_size": 128})
        bench.watch_planner()
        bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")
        drawn, render = [], node.face.view.render
        monkeypatch.setattr(node.face.view, "render", lambda *of: drawn.append(render(*of)) or drawn[-1])
        so_far = len(bench.heard["planner/status"])
        bench.wait(lambda: len(bench.heard["planner/status"]) > so_far + 60, "half a second in which nobody looks")
        assert not drawn
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        bench.listen(Image, "planner/latent_view", latched)
        image = bench.wait(lambda: bench.heard["planner/latent_view"], "a latent view")[-1]
        assert (image.height, image.width, image.encoding) == (128, 128, "rgb8")
        pixels = np.frombuffer(image.data, np.uint8).reshape(128, 128, 3)
        assert np.count_nonzero(np.all(pixels == 255, axis=2)) > 30, "the white path is not in the picture"

    def test_path_markers_and_health(self, moving, skill):
        moving.listen(Path, "path")
        moving.listen(MarkerArray, "planner/markers")
        moving.listen(DiagnosticArray, "/diagnostics")
        moving.send_spheres(([0.465, 0.8, 0.34], 0.03))
        path = moving.wait(lambda: moving.heard["path"], "a path")[-1]
        last = path.poses[-1].pose.position
        np.testing.assert_allclose([last.x, last.y, last.z], skill.goal_pose[:3], atol=1e-3)

        def seen(action: int) -> bool:
            shown = moving.heard["planner/markers"]
            return bool(shown) and any(m.ns == "obstacles" and m.action == action for m in shown[-1].markers)

        moving.wait(lambda: seen(Marker.ADD), "the obstacle among the markers")
        moving.delete_spheres()
        moving.wait(lambda: seen(Marker.DELETE), "the deletion of the obstacle's marker")
        moving.wait(lambda: float(moving.health().get("ticks", "0")) > 10, "the loop's health")
        assert float(moving.health()["rate_hz"]) > 0.0
        assert "age_joint_states" in moving.health()


class TestParameters:
    @pytest.mark.parametrize(
        ("name", "value", "hint"),
        [
            ("speed", 5.0, "from -1 to 2"),
            ("speed", 5, "parameter speed = 5.0: expected a float from -1 to 2 [m/s]"),
            ("rate", math.nan, "from 10 to 1000"),
            ("tool_spheres", [0.0, 0.0, 0.04], "rows of 4"),
            ("tool_spheres", [0.0, 0.0, 0.0, -0.04], "between 0 and 1000"),
            ("obstacle_silence_policy", "pray", "one of hold, keep"),
            ("sped", 0.1, "did you mean speed?"),
        ],
    )
    def test_bad_ones_at_start_are_refused_by_name(self, bench, planner_options, name, value, hint):
        with pytest.raises(ParameterError, match=name.split("_")[0]) as caught:
            bench.add(PlannerNode, **planner_options | {name: value})
        assert hint in str(caught.value)

    def test_bad_ones_at_run_time_are_refused_all_or_nothing(self, ready):
        wanted = [Parameter("state_timeout", value=1.5), Parameter("obstacle_timeout", value=-1.0)]
        request = SetParametersAtomically.Request(parameters=[p.to_parameter_msg() for p in wanted])
        result = ready.call(SetParametersAtomically, "planner/set_parameters_atomically", request).result
        assert not result.successful
        assert "obstacle_timeout" in result.reason
        assert ready.planner.get_parameter("state_timeout").value == 2.0
        assert ready.planner.cycle.state_timeout == 2.0

    def test_good_ones_at_run_time_take_effect(self, ready, start_joints):
        request = SetParametersAtomically.Request(
            parameters=[Parameter("state_timeout", value=0.011).to_parameter_msg()]
        )
        assert ready.call(SetParametersAtomically, "planner/set_parameters_atomically", request).result.successful
        ready.wait_for_code("STALE_STATE", "older than state_timeout, 0.011 s")

    def test_all_bad_ones_are_named_at_once(self, bench, planner_options):
        with pytest.raises(ParameterError, match=r"parameter rate = 5.0: .*; parameter speed = True: expected a float"):
            bench.add(PlannerNode, **planner_options | {"speed": True, "rate": 5})

    def test_integers_are_floats_at_start_and_at_run_time(self, bench, planner_options):
        options = {"speed_scale": 1, "prediction": 2, "detour": 0, "task_frame": [0, 0, 0, 1, 0, 0, 0]}
        node = bench.add(PlannerNode, **planner_options | options)
        assert node.get_parameter("speed_scale").value == 1.0
        assert list(node.get_parameter("task_frame").value) == [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        for kind, name in ((SetParametersAtomically, "set_parameters_atomically"), (SetParameters, "set_parameters")):
            request = kind.Request(parameters=[Parameter("state_timeout", value=1).to_parameter_msg()])
            answer = bench.call(kind, f"planner/{name}", request)
            assert all(result.successful for result in getattr(answer, "results", None) or [answer.result])
            assert node.cycle.state_timeout == 1.0
            node.set_parameters([Parameter("state_timeout", value=2.0)])
        assert not node.set_parameters([Parameter("state_timeout", value=11)])[0].successful
        assert "without a name" in node.set_parameters([Parameter("", value=11)])[0].reason

    def test_what_cannot_change_is_refused(self, ready):
        assert not ready.planner.set_parameters([Parameter("prediction", value=2.0)])[0].successful

    @pytest.mark.parametrize("scale", [0.3, 0.02], ids=["control: as fast as before", "slower"])
    def test_an_arm_in_motion_can_be_slower_and_farther_away(self, moving, scale):
        """Its fastest joint makes 2.6 rad/s; `status` has what is commanded of the fastest one."""
        planner, slow = moving.planner.planner, 0.02 * 2.61
        moving.wait(lambda: float(moving.status()["speed"]) > 3.0 * slow, "an arm in fast motion")
        changes = {"speed_scale": scale, "obstacle_margin": 0.02, "obstacle_position_error": 0.01}
        results = moving.planner.set_parameters([Parameter(name, value=value) for name, value in changes.items()])
        assert all(result.successful for result in results)
        moving.wait(lambda: float(moving.status()["obstacle_margin"]) == 0.02, "the margin in the status")
        moving.wait(lambda: float(moving.status()["obstacle_position_error"]) == 0.01, "the error in the status")
        assert planner.settings.speed_scale == scale
        if scale == 0.02:
            moving.wait(lambda: float(moving.status()["speed"]) <= slow + 1e-6, "an arm that has slowed down")
            assert planner.played_limits is planner.limits
            since = moving.now()
            moving.live(1.5)
            heard = [one for one in moving.heard["planner/status"] if messages.seconds(one.header.stamp) > since]
            values = [{pair.key: pair.value for pair in message.status[0].values} for message in heard]
            later = [float(value["speed"]) for value in values]
            assert 0.0 < max(later) <= slow + 1e-6
            moving.planner.set_parameters([Parameter("speed_scale", value=0.3)])
        moving.wait(moving.at_goal, "rest at the goal")

    def test_its_speed_is_overridden_in_motion_down_to_rest_and_up_again(self, moving):
        """On one path: by a tenth of the speed of joints and tool, by none, and by all of it to the goal."""

        def override(share: float) -> None:
            assert moving.planner.set_parameters([Parameter("speed_override", value=share)])[0].successful
            moving.wait(lambda: float(moving.status()["speed_override"]) == share, "the share in the status")

        planner, slow = moving.planner.planner, 0.1 * 0.3 * 2.61
        moving.wait(lambda: float(moving.status()["speed"]) > 2.0 * slow, "an arm in fast motion")
        override(0.1)
        moving.wait(lambda: planner.played_limits is planner.limits, "a motion that slows down")
        # from its takeover on
        moving.live(2.0 * planner.latency)
        since = moving.now()
        moving.live(1.0)
        heard = [one for one in moving.heard["target_pose"] if messages.seconds(one.header.stamp) > since]
        times = np.array([messages.seconds(one.header.stamp) for one in heard])
        points = np.array([[one.pose.position.x, one.pose.position.y, one.pose.position.z] for one in heard])
        moved = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        assert 0.0 < moved <= 0.1 * TOOL_LIMITS.speed * (times[-1] - times[0]) * (1.0 + 1e-3)
        override(0.0)
        moving.wait_for_code("HOLD_REQUESTED", "speed_override is 0: the arm rests on its path until it is 0.033")
        moving.wait(moving.at_rest, "rest on the path")
        assert not moving.at_goal()
        override(1.0)
        moving.wait_for_code("OK")
        moving.wait(moving.at_goal, "rest at the goal")


class TestSkills:
    def test_a_missing_skill_is_named(self, bench, planner_options, tmp_path):
        with pytest.raises(SkillError, match="nowhere"):
            bench.add(PlannerNode, **planner_options | {"skill": str(tmp_path / "nowhere")})

    def test_a_damaged_skill_is_named_with_the_reason(self, bench, planner_options, skill, tmp_path):
        folder = skill.save(tmp_path / "damaged")
        weights = folder / "weights.safetensors"
        weights.write_bytes(weights.read_bytes()[:-100])
        with pytest.raises(SkillError, match="truncated or altered"):
            bench.add(PlannerNode, **planner_options | {"skill": str(folder)})


def test_nodes_come_and_go_without_leaving_threads(bench, planner_options):
    for repetition in range(5):
        node = PlannerNode(context=bench.context, parameter_overrides=options(planner_options))
        node.start()
        node.stop()
        node.destroy_node()
        if repetition == 0:
            threads = threading.active_count()
    assert threading.active_count() == threads


def options(values) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]
