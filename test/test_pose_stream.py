"""PoseStream: whether a tool could still stop among what moves, and how it comes to rest.

That references are kept and replaced as they should be is tested with the planner (`planner/`).
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.pose_smoothing import corners_cut
from geodesic_motion_ros.pose_solver import Plan, PoseSolver, Scene
from geodesic_motion_ros.pose_stream import PoseStream
from geodesic_motion_ros.query import Pose
from geodesic_motion_ros.reference import TaskSpaceReference
from geodesic_motion_ros.task_frame import TaskFrame
from geodesic_motion_ros.verdict import Verdict, VerdictCode

SETTINGS, RADIUS = PlannerSettings(), 0.03
TOOL = SETTINGS.tool_radii[0]
#: Of a query the stream asks only whether it is the same.
QUERY = SimpleNamespace()
#: From a tool's middle to a sphere's where both touch.
TOUCHING = TOOL + RADIUS


@pytest.fixture(scope="module")
def solver(fan_skill) -> PoseSolver:
    planner = ReactivePlanner(fan_skill)
    return PoseSolver(fan_skill, planner.graph, SETTINGS, planner.robot)


@pytest.fixture(scope="module")
def way(fan_skill) -> TaskSpaceReference:
    start, goal = fan_skill.start_pose, fan_skill.goal_pose
    return ReactivePlanner(fan_skill).plan(start[:3], start[3:], goal[:3], goal[3:]).reference


def scene(obstacles: Obstacles) -> Scene:
    return Scene.of(TaskFrame.identity(), obstacles)


def gone(solver: PoseSolver, way: TaskSpaceReference, settings: PlannerSettings = SETTINGS):
    """A stream in the middle of a way, where it is and how it moves there."""
    stream = PoseStream(settings, solver)
    rest = way.rest(*way.locate(0.5 * way.duration))
    stream.begin(QUERY, Plan(rest, Verdict(VerdictCode.OK)), scene(Obstacles.none()))
    speed = SETTINGS.speed * rest.rate(0.0)
    start = Pose(*rest.sample(0.0))
    return stream, start, stream.motion(start, speed), speed


def sphere(centre: np.ndarray, velocity: np.ndarray) -> Obstacles:
    return Obstacles.of_spheres(centre[None], np.array([RADIUS]), velocity[None])


def passing_by(reference: TaskSpaceReference, late: float) -> Obstacles:
    """A sphere at 0.4 m/s from aside: it comes to touch the tool's place after 0.5 s so much later [s] than the tool is
    there.
    """
    meeting, speed = 0.5, 0.4
    side = np.cross(reference.velocity(meeting)[:3], [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    return sphere(reference.sample(meeting)[0] - (TOUCHING + speed * (meeting + late)) * side, speed * side)


def across(reference: TaskSpaceReference) -> np.ndarray:
    """A direction (3,) across the beginning of a way."""
    side = np.cross(reference.velocity(0.0)[:3], [0.0, 0.0, 1.0])
    return side / np.linalg.norm(side)


def test_a_stop_keeps_to_the_way_and_takes_as_long_as_a_stop_must(solver, way) -> None:
    stream, start, _, speed = gone(solver, way)
    stop = stream.braking(start, Obstacles.none(), speed)
    np.testing.assert_allclose(stop.positions[0], start.position, atol=1e-6)
    assert np.linalg.norm(stop.velocity(stop.duration)) == 0.0
    assert stop.duration == pytest.approx(speed / SETTINGS.acceleration, rel=0.1)
    passed = np.array([way.sample(time)[0] for time in np.linspace(0.0, way.duration, 2000)])
    for position in stop.positions:
        assert np.min(np.linalg.norm(passed - position, axis=1)) < 1e-3
    assert stream.braking(start, Obstacles.none(), 0.0) is None
    elsewhere = Pose(start.position + 0.1, start.quaternion)
    assert stream.braking(elsewhere, Obstacles.none(), speed) is None


def test_a_stop_that_would_touch_what_stands_is_told_from_a_free_one(solver, way) -> None:
    stream, start, _, speed = gone(solver, way)
    end = stream.braking(start, Obstacles.none(), speed).positions[-1]
    ahead = end + (TOUCHING - 0.005) * (end - start.position) / np.linalg.norm(end - start.position)
    standing, moving = sphere(ahead, np.zeros(3)), sphere(ahead, np.array([0.0, 0.0, 0.1]))
    assert stream.free_braking(start, standing, speed) is None
    assert np.min(stream.braking(start, standing, speed).clearance) <= 0.0
    assert stream.free_braking(start, moving, speed) is not None
    assert stream.free_braking(start, Obstacles.none(), speed) is not None


def test_a_tool_goes_on_only_as_long_as_it_could_stop_wherever_what_moves_comes_to_a_stand(solver, way) -> None:
    stream, start, motion, speed = gone(solver, way)
    going = motion.rest
    side = across(going)
    end = stream.braking(start, Obstacles.none(), speed).positions[-1]
    along = (end - start.position) / np.linalg.norm(end - start.position)
    # Where the tool stops now it just keeps off; going on for 30 ms takes it 6 mm further.
    line = end + (TOUCHING + 0.003) * along
    crossing = sphere(line - 0.1 * side, 0.4 * side)
    assert stream.objection(going, start, motion, crossing)
    assert not stream.stoppable(Plan(going, Verdict(VerdictCode.OK)), start, motion, scene(crossing)).verdict.ok
    # The controls: it stands, it does not come this far, nothing is avoided.
    assert not stream.objection(going, start, motion, sphere(line - 0.1 * side, np.zeros(3)))
    assert not stream.objection(going, start, motion, sphere(line - 0.4 * side, 0.4 * side))
    blind, *where = gone(solver, way, replace(SETTINGS, avoidance=False))
    assert not blind.objection(going, *where[:2], crossing)
    # No stop is free now: going on is no worse.
    assert not stream.objection(going, start, motion, sphere(end - 0.1 * side, 0.4 * side))
    # What has passed by now may have come to a stand before, since it was last seen.
    passed = sphere(line + 0.10 * side, 0.4 * side)
    assert not stream.objection(going, start, motion, passed)
    assert stream.objection(going, start, motion, replace(passed, age=0.25))
    # That it would be met later, where it stops, is no reason to go on where the way is not free of it.
    assert stream.objection(going, start, motion, sphere(line + 0.02 * along, -0.12 * along))


def test_a_tool_goes_on_past_what_comes_to_where_it_would_stop(solver, way) -> None:
    stream, start, motion, speed = gone(solver, way)
    going, side = motion.rest, across(motion.rest)
    stop = stream.braking(start, Obstacles.none(), speed)
    beside = stop.positions[-1] + (TOUCHING + 0.025) * side
    coming, leaving = sphere(beside, -0.1 * side), sphere(beside - 0.016 * side, 0.1 * side)
    # Both leave it a stop now, and not so a moment later.
    for obstacles in (coming, leaving):
        assert solver.clearance_wherever_they_stop(stop, 0.0, stop.duration, obstacles, 12) > 0.0
        assert not stream.leaves_a_stop(going, start, obstacles)
    # Where the tool stood it would be touched by the one that comes.
    assert not stream.objection(going, start, motion, coming)
    assert stream.objection(going, start, motion, leaving)
    # The way is gone on too where no other was found, and it would be met: later, not soon.
    for meeting, goes_on in ((0.7, True), (0.25, False)):
        aside = TOUCHING + 0.15 * (meeting - 0.06)
        meets = sphere(going.sample(meeting)[0] + aside * side, -0.15 * side)
        both = Obstacles.of_spheres(
            np.vstack([beside + 0.015 * side, meets.centres]), np.full(2, RADIUS),
            np.vstack([coming.velocities, meets.velocities]),
        )  # fmt: skip
        assert np.min(solver.certified(going, both, trusting=True).clearance) <= 0.0
        assert (stream.gone_past(QUERY, start, motion, scene(both), stop) is not None) == goes_on
        # The control: as long as giving way may do, it is not gone on.
        assert stream.gone_on(QUERY, start, motion, scene(both)) is None
    # Nothing comes to where it would stop.
    assert stream.gone_past(QUERY, start, motion, scene(meets), stop) is None


def test_a_way_is_gone_on_to_a_goal_that_something_comes_to_where_it_comes_to_the_stop_as_well(solver, way) -> None:
    stream, start, _, _ = gone(solver, way)
    near = way.rest(*way.locate(way.duration - 0.4))
    stream.begin(QUERY, Plan(near, Verdict(VerdictCode.OK)), scene(Obstacles.none()))
    start = Pose(*near.sample(0.0))
    motion = stream.motion(start, SETTINGS.speed * near.rate(0.0))
    goal, side = near.positions[-1], across(near)
    covers = sphere(goal + (TOUCHING + 0.08) * side, -0.08 * side)
    assert np.min(solver.certified(near, covers, trusting=True).clearance) < 0.0
    assert stream.gone_on(QUERY, start, motion, scene(covers)) is not None
    assert stream.gone_on(QUERY, start, motion, scene(covers), turning=True) is not None
    # Where nothing comes to the stop, the tool stops for another way, and goes on where there is none.
    along = near.velocity(0.0)[:3] / np.linalg.norm(near.velocity(0.0)[:3])
    behind = scene(sphere(start.position - (TOUCHING + 0.1) * along, 0.02 * along))
    assert stream.gone_on(QUERY, start, motion, behind, turning=True) is None
    assert stream.gone_on(QUERY, start, motion, behind) is not None
    # The controls: it comes before the tool is there, and to the goal alone.
    sooner = sphere(goal + (TOUCHING + 0.08) * side, -0.4 * side)
    assert stream.gone_on(QUERY, start, motion, scene(sooner)) is None
    far = Pose(*way.sample(0.0))
    stream.begin(QUERY, Plan(way, Verdict(VerdictCode.OK)), scene(Obstacles.none()))
    assert stream.gone_on(QUERY, far, stream.motion(far, 0.0), scene(covers)) is None


def test_a_tool_waits_rather_than_go_where_something_comes_soon_after_it(solver, way) -> None:
    stream, start, motion, _ = gone(solver, way)
    going = motion.rest
    soon, later = passing_by(going, 0.35), passing_by(going, 1.0)
    assert np.min(solver.certified(going, soon, trusting=True).clearance) > 0.0
    assert stream.objection(going, start, motion, soon).startswith("waiting")
    assert not stream.objection(going, start, motion, later)
    # To wait is no better where another comes to where it stops.
    end = stream.braking(start, Obstacles.none(), motion.speed * SETTINGS.speed).positions[-1]
    velocity = -0.15 * soon.velocities[0] / np.linalg.norm(soon.velocities[0])
    centres = np.stack([soon.centres[0], end - (TOUCHING / 0.15 + 1.0) * velocity])
    both = Obstacles.of_spheres(centres, np.full(2, RADIUS), np.stack([soon.velocities[0], velocity]))
    assert np.min(solver.certified(going, both, trusting=True).clearance) > 0.0
    assert not stream.objection(going, start, motion, both)


def test_a_tool_does_not_wait_for_ever(solver, way) -> None:
    stream, start, motion, _ = gone(solver, way)
    going, clear = motion.rest, Obstacles.of_spheres(np.full((1, 3), 9.0), np.array([RADIUS]), np.ones((1, 3)))
    soon = passing_by(going, 0.35)
    waits = [bool(stream.objection(going, start, motion, replace(soon, time=now))) for now in (0.0, 2.9, 3.1, 9.0)]
    assert waits == [True, True, False, False]
    # Once there was a way that need not wait it waits again.
    assert not stream.objection(going, start, motion, replace(clear, time=9.1))
    assert stream.objection(going, start, motion, replace(soon, time=9.2))


@pytest.mark.parametrize("seed", range(4))
def test_room_is_that_from_what_comes_to_a_stand_at_any_time_and_no_less(solver, way, seed) -> None:
    random = np.random.default_rng(seed)
    stream, start, _, speed = gone(solver, way)
    stop = stream.braking(start, Obstacles.none(), speed)
    centres = start.position + random.normal(scale=0.12, size=(2, 3))
    velocities = 0.4 * (stop.positions[-1] - centres) + random.normal(scale=0.1, size=(2, 3))
    radii, later, age = random.uniform(0.01, 0.03, 2), 0.03, 0.1 * seed
    obstacles = replace(Obstacles.of_spheres(centres, radii, velocities), age=age)
    told = solver.clearance_wherever_they_stop(stop, later, stop.duration, obstacles, 12)

    times = np.linspace(0.0, stop.duration, 60)
    tool = np.array([stop.sample(time)[0] for time in times])
    gaps = []
    for stands in np.linspace(-age, later + stop.duration, 60):
        moved = np.minimum(later + times, stands)
        apart = tool[:, None] - (centres + moved[:, None, None] * velocities)
        gaps.append(np.min(np.linalg.norm(apart, axis=2) - radii) - TOOL)
    assert told <= min(gaps) + 1e-5
    assert told == pytest.approx(min(gaps), abs=3e-3)


def test_room_is_left_by_what_comes_where_the_tool_has_been(solver, way) -> None:
    stream, start, _, speed = gone(solver, way)
    stop = stream.braking(start, Obstacles.none(), speed)
    line = stop.positions[-1] - start.position
    along = line / np.linalg.norm(line)
    side = np.cross(along, [0.0, 0.0, 1.0])
    # Behind the tool it reaches the tool's line as the tool comes to rest.
    place = start.position - 0.03 * along
    late = sphere(place - (TOUCHING + 0.01) * side, (TOUCHING + 0.01) / stop.duration * side)
    at_once = late.stopping_places(stop.duration, 12)
    assert np.min(solver.certified(stop, at_once).clearance) < -0.02
    room = solver.clearance_wherever_they_stop(stop, 0.0, stop.duration, late, 12)
    assert room > np.min(solver.certified(stop, at_once).clearance) + 0.01


def test_what_was_planned_is_taken_where_the_tool_could_stop(solver, way) -> None:
    stream, start, motion, _ = gone(solver, way)
    plan = Plan(motion.rest, Verdict(VerdictCode.OK))
    assert stream.stoppable(plan, start, motion, scene(Obstacles.none())) is plan
    nothing = Plan(None, Verdict(VerdictCode.NO_FEASIBLE_PATH))
    assert stream.stoppable(nothing, start, motion, scene(Obstacles.none())) is nothing


@pytest.mark.parametrize("velocity", [np.zeros(3), np.array([0.0, 0.0, 0.01])])
def test_the_certificate_leaves_room_for_what_smoothing_cuts_off_corners(solver, way, velocity):
    obstacles = sphere(way.sample(0.5 * way.duration)[0] + [0.0, 0.0, 0.1], velocity)
    gentle, hard = (np.min(solver.certified(replace(way, strain=strain), obstacles).clearance) for strain in (0.0, 2.0))
    assert gentle - hard == pytest.approx(corners_cut(way.limits, 2.0, np.zeros(1))[0], rel=1e-6)
    assert gentle - hard > 5e-5
