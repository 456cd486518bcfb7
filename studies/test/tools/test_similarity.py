from itertools import combinations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.readers import read_demonstrations
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import rotate_by, slerp
from geodesic_motion_studies.tools.similarity import compare, distance_to_closest, dtw_matching

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def wavy(seed: int, samples: int = 300) -> PoseCurve:
    """A smooth random motion of about half a metre that turns by about a radian."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, samples)
    waves = sum(rng.normal(0.0, 0.05 / k, 3) * np.sin(np.pi * k * s)[:, None] for k in range(1, 5))
    turn = s[:, None] * rng.normal(0.0, 0.5, 3)
    positions = np.array([0.4, 0.0, 0.3]) + s[:, None] * np.array([0.0, 0.5, 0.1]) + waves
    return PoseCurve(positions, rotate_by(turn, np.tile(IDENTITY, (samples, 1))))


def moved(curve: PoseCurve, by: np.ndarray) -> PoseCurve:
    return PoseCurve(curve.positions + by, curve.quaternions)


@pytest.mark.parametrize("seed", range(5))
def test_a_motion_is_at_no_distance_from_itself(seed):
    found = compare(wavy(seed), wavy(seed))
    assert found.dtw == 0.0
    assert found.frechet == 0.0
    assert found.orientation < 1e-7


@pytest.mark.parametrize("seed", range(5))
def test_symmetric(seed):
    forth, back = compare(wavy(seed), wavy(seed + 100)), compare(wavy(seed + 100), wavy(seed))
    assert forth.dtw == pytest.approx(back.dtw, rel=1e-12)
    assert forth.frechet == back.frechet
    assert forth.orientation == pytest.approx(back.orientation, rel=1e-12)


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_timing_does_not_matter(power):
    fine = wavy(4, 4000)
    index = np.round(np.linspace(0.0, 1.0, 2000) ** power * 3999).astype(int)
    retimed = PoseCurve(fine.positions[index], fine.quaternions[index])
    other = wavy(5)
    assert compare(fine, retimed).frechet < 1e-3
    assert compare(retimed, other).dtw == pytest.approx(compare(fine, other).dtw, abs=2e-4)
    assert compare(retimed, other).orientation == pytest.approx(compare(fine, other).orientation, abs=2e-3)


def test_signs_of_quaternions_do_not_matter():
    curve, other = wavy(1), wavy(2)
    flipped = PoseCurve(curve.positions, -curve.quaternions)
    assert compare(flipped, other).orientation == pytest.approx(compare(curve, other).orientation, rel=1e-9)


def test_parallel_lines_are_as_far_apart_as_they_are():
    s = np.linspace(0.0, 1.0, 50)
    line = PoseCurve(
        s[:, None] * np.array([1.0, 0.0, 0.0]), slerp(IDENTITY, np.array([0.0, 0.0, 0.0, 1.0]), 0 * s)
    )
    found = compare(line, moved(line, np.array([0.0, 0.02, 0.0])))
    assert found.dtw == pytest.approx(0.02)
    assert found.frechet == pytest.approx(0.02)
    assert found.orientation == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_frechet_is_at_least_the_largest_distance_of_the_ends_and_at_least_dtw(seed):
    first, second = wavy(seed), moved(wavy(seed + 50), np.array([0.0, 0.03, 0.0]))
    found = compare(first, second)
    ends = np.linalg.norm(first.positions[[0, -1]] - second.positions[[0, -1]], axis=1)
    assert found.frechet >= ends.max() - 1e-12
    equal_arc = np.linalg.norm(first.resample(200).positions - second.resample(200).positions, axis=1)
    assert found.frechet <= equal_arc.max() + 1e-12


def test_matching_is_monotone_and_no_dearer_than_the_diagonal():
    first, second = wavy(7, 60).positions, wavy(8, 60).positions
    path = dtw_matching(first, second)
    assert path[0].tolist() == [0, 0]
    assert path[-1].tolist() == [59, 59]
    steps = np.diff(path, axis=0)
    assert set(map(tuple, steps.tolist())) <= {(1, 0), (0, 1), (1, 1)}
    along_path = np.linalg.norm(first[path[:, 0]] - second[path[:, 1]], axis=1).sum()
    assert along_path <= np.linalg.norm(first - second, axis=1).sum() * (1.0 + 1e-12)


def test_matching_is_the_cheapest_of_all():
    """Every monotone matching of two short sequences, tried one by one."""
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(4, 3)), rng.normal(size=(5, 3))
    distances = np.linalg.norm(first[:, None] - second, axis=2)

    def cheapest(i: int, j: int) -> float:
        if i == 0 and j == 0:
            return distances[0, 0]
        before = [cheapest(i - a, j - b) for a, b in ((1, 0), (0, 1), (1, 1)) if i >= a and j >= b]
        return distances[i, j] + min(before)

    path = dtw_matching(first, second)
    assert distances[path[:, 0], path[:, 1]].sum() == pytest.approx(cheapest(3, 4))


def test_closest_of_several():
    curve = wavy(3)
    others = [moved(curve, np.array([0.0, 0.0, height])) for height in (0.1, 0.02, 0.05)]
    assert distance_to_closest(curve, others) == pytest.approx(compare(curve, others[1]).dtw)


@pytest.mark.parametrize(("task", "dtw_mm", "degrees"), [("bottle2shelf", 28.9, 6.2), ("pouring", 35.4, 6.3)])
def test_human_variation_of_real_recordings(recordings, task, dtw_mm, degrees):
    """Published figures of these recordings: they pin the definition of the measure."""
    shown = read_demonstrations(recordings / "robotasks" / f"{task}.npy", "cm")
    pairs = [compare(first.curve, second.curve) for first, second in combinations(shown, 2)]
    assert 1e3 * np.mean([pair.dtw for pair in pairs]) == pytest.approx(dtw_mm, abs=0.1)
    assert np.degrees(np.mean([pair.orientation for pair in pairs])) == pytest.approx(degrees, abs=0.1)
