"""What the judges object to, on commands that are made up; each rule beside a command that keeps it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_studies.faults.judge import Target, TargetJudge, Trajectory, TrajectoryJudge

ROBOT = Robot.named("panda")
LIMITS = JointLimits.of(ROBOT, 0.3, 0.2)
NOW = 1000.0
#: The one place (1, 7) where the arm was.
READY = ROBOT.ready[None]


def motion(start: np.ndarray, displacement: np.ndarray, duration: float = 2.0, begin: float = NOW) -> Trajectory:
    """From rest to rest, heard when it begins."""
    ends = np.stack([start, start + displacement])
    still = np.zeros_like(ends)
    times = np.linspace(0.0, duration, 21)
    inner = times[:-1]
    samples = quintic_samples(np.array([0.0, duration]), ends, still, still, inner)
    last = np.stack([ends[1], still[1], still[1]])[:, None]
    positions, velocities, accelerations = np.concatenate([samples, last], axis=1)
    return Trajectory(begin + 0.002, begin, JointWaypoints(times, positions, velocities, accelerations))


@pytest.fixture
def judge() -> TrajectoryJudge:
    return TrajectoryJudge(LIMITS)


@pytest.fixture
def good() -> Trajectory:
    return motion(ROBOT.ready, np.full(7, 0.1))


def changed(trajectory: Trajectory, **values: np.ndarray) -> Trajectory:
    return replace(trajectory, waypoints=replace(trajectory.waypoints, **values))


class TestTrajectories:
    def test_a_good_one_is_not_objected_to(self, judge, good) -> None:
        assert judge.hear(good, READY) == []
        assert judge.largest_step < 1e-6

    def test_one_that_goes_on_where_the_other_is_starts_right(self, judge, good) -> None:
        judge.hear(good, READY)
        points = good.waypoints
        later = replace(good, heard=good.begin + 1.0)
        assert judge.hear(replace(later, begin=good.begin + 0.9, waypoints=_since(points, 9))) == []

    def test_a_step_is_measured(self, judge, good) -> None:
        judge.hear(good, READY)
        step = changed(good, positions=good.waypoints.positions + 0.021)
        assert any("starts 0.0210 rad" in sentence for sentence in judge.hear(step))
        assert judge.largest_step == pytest.approx(0.021)

    def test_the_first_one_starts_where_the_arm_is(self, judge, good) -> None:
        assert any("starts 0.03" in sentence for sentence in judge.hear(good, READY + 0.03))

    def test_where_the_arm_was_found_elsewhere_it_may_start_there(self, judge, good) -> None:
        judge.hear(good, READY)
        elsewhere = motion(ROBOT.ready + 0.3, np.full(7, 0.1))
        assert judge.hear(elsewhere, READY + 0.3) == []

    def test_of_the_places_where_the_arm_has_just_been_it_may_start_at_any(self, judge, good) -> None:
        judge.hear(good, READY)
        places = ROBOT.ready + np.array([[0.3], [0.35], [0.4]])
        anew = motion(places[1], np.full(7, 0.1))
        assert any("starts 0.05" in sentence for sentence in judge.hear(anew, places[2:]))
        assert judge.hear(anew, places) == []

    @pytest.mark.parametrize("jump", [5.0, -5.0])
    def test_what_was_commanded_by_the_clock_before_it_was_set_is_not_played_on(self, judge, good, jump) -> None:
        judge.hear(good, READY)
        here = ROBOT.ready + 0.05
        anew = motion(here, np.full(7, 0.1), begin=NOW + 1.0 + jump)
        assert judge.hear(anew, here[None]) == []
        later = replace(anew, heard=anew.begin + 0.5, begin=anew.begin + 0.5, waypoints=_since(anew.waypoints, 5))
        assert judge.hear(later) == []

    def test_positions_keep_the_margin(self, judge) -> None:
        near = ROBOT.upper.copy()
        near[1] = ROBOT.upper[1] - 0.005
        near = np.where(np.arange(7) == 1, near, ROBOT.ready)
        assert any("margin" in sentence for sentence in judge.hear(motion(near, np.zeros(7)), near[None]))

    def test_velocities_keep_the_limits(self, judge) -> None:
        sentences = judge.hear(motion(ROBOT.ready, np.full(7, 0.5), duration=1.0), READY)
        assert any("velocity" in sentence for sentence in sentences)

    def test_between_the_knots_accelerations_keep_the_limits_too(self, judge) -> None:
        ends, still = np.stack([ROBOT.ready, ROBOT.ready + 0.1]), np.zeros((2, 7))
        abrupt = Trajectory(NOW, NOW, JointWaypoints(np.array([0.0, 0.3]), ends, still, still))
        assert any("acceleration" in sentence for sentence in judge.hear(abrupt, READY))

    def test_the_end_is_at_rest(self, judge, good) -> None:
        braking = good.waypoints.accelerations.copy()
        braking[-1] = 0.1
        assert any("rest" in sentence for sentence in judge.hear(changed(good, accelerations=braking), READY))

    def test_an_old_stamp_is_reported(self, judge, good) -> None:
        late = replace(good, heard=good.begin + 0.3)
        assert any("stamp" in sentence for sentence in judge.hear(late, READY))

    def test_what_has_ended_is_reported(self, judge, good) -> None:
        late = replace(good, heard=good.begin + 2.1)
        assert any("in the past" in sentence for sentence in judge.hear(late, READY))


def _since(points: JointWaypoints, first: int) -> JointWaypoints:
    return JointWaypoints(
        points.times[first:] - points.times[first], points.positions[first:], points.velocities[first:],
        points.accelerations[first:],
    )  # fmt: skip


DOWN = np.array([0.0, 1.0, 0.0, 0.0])
#: Of the stream of poses [s].
PERIOD = 0.01


def pose(x: float = 0.0, angle: float = 0.0, at: float = NOW) -> Target:
    turned = np.array([0.0, np.cos(angle / 2), np.sin(angle / 2), 0.0])
    return Target(at, at, np.array([0.5 + x, 0.0, 0.4]), turned)


class TestTargets:
    def test_small_steps_are_not_objected_to(self) -> None:
        judge = TargetJudge(1.0, PERIOD)
        assert judge.hear(pose()) == judge.hear(pose(0.002, 0.008)) == []
        assert judge.largest_step == pytest.approx(0.008, abs=1e-6)

    @pytest.mark.parametrize("second", [pose(0.011), pose(angle=0.021)])
    def test_large_ones_are(self, second: Target) -> None:
        judge = TargetJudge(1.0, PERIOD)
        judge.hear(pose())
        assert any("from the one before" in sentence for sentence in judge.hear(second))

    def test_a_first_one_is_where_the_arm_is(self) -> None:
        arm = np.array([0.52, 0.0, 0.4]), DOWN
        assert any("20.0 mm" in sentence for sentence in TargetJudge(1.0, PERIOD).hear(pose(), [arm]))
        assert TargetJudge(1.0, PERIOD).hear(pose(), [arm, (np.array([0.501, 0.0, 0.4]), DOWN)]) == []

    def test_what_is_not_finite_is_reported(self) -> None:
        spoiled = replace(pose(), position=np.array([np.nan, 0.0, 0.0]))
        assert TargetJudge(1.0, PERIOD).hear(spoiled) == ["is not finite"]

    def test_the_other_sign_is_reported(self) -> None:
        judge = TargetJudge(1.0, PERIOD)
        judge.hear(pose())
        assert any("sign" in sentence for sentence in judge.hear(replace(pose(), quaternion=-DOWN)))

    def test_an_old_stamp_is_reported(self) -> None:
        assert any("stamp" in sentence for sentence in TargetJudge(1.0, PERIOD).hear(replace(pose(), heard=NOW + 0.3)))

    def test_norms_are_one(self) -> None:
        assert any(
            "norm" in sentence for sentence in TargetJudge(1.0, PERIOD).hear(replace(pose(), quaternion=1.1 * DOWN))
        )


def stream(speeds: np.ndarray, jitter: float = 0.0, lost: int = 0, late: int | None = None) -> list[Target]:
    """Poses that move on by a speed [m/s] in each period, stamps wrong by up to `jitter` [s]; one of `lost` is missing,
    and from `late` on they come 60 ms later.
    """
    random = np.random.default_rng(0)
    distances = PERIOD * np.cumsum(speeds)
    stamps = NOW + PERIOD * np.arange(len(speeds)) + random.uniform(-jitter, jitter, len(speeds))
    if late is not None:
        stamps[late:] += 0.06
    poses = [pose(distance, at=stamp) for distance, stamp in zip(distances, stamps, strict=True)]
    return [target for number, target in enumerate(poses) if not lost or number % lost != lost // 2]


def objections(poses: list[Target], judge: TargetJudge | None = None) -> list[str]:
    judge = judge or TargetJudge(1.0, PERIOD)
    return [sentence for target in poses for sentence in judge.hear(target)]


#: At 0.5 m/s^2 to 0.2 m/s, a while so, and to rest: every period's speed [m/s].
AT_THE_LIMIT = np.concatenate([np.zeros(20), np.linspace(0.0, 0.2, 41), np.full(60, 0.2), np.linspace(0.2, 0.0, 41)])


class TestAccelerationOfTargets:
    @pytest.mark.parametrize("jitter", [0.0, 0.002])
    @pytest.mark.parametrize("lost", [0, 20])
    def test_a_stream_at_the_limit_is_not_objected_to(self, jitter: float, lost: int) -> None:
        assert objections(stream(AT_THE_LIMIT, jitter, lost)) == []

    @pytest.mark.parametrize("jitter", [0.0, 0.002])
    @pytest.mark.parametrize("lost", [0, 20])
    def test_a_stop_within_one_period_is_found(self, jitter: float, lost: int) -> None:
        frozen = np.append(AT_THE_LIMIT[:90], np.zeros(30))
        assert any("an acceleration of" in sentence for sentence in objections(stream(frozen, jitter, lost)))

    def test_so_is_to_set_out_within_one(self) -> None:
        assert any("acceleration" in sentence for sentence in objections(stream(np.repeat([0.0, 0.1], 20))))

    def test_a_stream_that_comes_late_and_goes_on_is_not_objected_to(self) -> None:
        assert objections(stream(AT_THE_LIMIT, late=90)) == []

    def test_what_begins_anew_is_not_compared_with_what_was_before(self) -> None:
        judge = TargetJudge(1.0, PERIOD)
        assert objections(stream(AT_THE_LIMIT[:90]), judge) == []
        still = stream(np.zeros(20))
        arm = still[0].position, still[0].quaternion
        assert judge.hear(still[0], [arm]) == objections(still[1:], judge) == []
