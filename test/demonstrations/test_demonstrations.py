import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.quaternions import angle_between, slerp
from geodesic_motion_ros.utils.errors import DemonstrationError

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def arrays(samples: int = 50) -> dict[str, np.ndarray]:
    """An arc that turns about a skew axis, sampled unevenly in time."""
    s = np.linspace(0.0, 1.0, samples)
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    positions = np.stack([0.4 + 0.1 * np.sin(s), 0.5 * s, 0.3 + 0.1 * s**2], axis=1)
    quaternions = slerp(IDENTITY, np.concatenate([[np.cos(1.0)], np.sin(1.0) * axis]), s)
    return {"positions": positions, "quaternions": quaternions, "times": 0.5 + s + s**2}


def demonstration(samples: int = 50, **changes) -> Demonstration:
    return Demonstration(**(arrays(samples) | {"name": "pour_1"} | changes))


def test_arrays_are_copied_and_cannot_be_written_to():
    given = arrays()
    shown = Demonstration(**given, name="pour_1")
    given["positions"][0] = 9.0
    assert shown.positions[0, 0] == pytest.approx(0.4)
    with pytest.raises(ValueError, match="read-only"):
        shown.positions[0] = 9.0


def test_signs_are_made_continuous_and_the_first_is_kept():
    given = arrays()
    recorded = -given["quaternions"]
    recorded[20:30] *= -1.0
    shown = demonstration(quaternions=recorded)
    assert np.all(np.sum(shown.quaternions[1:] * shown.quaternions[:-1], axis=1) > 0.0)
    np.testing.assert_allclose(shown.quaternions[0], recorded[0])
    assert np.max(angle_between(shown.quaternions, recorded)) < 1e-7


def test_nearly_unit_quaternions_are_normalised():
    shown = demonstration(quaternions=1.005 * arrays()["quaternions"])
    np.testing.assert_allclose(np.linalg.norm(shown.quaternions, axis=1), 1.0, atol=1e-15)


def spoiled(name: str, index: tuple[int, ...], value: float) -> dict[str, np.ndarray]:
    array = arrays()[name].copy()
    array[index] = value
    return {name: array}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (spoiled("positions", (7, 1), np.nan), r"'pour_1', sample 7, column py: nan is not a finite number"),
        (spoiled("positions", (3, 2), np.inf), r"sample 3, column pz: inf"),
        (spoiled("quaternions", (4, 3), -np.inf), r"sample 4, column qz: -inf"),
        (spoiled("times", (9,), np.nan), r"sample 9, column t: nan"),
        (spoiled("quaternions", (5,), 0.0), r"sample 5, columns qw,qx,qy,qz: the quaternion is zero"),
        (spoiled("quaternions", (6,), 1.0), r"sample 6.*has length 2; it must have length 1 within 0.01"),
        (spoiled("positions", (8, 0), 45.0), r"sample 8: the position is 45 m from the base.*3 m"),
        (spoiled("times", (12,), 0.0), r"sample 12, column t: 0 s does not come after .*strictly increasing"),
        ({"times": np.zeros(50)}, r"sample 1, column t"),
        (
            {"positions": np.zeros((50, 2))},
            r"shape \(50, 2\) cannot hold px, py, pz; it needs .*\(samples, 3\)",
        ),
        ({"quaternions": np.zeros((49, 4)) + IDENTITY}, r"50 positions, 49 quaternions and 50 times"),
    ],
)
def test_bad_input_is_refused_by_name_and_place(changes, message):
    with pytest.raises(DemonstrationError, match=message):
        demonstration(**changes)


@pytest.mark.parametrize("samples", [0, 1])
def test_too_few_samples_are_refused(samples):
    whole = arrays()
    with pytest.raises(DemonstrationError, match=f"'pour_1' has {samples} sample.*at least 2"):
        demonstration(**{name: array[:samples] for name, array in whole.items()})


@pytest.mark.parametrize("by", ["arc_length", "time"])
def test_resampling_keeps_ends_and_spaces_samples_equally(by):
    shown = demonstration(400)
    resampled = shown.resample(60, by)
    assert len(resampled) == 60
    np.testing.assert_allclose(resampled.positions[[0, -1]], shown.positions[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(resampled.times[[0, -1]], shown.times[[0, -1]], atol=1e-12)
    positions = np.linalg.norm(np.diff(resampled.positions, axis=0), axis=1)
    spacing = positions if by == "arc_length" else np.diff(resampled.times)
    np.testing.assert_allclose(spacing, spacing[0], rtol=1e-3)


def test_resampling_to_the_own_instants_changes_nothing():
    shown = demonstration(times=np.arange(50) / 100.0)
    again = shown.resample(50, by="time")
    np.testing.assert_allclose(again.positions, shown.positions, atol=1e-12)
    np.testing.assert_allclose(again.quaternions, shown.quaternions, atol=1e-12)


def test_bad_resampling_is_refused():
    with pytest.raises(DemonstrationError, match="at least 2"):
        demonstration().resample(1)
    with pytest.raises(DemonstrationError, match="'arc_length' or 'time'"):
        demonstration().resample(10, by="phase")
    still = demonstration(positions=np.full((50, 3), 0.3))
    with pytest.raises(DemonstrationError, match=r"'pour_1' moves 0 mm in all.*resample by 'time'"):
        still.resample(10)
    assert len(still.resample(10, by="time")) == 10


def test_stacked_arrays_need_equal_lengths():
    uneven = Demonstrations((demonstration(50), demonstration(60)))
    with pytest.raises(DemonstrationError, match="between 50 and 60 samples: resample them first"):
        uneven.positions_array()
    even = uneven.resample(40)
    assert even.positions_array().shape == (2, 40, 3)
    assert even.quaternions_array().shape == (2, 40, 4)


def test_no_demonstrations_are_refused():
    with pytest.raises(DemonstrationError, match="at least one"):
        Demonstrations(())


def test_split_keeps_order_frame_and_orientation_flag():
    items = tuple(demonstration(name=str(i)) for i in range(5))
    train, held_out = Demonstrations(items, frame="table", has_orientation=False).split([3, 1])
    assert [item.name for item in train] == ["0", "2", "4"]
    assert [item.name for item in held_out] == ["3", "1"]
    assert train.frame == held_out.frame == "table"
    assert not train.has_orientation


@pytest.mark.parametrize(
    ("held_out", "message"),
    [
        ([5], "cannot hold out demonstration 5: the 3 are numbered 0 to 2"),
        ([-1], "cannot hold out demonstration -1"),
        ([1, 1], "twice"),
        ([], "leave at least one"),
        ([0, 1, 2], "leave at least one"),
    ],
)
def test_bad_splits_are_refused(held_out, message):
    items = Demonstrations(tuple(demonstration(name=str(i)) for i in range(3)))
    with pytest.raises(DemonstrationError, match=message):
        items.split(held_out)


def test_one_hemisphere_flips_whole_demonstrations_only():
    flipped = demonstration(70, quaternions=-arrays(70)["quaternions"])
    mixed = Demonstrations((demonstration(), flipped, demonstration(30)))
    aligned = mixed.align_hemispheres()
    np.testing.assert_array_equal(aligned[0].quaternions, mixed[0].quaternions)
    # Only the sign changes, but for the rounding of a second normalisation.
    np.testing.assert_allclose(aligned[1].quaternions, -flipped.quaternions, rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(aligned[2].quaternions, mixed[2].quaternions)
