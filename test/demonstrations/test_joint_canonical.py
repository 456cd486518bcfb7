"""Canonical form in joint space: offsets come out and go back in, and families are never averaged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.canonical import ConfigurationForm, sample_body_arc
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import DemonstrationError

ROBOT, METRIC = Robot.named("panda"), JointMetricSettings()


@pytest.fixture(scope="module")
def form(reach_demonstrations):
    return ConfigurationForm(reach_demonstrations, ROBOT, METRIC).sheet(60)


def test_samples_are_equally_far_apart_on_the_body(reach_demonstrations):
    path = sample_body_arc(reach_demonstrations[0].configurations, ROBOT, METRIC, 60)
    body = METRIC.body_points(ROBOT)
    points = place_body_points(path, body.frames, body.offsets, ROBOT.chain)
    moved = np.sum(np.diff(points, axis=0) ** 2, axis=-1).mean(axis=1)
    steps = np.sqrt(moved + METRIC.joint_weight**2 * np.sum(np.diff(path, axis=0) ** 2, axis=1))
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.02)
    np.testing.assert_array_equal(path[[0, -1]], reach_demonstrations[0].configurations[[0, -1]])


def test_canonical_demonstrations_begin_and_end_at_the_poles(form):
    np.testing.assert_allclose(form.configurations[:, 0], form.start_poles[form.start_groups], atol=1e-6)
    np.testing.assert_allclose(form.configurations[:, -1], form.goal_poles[form.goal_groups], atol=1e-6)


def test_adding_the_offsets_returns_the_demonstrations(form, reach_demonstrations):
    s = np.linspace(0.0, 1.0, 60)
    for number, item in enumerate(reach_demonstrations):
        shown = sample_body_arc(item.configurations, ROBOT, METRIC, 60)
        start, goal = form.start_poles[form.start_groups[number]], form.goal_poles[form.goal_groups[number]]
        np.testing.assert_allclose(form.start_offsets[number], shown[0] - start, atol=1e-12)
        offsets = JointOffsets.between(ROBOT, np.stack([start, goal]), shown[[0, -1]])
        returned = offsets.carried(form.configurations[number], s, np.zeros((60, 0)))
        np.testing.assert_allclose(returned, shown, atol=1e-6)


def test_families_that_begin_alike_have_one_pole(form):
    assert form.start_groups.tolist() == form.goal_groups.tolist() == [0] * 8
    np.testing.assert_allclose(form.start_offsets.mean(axis=0), 0.0, atol=1e-12)


def test_families_that_begin_apart_are_never_averaged(separated_demonstrations):
    form = ConfigurationForm(separated_demonstrations, ROBOT, METRIC).sheet(60)
    assert form.start_groups.tolist() == form.goal_groups.tolist() == [0, 0, 0, 1, 1, 1]
    starts = np.stack([item.configurations[0] for item in separated_demonstrations])
    for group in range(2):
        np.testing.assert_allclose(form.start_poles[group], starts[3 * group : 3 * group + 3].mean(axis=0))
    # The mean of all would be an arm that nobody showed.
    apart = np.linalg.norm(form.start_poles[0] - form.start_poles[1])
    assert apart > 5.0 * np.linalg.norm(form.start_offsets, axis=1).max()


def test_one_that_begins_elsewhere_is_named(reach_demonstrations):
    items = list(reach_demonstrations)[:2]
    odd = items[1].configurations + np.array([3.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    items[1] = JointDemonstration(odd, items[1].times, "odd")
    mixed = JointDemonstrations(tuple(items), reach_demonstrations.joint_names, "panda")
    with pytest.raises(DemonstrationError, match="starts further than"):
        ConfigurationForm(mixed, ROBOT, METRIC).sheet(60)


def test_the_order_of_demonstrations_does_not_matter(form, reach_demonstrations):
    backwards = replace(reach_demonstrations, items=reach_demonstrations.items[::-1])
    other = ConfigurationForm(backwards, ROBOT, METRIC).sheet(60)
    np.testing.assert_allclose(other.configurations[::-1], form.configurations, atol=1e-9)
