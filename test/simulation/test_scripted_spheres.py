"""Scripted obstacles are where the script says, and a script that makes no sense is refused by name."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from geodesic_motion_ros.simulation.scripted_spheres import (
    NAMED,
    CircleObstacle,
    LineObstacle,
    ScriptedSpheres,
    StaticObstacle,
    crossing,
    spheres_named,
)
from geodesic_motion_ros.utils.errors import ParameterError


def test_a_line_obstacle_waits_moves_and_stays() -> None:
    ball = LineObstacle(start=(0.0, 0.0, 0.0), end=(0.0, 1.0, 0.0), speed=0.5, radius=0.1, start_time=2.0)
    np.testing.assert_allclose(ball.position(0.0), [0.0, 0.0, 0.0])
    np.testing.assert_allclose(ball.position(3.0), [0.0, 0.5, 0.0])
    np.testing.assert_allclose(ball.position(9.0), [0.0, 1.0, 0.0])


def test_a_line_of_no_length_is_a_point() -> None:
    np.testing.assert_array_equal(
        LineObstacle((1.0, 2.0, 3.0), (1.0, 2.0, 3.0), 1.0, 0.1).position(5.0), [1, 2, 3]
    )


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (1.0, -2.0, 0.5)])
def test_a_circle_obstacle_stays_on_its_circle(axis: tuple[float, float, float]) -> None:
    orbit = CircleObstacle((0.4, 0.1, 0.3), amplitude=0.2, period=4.0, radius=0.05, axis=axis, start_time=1.0)
    offsets = np.array([orbit.position(t) for t in np.linspace(1.0, 5.0, 41)]) - [0.4, 0.1, 0.3]
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 0.2)
    np.testing.assert_allclose(offsets @ np.array(axis), 0.0, atol=1e-12)
    np.testing.assert_allclose(offsets[0], offsets[-1], atol=1e-12)
    np.testing.assert_allclose(offsets[0], -offsets[20], atol=1e-12)
    np.testing.assert_array_equal(orbit.position(0.0), orbit.position(1.0))


def test_a_crossing_obstacle_passes_its_point_on_time() -> None:
    point = np.array([0.4, -0.1, 0.3])
    ball = crossing(point, direction=np.array([0.0, 0.0, -2.0]), time=3.0, speed=0.1, radius=0.04, before=0.2)
    np.testing.assert_allclose(ball.position(3.0), point)
    np.testing.assert_allclose(ball.position(2.0), point + [0.0, 0.0, 0.1])
    np.testing.assert_allclose(ball.position(0.0), point + [0.0, 0.0, 0.2])
    assert (ball.speed, ball.radius) == (0.1, 0.04)


def test_spheres_come_from_yaml() -> None:
    script = ScriptedSpheres.from_dict(
        yaml.safe_load(
            """
            ball: {kind: line, start: [0.5, -0.4, 0.3], end: [0.5, 0.2, 0.3],
                   speed: 0.2, start_time: 1, radius: 0.05}
            post: {kind: static, centre: [0.4, 0, 0.2], radius: 0.04}
            """
        )
    )
    spheres = script.obstacles(2.0)
    assert list(spheres) == ["ball", "post"]
    np.testing.assert_allclose(spheres["ball"][0], [0.5, -0.2, 0.3])
    assert [radius for _, radius in spheres.values()] == [0.05, 0.04]


@pytest.mark.parametrize("name", sorted(NAMED))
def test_the_named_spheres_can_be_played(name: str) -> None:
    script = spheres_named(name)
    for time in (0.0, 1.0, 100.0):
        for centre, radius in script.obstacles(time).values():
            assert centre.shape == (3,)
            assert np.all(np.isfinite(centre))
            assert radius > 0.0


def test_an_unknown_name_is_answered_with_those_that_exist() -> None:
    with pytest.raises(ParameterError, match=r"'nowhere'.*empty, static, crossing"):
        spheres_named("nowhere")


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"kind": "spiral"}, "'ball' has kind 'spiral': the kinds are static, line, circle"),
        ({}, "kind None"),
        (3, "kind 3"),
        ({"kind": "static", "radius": 0.1}, "'ball' has no 'centre'"),
        ({"kind": "static", "centre": [0, 0, 0], "radius": 0.1, "colour": 1}, "unknown 'colour'"),
        ({"kind": "static", "centre": [0, 0, 0], "radius": 0.0}, "'ball': radius.*positive"),
        ({"kind": "static", "centre": [0, 0, 0], "radius": True}, "'ball': radius"),
        ({"kind": "static", "centre": [0, 0], "radius": 0.1}, "'ball': centre"),
        ({"kind": "static", "centre": 0.3, "radius": 0.1}, "'ball': centre"),
        ({"kind": "static", "centre": [0, float("nan"), 0], "radius": 0.1}, "'ball': centre"),
        ({"kind": "line", "start": [0, 0, 0], "end": [1, 0, 0], "speed": -1, "radius": 0.1}, "'ball': speed"),
        (
            {
                "kind": "line",
                "start": [0, 0, 0],
                "end": [1, 0, 0],
                "speed": 1,
                "radius": 0.1,
                "start_time": "now",
            },
            "'ball': start_time",
        ),
        (
            {"kind": "circle", "centre": [0, 0, 0], "amplitude": 1, "period": 0, "radius": 0.1},
            "'ball': period",
        ),
        (
            {
                "kind": "circle",
                "centre": [0, 0, 0],
                "amplitude": 1,
                "period": 1,
                "radius": 0.1,
                "axis": [0, 0, 0],
            },
            "'ball': axis",
        ),
        ({"kind": ["static"]}, "'ball' has kind"),
    ],
)
def test_a_script_that_makes_no_sense_is_named(entry: object, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        ScriptedSpheres.from_dict({"ball": entry})


def test_a_script_must_be_a_mapping() -> None:
    with pytest.raises(ParameterError, match="is a list"):
        ScriptedSpheres.from_dict([1, 2])


@pytest.mark.parametrize(
    "change",
    [{"direction": np.zeros(3)}, {"speed": 0.0}, {"before": -1.0}, {"radius": 0.0}, {"time": np.inf}],
)
def test_a_crossing_that_makes_no_sense_is_refused(change: dict) -> None:
    good = {"point": np.zeros(3), "direction": np.ones(3), "time": 1.0, "speed": 0.1, "radius": 0.05}
    with pytest.raises(ParameterError):
        crossing(**(good | change))


def test_obstacles_are_values() -> None:
    assert StaticObstacle((0.0, 0.0, 0.0), 0.1) == StaticObstacle((0.0, 0.0, 0.0), 0.1)
