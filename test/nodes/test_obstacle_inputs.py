"""What the planner knows of obstacles by the stamps of their messages, at times of the test's own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PointStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.messages import cloud_message
from test.nodes.inputs_bench import PATIENCE, SPEED, Bench

UNHEARD = "nothing has been received yet (required_obstacle_topics)"


def cloud(header: Header) -> PointCloud2:
    """Of one point, the origin."""
    return cloud_message(np.zeros((1, 3)), header.frame_id, header.stamp)


class TestLate:
    def test_what_moves_is_where_it_has_moved_since_its_stamp(self, bench):
        bench.move(late=0.4)
        np.testing.assert_allclose(bench.place_now(), SPEED * bench.true_time, atol=1e-6)
        np.testing.assert_allclose(bench.inputs.snapshot().obstacles.velocities, [[SPEED, 0.0, 0.0]], atol=1e-6)
        snapshot = bench.inputs.snapshot()
        assert not snapshot.silent_sources
        assert not snapshot.late_sources
        # a stop is kept free of all places since it was seen
        assert snapshot.obstacles.moved_on(snapshot.heard, 1.6, 0.0).ages == pytest.approx(0.4)

    def test_without_a_stamp_it_lags_behind(self, bench):
        bench.move(late=None, delay=0.4)
        np.testing.assert_allclose(bench.place_now(), SPEED * (bench.true_time - 0.4), atol=1e-6)

    def test_a_stamp_of_the_future_is_the_arrival(self, bench):
        bench.move(late=-5.0, delay=0.0)
        np.testing.assert_allclose(bench.place_now(), SPEED * bench.true_time, atol=1e-6)
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.0)

    def test_of_a_stamp_of_long_ago_nothing_is_foretold_and_the_topic_is_late(self, bench):
        bench.move(late=2.0)
        np.testing.assert_allclose(bench.place_now(), SPEED * (bench.true_time - 2.0), atol=1e-6)
        snapshot = bench.inputs.snapshot()
        assert snapshot.late_sources == {"obstacles": pytest.approx(2.0)}
        assert not snapshot.silent_sources
        assert bench.inputs.ages()["obstacles"] == pytest.approx(2.0)
        bench.move(late=0.0, duration=0.1)
        assert not bench.inputs.snapshot().late_sources
        # it falls silent by how long nothing has been heard
        bench.go(0.6)
        assert bench.inputs.snapshot().silent_sources == {"obstacles": pytest.approx(0.6)}
        assert not bench.inputs.snapshot().late_sources

    def test_the_keep_policy_keeps_late_obstacles_too(self, node):
        bench = Bench(node, obstacle_silence_policy="keep")
        bench.move(late=2.0)
        assert not bench.inputs.snapshot().late_sources
        assert len(bench.inputs.snapshot().obstacles) == 1

    @pytest.mark.parametrize("topic", ["obstacle_marker", "obstacle_point", "obstacle_cloud"])
    def test_every_topic_is_judged_by_its_stamps(self, bench, topic):
        inputs = bench.inputs
        if topic == "obstacle_marker":
            inputs.obstacles.on_marker(serialize_message(bench.sphere(late=2.0)))
        elif topic == "obstacle_point":
            inputs.obstacles.on_point(PointStamped(header=bench.header(2.0)))
        else:
            bench.parameters["self_filter"] = False  # which joint states of then would take
            inputs.start()
            inputs.obstacles.clouds.on_cloud(cloud(bench.header(2.0)))
            assert bench.changed.wait(PATIENCE)
            inputs.stop()
        assert len(inputs.snapshot().obstacles) == 1
        assert inputs.snapshot().late_sources == {topic: pytest.approx(2.0)}
        bench.go(0.6)
        assert inputs.snapshot().silent_sources == {topic: pytest.approx(0.6)}

    @pytest.mark.parametrize("speed", [SPEED, 0.0])
    def test_of_two_who_share_a_topic_the_late_one_is_named_by_its_obstacles(self, bench, speed):
        for _ in range(30):
            bench.go(1.0 / 60.0)
            bench.tell(bench.sphere(speed * bench.true_time, 2.0, ns="late"))
            bench.tell(bench.sphere(ns="on time"))
        assert bench.inputs.snapshot().late_sources == {"obstacles/late/0": pytest.approx(2.0)}

    def test_what_has_no_stamp_is_as_old_as_what_stands_beside_it(self, bench):
        everything = Marker(action=Marker.DELETEALL, ns="other")
        bench.tell(everything, bench.sphere(late=2.0), bench.sphere(late=None, id=1))
        assert bench.inputs.snapshot().late_sources == {"obstacles": pytest.approx(2.0)}
        # with one newer marker in the message its topic is not late, but the other one is
        bench.tell(bench.sphere(late=2.0), bench.sphere(late=0.1, id=1))
        assert bench.inputs.snapshot().late_sources == {"obstacles//0": pytest.approx(2.0)}
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.1)

    def test_what_was_overtaken_makes_nothing_older(self, bench):
        bench.tell(bench.sphere(late=0.1))
        bench.tell(bench.sphere(late=0.4))
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.1)
        assert bench.inputs.refusals.counts["obstacles"] == 1

    def test_a_lifetime_counts_from_the_arrival(self, bench):
        marker = bench.sphere(late=2.0)
        marker.lifetime.sec = 1
        bench.tell(marker)
        bench.go(0.9)
        assert len(bench.inputs.snapshot().obstacles) == 1
        bench.go(0.2)
        assert len(bench.inputs.snapshot().obstacles) == 0

    def test_what_moved_and_is_not_published_again_may_stand_anywhere_since_its_stamp(self, bench):
        bench.move(late=0.4)
        bench.go(0.3)
        obstacles = bench.inputs.snapshot().obstacles
        standing = ~np.any(obstacles.velocities, axis=1)
        x = obstacles.centres[standing, 0]
        # until it is looked at again, 50 ms later
        np.testing.assert_allclose([min(x), max(x)], SPEED * (bench.true_time - np.array([0.7, -0.05])), atol=1e-6)


def test_a_detector_that_labels_its_obstacles_is_heard(bench):
    label = bench.sphere(ns="labels")
    label.type, label.text, label.scale.x, label.scale.y = Marker.TEXT_VIEW_FACING, "cup", 0.0, 0.0
    bench.tell(Marker(action=Marker.DELETEALL), bench.sphere(), label)
    bench.inputs.obstacles.on_marker(serialize_message(label))
    snapshot = bench.inputs.snapshot()
    assert len(snapshot.obstacles) == 1
    assert (bench.inputs.refusals.counts, snapshot.unusable_sources) == ({}, {})


class TestClock:
    @pytest.mark.parametrize("jump", [5.0, -5.0])
    def test_that_is_set_makes_nothing_old(self, bench, jump):
        bench.move(late=0.1)
        bench.jump(jump)
        assert not bench.inputs.snapshot().late_sources
        # its sender's clock is set as well
        bench.move(late=0.1)
        snapshot = bench.inputs.snapshot()
        assert not snapshot.late_sources
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.1)
        np.testing.assert_allclose(bench.place_now(), SPEED * bench.true_time, atol=1e-6)

    def test_of_the_node_alone_that_is_set_makes_late_until_its_sender_agrees(self, bench):
        bench.tell(bench.sphere())
        bench.jump(5.0)
        for _ in range(6):
            bench.go(0.1)
            bench.tell(bench.sphere(late=5.0))
        assert bench.inputs.snapshot().late_sources == {"obstacles": pytest.approx(0.6)}
        bench.tell(bench.sphere())
        assert not bench.inputs.snapshot().late_sources

    def test_that_is_not_there_yet_makes_nothing_late(self, bench):
        bench.ros_time_is_active, stamp = True, bench.header()
        bench.ros = 0
        marker = bench.sphere()
        marker.header = stamp
        bench.tell(marker)
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.0)
        assert not bench.inputs.snapshot().late_sources


class TestRequired:
    @pytest.fixture(params=["hold", "keep"])
    def bench(self, request, node) -> Bench:
        required = ["", "obstacles", "obstacle_point"]
        return Bench(node, required_obstacle_topics=required, obstacle_silence_policy=request.param)

    def test_topics_are_unheard_until_each_has_spoken_and_after_all_was_cleared(self, bench):
        assert bench.inputs.snapshot().unusable_sources == {"obstacles": UNHEARD, "obstacle_point": UNHEARD}
        bench.tell()
        assert bench.inputs.snapshot().unusable_sources == {"obstacle_point": UNHEARD}
        bench.inputs.obstacles.on_point(PointStamped(header=bench.header()))
        assert bench.inputs.snapshot().unusable_sources == {}
        bench.inputs.obstacles.clear()
        assert bench.inputs.snapshot().unusable_sources == {"obstacles": UNHEARD, "obstacle_point": UNHEARD}

    def test_one_that_deletes_its_last_obstacle_must_go_on(self, bench):
        bench.inputs.obstacles.on_point(PointStamped(header=bench.header()))
        for markers in ([bench.sphere()], [Marker(action=Marker.DELETEALL)], []):
            bench.tell(*markers)
            bench.go(0.4)
            assert "obstacles" not in bench.inputs.snapshot().silent_sources
            assert bench.inputs.snapshot().unusable_sources == {}
        bench.tell(Marker(action=Marker.DELETEALL))
        bench.go(0.6)
        silent = bench.parameters["obstacle_silence_policy"] == "hold"
        assert ("obstacles" in bench.inputs.snapshot().silent_sources) is silent
        assert bench.inputs.snapshot().unusable_sources == {}

    def test_one_that_deletes_all_and_cannot_be_used_is_unusable_until_it_can(self, bench):
        bench.inputs.obstacles.on_point(PointStamped(header=bench.header()))
        elsewhere = Marker(header=Header(frame_id="camera"), type=Marker.SPHERE)
        for before in ([bench.sphere()], []):
            bench.tell(*before)
            assert bench.inputs.snapshot().unusable_sources == {}
            bench.tell(Marker(action=Marker.DELETEALL), elsewhere)
            (reason,) = bench.inputs.snapshot().unusable_sources.values()
            assert "frame 'camera' is unknown" in reason
        bench.tell(bench.sphere())
        bench.tell(elsewhere)
        assert bench.inputs.snapshot().unusable_sources == {}

    def test_none_is_by_default(self, node):
        assert Bench(node).inputs.snapshot().unusable_sources == {}


class TestHeld:
    """What the hand holds: a message counts as a whole, or not at all."""

    def ball(self, number: int = 1, **fields: Any) -> Marker:
        marker = Marker(header=Header(frame_id="panda_grasptarget"), ns="toy", id=number, type=Marker.SPHERE, **fields)
        marker.scale.x = marker.scale.y = marker.scale.z = 0.06
        return marker

    def tell(self, bench: Bench, *markers: Marker) -> tuple[list[str], str]:
        """Names of what is held after a message, and why that is not known."""
        bench.inputs.obstacles.receive_held(serialize_message(MarkerArray(markers=list(markers))))
        snapshot = bench.inputs.snapshot()
        return [held.name for held in snapshot.held], snapshot.held_refused

    def test_all_of_a_message_or_nothing(self, bench):
        assert self.tell(bench, self.ball(), self.ball(2)) == (["toy/1", "toy/2"], "")
        mesh = self.ball(3)
        mesh.type, mesh.mesh_resource = Marker.MESH_RESOURCE, "package://toys/car.stl"
        names, refused = self.tell(bench, self.ball(4), mesh)
        assert names == ["toy/1", "toy/2"]
        assert "marker toy/3: type 10, a mesh" in refused
        assert bench.inputs.refusals.counts == {"~/held_objects": 1}
        # What is said of other objects, or of none, does not say what was to be attached.
        assert self.tell(bench) == (names, refused)
        assert self.tell(bench, self.ball()) == (names, refused)
        assert self.tell(bench, self.ball(4)) == ([*names, "toy/4"], refused)
        assert self.tell(bench, self.ball(3, action=Marker.DELETE)) == ([*names, "toy/4"], "")

    def test_an_object_whose_replacement_was_refused_still_counts_and_can_be_detached(self, bench):
        self.tell(bench, self.ball())
        names, refused = self.tell(bench, self.ball(lifetime=Duration(sec=1)))
        assert names == ["toy/1"]
        assert "lifetime" in refused
        assert self.tell(bench, self.ball(action=Marker.DELETE)) == ([], "")

    @pytest.mark.parametrize(("namespace", "why"), [("toy", ""), ("", ""), ("other", "marker toy/1: action 7")])
    def test_what_is_unknown_is_detached_with_its_namespace(self, bench, namespace, why):
        self.tell(bench, self.ball(action=7))
        _, refused = self.tell(bench, Marker(ns=namespace, action=Marker.DELETEALL))
        assert refused[: len(why)] == why
        assert bool(refused) == bool(why)

    def test_to_detach_what_is_not_held_changes_nothing(self, bench):
        self.tell(bench, self.ball())
        assert self.tell(bench, self.ball(2, action=Marker.DELETE)) == (["toy/1"], "")
        assert "nothing of this name is held; held: toy/1" in bench.inputs.refusals.newest(PATIENCE)
        assert self.tell(bench, self.ball(action=Marker.DELETE)) == ([], "")

    def test_what_is_no_marker_array(self, bench):
        bench.inputs.obstacles.receive_held(b"\x00\x01\x00\x00\xff")
        assert bench.inputs.snapshot().held_refused
        assert self.tell(bench, self.ball())[1]
        assert self.tell(bench, Marker(action=Marker.DELETEALL)) == ([], "")
