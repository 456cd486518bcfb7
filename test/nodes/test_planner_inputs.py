"""What the planner knows of the task frame, at times of the test's own."""

from __future__ import annotations

import pytest
from geometry_msgs.msg import PoseStamped


def test_the_task_frame_has_an_age_once_it_was_heard_and_is_never_silent(bench):
    assert "task_frame" not in bench.inputs.ages()
    frame = PoseStamped(header=bench.header(0.2))
    frame.pose.orientation.w = 1.0
    bench.inputs.on_task_frame(frame)
    bench.go(3.0)
    assert bench.inputs.ages() == {"task_frame": pytest.approx(3.2)}
    assert not bench.inputs.snapshot().silent_sources
