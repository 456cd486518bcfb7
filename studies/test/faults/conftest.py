"""A bench with a made planner, twin and time: what rows say of a planner that is right, and of one that has a flaw."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.marker_messages import read_marker, sphere_marker
from geodesic_motion_ros.nodes.messages import MessageRefused, read_joint_positions, seconds
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.faults import (
    asking,
    bench,
    goal_faults,
    message_faults,
    obstacle_faults,
    record,
    relay,
    state_faults,
)
from geodesic_motion_studies.faults.fault import STATE_TIMEOUT, Findings

FRAME = "panda_link0"
JOINTS = Robot.named("panda").joint_names
TIMEOUTS = {parameter.name: parameter.default for parameter in PLANNER if parameter.name.endswith("_timeout")}
PERIOD, SPEED, TOOL = 0.01, 0.2, 0.05
START, GOAL = np.array([0.5, -0.4, 0.4]), np.array([0.5, 0.4, 0.4])
#: The path (81, 3) [m]; its share is the position [rad] of the first joint, the others stand at 0.
PATH = START + np.linspace(0.0, 1.0, 81)[:, None] * (GOAL - START)
DURATION = float(np.linalg.norm(GOAL - START)) / SPEED
#: No wait takes longer than this [s], in which the arm can follow all its path.
PATIENCE = 5.0
#: A sphere nearer than this to the path blocks it [m].
ROOM = 0.1


class MadeTime:
    """A machine's steady clock."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now


class MadePlanner:
    """Goes straight to its goal, stops for what criteria want, and goes on; all but for its flaws.

    Attributes
    ----------
    share : of the path that the arm has followed. flaws : by name, as in `test_criteria.py`.
    keep : whether silence of obstacles is no reason to stop. ended : whether no goal is taken any more.
    """

    def __init__(self, flaws: Sequence[str]) -> None:
        self.flaws = set(flaws)
        self.tracker, self.keep, self.goal = ObstacleTracker(), False, False
        self.share, self.seen, self.stamp = 0.0, np.zeros(7), -math.inf
        self.refusals: dict[str, int] = {"joint_states": 0, "obstacles": 0}
        self.reason, self.refused_at = "", -math.inf
        # What is said, and when that was last what there was to say.
        self.verdict, self.agreed = ("NO_GOAL", ""), -math.inf
        self.ticks, self.ended = 0, False

    def hear_state(self, message: JointState, now: float) -> None:
        try:
            joints = read_joint_positions(message, JOINTS)
        except MessageRefused as error:
            self._refuse("joint_states", f"joint_states: {error}", now)
            return
        self.seen = np.array(message.position[:7]) if "reads in order" in self.flaws else joints
        self.stamp = now if "takes old for new" in self.flaws else seconds(message.header.stamp)

    def hear_obstacles(self, message: MarkerArray, now: float) -> None:
        for marker in message.markers:
            try:
                update = read_marker(marker, FRAME)
            except MessageRefused as error:
                self._refuse("obstacles", str(error), now)
                continue
            believed = update.stamp == 0.0 or "takes old for new" in self.flaws
            transit = 0.0 if believed else now - update.stamp
            self.tracker.hear("obstacles", now, transit)
            if update.action == "put":
                lifetime = 0.1 if "forgets early" in self.flaws else update.lifetime
                self.tracker.put(
                    "obstacles", update.key, update.centre, update.radius, now, lifetime, transit=transit
                )
            elif "never deletes" not in self.flaws:
                if update.action == "delete":
                    self.tracker.delete("obstacles", update.key, now, transit)
                else:
                    self.tracker.delete_all("obstacles", now, update.key[0], transit)

    def _refuse(self, topic: str, reason: str, now: float) -> None:
        self.refused_at = now
        self.refusals[topic] += "does not count" not in self.flaws
        self.reason = "" if "does not say why" in self.flaws else reason

    def tick(self, now: float) -> record.Status:
        """Looks, moves and says so."""
        judged = self._judged(now)
        late = 0.15 if "reacts late" in self.flaws and judged[0].startswith("STALE") else 0.0
        late = 0.05 if "answers late" in self.flaws and judged[0] != "NO_GOAL" else late
        if judged[0] == self.verdict[0]:
            self.agreed = now
        if now - self.agreed >= late or judged[0] == self.verdict[0]:
            self.verdict = judged
        if "stays" in self.flaws and self.verdict[0] not in ("OK", "NO_GOAL"):
            self.goal, self.ended = False, True
        goes = self.goal and self.share < 1.0 and (self.verdict[0] == "OK" or "rolls on" in self.flaws)
        self.share = min(1.0, self.share + goes * PERIOD / DURATION)
        self.ticks += 1
        goal_code = "OK" if self.goal else "NO_GOAL"
        values = {
            "code": self.verdict[0], "reason": self.verdict[1], "goal_code": goal_code, "goal_reason": "",
            "speed": SPEED * goes, "tick": self.ticks, "time_to_goal": (1.0 - self.share) * DURATION,
            "clearance": self._gap(now, round(80 * self.share)), "deadline_misses": 0, "refused_input": self.reason,
        }  # fmt: skip
        values |= {f"refused_{topic}": number for topic, number in self.refusals.items()}
        return record.Status(now, {key: str(value) for key, value in values.items()})

    def _judged(self, now: float) -> tuple[str, str]:
        timeout = 0.03 if "knows no patience" in self.flaws else STATE_TIMEOUT
        deaf = "does not mind silence" in self.flaws
        if now - self.stamp > timeout and not deaf:
            return "STALE_STATE", f"no joint_states; {self.reason}"
        if not self.goal:
            return "NO_GOAL", "no goal"
        if abs(self.seen[0] - self.share) > 0.1 or np.any(np.abs(self.seen[1:]) > 0.1):
            return "BAD_INPUT", "the arm is elsewhere"
        if "hesitates" in self.flaws and self.ticks % 20 == 0:
            return "BAD_INPUT", "for once"
        if "stops for nonsense" in self.flaws and now - self.refused_at < 0.1:
            return "BAD_INPUT", self.reason
        silent = self.tracker.silent(now, TIMEOUTS["obstacle_timeout"])
        late = self.tracker.late(now, TIMEOUTS["obstacle_timeout"])
        if (silent or late) and not deaf and (not self.keep or "always holds" in self.flaws):
            names = "an obstacle" if "names nothing" in self.flaws else ", ".join(silent | late)
            return "STALE_OBSTACLES", f"{names} not received" if silent else f"stamps lag: {names}"
        here = round(80 * self.share)
        if self._gap(now, here, here + 1) <= 0.0:
            return "IN_COLLISION", "the tool overlaps an obstacle"
        return ("NO_FEASIBLE_PATH", "blocked") if self._gap(now, here) <= ROOM else ("OK", "")

    def _gap(self, now: float, first: int, end: int | None = None) -> float:
        """Least distance [m] of spheres from a part of the path."""
        spheres = self.tracker.current(now)
        if "is blind" in self.flaws or not len(spheres):
            return math.inf
        apart = np.linalg.norm(PATH[first:end, None] - spheres.centres, axis=-1) - spheres.radii - TOOL
        return float(np.min(apart))


class MadeAsking(asking.Asking):
    """Asks the made planner and twin."""

    made: MadeBench

    def plan(self, start: np.ndarray | None = None) -> list[Any]:
        drifts = self.made.planner.ticks if "plans otherwise" in self.made.planner.flaws else 0
        points = [SimpleNamespace(x=x, y=y + drifts, z=z) for x, y, z in PATH]
        return [SimpleNamespace(position=point) for point in points]

    def set_parameters(self, name: str, **values: Any) -> None:
        self.made.planner.keep = values["obstacle_silence_policy"] == "keep"

    def show_scene(self, scene: Mapping[str, Mapping[str, Any]]) -> None:
        self.made.show(scene)


class MadeBench(bench.Bench):
    """The bench's own waiting, with relays and a record of its own; every wait is ticks of a made time."""

    def __init__(self, clock: MadeTime, flaws: Sequence[str]) -> None:
        self.made_time = clock
        self.planner, self.scene, self.shown = MadePlanner(flaws), {}, clock.now
        self.skill = SimpleNamespace(
            space="task", base_frame=FRAME, goal_pose=np.append(GOAL, [0.0, 1.0, 0.0, 0.0]),
            start_pose=np.append(START, [0.0, 1.0, 0.0, 0.0]),
        )  # fmt: skip
        self.goal = self.skill.goal_pose
        limits = np.full(7, 2.0)
        self.robot = SimpleNamespace(
            joint_names=JOINTS, lower=-limits, upper=limits,
            forward=lambda joints: (START + joints[0] * (GOAL - START), self.goal[3:]),
        )  # fmt: skip
        self.node, self.timers = self, []
        self.processes = SimpleNamespace(check=lambda: None)
        self._executor = SimpleNamespace(spin_once=lambda **_: self._pass())
        self.relays = {
            topic: relay.Relay(self, kind, topic, f"relayed/{topic}") for topic, kind in bench.RELAYED.items()
        }
        self.seen = record.Record(self, self.robot, SimpleNamespace(simulated=True))
        self.asks = MadeAsking(self, self.skill, self.relays["obstacles"], self.wait)
        self.asks.made = self

    @property
    def now(self) -> float:
        return self.made_time.now

    # ------------------------------------------------------------------ as a node

    def create_publisher(self, kind: type, topic: str, *_: object) -> SimpleNamespace:
        def publish(message: Any) -> None:
            heard = deserialize_message(message, kind) if isinstance(message, bytes) else message
            if kind is PoseStamped:
                self.planner.goal = not self.planner.ended
            elif kind is JointState:
                self.planner.hear_state(heard, self.now)
            elif kind is MarkerArray:
                self.planner.hear_obstacles(heard, self.now)

        return SimpleNamespace(publish=publish, get_subscription_count=lambda: 1)

    def create_subscription(self, *_: object, **__: object) -> None: ...

    def create_timer(self, period: float, call: Callable[[], object]) -> None:
        self.timers.append([self.now, period, call])

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=self._stamp))

    def _stamp(self) -> Time:
        return Time(sec=int(self.now), nanosec=int(1e9 * (self.now % 1.0)))

    # ------------------------------------------------------------------ as a bench

    def wait(self, condition: Callable[[], Any], what: str, patience: float = PATIENCE) -> float:
        return super().wait(condition, what, min(patience, PATIENCE))

    def prepare(self, *_: object) -> None:
        self.spend(0.05)

    def judge(self, findings: Findings) -> None:
        """What is commanded has judges of its own."""

    def stop_nodes(self) -> None: ...

    def distances_from_arm(self, points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - self.seen.tool, axis=1) - TOOL

    def show(self, scene: Mapping[str, Mapping[str, Any]]) -> None:
        """The twin's obstacles from now on."""
        self.scene, self.shown = scene, self.now
        everything = Marker(header=Header(frame_id=FRAME, stamp=self._stamp()), action=Marker.DELETEALL)
        self._say("obstacles", MarkerArray(markers=[everything]))

    def _say(self, topic: str, message: Any) -> None:
        self.relays[topic].hear(serialize_message(message))

    def _pass(self) -> None:
        """One period of twin, relays and planner."""
        self.made_time.now += PERIOD
        joints = [self.planner.share] + 6 * [0.0]
        header = Header(stamp=self._stamp(), frame_id=FRAME)
        state = JointState(header=header, name=list(JOINTS), position=joints, velocity=7 * [0.0])
        self.seen.states.append(record.ArmState(self.now, self.now, np.array(joints)))
        self._say("joint_states", state)
        spheres = {name: self._place(ball) for name, ball in self.scene.items()}
        if spheres:
            markers = [
                sphere_marker(name, 0, place, self.scene[name]["radius"], (1.0, 0.0, 0.0, 1.0), FRAME, header.stamp)
                for name, place in spheres.items()
            ]
            self._say("obstacles", MarkerArray(markers=markers))
        for timer in self.timers:
            if self.now >= timer[0]:
                timer[0] = max(timer[0] + timer[1], self.now)
                timer[2]()
        self.seen.statuses.append(self.planner.tick(self.now))
        if self.planner.goal:
            self.seen.path = PATH
        for name, place in spheres.items():
            gap = float(np.linalg.norm(place - self.seen.tool)) - self.scene[name]["radius"] - TOOL
            self.seen.least_clearance = min(self.seen.least_clearance, gap)
            self.seen.contacts += gap < 0.0

    def _place(self, ball: Mapping[str, Any]) -> np.ndarray:
        if ball["kind"] == "static":
            return np.array(ball["centre"])
        begin, end = np.array(ball["start"]), np.array(ball["end"])
        share = ball["speed"] * (self.now - self.shown) / np.linalg.norm(end - begin)
        return begin + min(share, 1.0) * (end - begin)


@pytest.fixture
def made_bench(monkeypatch: pytest.MonkeyPatch) -> Callable[..., MadeBench]:
    """made_bench(*flaws) is a bench with a planner that has these flaws."""

    clock = MadeTime()
    for module in (asking, bench, goal_faults, message_faults, obstacle_faults, record, relay, state_faults):
        monkeypatch.setattr(module, "time", clock)
    return lambda *flaws: MadeBench(clock, flaws)
