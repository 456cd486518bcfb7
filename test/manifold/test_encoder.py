import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.manifold.encoder import TaskSpaceEncoder
from geodesic_motion_ros.utils.errors import SkillError


@pytest.fixture
def arrays():
    rng = np.random.default_rng(0)
    shapes = {
        "W1": (6, 7),
        "b1": (6,),
        "W2": (5, 6),
        "b2": (5,),
        "W3": (2, 5),
        "b3": (2,),
        "position_offset": (3,),
    }
    return {name: rng.normal(size=shape) for name, shape in shapes.items()} | {
        "position_scale": np.array(0.3)
    }


def test_codes_of_a_batch_are_codes_of_its_rows(arrays):
    encoder = TaskSpaceEncoder.from_arrays(arrays)
    rng = np.random.default_rng(1)
    positions, quaternions = rng.normal(size=(4, 9, 3)), normalise(rng.normal(size=(4, 9, 4)))
    codes = encoder.encode(positions, quaternions)
    assert codes.shape == (4, 9, 2)
    np.testing.assert_allclose(codes[2, 5], encoder.encode(positions[2, 5], quaternions[2, 5]), rtol=1e-12)


def test_units_are_scaled_away(arrays):
    """Twice the scale, offset and positions: the same code."""
    encoder = TaskSpaceEncoder.from_arrays(arrays)
    doubled = TaskSpaceEncoder.from_arrays(
        arrays | {name: 2.0 * arrays[name] for name in ("position_offset", "position_scale")}
    )
    positions, quaternions = np.array([0.4, 0.1, 0.3]), np.array([0.5, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(
        encoder.encode(positions, quaternions), doubled.encode(2.0 * positions, quaternions)
    )


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("b2", None, "lack b2"),
        ("b1", np.array([0.0, 0.0, np.inf, 0.0, 0.0, 0.0]), "encoder weight b1 holds NaN or infinite"),
        ("b1", np.zeros((2, 3)), "b1 has shape"),
        ("W1", np.zeros((6, 10)), "W1 has shape"),
        ("W1", np.array(1.0), "W1 has shape"),
        ("W2", np.zeros((5, 7)), "W2 has shape"),
        ("W3", np.full((2, 5), np.nan), "W3 holds NaN"),
    ],
)
def test_bad_weights_are_refused_by_name(arrays, name, value, match):
    if value is None:
        del arrays[name]
    else:
        arrays[name] = value
    with pytest.raises(SkillError, match=match):
        TaskSpaceEncoder.from_arrays(arrays)
