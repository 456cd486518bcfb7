"""The bench: planner and twin as two processes over DDS, relays between them, and everything recorded that they say."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from geodesic_motion_ros.demo.demo_run import Processes, isolated_environment
from geodesic_motion_ros.nodes.parameter_tables import TABLES
from geodesic_motion_ros.nodes.twin_parameters import start_joints
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import GeodesicMotionError
from geodesic_motion_ros.utils.shared_files import find_shared
from geodesic_motion_studies.faults.asking import Asking
from geodesic_motion_studies.faults.bench_clock import BenchClock
from geodesic_motion_studies.faults.commands import Commands
from geodesic_motion_studies.faults.fault import (
    FILTER,
    MOTION,
    PLANNER,
    START,
    STATE_TIMEOUT,
    Fault,
    Findings,
    NotSeenError,
)
from geodesic_motion_studies.faults.offering import AS_PLANNED, Offering
from geodesic_motion_studies.faults.record import Record, Status
from geodesic_motion_studies.faults.relay import Relay
from geodesic_motion_studies.faults.standstill import Standstill

#: Longest time [s] to wait for nodes that start, and for an arm that moves.
START_PATIENCE, PATIENCE = 60.0, 25.0
#: Topics between twin and planner that a relay stands in.
RELAYED = {"joint_states": JointState, "obstacles": MarkerArray, "obstacle_point": PointStamped}
_PLANNER = {"latent_view_rate": 0.0, "state_timeout": STATE_TIMEOUT}
_OF_FILTER = {"use_sim_time", *(parameter.name for parameter in TABLES[FILTER])}
#: An arm whose joints are so far off [rad] is where it begins.
_AT_START = 0.02


class Bench:
    """Runs the two nodes of a skill, talks to them and records them; all of it in the caller's thread.

    Attributes
    ----------
    relays : by topic. clock : that the nodes run by where a fault wants one.
    seen : what the nodes say. asks : talks to them. commands : what the planner commands.
    """

    def __init__(
        self,
        skill: str,
        folder: Path,
        domain: int,
        planner_on: Sequence[str] = (),
        output: str = "joint_trajectory",
        subject: str = PLANNER,
    ) -> None:
        """skill : a folder, or the name of a shipped skill. folder : for parameter files and logs of the nodes.
        output : what commands the arm, joint_trajectory or target_pose.
        subject : whose faults these are. A filter goes by the name of the planner, and is offered the motions of the
        skill. planner_on : a command that runs the planner on another host; none: it runs on this one.
        """
        self.skill_name, self.skill = skill, Skill.load(skill)
        self.robot = Robot.named(self.skill.robot)
        self.goal = self.skill.goal_pose
        self._body = CollisionModel.named(self.skill.robot)
        # Compiled now, not while messages wait to be passed on.
        self._body.positions(self.robot, self.robot.ready[None])
        self.domain, self.subject = domain, subject
        if planner_on:
            # That of a bench on one host, which began this process: it keeps to the loopback device.
            os.environ.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
        # LOCALHOST would add shared memory, which the nodes do not use by default.
        self.environment = isolated_environment(domain) | (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
            if planner_on
            else {
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
                "FASTRTPS_DEFAULT_PROFILES_FILE": str(find_shared("config/loopback.xml")),
            }
        )
        self.folder = folder
        self.processes = Processes(folder, self.environment)
        self._planner_on = planner_on
        self._given: dict[str, dict[str, Any]] = {}
        #: Why nodes that ran were started again, in order.
        self.restarts: list[str] = []
        self._context = rclpy.Context()
        # Read when the context begins, of this process too.
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET" if planner_on else "LOCALHOST"
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("bench", context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._standstill = Standstill()
        self._executor.add_node(self.node)
        self.clock = BenchClock(self.node)
        self.relays = {topic: Relay(self.node, kind, topic, f"relayed/{topic}") for topic, kind in RELAYED.items()}
        self.seen = Record(self.node, self.robot, self.clock)
        if subject == FILTER:
            self.asks: Asking = Offering(self.node, self.skill, self.relays["obstacles"], self.wait, self.seen)
        else:
            self.asks = Asking(self.node, self.skill, self.relays["obstacles"], self.wait)
        self.commands = Commands(self._context, self.skill, self.robot, output, self.clock, self.seen)
        # Nor for a collection of all libraries' objects.
        gc.collect()
        gc.freeze()

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.processes.__exit__()
        self._standstill.close()
        self.commands.close()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    # ------------------------------------------------------------------ nodes

    def start(self, name: str, parameters: Mapping[str, Any]) -> None:
        """Start `planner` or `twin`; its parameters are those of the bench and these."""
        if name == "planner":
            self._start_planner(self.processes, parameters, self._planner_on)
        else:
            self.processes.start(name, {"skill": self.skill_name, **parameters})
        self._given[name] = dict(parameters)

    def _start_planner(
        self, processes: Processes, parameters: Mapping[str, Any], before: Sequence[str] = ()
    ) -> None:
        remapped = {topic: f"relayed/{topic}" for topic in RELAYED}
        given = _PLANNER | {"skill": self.skill_name, "output": self.commands.topic, **parameters}
        if self.subject == FILTER:
            given = {"robot": self.skill.robot, "scene": "none", **AS_PLANNED, **given}
            given = {key: value for key, value in given.items() if key in _OF_FILTER}
            processes.start("planner", given, remapped | {"__node": "planner"}, before, "nodes.filter_node")
        else:
            processes.start("planner", given, remapped, before)

    def prepare(self, planner: Mapping[str, Any], twin: Mapping[str, Any], fresh: bool = False) -> None:
        """Bring both nodes to where the arm stands at its start without a goal, nothing disturbed."""
        sim = bool(planner.get("use_sim_time"))
        wanted = {"planner": dict(planner), "twin": dict(twin) | ({"use_sim_time": True} if sim else {})}
        if fresh or self._given != wanted:
            objection = "other parameters"
        else:
            objection = self._renewed()
        if objection:
            self.restarts.append(objection)
            self.stop_nodes()
            self.clock.run(sim)
            self.seen.forget()
            for name in ("twin", "planner"):
                self.start(name, wanted[name])
            self._wait_for_nodes()
        self.seen.begin()
        self.commands.begin()
        self._standstill.take()
        self.spend(0.05)

    def stop_nodes(self) -> None:
        """End what runs, in order; relays pass everything on again."""
        self.processes.__exit__()
        self._given.clear()
        self.asks.forget()
        for relay in self.relays.values():
            relay.release()

    def restart(self, name: str) -> None:
        """Start a node again as it was started last."""
        self.start(name, self._given[name])

    def attempt(self, parameters: Mapping[str, Any]) -> tuple[int, str]:
        """Start another planner, which is to refuse its parameters: its exit code and what it says."""
        with Processes(self.folder / "refused", self.environment) as processes:
            self._start_planner(processes, parameters)
            began = time.monotonic()
            self.wait(
                lambda: processes.exit_code("planner") is not None or time.monotonic() > began + START_PATIENCE,
                "a refusal", 2.0 * START_PATIENCE,
            )  # fmt: skip
            code = processes.exit_code("planner")
            return (0 if code is None else code), processes.log("planner")

    def memory(self, name: str) -> float:
        """What a node occupies in memory, MB."""
        status = Path(f"/proc/{self.processes.number(name)}/status").read_text()
        return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]) / 1024.0

    def _wait_for_nodes(self) -> None:
        def ready() -> bool:
            listened = self.asks.is_heard and all(relay.listeners for relay in self.relays.values())
            if not listened or self.seen.status is None or self.seen.status.code != "NO_GOAL":
                return False
            return "/twin" in self.seen.status.values["commands_received_by"].split()

        self.wait(ready, "planner and twin to start", START_PATIENCE)

    def _renewed(self) -> str:
        """Bring nodes that run back to the beginning: '', or how they do not follow."""
        for relay in self.relays.values():
            relay.release()
        self.clock.set_speed(1.0)
        try:
            self.asks.tell_spheres([])
            self.asks.hold(False)
            self.asks.show_scene({})
            self.asks.trigger("planner/clear_obstacles")
            self.asks.trigger("twin/reset")
            since = time.monotonic()
            self.verdict("NO_GOAL", since=since + 0.3, patience=5.0)
        except GeodesicMotionError as error:
            return str(error)
        off = float(np.max(np.abs(self.seen.configuration - start_joints(self.skill_name))))
        return "" if off < _AT_START else f"the arm is {off:.3f} rad from its start"

    # ------------------------------------------------------------------ phases

    def reach(self, phase: str, fault: Fault, random: np.random.Generator) -> None:
        """Let the arm reach a phase of a fault; when exactly is up to chance."""
        if phase == START:
            return
        self.set_out(START)
        whole = self.seen.status.number("time_to_goal")
        left = random.uniform(*fault.in_motion) * whole if phase == MOTION else random.uniform(*fault.near_goal)
        self.wait(
            lambda: self.seen.status.code == "OK" and self.seen.status.number("time_to_goal") < left,
            f"the phase {phase}",
        )

    def set_out(self, phase: str) -> None:
        """At the start let the arm set out for its goal; in other phases it has."""
        if phase == START:
            self.asks.send_goal()
            self.wait(lambda: len(self.seen.path) and self.seen.status.code == "OK", "a path")

    def finish(self, findings: Findings) -> None:
        """Motion resumes after a fault has cleared: the arm reaches its goal, which is sent again where it was
        dropped or never taken."""
        since = time.monotonic()
        self.wait(
            lambda: self.seen.status.sent > since + 0.7 and not self.seen.status.lost, "the planner to settle"
        )
        if self.seen.status.without_goal:
            self.asks.send_goal()
        began = time.monotonic()
        try:
            self.arrive()
        except NotSeenError:
            status = self.seen.status
            findings.require(False, f"the goal is not reached afterwards: {status.code}: {status.reason}")
            return
        findings.note(f"goal reached {time.monotonic() - began:.1f} s after")

    def arrive(self, patience: float = PATIENCE) -> None:
        """Wait until the arm rests at its goal."""

        def arrived() -> bool:
            status = self.seen.status
            return status.code == "OK" and status.number("time_to_goal") == 0.0 and self.seen.rests

        self.wait(arrived, "arrival at the goal", patience)

    def judge(self, findings: Findings) -> None:
        """Judge every command of the run so far, and say how much of it the machine let be."""
        self.commands.judge(findings)
        findings.note(f"machine stood still for {1000.0 * self._standstill.take():.0f} ms at most")

    def distances_from_arm(self, points: np.ndarray) -> np.ndarray:
        """Of points (n, 3) from the arm where it is, (n,) [m]."""
        body = self._body.positions(self.robot, self.seen.configuration[None])[0]
        return np.min(np.linalg.norm(points[:, None] - body, axis=-1) - self._body.radii, axis=1)

    # ------------------------------------------------------------------ waiting

    def wait(self, condition: Callable[[], Any], what: str, patience: float = PATIENCE) -> float:
        """Wait until a condition is true; the time that took [s]. NotSeenError after too long."""
        began = time.monotonic()
        while not condition():
            self._executor.spin_once(timeout_sec=0.02)
            self.processes.check()
            if time.monotonic() - began > patience:
                status = self.seen.status
                said = "nothing" if status is None else f"{status.code}: {status.reason}"
                raise NotSeenError(f"timed out after {patience:g} s waiting for {what}; the planner says {said}")
        return time.monotonic() - began

    def spend(self, duration: float) -> None:
        """Go on for so long [s]."""
        end = time.monotonic() + duration
        self.wait(lambda: time.monotonic() >= end, "time to pass", duration + PATIENCE)

    def verdict(
        self, code: str, text: str = "", since: float | None = None, patience: float = PATIENCE, of: str = ""
    ) -> Status:
        """A status after `since` [s, steady clock] with a code, and a text in its reason; of "goal_": what is said of
        the newest goal.
        """
        return self._first(
            lambda status: status.values[f"{of}code"] == code and text in status.values[f"{of}reason"],
            time.monotonic() if since is None else since, f"{code} {text}".strip(), patience,
        )  # fmt: skip

    def rest(self) -> float:
        """Wait until nothing that moves is commanded any more; the time that took [s]."""
        return self.wait(lambda: self.seen.status.number("speed") == 0.0, "rest")

    def ticks_until(self, since: float, condition: Callable[[Status], object], what: str) -> tuple[int, Status]:
        """Ticks of the planner from `since` [s, steady clock] to the first status that fulfils a condition."""
        before = [status for status in self.seen.statuses if status.sent <= since][-1]
        found = self._first(condition, since, what, PATIENCE)
        return int(found.number("tick") - before.number("tick")), found

    def _first(self, condition: Callable[[Status], object], since: float, what: str, patience: float) -> Status:
        """The first status after a moment [s, steady clock] that fulfils a condition."""
        found: list[Status] = []
        looked_at = len(self.seen.statuses) - len(self.seen.since(since))

        def seen() -> bool:
            nonlocal looked_at
            fresh, looked_at = self.seen.statuses[looked_at:], len(self.seen.statuses)
            found.extend(status for status in fresh if status.sent > since and condition(status))
            return bool(found)

        self.wait(seen, what, patience)
        return found[0]
