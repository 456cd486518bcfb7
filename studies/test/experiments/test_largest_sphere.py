"""Spheres on the tool's path: what is passed grows with the detour, and what is handed over is complete."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.largest_sphere import LargestSphere, LargestSpheres


@pytest.fixture(scope="module")
def found() -> LargestSpheres:
    return LargestSphere("panda_bottle2shelf", 4, (0.1, 0.0)).measure(Path())


def test_a_longer_detour_passes_more(found: LargestSpheres) -> None:
    np.testing.assert_array_equal(found.detours, [0.0, 0.1])
    assert np.all(found.radii[:, 1] >= found.radii[:, 0])
    assert found.radii[1, 1] > found.radii[1, 0] + 0.01


def test_what_covers_an_end_is_passed_nowhere_and_the_next_one_has_a_reason(found: LargestSpheres) -> None:
    assert np.all(found.radii <= found.free[:, None] + 1e-9)
    assert all(reason for reasons in found.reasons for reason in reasons)


def test_what_is_handed_over_is_complete(found: LargestSpheres, tmp_path: Path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", found.as_dict()).read_text())
    assert np.shape(content["radii_m"]) == (4, 2)
    assert content["places_where_it_leaves_the_ends_free"] <= 4
    lines = found.table().splitlines()
    assert max(map(len, lines)) <= 120
    assert sum(line.startswith("detour ") for line in lines) == 2
    found.draw(tmp_path / "largest_sphere.png")
    assert (tmp_path / "largest_sphere.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("places", "detours"), [(1, (0.1,)), (5, ()), (5, (0.1, 0.31)), (5, (float("nan"),))])
def test_what_cannot_be_measured_is_refused(places: int, detours: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError, match=r"at least 2 is needed|from 0 to"):
        LargestSphere("panda_bottle2shelf", places, detours)
