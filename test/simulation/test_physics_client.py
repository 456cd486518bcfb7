"""PyBullet's functions reach the client's own server and no other."""

from __future__ import annotations

import subprocess
import sys

import pybullet
import pytest

from geodesic_motion_ros.simulation.physics_client import PhysicsClient
from geodesic_motion_ros.utils.errors import ParameterError


def test_each_client_has_a_world_of_its_own() -> None:
    first, second = PhysicsClient(), PhysicsClient()
    try:
        first.createMultiBody(0.0, first.createCollisionShape(first.GEOM_SPHERE, radius=0.1))
        assert first.getNumBodies() == 1
        assert second.getNumBodies() == 0
    finally:
        first.disconnect()
        assert not first.isConnected()
        assert second.isConnected()
        second.disconnect()


def test_constants_are_those_of_pybullet() -> None:
    client = PhysicsClient()
    try:
        assert client.GEOM_SPHERE == pybullet.GEOM_SPHERE
    finally:
        client.disconnect()


def test_a_window_without_a_display_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(ParameterError, match="DISPLAY"):
        PhysicsClient(gui=True)


def test_loading_it_prints_nothing_and_leaves_standard_error_open() -> None:
    code = "import sys, geodesic_motion_ros.simulation.physics_client; print('still open', file=sys.stderr)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (ran.stdout, ran.stderr) == ("", "still open\n")
