"""Pictures of the demo: when what is shown of a recording."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.demo.demo_pictures import instants_of_motion, met
from geodesic_motion_ros.demo.demo_run import Recording


def test_instants_of_motion_leave_out_where_the_arm_stands() -> None:
    """A second of standing, two of motion, three of trembling: five pictures show start and motion."""
    times = np.arange(0.0, 6.0, 0.01)
    covered = np.clip(times - 1.0, 0.0, 2.0) * 0.1 + 1e-4 * np.sin(40.0 * times)
    instants = instants_of_motion(times, covered[:, None] * [1.0, 0.0, 0.0], 5)
    assert instants[0] == 0.0
    np.testing.assert_allclose(instants[1:], [1.5, 2.0, 2.5, 3.0], atol=0.11)


def test_what_does_not_move_is_shown_at_even_times() -> None:
    times = np.linspace(0.0, 4.0, 100)
    instants = instants_of_motion(times, np.ones((100, 3)), 3)
    np.testing.assert_allclose(instants, [0.0, 2.0, 4.0], atol=0.11)


def test_an_obstacle_was_met_where_it_was_nearest() -> None:
    """It comes down onto a point that moves along; they are nearest at two seconds, though the path ends elsewhere."""
    times = np.linspace(0.0, 4.0, 81)
    points = times[:, None] * [0.1, 0.0, 0.0]
    obstacles = [np.array([0.2, 0.0, 0.1 + 0.1 * abs(time - 2.0)]) for time in times]
    sphere = met(Recording(obstacle_times=times.tolist(), obstacles=obstacles), times, points, 0.05)
    np.testing.assert_allclose(sphere.centre, [0.2, 0.0, 0.1], atol=1e-9)
    assert sphere.radius == 0.05
    assert len(sphere.track) == len(times)
