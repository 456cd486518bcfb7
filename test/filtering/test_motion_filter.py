"""Motions that others offer: played as offered where they are free, braked along their path where they are not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.mode import Mode
from geodesic_motion_ros.contract.requirement import Requirement, Requirements
from geodesic_motion_ros.contract.settings import EVASION_DISPLACED_WITHIN
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.filtering.motion_filter import MotionFilter, Recovery
from geodesic_motion_ros.filtering.offer_solver import OfferSolver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.utils.deadline import NEVER, Deadline
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.wild_chunks import offer_wild
from test.filtering.conftest import BEGIN, DURATION, MOVED, Filtering, offered

#: A sphere halfway along the motion, and how large it is [m].
RADIUS = 0.05


def halfway(filtering: Filtering) -> np.ndarray:
    """The place (3,) [m] of the hand halfway along the offered motion."""
    return filtering.filter.robot.forward(BEGIN + 0.5 * MOVED)[0]


def off_the_path(positions: np.ndarray) -> float:
    """Largest distance [rad] of a joint from the straight path of the offered motion."""
    share = np.clip((positions - BEGIN) @ MOVED / (MOVED @ MOVED), 0.0, 1.0)
    return float(np.max(np.abs(positions - BEGIN - share[:, None] * MOVED)))


def keeps_limits(filtering: Filtering) -> bool:
    """Whether what was commanded keeps the limits of speed, and jumps nowhere."""
    positions, velocities, _ = np.moveaxis(np.array(filtering.commanded), 1, 0)
    limits = filtering.filter.limits
    # Over a tick the mean of both ends' velocities is off by no more than the jerk allows.
    mean = 0.5 * (velocities[1:] + velocities[:-1])
    jumps = np.abs(np.diff(positions, axis=0) / 0.01 - mean) > 0.01**2 * limits.jerk + 1e-9
    return bool(np.all(np.abs(velocities) <= limits.velocity + 1e-9) and not np.any(jumps))


@pytest.mark.parametrize(("rate", "with_velocities"), [(30.0, False), (100.0, False), (10.0, True)])
def test_a_free_trajectory_is_played_as_it_was_offered(
    filtering: Filtering, rate: float, with_velocities: bool
) -> None:
    times = np.linspace(0.0, DURATION, round(rate * DURATION) + 1)
    positions, velocities = offered(times)
    assert filtering.filter.offer(times, positions, velocities if with_velocities else None, begin=0.05).ok
    filtering.run(DURATION + 0.3)
    played = filtering.positions
    wanted, _ = offered(0.01 * np.arange(len(played)) - 0.05)
    # A cubic through points a thirtieth of a second apart is nearer than a milliradian.
    np.testing.assert_allclose(played, wanted, atol=1e-3)
    assert filtering.at_rest
    assert filtering.plans[-1].verdict.ok
    assert keeps_limits(filtering)


@pytest.mark.parametrize("rate", [5.0, 50.0])
def test_chunks_that_overlap_are_joined_into_one_motion(filtering: Filtering, rate: float) -> None:
    """Each tells the next half second, thirty points a second, from where the arm is to be."""
    ahead = np.arange(16) / 30.0

    def send(now: float) -> None:
        if round(now * 100) % round(100.0 / rate) == 0:
            assert filtering.filter.offer(ahead, offered(now + ahead)[0], begin=now).ok

    filtering.run(DURATION + 1.0, send)
    assert off_the_path(filtering.positions) < 2e-3
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-6)
    assert keeps_limits(filtering)


def test_chunks_that_jitter_and_begin_where_the_arm_is_are_played_at_their_times(filtering: Filtering) -> None:
    """As of a network: the control is that through these points motions exceed the limits of acceleration."""
    random, ahead, over = np.random.default_rng(0), np.arange(16) / 30.0, []

    def send(now: float) -> None:
        if round(now * 100) % 25 == 0:
            positions = offered(now + ahead)[0] + random.normal(0.0, 2e-3, (16, 7))
            positions[0] = filtering.filter.commanded_state(now)[0]
            bends = np.abs(np.diff(positions, 2, axis=0)) * 30.0**2
            over.append(np.max(bends / filtering.filter.limits.acceleration) > 1.0)
            assert filtering.filter.offer(ahead, positions, begin=now).ok

    filtering.run(DURATION + 0.3, send)
    assert np.mean(over) > 0.5
    wanted, _ = offered(0.01 * np.arange(len(filtering.positions)))
    np.testing.assert_allclose(filtering.positions, wanted, atol=0.03)
    assert keeps_limits(filtering)


def test_the_arm_brakes_along_its_path_before_what_stands_there_and_goes_on_when_that_is_removed(
    filtering: Filtering, least_clearance: Callable[..., float]
) -> None:
    place = halfway(filtering)
    times = np.linspace(0.0, DURATION, 76)
    sphere = Obstacles.of_spheres(place[None], np.array([RADIUS]))
    filtering.filter.observe(sphere)
    assert filtering.filter.offer(times, offered(times)[0]).ok
    plan = filtering.run(DURATION)
    assert filtering.at_rest
    assert (plan.verdict.code, plan.mode) == (VerdictCode.NO_FEASIBLE_PATH, Mode.WAITING)
    assert "panda" in plan.verdict.reason
    # It has come a part of the path, and the control would have touched.
    assert np.linalg.norm(filtering.positions[-1] - BEGIN) > 0.1 * np.linalg.norm(MOVED)
    assert least_clearance(filtering.positions, lambda _: place, RADIUS) > 0.0
    assert least_clearance(offered(times)[0], lambda _: place, RADIUS) < 0.0
    filtering.filter.observe(Obstacles.none())
    filtering.run(DURATION + 1.0)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-6)
    assert off_the_path(filtering.positions) < 2e-3
    assert keeps_limits(filtering)


@pytest.mark.parametrize("chunks", [False, True], ids=["whole", "chunks"])
@pytest.mark.parametrize("speed", [0.1, 0.4])
def test_nothing_is_touched_that_crosses_the_path(
    filtering: Filtering, least_clearance: Callable[..., float], speed: float, chunks: bool
) -> None:
    """The control: an arm that plays what is offered touches the sphere. Chunks are of one who does not look."""
    place, velocity = halfway(filtering), speed * np.array([0.6, 0.0, 0.8])
    times, ahead = np.linspace(0.0, DURATION, 76), np.arange(16) / 30.0

    def centre(tick: int) -> np.ndarray:
        return place + (0.01 * tick - 0.5 * DURATION) * velocity

    def send(now: float) -> None:
        obstacle = Obstacles.of_spheres(centre(round(100 * now))[None], np.array([RADIUS]), velocity[None], now)
        filtering.filter.observe(obstacle)
        if chunks and round(100 * now) % 10 == 0:
            filtering.filter.offer(ahead, offered(now + ahead)[0], begin=now)

    if not chunks:
        assert filtering.filter.offer(times, offered(times)[0]).ok
    filtering.run(2.0 * DURATION, send)
    control, _ = offered(0.01 * np.arange(len(filtering.positions)))
    assert least_clearance(control, centre, RADIUS) < 0.0
    assert least_clearance(filtering.positions, centre, RADIUS) > 0.0
    assert off_the_path(filtering.positions) < 2e-3
    assert keeps_limits(filtering)


def test_an_arm_inside_an_obstacle_is_in_collision_and_goes_on_when_that_is_removed(filtering: Filtering) -> None:
    hand, _ = filtering.filter.robot.forward(BEGIN)
    filtering.filter.observe(Obstacles.of_spheres(hand[None], np.array([0.1])))
    times = np.linspace(0.0, DURATION, 76)
    assert filtering.filter.offer(times, offered(times)[0]).ok
    plan = filtering.run(0.5)
    assert plan.verdict.code is VerdictCode.IN_COLLISION
    assert "overlaps the sphere at" in plan.verdict.reason
    np.testing.assert_array_equal(filtering.positions[-1], BEGIN)
    filtering.filter.observe(Obstacles.none())
    filtering.run(DURATION + 0.5)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-6)


def test_an_arm_that_is_pushed_towards_an_obstacle_keeps_its_margin_and_may_leave(filtering: Filtering) -> None:
    """Fifty targets a second lead into a sphere on the path, and then back. The control: they reach into it."""
    sphere = Obstacles.of_spheres(halfway(filtering)[None], np.array([RADIUS]))
    margin = filtering.filter.settings.obstacle_margin
    filtering.filter.observe(sphere)

    def clearance(position: np.ndarray) -> float:
        return obstacle_clearance(filtering.filter.collision, filtering.filter.robot, position, sphere)[0]

    def pushed(sign: float) -> Callable[[float], None]:
        def send(now: float) -> None:
            if round(100 * now) % 2 == 0:
                here = filtering.filter.commanded_state(now)[0]
                share = np.clip((here - BEGIN) @ MOVED / (MOVED @ MOVED) + sign * 0.2, 0.0, 1.0)
                assert filtering.filter.offer(np.zeros(1), (BEGIN + share * MOVED)[None]).ok

        return send

    filtering.run(4.0, pushed(1.0))
    clearances = [clearance(position) for position in filtering.positions]
    # Chunk by chunk the arm may lose a thousandth of what it keeps.
    assert 0.8 * margin < min(clearances) < 10.0 * margin
    ahead = np.clip((filtering.positions[-1] - BEGIN) @ MOVED / (MOVED @ MOVED) + 0.2, 0.0, 1.0)
    assert clearance(BEGIN + ahead * MOVED) < 0.0
    filtering.run(4.0, pushed(-1.0))
    np.testing.assert_allclose(filtering.positions[-1], BEGIN, atol=1e-3)


@pytest.mark.parametrize("recover", ["detour", "wait"])
def test_an_arm_that_may_passes_around_what_stays_and_comes_to_the_end_of_the_trajectory(
    least_clearance: Callable[..., float], recover: Recovery
) -> None:
    filtering = Filtering(MotionFilter("panda", DeclaredScene.empty(), recover=recover))
    filtering.filter.stand_at(BEGIN, 0.0)
    place, times = halfway(filtering), np.linspace(0.0, DURATION, 76)
    filtering.filter.observe(Obstacles.of_spheres(place[None], np.array([0.03])))
    assert filtering.filter.offer(times, offered(times)[0]).ok
    patience = filtering.filter.settings.patience
    filtering.run(2.0 * DURATION + patience)
    arrived = np.allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-6)
    assert arrived == (recover == "detour")
    assert filtering.at_rest
    assert least_clearance(filtering.positions, lambda _: place, 0.03) > 0.0
    assert keeps_limits(filtering)


def test_silence_is_a_stop(filtering: Filtering) -> None:
    """After one chunk that ends in motion the arm is at rest, on the path and no farther than it was sent."""
    ahead = np.arange(16) / 30.0
    begin = 0.25 * DURATION
    filtering.filter.stand_at(offered(np.array([begin]))[0][0], 0.0)
    assert filtering.filter.offer(ahead, offered(begin + ahead)[0]).ok
    filtering.run(2.0)
    assert filtering.at_rest
    np.testing.assert_allclose(filtering.positions[-1], offered(begin + ahead[-1:])[0][0], atol=1e-6)


def test_a_trajectory_that_begins_later_is_waited_for(filtering: Filtering) -> None:
    times = np.linspace(0.0, DURATION, 76)
    assert filtering.filter.offer(times, offered(times)[0], begin=1.0).ok
    plan = filtering.run(0.9)
    assert filtering.at_rest
    assert "begins in" in plan.verdict.reason
    filtering.run(DURATION + 0.5)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-6)


@pytest.mark.parametrize("in_time", [True, False])
def test_where_no_place_is_free_for_long_one_that_is_free_for_now_is_searched_in_the_end(
    in_time: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However slow the machine: a search that has come to its end is over, though its tick is late."""
    searched: list[float] = []

    def found_none(judge: OfferSolver, requirement: Requirement, *rest: object) -> None:
        searched.append(requirement.horizon)

    monkeypatch.setattr("geodesic_motion_ros.filtering.motion_filter.evasion_beside", found_none)
    filtering = Filtering(MotionFilter("panda", DeclaredScene.empty(), recover="detour"))
    filtering.filter.stand_at(BEGIN, 0.0)
    times, centre = np.linspace(0.0, DURATION, 76), halfway(filtering)
    assert filtering.filter.offer(times, offered(times)[0]).ok
    requirements = Requirements.of(filtering.filter.settings)
    for tick in range(20):
        # It stands on the path, and another one comes to the arm, which it meets in a third of a second.
        hand, _ = filtering.filter.robot.forward(BEGIN)
        both = np.stack([centre, hand + [0.0, 0.0, 0.3 - 0.004 * tick]])
        velocities = [[0.0, 0.0, 0.0], [0.0, 0.0, -0.4]]
        filtering.filter.observe(Obstacles.of_spheres(both, [0.06, 0.04], velocities, 0.01 * tick))
        late = Deadline(-1.0, lambda: 0.0)
        filtering.filter.tick(0.01 * tick, NEVER if in_time else late)
    assert {requirements.evasion.horizon, requirements.beside_graph.horizon} == set(searched)


def test_a_stop_that_is_requested_is_one_and_the_trajectory_is_forgotten_with_clear_goal(
    filtering: Filtering,
) -> None:
    times = np.linspace(0.0, DURATION, 76)
    assert filtering.filter.offer(times, offered(times)[0]).ok
    filtering.run(0.5 * DURATION)
    filtering.filter.clear_goal()
    plan = filtering.run(1.0)
    assert filtering.at_rest
    assert (plan.verdict.code, plan.mode) == (VerdictCode.NO_GOAL, Mode.IDLE)
    assert off_the_path(filtering.positions) < 2e-3


def changed(points: np.ndarray, index: tuple[int, int], value: float) -> np.ndarray:
    """Points with one number replaced."""
    points = points.copy()
    points[index] = value
    return points


TIMES = np.linspace(0.0, 0.5, 16)
POSITIONS = offered(TIMES)[0]


@pytest.mark.parametrize(
    ("times", "positions", "begin", "words"),
    [
        (TIMES[:0], POSITIONS[:0], None, "the trajectory has no points"),
        (TIMES, POSITIONS[:, :6], None, "positions has shape (16, 6): expected (m, 7)"),
        (TIMES[:5], POSITIONS, None, "the trajectory has 5 times and 16 positions"),
        (TIMES, changed(POSITIONS, (3, 1), np.nan), None, "point 3: the position of 'panda_joint2' is nan"),
        (TIMES[::-1], POSITIONS, None, "point 1 comes at"),
        (TIMES, POSITIONS, np.inf, "begin [s] is inf"),
        (TIMES, POSITIONS, "now", "begin [s] is 'now': a real number is needed"),
        (TIMES, POSITIONS, np.zeros(1), "begin [s] is array([0.]): a real number is needed"),
        (TIMES, POSITIONS, True, "begin [s] is True: a real number is needed"),
        (TIMES, np.ma.masked_less(POSITIONS, -1.0), None, "positions has masked values"),
        (TIMES, changed(POSITIONS, (4, 3), 0.5), None, "point 4 takes 'panda_joint4' to 0.500 rad, beyond its limit"),
        (TIMES, changed(POSITIONS, (4, 0), 0.4), None, "'panda_joint1' would move at"),
        (1e6 * TIMES, POSITIONS, None, "the trajectory lasts 5e+05 s, at most 600 s may be"),
        (TIMES, POSITIONS + 0.4, None, "is commanded, at most 0.3 may be: a jump"),
        (TIMES, POSITIONS, -1.0, "the trajectory was over 0.50 s ago"),
        (TIMES, POSITIONS, 1e9, "the trajectory begins in"),
        ("words", POSITIONS, None, "times is 'words'"),
    ],
)
def test_what_is_wrong_with_a_trajectory_is_named_and_the_one_before_goes_on(
    filtering: Filtering, times: object, positions: object, begin: float | None, words: str
) -> None:
    whole = np.linspace(0.0, DURATION, 76)
    assert filtering.filter.offer(whole, offered(whole)[0]).ok
    refused = filtering.filter.offer(times, positions, begin=begin)
    assert refused.code is VerdictCode.BAD_INPUT
    assert words in refused.reason
    filtering.run(DURATION + 0.3)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-6)


def test_no_trajectory_whatever_is_in_it_raises_or_breaks_a_limit(motion_filter: MotionFilter) -> None:
    """Chunks full of nonsense among moving spheres; `geodesic-motion experiment chunks` offers thousands."""
    wild = offer_wild(motion_filter, np.random.default_rng(1), 400)
    assert wild.taken > 50
    assert wild.refused > 200
    assert wild.motions > 20
    assert not wild.raised
    assert not wild.unnamed
    assert not wild.broken


def test_a_detour_needs_to_know_what_stands_around_the_arm() -> None:
    with pytest.raises(ParameterError, match="declare what stands around the arm"):
        MotionFilter("panda", recover="detour")


def test_what_the_filter_does_not_know_is_refused_by_name() -> None:
    with pytest.raises(ParameterError, match="recover = 'Detour': expected one of wait, detour"):
        MotionFilter("panda", DeclaredScene.empty(), recover="Detour")  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="scene = 'table': a DeclaredScene is needed"):
        MotionFilter("panda", "table")  # type: ignore[arg-type]


@pytest.mark.parametrize("recover", ["detour", "wait"])
def test_a_stream_of_chunks_is_passed_around_what_covers_their_ends(
    least_clearance: Callable[..., float], recover: Recovery
) -> None:
    """Each leads on by half a second from where the arm is, into the sphere, as of one who does not look."""
    filtering = Filtering(MotionFilter("panda", DeclaredScene.empty(), recover=recover))
    filtering.filter.stand_at(BEGIN, 0.0)
    place = halfway(filtering)
    filtering.filter.observe(Obstacles.of_spheres(place[None], np.array([0.03])))
    ahead = np.arange(16) / 30.0

    def send(now: float) -> None:
        if round(now * 100) % 25 == 0:
            here = filtering.filter.commanded_state(now)[0]
            share = np.clip((here - BEGIN) @ MOVED / (MOVED @ MOVED) + 0.3 * ahead, 0.0, 1.0)[:, None]
            # Beside the straight line it comes back to that.
            beside = (here - BEGIN - share[0] * MOVED) * (1.0 - ahead / ahead[-1])[:, None]
            filtering.filter.offer(ahead, BEGIN + share * MOVED + beside, begin=now)

    filtering.run(filtering.filter.settings.patience + 12.0, send)
    arrived = np.allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-3)
    assert arrived == (recover == "detour")
    assert least_clearance(filtering.positions, lambda _: place, 0.03) > 0.0
    assert keeps_limits(filtering)


def test_an_arm_that_creeps_behind_what_draws_back_does_not_begin_to_wait_anew() -> None:
    """A sphere draws back by a centimetre every second and a half: each time the arm plays on a little."""
    filtering = Filtering(MotionFilter("panda", DeclaredScene.empty(), recover="detour"))
    filtering.filter.stand_at(BEGIN, 0.0)
    times, place = np.linspace(0.0, DURATION, 76), halfway(filtering)
    onwards = filtering.filter.robot.forward(BEGIN + 0.6 * MOVED)[0] - place
    onwards /= np.linalg.norm(onwards)
    assert filtering.filter.offer(times, offered(times)[0]).ok

    def send(now: float) -> None:
        centre = place + 0.01 * (round(100 * now) // 150) * onwards
        filtering.filter.observe(Obstacles.of_spheres(centre[None], np.array([0.03])))

    crept = 0
    for _ in range(100):
        stood = filtering.commanded and filtering.at_rest
        plan = filtering.run(0.1, send)
        if plan.verdict.ok and off_the_path(filtering.positions[-10:]) > 0.02:
            break
        crept += bool(stood and not filtering.at_rest)
    blocked = next(number for number, plan in enumerate(filtering.plans) if not plan.verdict.ok)
    assert crept > 0  # the control: it did not stand all the time
    assert filtering.now < 0.01 * blocked + filtering.filter.settings.patience + 1.0


@pytest.mark.parametrize("recover", ["detour", "wait"])
def test_an_arm_that_waits_makes_room_for_what_comes_where_it_may_leave_its_path(
    least_clearance: Callable[..., float], recover: Recovery
) -> None:
    """A sphere stands on the path, and another one comes to where the arm waits for it to leave."""
    filtering = Filtering(MotionFilter("panda", DeclaredScene.empty(), recover=recover))
    filtering.filter.stand_at(BEGIN, 0.0)
    times, stands = np.linspace(0.0, DURATION, 76), halfway(filtering)
    filtering.filter.observe(Obstacles.of_spheres(stands[None], np.array([0.06])))
    assert filtering.filter.offer(times, offered(times)[0]).ok
    filtering.run(1.0)
    assert filtering.at_rest
    hand, _ = filtering.filter.robot.forward(filtering.positions[-1])
    velocity = 0.15 * (hand - stands) / np.linalg.norm(hand - stands)
    begun = len(filtering.positions)

    def centre(tick: int) -> np.ndarray:
        return hand + (0.01 * (tick - begun) - 2.5) * velocity

    def send(now: float) -> None:
        both = np.stack([stands, centre(round(100 * now))])
        velocities = np.stack([np.zeros(3), velocity])
        filtering.filter.observe(Obstacles.of_spheres(both, np.array([0.06, 0.04]), velocities, now))

    filtering.run(2.6, send)
    evading = ["evading what is coming" in plan.verdict.reason for plan in filtering.plans]
    assert any(evading) == (recover == "detour")
    assert (least_clearance(filtering.positions, centre, 0.04) > 0.0) == (recover == "detour")
    assert keeps_limits(filtering)
    if recover == "detour":
        # In good time: not only once the sphere would meet the arm soon.
        soon = round(200 * EVASION_DISPLACED_WITHIN)
        rest = filtering.positions[begun - 1]
        assert least_clearance([rest], lambda _: centre(evading.index(True) + soon), 0.04) > 0.0
