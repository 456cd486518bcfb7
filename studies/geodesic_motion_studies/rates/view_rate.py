"""What a page in the browser costs a planner that moves a twin, and how soon it answers a sphere that is dragged.

First the page is a process of its own, as `geodesic-motion view --control` starts it: nobody looks at it, or a
headless Chromium does, which renders by the processor. Then it is part of this process, which drags its sphere into
the path, as `reaction_time` shows one.
"""

from __future__ import annotations

import os
import shutil
import socket
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from geodesic_motion_ros.nodes.view_node import ViewNode
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.rates.planner_stream import PATIENCE, PlannerStream
from geodesic_motion_studies.rates.reaction_time import ReactionRow, answers, reaction_row

#: Names of programs that are a Chromium.
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: Where the page's sphere is in nobody's path (3,) [m].
_AWAY = np.array([-0.6, 0.6, 1.2])


@dataclass(frozen=True)
class ViewRow:
    """Who looks, the planner's rate [Hz] and its ticks [ms], and the shares of a core of planner, page and browser."""

    looks: str
    rate: float
    tick_p50: float
    tick_p99: float
    planner_percent: float
    page_percent: float
    browser_percent: float


def browser() -> str | None:
    """Return the path of a Chromium; None where there is none."""
    return next(filter(None, map(shutil.which, _BROWSERS)), None)


def measure_view(skill: str, folder: Path, seconds: float = 10.0, domain: int = 85) -> list[ViewRow]:
    """Let a planner move a twin to and fro, without a page, with one, and with a browser that shows it.

    seconds : length of each stretch.

    Raises
    ------
    ParameterError : seconds is not positive. DemoError : a node ends or does not answer.
    """
    if not seconds > 0.0:
        raise ParameterError(f"seconds {seconds}: must be positive")
    port = _free_port()
    page = [
        sys.executable, "-m", "geodesic_motion_ros", "view", skill, "--control", "--port", str(port),
    ]  # fmt: skip
    looking: dict[str, dict[str, Sequence[str]]] = {"no page": {}, "a page": {"page": page}}
    if browser() is not None:
        shown = _browser_command(folder / "profile", f"http://127.0.0.1:{port}")
        looking["a page, and a browser"] = {"page": page, "browser": shown}
    rows = []
    for name, beside in looking.items():
        with PlannerStream(skill, folder / name.replace(" ", "_"), 100.0, domain, beside=beside) as stream:
            rows.append(_stretch(stream, name, tuple(beside), seconds))
    return rows


def measure_drags(skill: str, folder: Path, drags: int = 50, domain: int = 85) -> list[ReactionRow]:
    """Drag the page's sphere into the path of the moving arm, and time the planner's answers, from the drag on.

    Raises
    ------
    ParameterError : drags is not positive. DemoError : a node ends or does not answer.
    """
    if drags <= 0:
        raise ParameterError(f"drags {drags}: must be positive")
    with PlannerStream(skill, folder / "drags", 100.0, domain) as stream, _page(stream, skill) as view:
        stream.spheres = None
        stream.wait(lambda: view.page.spheres, PATIENCE)
        ((number, *_),) = view.page.spheres
        times = answers(stream, drags, lambda place: view.page.drag(number, _AWAY if place is None else place))
        return [reaction_row(100.0, drags, times)]


def table(rows: Sequence[ViewRow]) -> str:
    """The rows as plain text."""
    head = ["", "rate Hz", "tick p50 ms", "p99 ms", "planner % of a core", "page %", "browser %"]
    return text_table(head, [list(astuple(row)) for row in rows], digits=1)


def _stretch(stream: PlannerStream, name: str, beside: Sequence[str], seconds: float) -> ViewRow:
    """Send goals by turns, each as the one before is reached, and sum up the ticks and the processor time."""
    names = ("planner", *beside)
    goals = [stream.skill.goal_pose, stream.skill.start_pose]
    stream.send_goal(*np.split(goals[0], [3]))
    stream.wait(lambda: stream.code == "OK", PATIENCE)
    stream.ticks.clear()
    before, begin = {one: stream.processor_time(one) for one in names}, stream.now()

    def over() -> bool:
        if stream.time_to_goal == 0.0:
            goals.reverse()
            stream.send_goal(*np.split(goals[0], [3]))
        return stream.now() - begin >= seconds

    stream.wait(over, seconds + PATIENCE)
    lasted = stream.now() - begin
    shares = {one: 100.0 * (stream.processor_time(one) - before[one]) / lasted for one in names}
    first, last = stream.ticks[0], stream.ticks[-1]
    p50, p99 = np.percentile([tick.duration for tick in stream.ticks], [50.0, 99.0])
    rate = (last.number - first.number) / (last.time - first.time)
    of_core = [shares.get(one, float("nan")) for one in ("planner", "page", "browser")]
    return ViewRow(name, rate, float(p50), float(p99), *of_core)


@contextmanager
def _page(stream: PlannerStream, skill: str) -> Iterator[ViewNode]:
    """A page of this process, beside a stream."""
    overrides = [Parameter("port", value=0), Parameter("control", value=True), Parameter("skill", value=skill)]
    view = ViewNode(context=stream.node.context, parameter_overrides=overrides)
    executor = SingleThreadedExecutor(context=stream.node.context)
    executor.add_node(view)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    view.start()
    try:
        yield view
    finally:
        view.stop()
        executor.shutdown()
        thread.join()
        view.destroy_node()


def _browser_command(profile: Path, address: str) -> list[str]:
    root = ["--no-sandbox"] if os.geteuid() == 0 else []
    return [
        str(browser()), "--headless=new", *root, "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        "--remote-debugging-port=0", f"--user-data-dir={profile}", address,
    ]  # fmt: skip


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
