"""How fast starts fade: found in demonstrations of which it is known, and 1 where they do not say."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.canonical import LARGEST_OFFSET, ConfigurationForm, PoseForm
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.fade import FADES, likeliest_fade, scatter_within
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.robot.kinematics import Robot

ROBOT, METRIC = Robot.named("panda"), JointMetricSettings()
#: Of starts [m], beside the line that all follow.
SPREAD = 0.03
SHARE = np.linspace(0.0, 1.0, 200)[:, None]


def joining(fade: float, spread: float, seed: int = 0, count: int = 7) -> Demonstrations:
    """Poses that start so far [m] beside a line of half a metre and join it with a fade, each with its own bend."""
    random = np.random.default_rng(seed)
    line = np.concatenate([0.5 * SHARE, 0.0 * SHARE, 0.3 + 0.0 * SHARE], axis=1)
    items = []
    for number in range(count):
        beside, bend = np.zeros((2, 3))
        beside[1:], bend[1:] = spread * random.normal(size=2), 0.003 * random.normal(size=2)
        positions = line + (1.0 - SHARE) ** fade * beside + np.sin(np.pi * SHARE) * bend
        items.append(Demonstration(positions, np.tile([1.0, 0.0, 0.0, 0.0], (200, 1)), 3.0 * SHARE[:, 0], f"d{number}"))
    return Demonstrations(tuple(items))


@pytest.mark.parametrize("seed", range(3))
def test_the_fade_of_the_demonstrations_is_found(seed):
    assert PoseForm(joining(4.0, SPREAD, seed), 0.1).fade == 4.0
    # The control: the same starts, faded linearly.
    assert PoseForm(joining(1.0, SPREAD, seed), 0.1).fade == 1.0


def test_demonstrations_that_begin_at_one_place_say_nothing():
    assert PoseForm(joining(4.0, 0.0), 0.1).fade == 1.0
    assert likeliest_fade(lambda fade: 0.0, 5) == 1.0


def test_a_gain_that_chance_explains_is_none():
    assert likeliest_fade(lambda fade: 1.0 if fade == 1.0 else 0.9, 7) == 1.0
    # The control: the same gain of many more.
    assert likeliest_fade(lambda fade: 1.0 if fade == 1.0 else 0.9, 70) > 1.0


def test_demonstrations_are_most_alike_with_their_own_fade():
    forms = {fade: PoseForm(joining(4.0, SPREAD), 0.1, fade).sheet(100) for fade in FADES}
    scattered = {fade: scatter_within(form.positions, np.zeros(7)) for fade, form in forms.items()}
    assert scattered[4.0] < scattered[2.0] < scattered[1.0]


def test_offsets_come_out_and_go_in_with_the_fade():
    shown = joining(4.0, SPREAD)
    form = PoseForm(shown, 0.1).sheet(100)
    left = (1.0 - np.linspace(0.0, 1.0, 100)[:, None]) ** form.fade
    for number in range(len(shown)):
        offset = left * form.start_offsets[number, :3] + (1.0 - left) * form.goal_offsets[number, :3]
        expected = PoseForm(Demonstrations((shown[number],)), 0.1).sheet(100).positions[0]
        np.testing.assert_allclose(form.positions[number] + offset, expected, atol=1e-12)


def test_modes_scatter_about_means_of_their_own():
    curves = np.zeros((4, 10, 2))
    curves[2:] = 5.0
    assert scatter_within(curves, np.array([0, 0, 1, 1])) == 0.0
    assert scatter_within(curves, np.zeros(4)) == pytest.approx(4 * 10 * 2 * 2.5**2)


def arm_joining(fade: float, starts: np.ndarray) -> JointDemonstrations:
    """Reaches of the arm that start so far (N, 7) [rad] beside the common one and join it with a fade, each with a bend
    of its own.
    """
    first = np.array([0.2, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8])
    last = np.array([-0.6, 0.5, 0.0, -1.7, 0.0, 2.4, 0.3])
    path = first + SHARE * (last - first)
    bends = np.sin(np.pi * SHARE)[None] * np.random.default_rng(0).normal(scale=0.03, size=(len(starts), 1, 7))
    items = []
    for number, start in enumerate(starts):
        offsets = JointOffsets.between(ROBOT, path[[0, -1]], path[[0, -1]] + [start, np.zeros(7)], fade=fade)
        moved = path + offsets.displacements(path, SHARE[:, 0]) + bends[number]
        items.append(JointDemonstration(moved, 3.0 * SHARE[:, 0], f"d{number}"))
    return JointDemonstrations(tuple(items), ROBOT.joint_names, "panda")


def test_the_fade_of_an_arm_is_found():
    starts = np.random.default_rng(1).normal(scale=0.12, size=(7, 7))
    assert ConfigurationForm(arm_joining(4.0, starts), ROBOT, METRIC).fade == 4.0
    assert ConfigurationForm(arm_joining(1.0, starts), ROBOT, METRIC).fade == 1.0
    assert ConfigurationForm(arm_joining(4.0, starts), ROBOT, METRIC, fade=1.0).fade == 1.0


@pytest.mark.parametrize(("apart", "groups"), [(0.8, 1), (2.5, 2)])
def test_a_start_has_a_pole_of_its_own_only_where_the_mean_of_all_is_out_of_reach(apart, groups):
    starts = np.random.default_rng(1).normal(scale=0.03, size=(7, 7))
    starts[-2:, 0] += apart
    form = ConfigurationForm(arm_joining(1.0, starts), ROBOT, METRIC)
    assert len(form.start_poles) == groups
    assert np.linalg.norm(form.start_offsets, axis=1).max() < LARGEST_OFFSET
