import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.checks import check_columns, check_rising_times
from geodesic_motion_ros.utils.errors import DemonstrationError


def test_columns_are_a_copy_of_finite_numbers():
    given = np.ones((4, 2), dtype=np.float32)
    copy = check_columns(given, ("a", "b"), "wave")
    given[0] = 7.0
    assert copy.dtype == float
    assert np.all(copy == 1.0)
    given[2, 1] = np.nan
    with pytest.raises(DemonstrationError, match="'wave', sample 2, column b: nan is not a finite number"):
        check_columns(given, ("a", "b"), "wave")
    with pytest.raises(DemonstrationError, match=r"shape \(4, 2\) cannot hold a, b, c"):
        check_columns(given, ("a", "b", "c"), "wave")


def test_times_must_rise():
    np.testing.assert_array_equal(check_rising_times([0, 1, 3], "wave"), [0.0, 1.0, 3.0])
    with pytest.raises(DemonstrationError, match="'wave', sample 2, column t: 1 s does not come after 1 s"):
        check_rising_times([0.0, 1.0, 1.0], "wave")
