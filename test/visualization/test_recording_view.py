"""The picture of a recording: what is drawn against which axis."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from geodesic_motion_ros.demonstrations.takes import POSE, Take
from geodesic_motion_ros.visualization.recording_view import _draw_take

TIMES = np.linspace(0.0, 1.0, 20)


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (POSE, {"position [m]": 3, "quaternion (dotted)": 4}),
        (POSE[:3], {"position [m]": 3}),
        (("a", "b", "c", "d", "e"), {"joints [rad]": 5}),
    ],
)
def test_each_axis_has_what_its_label_says(names, labels) -> None:
    values = np.stack([0.1 * (number + 1) * TIMES for number in range(len(names))], axis=1)
    figure = Figure()
    _draw_take(figure.subplots(), Take("take", TIMES, values, names), [], frozenset(), [])
    assert {axes.get_ylabel(): len(axes.lines) for axes in figure.axes} == labels
