"""Faults of obstacles: their topic falls silent, they come and go where they should not."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from geometry_msgs.msg import Pose
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.marker_messages import sphere_marker
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_studies.faults.asking import Sphere
from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import (
    GOAL,
    MOTION,
    PLANNER_ALONE,
    START,
    Fault,
    FaultSkipped,
    Findings,
)
from geodesic_motion_studies.faults.goal_faults import require_unchanged
from geodesic_motion_studies.faults.record import Status, ahead
from geodesic_motion_studies.faults.relay import Relay
from geodesic_motion_studies.faults.state_faults import (
    STOP,
    refused,
    require_hold,
    require_only_ok,
    require_refused,
)

_TIMEOUT = next(parameter.default for parameter in PLANNER if parameter.name == "obstacle_timeout")
#: The planner answers within so many ticks of hearing.
TICKS = 3
#: A place where it blocks nothing [m]; the radius of spheres [m].
AWAY, _RADIUS = (-0.6, 0.9, 1.2), 0.04
#: A sphere appears so far ahead on the tool's path [m], and moves with this speed [m/s].
AHEAD, _SPEED = 0.30, 0.25
#: Room beyond the braking distance in which there must be no contact [m].
_ROOM = 0.05
#: A clearance that has changed by this [m] tells of another obstacle.
_CHANGED = 0.01
#: What covers the goal is waited for where the arm is: otherwise it would go as near to it as it can, and not hold.
_WAITS = MappingProxyType({"approach_covered_goal": False})
#: Radius of what covers a goal [m]; an arm has come as near to it as it can within so long [s].
_COVER, _APPROACH = 0.05, 15.0
#: Behind the start by this [m] the arm is never.
_BEHIND_START = 0.01
#: Half the sides of a wall [m], how many spheres it has along each, and their radius [m].
_WALL, _BRICKS, _BRICK = 0.36, 7, 0.07


def static(centre: Iterable[float], radius: float = _RADIUS) -> dict[str, dict[str, Any]]:
    """A scene of the twin with one sphere that stands."""
    return {"ball": {"kind": "static", "centre": [float(x) for x in centre], "radius": radius}}


def coming_to(place: np.ndarray) -> dict[str, dict[str, Any]]:
    """A scene of the twin with one sphere that comes to a place (3,) [m] from outside, and stays there."""
    begin = place + AHEAD * outwards(place)
    line = {"kind": "line", "start": begin.tolist(), "end": place.tolist(), "speed": _SPEED, "radius": _RADIUS}
    return {"ball": line}


def require_no_contact(bench: Bench, findings: Findings) -> None:
    """Arm and obstacles have not touched in this run."""
    findings.require(bench.seen.contacts == 0, f"contact in {bench.seen.contacts} steps")


def outwards(place: np.ndarray) -> np.ndarray:
    """The level direction (3,) away from the robot's base, where its body is not."""
    return np.array([place[0], place[1], 0.0]) / np.hypot(place[0], place[1])


def obstacle_beside(bench: Bench) -> Relay:
    """A topic publishes a sphere where it blocks nothing; its relay."""
    bench.asks.show_scene(static(AWAY))
    relay = bench.relays["obstacles"]
    before = relay.last_passed
    bench.wait(lambda: relay.last_passed > before, "an obstacle")
    return relay


def set_out_beside_an_obstacle(bench: Bench, phase: str) -> Relay:
    """The same, and set out."""
    relay = obstacle_beside(bench)
    bench.set_out(phase)
    return relay


class ObstaclesSilent(Fault):
    name = "obstacles_silent"
    criterion = "an obstacle topic is silent: STALE_OBSTACLES, named, <= 100 ms after obstacle_timeout, stop; resumes"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        relay = set_out_beside_an_obstacle(bench, phase)
        relay.passing = False
        require_hold(bench, findings, "STALE_OBSTACLES", "obstacles", relay.last_passed + _TIMEOUT)
        relay.release()
        bench.finish(findings)


class ObstaclesSilentKept(Fault):
    name = "obstacles_silent_kept"
    criterion = "an obstacle topic is silent, obstacle_silence_policy keep: motion goes on among those last known"
    phases = (MOTION,)

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        bench.asks.set_parameters("planner", obstacle_silence_policy="keep")
        try:
            bench.asks.show_scene(static(AWAY))
            bench.spend(0.1)
            bench.relays["obstacles"].passing = False
            since = time.monotonic()
            bench.arrive()
            bench.wait(lambda: time.monotonic() > since + 2.0 * _TIMEOUT, "silence")
            require_only_ok(findings, bench.seen.since(since))
        finally:
            bench.asks.set_parameters("planner", obstacle_silence_policy="hold")


class ObstacleForgotten(Fault):
    name = "obstacle_forgotten"
    criterion = (
        "of two publishers of a topic the one whose sphere moves dies: STALE_OBSTACLES, the sphere named, <= 100 ms "
        "after obstacle_timeout, stop; resumes"
    )

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        bench.relays["obstacle_point"].passing = False
        bench.asks.tell_spheres([(np.array(AWAY), _RADIUS)])
        begin, end = ([AWAY[0], side * AWAY[1], AWAY[2]] for side in (0.9, -0.9))
        bench.asks.show_scene({"ball": {"kind": "line", "start": begin, "end": end, "speed": 0.1, "radius": _RADIUS}})
        relay, since = bench.relays["obstacles"], time.monotonic()
        bench.wait(lambda: relay.last_passed > since + 0.3, "an obstacle that moves")
        bench.set_out(phase)
        # What the bench itself tells passes by the relay.
        relay.passing = False
        require_hold(bench, findings, "STALE_OBSTACLES", "obstacles/", relay.last_passed + _TIMEOUT)
        relay.release()
        bench.finish(findings)


class ObstaclesNotFinite(Fault):
    name = "obstacles_not_finite"
    criterion = "NaN, Inf, 1e300, unknown frames in obstacles: dropped, counted, reference unchanged"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        # A topic of which nothing could ever be used stops the arm, as it should.
        obstacle_beside(bench)
        before, since = refused(bench, "obstacles"), time.monotonic()
        stamp = bench.node.get_clock().now().to_msg()
        place = bench.goal[:3]
        bad = []
        for value in (float("nan"), float("inf"), 1e300):
            spoiled = place.copy()
            spoiled[random.integers(3)] = value
            bad += [(spoiled, _RADIUS, bench.skill.base_frame), (place, value, bench.skill.base_frame)]
        bad += [(place, -_RADIUS, bench.skill.base_frame), (place, _RADIUS, "nowhere")]
        for number, (centre, radius, frame) in enumerate(bad):
            marker = sphere_marker("bad", number, centre, radius, (1.0, 0.0, 0.0, 1.0), frame, stamp)
            bench.relays["obstacles"].send(MarkerArray(markers=[marker]))
        require_refused(bench, findings, "obstacles", len(bad), before, "nowhere")
        require_unchanged(bench, findings, phase, since)
        bench.finish(findings)


class ObstacleTeleports(Fault):
    name = "obstacle_teleports"
    planner = _WAITS
    criterion = (
        "a sphere is suddenly on the path ahead: another certified path or hold <= 3 ticks after receipt; no contact "
        "where it is beyond the braking distance + 5 cm"
    )

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        bench.relays["obstacle_point"].passing = False
        bench.asks.show_scene(static(AWAY))
        bench.set_out(phase)
        place = bench.seen.ahead(AHEAD + float(random.uniform(0.0, 0.05)))
        relay, heard = bench.relays["obstacles"], []

        def watched(message: MarkerArray) -> Iterable[MarkerArray]:
            at = [marker.pose.position for marker in message.markers]
            if not heard and any(abs(point.x - place[0]) + abs(point.y - place[1]) < 1e-6 for point in at):
                heard.append((time.monotonic(), bench.seen.tool))
                bench.seen.least_clearance = np.inf
            return [message]

        relay.change = watched
        bench.asks.show_scene(static(place))
        bench.wait(lambda: heard, "the sphere's new place")
        receipt, tool = heard[0]
        seen = [status for status in bench.seen.statuses if status.sent <= receipt][-1].number("clearance")

        def answered(status: Status) -> bool:
            return status.code != "OK" or abs(status.number("clearance") - seen) > _CHANGED

        bench.wait(lambda: bench.seen.least_clearance < np.inf, "a clearance")
        room = bench.seen.least_clearance
        ticks, status = bench.ticks_until(receipt, answered, "an answer to the sphere")
        findings.at_most(f"{status.code} after", ticks, TICKS, "ticks")
        bench.spend(1.5)
        stopped = bench.seen.status.code != "OK"
        # Who never brakes must not be excused by how far that took it.
        findings.require(not stopped or bench.seen.status.number("speed") == 0.0, "the arm has no path and still moves")
        braking = float(np.linalg.norm(bench.seen.tool - tool)) if stopped else 0.0
        findings.note(
            f"room {room:.3f} m, {bench.seen.status.code} after {braking:.3f} m, contacts {bench.seen.contacts}"
        )
        if room > braking + _ROOM:
            require_no_contact(bench, findings)
        relay.release()
        bench.asks.show_scene({})
        bench.finish(findings)


class PlannersObstacle(Fault):
    """Spheres that the planner alone receives appear, and vanish."""

    code: str

    @abstractmethod
    def spheres(self, bench: Bench, phase: str) -> Sequence[Sphere]:
        """What appears."""

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        since = bench.asks.tell_spheres(self.spheres(bench, phase))
        if phase == START:
            bench.asks.send_goal()
            said = bench.verdict(self.code)
            findings.require(bench.seen.status.number("speed") == 0.0, "the arm was set moving")
        else:
            ticks, said = bench.ticks_until(since, lambda status: status.code == self.code, self.code)
            findings.at_most(f"{self.code} after", ticks, TICKS, "ticks")
            before = dict.fromkeys(status.code for status in bench.seen.since(since) if status.sent < said.sent)
            findings.note(f"until then {', '.join(before) or 'nothing'}")
            findings.at_most("at rest after", bench.rest(), STOP)
        findings.note(said.reason)
        bench.spend(0.3)
        others = {status.code for status in bench.seen.statuses[-20:]} - {self.code}
        findings.require(not others, f"at rest the planner said {', '.join(sorted(others))}")
        since = bench.asks.tell_spheres([])
        ticks, _ = bench.ticks_until(since, lambda status: status.code == "OK", "OK")
        findings.at_most("OK again after", ticks, TICKS, "ticks")
        bench.finish(findings)


class ObstacleOnRobot(PlannersObstacle):
    name = "obstacle_on_robot"
    criterion = "a sphere appears on the hand: IN_COLLISION <= 3 ticks, hold, no path through it; resumes by itself"
    code = "IN_COLLISION"

    def spheres(self, bench: Bench, phase: str) -> Sequence[Sphere]:
        # A little before the hand, where it will come to rest.
        place = bench.seen.tool if len(bench.seen.path) == 0 or bench.seen.rests else bench.seen.ahead(0.05)
        return [(place, 0.12)]


class AllBlocked(PlannersObstacle):
    name = "all_blocked"
    planner = _WAITS
    criterion = (
        "a wall across all paths to the goal (near the goal: a sphere on it, while the arm can still stop before it): "
        "NO_FEASIBLE_PATH <= 3 ticks, hold; removed: resumes by itself <= 3 ticks after"
    )
    code = "NO_FEASIBLE_PATH"
    in_motion, near_goal = (0.78, 0.85), (2.8, 3.0)

    def spheres(self, bench: Bench, phase: str) -> Sequence[Sphere]:
        if phase == GOAL:
            return [(bench.goal[:3], 0.03)]
        path = tool_path(bench.asks.plan()) if phase == START else bench.seen.path
        centres = wall(path, bench.seen.tool)
        # The arm is to stand in no obstacle, nor to stop in one.
        return [(centre, _BRICK) for centre in centres[bench.distances_from_arm(centres) > _BRICK + _ROOM]]


def wall(path: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Centres (n, 3) [m] of the spheres of a wall across a path (k, 3) of the tool, `AHEAD` of where the tool is."""
    place = ahead(path, tool, AHEAD)
    passed = int(np.argmin(np.linalg.norm(path - place, axis=1)))
    direction = path[min(passed + 2, len(path) - 1)] - path[max(passed - 2, 0)]
    # Two directions across that of the path, and each other.
    across = np.linalg.svd(direction[None])[2][1:]
    steps = np.linspace(-_WALL, _WALL, _BRICKS)
    return place + np.array([x * across[0] + y * across[1] for x in steps for y in steps])


def tool_path(poses: Sequence[Pose]) -> np.ndarray:
    """Positions (n, 3) [m] of poses."""
    return np.array([(pose.position.x, pose.position.y, pose.position.z) for pose in poses]).reshape(-1, 3)


class GoalCovered(Fault):
    name = "goal_covered"
    criterion = (
        "a sphere on the goal: NO_FEASIBLE_PATH, the arm rests clear of it <= 15 s (how near is said); resumes then"
    )
    phases = (MOTION,)

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        since = bench.asks.tell_spheres([(bench.goal[:3], _COVER)])
        bench.verdict("NO_FEASIBLE_PATH", "", since)
        findings.at_most("at rest after", bench.rest(), _APPROACH)
        room = float(bench.distances_from_arm(bench.goal[None, :3])[0]) - _COVER
        findings.note(f"{1000.0 * room:.0f} mm before it")
        findings.require(room > 0.0, "the arm is in what covers its goal")
        since = bench.asks.tell_spheres([])
        bench.verdict("OK", "", since)
        bench.finish(findings)


class ManyObstacles(Fault):
    subjects = PLANNER_ALONE
    name = "many_obstacles"
    criterion = (
        "1 to 50 obstacles, then none: misses counted, the planner's plan the same bytes as before (the weights "
        "themselves: test_shortest_path.py)"
    )

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        # Where the arm stands at a plan's start its posture counts, which is another one afterwards.
        start, back = bench.skill.start_pose.copy(), (bench.skill.start_pose - bench.goal)[:3]
        start[:3] += _BEHIND_START * back / np.linalg.norm(back)
        before, misses = bench.asks.plan(start), bench.seen.status.number("deadline_misses")
        if not before:
            raise FaultSkipped("the skill has no plan from its own start to its goal")
        if phase == START:
            bench.asks.send_goal()
        for count in (1, 2, 5, 10, 20, 50):
            directions = random.normal(size=(count, 3))
            centres = 0.9 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
            bench.asks.tell_spheres([(centre + (0.3, 0.0, 0.4), _RADIUS) for centre in centres])
            bench.spend(0.2)
        bench.asks.tell_spheres([])
        bench.spend(0.1)
        findings.note(f"{bench.seen.status.number('deadline_misses') - misses:.0f} misses")
        findings.require(bench.asks.plan(start) == before, "the plan afterwards is another one")
        bench.finish(findings)


class ObstaclesDeleted(Fault):
    name = "obstacles_deleted"
    criterion = "DELETEALL and lifetimes are honoured: the planner forgets a sphere on the goal and goes on"
    phases = (START, MOTION)

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        bench.set_out(phase)
        marker = self._marker(bench)
        marker.lifetime.nanosec = 300_000_000
        bench.relays["obstacles"].send(MarkerArray(markers=[marker]))
        blocked = bench.verdict("NO_FEASIBLE_PATH")
        bench.relays["obstacles"].send(MarkerArray(markers=[self._marker(bench)]))
        bench.relays["obstacles"].send(MarkerArray(markers=[self._everything(bench)]))
        bench.verdict("OK", "", blocked.sent, patience=3.0)
        bench.finish(findings)

    def _marker(self, bench: Bench) -> Marker:
        stamp = bench.node.get_clock().now().to_msg()
        return sphere_marker("short", 0, bench.goal[:3], 0.06, (1.0, 0.0, 0.0, 1.0), bench.skill.base_frame, stamp)

    def _everything(self, bench: Bench) -> Marker:
        return Marker(header=Header(frame_id=bench.skill.base_frame), action=Marker.DELETEALL)


OBSTACLE_FAULTS = (
    ObstaclesSilent, ObstaclesSilentKept, ObstacleForgotten, ObstaclesNotFinite, ObstacleTeleports, ObstacleOnRobot,
    AllBlocked, GoalCovered, ManyObstacles, ObstaclesDeleted,
)  # fmt: skip
