"""Planner, twin and a depth camera that sees the arm, each a process of its own.

First the arm goes to and fro for minutes, among nothing but itself: whatever stops it is a false stop. Then a ball
stands beside the forearm, where this is about to go, place after place: is it avoided? As a control the same without
the ball in the cloud.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from geodesic_motion_ros.nodes.stolen_time import StolenTime
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.shared_files import find_shared
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_studies.rates.camera_process import FRAME, NAME, command
from geodesic_motion_studies.rates.depth_picture import BALL, DepthPicture, camera
from geodesic_motion_studies.rates.planner_stream import PATIENCE, PlannerStream, Tick

#: A skill of a Panda, and what the links of its forearm are called.
SKILL = "panda_reach_to_grasp"
FOREARM = ("panda_link3", "panda_link4", "panda_link5")
#: How far the ball is from the forearm's spheres [m] where the arm starts; how far off the path of the forearm's
#: spheres [rad] its direction may be; and which share of it the camera must see.
GAP, ASKEW, VISIBLE = 0.03, math.radians(60.0), 0.5
#: A verdict so long after a goal was sent belongs to its change [s]; a motion is waited for so long [s], and one past a
#: ball so long.
CHANGE, MOTION, PAST_BALL = 0.5, 60.0, 25.0
#: The least rate is that of so long [s].
WINDOW = 10.0
#: The shared memory that LOCALHOST means holds less than a cloud.
_BY_UDP = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(find_shared("config/loopback.xml")),
}
_PROCESSES = ("planner", "camera", "twin")


@dataclass(frozen=True)
class MinutesRow:
    """What minutes with the arm in the cloud have shown.

    Attributes
    ----------
    motions, unfinished : that ended at their goals, and that did not in `MOTION` seconds. motion_p50 : their time [s].
    rate, least_rate : ticks a second over all of it, and over the worst `WINDOW` seconds. missed_percent : of them.
    sent, used : clouds a second. points, of_arm, dropped : of a cloud, on average: all, those of the arm, and those
        that the planner has dropped as such.
    cloud_p50, cloud_p99 : time for a cloud [ms], that of waiting for a core and the interpreter included. cloud_share :
        of a core, all clouds together.
    false_stops : verdicts but OK, `CODE: reason`, by the number of their ticks; changing : those within `CHANGE`
        seconds of a goal.
    processor : time [s] a second, by process. stolen_percent : as of `StolenTime`.
    """

    minutes: float
    motions: int
    unfinished: int
    motion_p50: float
    rate: float
    least_rate: float
    missed_percent: float
    sent: float
    used: float
    points: float
    of_arm: float
    dropped: float
    cloud_p50: float
    cloud_p99: float
    cloud_share: float
    false_stops: dict[str, int]
    changing: dict[str, int]
    processor: dict[str, float]
    stolen_percent: float


@dataclass(frozen=True)
class BallRow:
    """A motion past a ball at a place (3,) [m].

    Attributes
    ----------
    in_cloud : whether the camera sees it. arrived : whether the arm came to its goal.
    start_gap, least_gap : between the ball and the arm's spheres where the motion began, and at the least [m].
    verdict : the most frequent one but OK, `CODE: reason`; "" where there was none. travelled : of the joint that moved
        most [rad].
    """

    place: tuple[float, float, float]
    in_cloud: bool
    arrived: bool
    start_gap: float
    least_gap: float
    verdict: str
    travelled: float


@dataclass(frozen=True, eq=False)
class _Health:
    """What diagnostics say, by when they came [s]."""

    time: float
    values: dict[str, str]


@dataclass(eq=False)
class CameraStream:
    """A planner stream with the camera, and what is heard of joints and diagnostics.

    Attributes
    ----------
    joints : (eta,) [rad] each. planner, camera : diagnostics of these two.
    """

    stream: PlannerStream
    joints: list[np.ndarray] = field(default_factory=list)
    planner: list[_Health] = field(default_factory=list)
    camera: list[_Health] = field(default_factory=list)

    @classmethod
    def of(
        cls, skill: str, folder: Path, rate: float, domain: int, points: int, ball: np.ndarray | None
    ) -> CameraStream:
        """Of a planner that needs clouds; to be entered by its `stream`."""
        place, quaternion = camera(points).pose
        stream = PlannerStream(
            skill, folder, rate, domain, beside={"camera": command(Skill.load(skill).robot, points, ball)},
            environment=_BY_UDP,
            camera_frame=FRAME, camera_pose=[*place.tolist(), *quaternion.tolist()],
            required_obstacle_topics=["obstacle_cloud"], scene="none",
        )  # fmt: skip
        stream.spheres = None
        heard = cls(stream)
        stream.node.create_subscription(JointState, "joint_states", heard._on_joints, QoSProfile(depth=10))
        stream.node.create_subscription(DiagnosticArray, "/diagnostics", heard._on_diagnostics, QoSProfile(depth=10))
        return heard

    def _on_joints(self, message: JointState) -> None:
        self.joints.append(np.array(message.position))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        health = _Health(self.stream.now(), {pair.key: pair.value for pair in message.status[0].values})
        (self.camera if message.status[0].name == NAME else self.planner).append(health)

    def clear(self) -> None:
        """Forget what was heard until now."""
        for heard in (self.joints, self.planner, self.camera, self.stream.ticks):
            heard.clear()

    def wait_for_clouds(self) -> None:
        """Wait until the planner has used one."""
        self.stream.wait(lambda: self.planner and int(self.planner[-1].values["clouds"]) > 0, PATIENCE)

    def send(self, pose: np.ndarray) -> int:
        """Ask for a pose (7,) of the tool, and return the number of that goal."""
        self.stream.send_goal(*np.split(pose, [3]))
        return self.stream.goal_number + 1

    def arrives(self, goal: int, patience: float) -> bool:
        """Wait until the arm stands at a goal, or so long [s]: whether it does."""
        stream, end = self.stream, self.stream.now() + patience
        # Until it moves it stands at the goal before.
        for there in (lambda: stream.time_to_goal > 0.0, lambda: stream.time_to_goal == stream.speed == 0.0):
            def over(there: Callable[[], bool] = there) -> bool:
                return (self._follows(goal) and there()) or stream.now() > end

            stream.wait(over, patience + PATIENCE)
        return self._follows(goal) and stream.time_to_goal == stream.speed == 0.0

    def _follows(self, goal: int) -> bool:
        return self.stream.goal_number >= goal and self.stream.code == "OK"


def measure_minutes(
    skill: str, folder: Path, minutes: float, points: int = 300_000, rate: float = 100.0, domain: int = 83
) -> MinutesRow:
    """Send the arm to and fro between the skill's ends for so long.

    Raises
    ------
    ParameterError : a number that is not positive. DemoError : a node ends or does not answer.
    """
    if not (minutes > 0.0 and points > 0 and rate > 0.0):
        raise ParameterError(f"minutes {minutes}, points {points}, rate {rate}: must be positive")
    heard = CameraStream.of(skill, folder / "minutes", rate, domain, points, None)
    with heard.stream as stream:
        heard.wait_for_clouds()
        goals = [stream.skill.goal_pose, stream.skill.start_pose]
        heard.clear()
        begin, times, sent, unfinished = stream.now(), [], [], 0
        stolen, before = StolenTime(), {name: stream.processor_time(name) for name in _PROCESSES}
        while stream.now() - begin < 60.0 * minutes:
            sent.append(stream.now())
            if heard.arrives(heard.send(goals[0]), MOTION):
                times.append(stream.now() - sent[-1])
            else:
                unfinished += 1
            goals.reverse()
        lasted, taken = stream.now() - begin, stolen.percent()
        processor = {name: (stream.processor_time(name) - before[name]) / lasted for name in _PROCESSES}
        ticks = [tick for tick in stream.ticks if tick.time >= begin]
    changing, false_stops = stops(ticks, sent)
    durations = np.array([float(health.values["cloud_ms"]) for health in heard.planner])
    used, counted = _a_second(heard.planner, "clouds"), ticks[-1].number - ticks[0].number
    return MinutesRow(
        minutes=lasted / 60.0,
        motions=len(times),
        unfinished=unfinished,
        motion_p50=float(np.median(times)) if times else math.nan,
        rate=counted / (ticks[-1].time - ticks[0].time),
        least_rate=least_rate(ticks),
        missed_percent=100.0 * (ticks[-1].misses - ticks[0].misses) / counted,
        sent=_a_second(heard.camera, "clouds_sent"),
        used=used,
        points=_mean(heard.camera, "points"),
        of_arm=_mean(heard.camera, "points_of_arm"),
        dropped=_mean(heard.planner, "cloud_points_of_arm"),
        cloud_p50=float(np.percentile(durations, 50.0)),
        cloud_p99=float(np.percentile(durations, 99.0)),
        cloud_share=1e-3 * float(np.mean(durations)) * used,
        false_stops=false_stops,
        changing=changing,
        processor=processor,
        stolen_percent=taken,
    )


def least_rate(ticks: Sequence[Tick]) -> float:
    """Ticks a second over the worst `WINDOW` seconds, or over all where there are no more."""
    times, numbers = np.array([tick.time for tick in ticks]), np.array([tick.number for tick in ticks])
    ends = np.searchsorted(times, times + WINDOW)
    begins = np.flatnonzero(ends < len(times))
    if not len(begins):
        begins, ends = np.array([0]), np.array([len(times) - 1])
    ends = ends[begins]
    return float(np.min((numbers[ends] - numbers[begins]) / (times[ends] - times[begins])))


def stops(ticks: Sequence[Tick], sent: Sequence[float]) -> tuple[dict[str, int], dict[str, int]]:
    """Count the verdicts but OK, those within `CHANGE` seconds of a goal, and the others."""
    changing: Counter[str] = Counter()
    others: Counter[str] = Counter()
    for tick in ticks:
        if tick.code != "OK":
            goal = np.searchsorted(sent, tick.time) - 1
            soon = goal >= 0 and tick.time - sent[goal] < CHANGE
            (changing if soon else others)[f"{tick.code}: {tick.reason}"] += 1
    return dict(changing.most_common()), dict(others.most_common())


def _a_second(heard: Sequence[_Health], key: str) -> float:
    """By how much a count grows a second."""
    first, last = heard[0], heard[-1]
    return (float(last.values[key]) - float(first.values[key])) / (last.time - first.time)


def _mean(heard: Sequence[_Health], key: str) -> float:
    return float(np.mean([float(health.values[key]) for health in heard]))


def ball_places(skill: Skill, count: int, points: int = 300_000, seed: int = 0) -> np.ndarray:
    """Centres (count, 3) [m] of balls `GAP` from the forearm where the arm starts, towards where it goes from there.

    The camera sees them, and no other link is nearer.
    """
    arm = ReactivePlanner(skill)
    motion = arm.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3])).reference
    assert motion is not None
    model = CollisionModel.named(skill.robot)
    spheres = model.positions(arm.robot, motion.positions)
    forearm = np.flatnonzero(np.isin(model.points.names, FOREARM))
    random = np.random.default_rng(seed)
    found: list[np.ndarray] = []
    while len(found) < count:
        sphere = random.choice(forearm)
        went = spheres[len(spheres) // 4, sphere] - spheres[0, sphere]
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        if direction @ went < math.cos(ASKEW) * np.linalg.norm(went):
            continue
        # As far out of this sphere as it takes to leave all others of the forearm so far behind.
        along = np.linspace(0.0, 0.5, 5001)[:, None] * direction + spheres[0, sphere]
        gaps = np.min(_gaps(along, spheres[0, forearm], model.radii[forearm]), axis=1)
        place = along[np.flatnonzero(gaps < GAP)[-1] + 1]
        if np.min(_gaps(place[None], spheres[0], model.radii)) < GAP - 1e-3:
            continue
        alone, seen = (
            DepthPicture(arm.robot, shown, points, place).take(motion.positions[0]).of_ball
            for shown in (model.of_link(model.points.names[0]), model)
        )
        if seen >= VISIBLE * alone > 0:
            found.append(place)
    return np.array(found)


def _gaps(places: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """From balls at places (n, 3) to spheres (S, 3), (S,): (n, S) [m]."""
    return np.linalg.norm(places[:, None] - centres, axis=2) - radii - BALL


def measure_balls(
    skill: str, folder: Path, places: np.ndarray, points: int = 300_000, rate: float = 100.0, domain: int = 83
) -> list[BallRow]:
    """Send the arm past a ball at each of the places (n, 3) [m], in the cloud and not.

    Raises
    ------
    ParameterError, DemoError : as of `measure_minutes`.
    """
    return [
        _past_ball(skill, folder / f"ball_{number}_{'seen' if shown else 'unseen'}", rate, domain, points, place, shown)
        for number, place in enumerate(places)
        for shown in (True, False)
    ]


def _past_ball(
    skill: str, folder: Path, rate: float, domain: int, points: int, place: np.ndarray, shown: bool
) -> BallRow:
    heard = CameraStream.of(skill, folder, rate, domain, points, place if shown else None)
    with heard.stream as stream:
        heard.wait_for_clouds()
        heard.clear()
        arrived = heard.arrives(heard.send(stream.skill.goal_pose), PAST_BALL)
        robot, model = Robot.named(stream.skill.robot), CollisionModel.named(stream.skill.robot)
        codes = Counter(f"{tick.code}: {tick.reason}" for tick in stream.ticks if tick.code not in ("OK", "NO_GOAL"))
    joints = np.array(heard.joints)
    centres = model.positions(robot, joints)[:, model.moving]
    gaps = np.min(np.linalg.norm(centres - place, axis=2) - model.radii[model.moving], axis=1) - BALL
    verdict = codes.most_common(1)[0][0] if codes else ""
    return BallRow(
        tuple(place.tolist()), shown, arrived, float(gaps[0]), float(np.min(gaps)), verdict,
        float(np.max(np.ptp(joints, axis=0))),
    )  # fmt: skip


def minutes_table(row: MinutesRow) -> str:
    """The row as plain text, one figure a line."""
    lines: list[list[Cell]] = [
        ["minutes", row.minutes],
        ["motions ended", row.motions],
        [f"motions not ended in {MOTION:g} s", row.unfinished],
        ["time of a motion p50 [s]", row.motion_p50],
        ["ticks a second", row.rate],
        [f"ticks a second, worst {WINDOW:g} s", row.least_rate],
        ["deadlines missed [%]", row.missed_percent],
        ["clouds sent a second", row.sent],
        ["clouds used a second", row.used],
        ["points of a cloud", round(row.points)],
        ["of the arm", round(row.of_arm)],
        ["dropped", round(row.dropped)],
        ["a cloud p50 [ms]", row.cloud_p50],
        ["a cloud p99 [ms]", row.cloud_p99],
        ["all clouds [% of a core]", 100.0 * row.cloud_share],
        *([f"{name} [% of a core]", 100.0 * share] for name, share in row.processor.items()),
        ["stolen [%]", row.stolen_percent],
        ["false stops [ticks]", sum(row.false_stops.values())],
        [f"verdicts within {CHANGE:g} s of a goal [ticks]", sum(row.changing.values())],
    ]
    verdicts = [
        f"{count:6d}  {verdict}" for counts in (row.false_stops, row.changing) for verdict, count in counts.items()
    ]
    return "\n".join([text_table(["planner, twin and a camera that sees the arm", ""], lines), *verdicts])


def balls_table(rows: Sequence[BallRow]) -> str:
    """The rows as plain text."""
    head = ["ball at [m]", "in the cloud", "arrived", "gap at the start mm", "least gap mm", "moved rad", "verdict"]
    cells: list[list[Cell]] = [
        [
            " ".join(f"{number:.3f}" for number in row.place), "yes" if row.in_cloud else "no",
            "yes" if row.arrived else "no", 1e3 * row.start_gap, 1e3 * row.least_gap, row.travelled, row.verdict,
        ]
        for row in rows
    ]  # fmt: skip
    return text_table(head, cells, left=(0, 6))
