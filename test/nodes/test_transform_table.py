"""Places of frames in each other are those of the composed transforms; what is not known is said. SciPy is the oracle.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.geometry.quaternions import from_rotation, to_rotation
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.transform_table import KEPT, NotYetKnown, TransformTable

#: [ns].
SECOND = 10**9


def matrix(origin: np.ndarray, rotation: Rotation) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation.as_matrix(), origin
    return made


def matrix_of(place: TaskFrame) -> np.ndarray:
    return matrix(place.origin, to_rotation(place.quaternion))


class Tree:
    """A table and, beside it, the same frames as matrices."""

    def __init__(self, seed: int) -> None:
        self.random, self.table = np.random.default_rng(seed), TransformTable()

    def pose(self) -> tuple[np.ndarray, Rotation]:
        return self.random.uniform(-2.0, 2.0, 3), Rotation.random(rng=self.random)

    def add(self, frame: str, parent: str, stamp: int, static: bool = False) -> np.ndarray:
        origin, rotation = self.pose()
        numbers = tuple(origin.tolist()), tuple(from_rotation(rotation).tolist())
        self.table.add(frame, parent, stamp, numbers, static)
        return matrix(origin, rotation)


@pytest.mark.parametrize("seed", range(5))
def test_any_frame_is_placed_in_any_other(seed) -> None:
    tree = Tree(seed)
    parents = {"base": "world", "arm": "base", "tool": "arm", "mast": "world", "camera": "mast"}
    above = {frame: tree.add(frame, parent, SECOND, static=frame == "mast") for frame, parent in parents.items()}

    def in_world(frame: str) -> np.ndarray:
        return np.eye(4) if frame == "world" else in_world(parents[frame]) @ above[frame]

    for target in ("world", *parents):
        for source in ("world", *parents):
            expected = np.linalg.inv(in_world(target)) @ in_world(source)
            found = tree.table.place(target, source, SECOND)
            np.testing.assert_allclose(matrix_of(found), expected, atol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.9, 1.0])
def test_between_two_stamps_a_frame_is_between_two_places(share) -> None:
    tree = Tree(1)
    ends = [tree.add("camera", "base", stamp) for stamp in (SECOND, 2 * SECOND)]
    tree.add("fixed", "camera", 0, static=True)
    place = tree.table.place("base", "camera", SECOND + round(share * SECOND))
    np.testing.assert_allclose(place.origin, (1.0 - share) * ends[0][:3, 3] + share * ends[1][:3, 3], atol=1e-12)
    turned = Slerp([0.0, 1.0], Rotation.from_matrix([end[:3, :3] for end in ends]))(share)
    np.testing.assert_allclose((to_rotation(place.quaternion).inv() * turned).magnitude(), 0.0, atol=1e-7)


def test_at_stamp_zero_it_is_the_newest_time_that_all_know() -> None:
    tree = Tree(2)
    arm = [tree.add("arm", "base", stamp) for stamp in (SECOND, 3 * SECOND)]
    tool = tree.add("tool", "arm", SECOND)
    np.testing.assert_allclose(matrix_of(tree.table.place("base", "tool", 0)), arm[0] @ tool, atol=1e-12)


def test_transforms_may_come_in_any_order() -> None:
    tree = Tree(3)
    places = {stamp: tree.add("camera", "base", stamp * SECOND) for stamp in (3, 1, 2)}
    for stamp, place in places.items():
        np.testing.assert_allclose(
            matrix_of(tree.table.place("base", "camera", stamp * SECOND)), place, atol=1e-12
        )  # fmt: skip
    corrected = tree.add("camera", "base", 2 * SECOND)
    np.testing.assert_allclose(matrix_of(tree.table.place("base", "camera", 2 * SECOND)), corrected, atol=1e-12)


def test_a_frame_that_gets_another_parent_is_there_alone() -> None:
    tree = Tree(4)
    tree.add("cup", "table", SECOND)
    held = tree.add("cup", "hand", 2 * SECOND)
    assert isinstance(tree.table.place("table", "cup", SECOND), Refusal)
    np.testing.assert_allclose(matrix_of(tree.table.place("hand", "cup", 2 * SECOND)), held, atol=1e-12)


def test_what_may_still_come_is_no_plain_refusal() -> None:
    tree = Tree(5)
    for step in range(15):
        tree.add("camera", "base", step * SECOND)
    oldest = 14 * SECOND - KEPT
    for source, stamp, reason in (
        ("camera", 14 * SECOND + 1, "up to"), ("map", SECOND, "nothing of map"), ("base", SECOND, ""),
        ("camera", oldest - 1, "after its stamp on"), ("camera", oldest, ""),
    ):  # fmt: skip
        found = tree.table.place("base", source, stamp)
        assert isinstance(found, Refusal) == bool(reason)
        assert isinstance(found, NotYetKnown) == (reason not in ("", "after its stamp on"))
        assert not reason or reason in found.reason


def test_frames_in_a_circle_end_no_search() -> None:
    tree = Tree(6)
    tree.add("one", "two", SECOND)
    tree.add("two", "one", SECOND)
    assert isinstance(tree.table.place("base", "one", SECOND), Refusal)
