"""Flaws of recordings: found, stated, and repaired or refused, by one rule each.

| flaw | rule | action |
|---|---|---|
| stamps that repeat or fall | not later than all before | those samples are left out; refused beyond LARGEST_SHARE |
| spike | up to LONGEST_SPIKE samples, faster than FASTEST there and back | a straight line in their place |
| jump (lost packets) | faster than FASTEST, and stays | repaired up to BRIDGED: the step takes longer; else left out |
| jump (two demonstrations) | slower, beyond BRIDGED, and far beyond the steps beside it | left out |
| gap | longer than GAP and GAP_STEPS usual steps | a straight line up to BRIDGED; else left out |
| jitter | steps of time beyond JITTER times the usual one | kept: learning counts length, not time |
| few samples | fewer than FEWEST; fewer than LOWEST_RATE a second | left out; kept |
| standstill at an end | longer than LONGEST_REST | kept: learning counts length, not time |
| no motion | nothing leaves MOTIONLESS | refused |
| another task, interrupted, another posture | `find_strangers` | left out |
| two tasks | `find_strangers` | refused |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from geodesic_motion_ros.demonstrations.breaks import is_far_beyond, is_gap
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.modes import cluster_modes
from geodesic_motion_ros.demonstrations.splitting import is_still
from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take, sizes_by_column
from geodesic_motion_ros.geometry.quaternions import angle_between, mean_rotation, rotation_vector_between

#: Faster than any arm that a hand guides: joints [rad/s], positions [m/s], parts of a quaternion [1/s], which change by
#: half of the angular velocity. Joints of arms turn by up to 7 rad/s; lost packets have been seen as 27 rad/s.
FASTEST = {"joint": 8.0, "position": 4.0, "quaternion": 6.0}
#: A straight line replaces at most so much of a motion [rad], [m]: in real demonstrations it is then within 1 cm of it.
BRIDGED = {"joint": 0.3, "position": 0.1, "quaternion": 0.15}
#: Without a motion larger than this there is nothing to learn [rad], [m].
MOTIONLESS = {"joint": 0.02, "position": 1e-3, "quaternion": 0.01}
LONGEST_SPIKE = 5
#: With more fast steps or wrong stamps than this share the rate, or the clock, is wrong, and not single samples.
LARGEST_SHARE = 0.1
JITTER = 2.0
FEWEST, LOWEST_RATE = 10, 5.0
LONGEST_REST = 2.0
#: A start or goal is another task's this share of the median length of the paths from the nearest other one, and this
#: many times as far as the others usually are: starts vary by a quarter of the length in real demonstrations, and one
#: of ten lay four times as far as the median from the nearest.
STRANGE_SHARE, STRANGE_TIMES = 0.25, 5.0
#: A demonstration is interrupted if it ends this share of the length before any goal, on the others' path (as near).
INTERRUPTED_SHARE = 0.05
#: [rad] over all joints, to the nearest other start or goal: an elbow or a wrist on the other side.
ANOTHER_POSTURE = 1.5
#: What a radian of the tool's orientation counts beside its position [m].
ROTATION_LENGTH = 0.2
#: Two tasks differ in starts and in goals by at least this [m], and each has at least two demonstrations.
TASKS_APART = 0.05


def repair_samples(take: Take) -> tuple[Take, list[Flaw]]:
    """Repair times that do not rise and spikes of a take; with what was found."""
    flaws = []
    for rule in (_rising_times, _without_spikes):
        take, found = rule(take)
        flaws += found
    return take, flaws


def repair_demonstration(take: Take) -> tuple[Take, list[Flaw]]:
    """Bridge the jumps of one demonstration, its times rising; with what was found."""
    flaws = _few_samples(take)
    if flaws and flaws[0].action is Action.LEFT_OUT:
        return take, flaws
    flaws += _no_motion(take)
    flaws += _gaps(take) + _jitter(take) + _rests(take)
    take, jumps = _bridged_jumps(take)
    return take, flaws + jumps


def _rising_times(take: Take) -> tuple[Take, list[Flaw]]:
    latest = np.maximum.accumulate(take.times)
    wrong = np.flatnonzero(np.append(False, take.times[1:] <= latest[:-1]))
    if not len(wrong):
        return take, []
    what = f"has {len(wrong)} of {len(take)} samples with a time that repeats or falls"
    time = float(take.times[wrong[0]])
    if len(wrong) > LARGEST_SHARE * len(take):
        how = f"times must rise; at most {LARGEST_SHARE:.0%} are repaired"
        if np.all(np.diff(take.times) >= 0.0):
            how += ". Are they written with too few digits? Write more of them, or leave t out and give --rate"
        return take, [Flaw(take.name, time, what, Action.REFUSED, how)]
    return take.part(np.delete(np.arange(len(take)), wrong)), [
        Flaw(take.name, time, what, Action.REPAIRED, "they are left out")
    ]


def _fast_steps(take: Take) -> np.ndarray:
    """Steps from each sample to the next in multiples of what FASTEST allows (T - 1,).

    A step of time counts as the usual one at least: messages that were held up arrive together.
    """
    steps = np.diff(take.times)
    allowed = np.maximum(steps, np.median(steps))[:, None] * sizes_by_column(FASTEST, take.names)
    return np.max(np.abs(np.diff(take.values, axis=0)) / allowed, axis=1)


def _without_spikes(take: Take) -> tuple[Take, list[Flaw]]:
    if len(take) < 4 or np.any(np.diff(take.times) <= 0.0):
        return take, []
    speeds = _fast_steps(take)
    fast = np.flatnonzero(speeds > 1.0)
    if not len(fast):
        return take, []
    if len(fast) > LARGEST_SHARE * len(speeds):
        what = f"has {len(fast)} of {len(speeds)} steps faster than an arm: {_speed(take, fast[0])}"
        time = float(take.times[fast[0]])
        return take, [Flaw(take.name, time, what, Action.KEPT, "are the rate and the units right?")]
    values, flaws, cut, next_step = take.values.copy(), [], np.zeros(len(take), dtype=bool), 0
    for step, back in zip(fast, np.append(fast[1:], len(take) * 2), strict=True):
        spiked = slice(step + 1, back + 1)
        if step < next_step:
            continue
        if back - step <= LONGEST_SPIKE and _is_slow(take, step, back + 1):
            share = ((take.times[spiked] - take.times[step]) / (take.times[back + 1] - take.times[step]))[:, None]
            values[spiked] = (1.0 - share) * take.values[step] + share * take.values[back + 1]
            next_step, size, how = back + 1, back - step, "a straight line in its place"
        elif step < 1 or step + 2 >= len(take):
            cut[slice(0, step + 1) if step < 1 else slice(step + 1, None)] = True
            size, how = 1, "the end is cut"
        else:
            continue
        what = f"has a spike of {size} sample{'s' if size > 1 else ''}, {_speed(take, step)}"
        flaws.append(Flaw(take.name, float(take.times[step]), what, Action.REPAIRED, how))
    return replace(take, values=values).part(~cut), flaws


def _is_slow(take: Take, first: int, last: int) -> bool:
    """Whether an arm may move from one sample to another in the time between them."""
    allowed = (take.times[last] - take.times[first]) * sizes_by_column(FASTEST, take.names)
    return bool(np.all(np.abs(take.values[last] - take.values[first]) <= allowed))


def _speed(take: Take, step: int) -> str:
    """The speed of a step in words, of the column that is fastest beside what it may do."""
    speeds = np.abs(take.values[step + 1] - take.values[step]) / (take.times[step + 1] - take.times[step])
    column = int(np.argmax(speeds / sizes_by_column(FASTEST, take.names)))
    unit = "rad/s" if take.is_of_joints else "m/s" if column < 3 else "1/s"
    return f"{speeds[column]:.3g} {unit} in {take.names[column]}"


def _bridged_jumps(take: Take) -> tuple[Take, list[Flaw]]:
    speeds = _fast_steps(take)
    fast = np.flatnonzero(speeds > 1.0)
    if len(fast) > LARGEST_SHARE * len(speeds):
        return take, []  # stated with the spikes
    moves, flaws, steps = np.abs(np.diff(take.values, axis=0)), [], np.diff(take.times)
    far = is_far_beyond(speeds) & np.any(moves > sizes_by_column(BRIDGED, take.names), axis=1) & ~is_gap(steps)
    for step in np.flatnonzero(far | (speeds > 1.0)):
        moved = moves[step]
        cause = "samples are lost" if speeds[step] > 1.0 else "samples are lost, or these are two demonstrations"
        time, what = float(take.times[step]), f"jumps, {_speed(take, step)}: {cause}"
        if np.all(moved <= sizes_by_column(BRIDGED, take.names)):
            lost = speeds[step] * max(steps[step], float(np.median(steps))) - steps[step]
            steps[step] += lost
            how = f"a straight line, {1e3 * lost:.0f} ms longer"
            flaws.append(Flaw(take.name, time, what, Action.REPAIRED, how))
        else:
            flaws.append(Flaw(take.name, time, what, Action.LEFT_OUT, "too far for a straight line"))
    return replace(take, times=take.times[0] + np.append(0.0, np.cumsum(steps))) if flaws else take, flaws


def _gaps(take: Take) -> list[Flaw]:
    steps, flaws = np.diff(take.times), []
    for step in np.flatnonzero(is_gap(steps)):
        moved = np.abs(take.values[step + 1] - take.values[step])
        bridged = bool(np.all(moved <= sizes_by_column(BRIDGED, take.names)))
        action, how = (
            (Action.REPAIRED, "a straight line") if bridged else (Action.LEFT_OUT, "too far for a straight line")
        )
        flaws.append(Flaw(take.name, float(take.times[step]), f"has a gap of {steps[step]:.2f} s", action, how))
    return flaws


def _jitter(take: Take) -> list[Flaw]:
    steps = np.diff(take.times)
    steps = steps[~is_gap(steps)]
    usual = float(np.median(steps))
    late = np.mean((steps > JITTER * usual) | (steps < usual / JITTER)) if len(steps) else 0.0
    if late <= LARGEST_SHARE:
        return []
    what = f"has jitter: {late:.0%} of the steps are not within a factor of {JITTER:g} of {1e3 * usual:.1f} ms"
    return [Flaw(take.name, float(take.times[0]), what, Action.KEPT, "learning counts length, not time")]


def _few_samples(take: Take) -> list[Flaw]:
    duration = float(take.times[-1] - take.times[0]) if len(take) else 0.0
    rate = (len(take) - 1) / duration if duration > 0.0 else 0.0
    begin = float(take.times[0]) if len(take) else 0.0
    what = f"has {len(take)} samples, {rate:.2g} a second"
    if len(take) < FEWEST:
        return [Flaw(take.name, begin, what, Action.LEFT_OUT, f"at least {FEWEST} make a motion")]
    if rate < LOWEST_RATE:
        how = f"straight lines between them; record {LOWEST_RATE:g} or more"
        return [Flaw(take.name, begin, what, Action.KEPT, how)]
    return []


def _rests(take: Take) -> list[Flaw]:
    still = is_still(take, LONGEST_REST)
    if np.all(still) or not np.any(still):
        return []
    moving = np.flatnonzero(~still)
    flaws = []
    for verb, first, last in (("begins", 0, moving[0]), ("ends", moving[-1], len(take) - 1)):
        begin, duration = float(take.times[first]), float(take.times[last] - take.times[first])
        if duration > LONGEST_REST:
            what = f"{verb} with a standstill of {duration:.1f} s"
            flaws.append(Flaw(take.name, begin, what, Action.KEPT, "learning counts length, not time"))
    return flaws


def _no_motion(take: Take) -> list[Flaw]:
    moved = np.abs(take.values - take.values[0]).max(axis=0)
    if np.any(moved >= sizes_by_column(MOTIONLESS, take.names)):
        return []
    unit = ("rad", 1.0) if take.is_of_joints else ("mm", 1e3)
    largest = f"{unit[1] * moved[: None if take.is_of_joints else 3].max():.2g} {unit[0]}"
    return [Flaw(take.name, float(take.times[0]), f"does not move: {largest} at most", Action.REFUSED, "take it out")]


def find_strangers(tool: Demonstrations, ends: Sequence[np.ndarray] = ()) -> list[Flaw]:
    """Find demonstrations that start or end where no other does: of another task, interrupted, or in another posture.

    Parameters
    ----------
    tool : the motions of the tool.
    ends : (2, eta) first and last configuration [rad] of each, where joints were recorded.

    Two groups of at least two demonstrations each, apart at both ends, are two tasks: which one was meant is not
    guessed. Groups that differ between the ends alone are modes of one task, and are kept.
    """
    if len(tool) < 3:
        return []
    length = float(np.median([item.length for item in tool]))
    flaws: dict[str, Flaw] = {}
    distances = {end: _between(tool, end) for end in (0, -1)}
    for index, item in enumerate(tool):
        if _ends_early(tool, index, distances[-1], length):
            apart, share = 1e3 * _nearest(distances[-1])[index], item.length / length
            what = f"is interrupted: ends {apart:.0f} mm from the others, at {share:.0%} of their length"
            flaws[item.name] = Flaw(item.name, float(item.times[-1]), what, Action.LEFT_OUT)
    for end, verb in ((0, "starts"), (-1, "ends")):
        nearest = _nearest(distances[end])
        limit = max(STRANGE_SHARE * length, STRANGE_TIMES * float(np.median(nearest)))
        for index in np.flatnonzero(nearest > limit):
            item = tool[int(index)]
            what = f"is of another task: {verb} {1e3 * nearest[index]:.0f} mm from where any other does"
            flaws.setdefault(item.name, Flaw(item.name, float(item.times[end]), what, Action.LEFT_OUT))
    if len(ends):
        flaws = _postures(tool, np.array(ends)) | flaws
    if not flaws and (tasks := _two_tasks(tool)):
        return [tasks]
    return list(flaws.values())


def _between(tool: Demonstrations, end: int) -> np.ndarray:
    """Distances (N, N) [m] between the first or the last poses."""
    positions = np.array([item.positions[end] for item in tool])
    quaternions = np.array([item.quaternions[end] for item in tool])
    turned = angle_between(quaternions[:, None], quaternions[None])
    return np.hypot(cdist(positions, positions), ROTATION_LENGTH * turned)


def _nearest(distances: np.ndarray) -> np.ndarray:
    """Distance (N,) of each to its nearest other one."""
    return np.min(distances + np.diag(np.full(len(distances), np.inf)), axis=1)


def _ends_early(tool: Demonstrations, index: int, distances: np.ndarray, length: float) -> bool:
    """Whether a demonstration ends on the path of another one, well before the goals of all."""
    item, near = tool[index], INTERRUPTED_SHARE * length
    nearest = _nearest(distances)
    if item.length > (1.0 - INTERRUPTED_SHARE) * length:
        return False
    if nearest[index] < max(near, STRANGE_TIMES * float(np.median(nearest))):
        return False
    others = np.concatenate([other.positions for number, other in enumerate(tool) if number != index])
    return float(np.min(np.linalg.norm(others - item.positions[-1], axis=1))) < 2.0 * near


def _postures(tool: Demonstrations, ends: np.ndarray) -> dict[str, Flaw]:
    """Those whose first or last configuration, of ends (N, 2, eta) [rad], is far from that of every other."""
    flaws = {}
    for end, verb in ((0, "starts"), (-1, "ends")):
        nearest = _nearest(cdist(ends[:, end], ends[:, end]))
        limit = max(ANOTHER_POSTURE, STRANGE_TIMES * float(np.median(nearest)))
        for index in np.flatnonzero(nearest > limit):
            item = tool[int(index)]
            what = f"is in another posture: {verb} {nearest[index]:.2f} rad from any other"
            flaws[item.name] = Flaw(item.name, float(item.times[end]), what, Action.LEFT_OUT)
    return flaws


def _two_tasks(tool: Demonstrations) -> Flaw | None:
    reference = [mean_rotation(np.array([item.quaternions[end] for item in tool])) for end in (0, -1)]
    features = np.array([
        [
            np.append(item.positions[end], ROTATION_LENGTH * rotation_vector_between(mean, item.quaternions[end]))
            for end, mean in zip((0, -1), reference, strict=True)
        ]
        for item in tool
    ])  # fmt: skip
    groups = cluster_modes(features)
    apart = groups[:, None] != groups[None]
    if not np.any(apart) or min(_between(tool, end)[apart].min() for end in (0, -1)) < TASKS_APART:
        return None
    listed = "; ".join(
        ", ".join(item.name for item, own in zip(tool, groups, strict=True) if own == group)
        for group in range(groups.max() + 1)
    )
    second = tool[int(np.argmax(groups))]
    what = f"is of another of {groups.max() + 1} tasks, apart at both ends: {listed}"
    return Flaw(second.name, float(second.times[0]), what, Action.REFUSED, "one skill is learned from one task")
