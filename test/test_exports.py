"""What the package itself hands out, and how little it loads for that."""

from __future__ import annotations

import subprocess
import sys

import pytest

import geodesic_motion_ros

HEAVY = {"numpy", "numba", "scipy", "torch", "rclpy", "pybullet", "matplotlib"}


@pytest.mark.parametrize("name", geodesic_motion_ros.__all__)
def test_the_package_hands_out_the_class_of_a_module(name: str) -> None:
    found = getattr(geodesic_motion_ros, name)
    assert isinstance(found, type)
    assert found.__name__ == name
    assert name in dir(geodesic_motion_ros)


def test_what_it_does_not_have_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Whatever'"):
        geodesic_motion_ros.Whatever  # noqa: B018
    with pytest.raises(ImportError):
        from geodesic_motion_ros import Whatever  # noqa: F401


def loaded_by(code: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; {code}; print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    return {name.partition(".")[0] for name in done.stdout.split()}


def test_importing_the_package_loads_no_library() -> None:
    assert not loaded_by("import geodesic_motion_ros") & HEAVY


def test_what_it_hands_out_needs_neither_torch_nor_ros_nor_pybullet() -> None:
    loaded = loaded_by(f"from geodesic_motion_ros import {', '.join(geodesic_motion_ros.__all__)}")
    assert "numpy" in loaded
    assert not loaded & {"torch", "rclpy", "pybullet", "matplotlib"}
