"""Where motions of a closed skill begin and end on its unrolled sheet."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.queries.round_frame import RoundFrame

FRAME = RoundFrame(6.0, 7.5)


def test_a_skill_that_is_not_closed_has_no_frame() -> None:
    assert RoundFrame.of(SimpleNamespace(period=None)) is None
    box = {"latent_lower": np.array([-3.2, -1.0]), "latent_upper": np.array([15.2, 1.0])}
    assert RoundFrame.of(SimpleNamespace(period=6.0, **box)) == FRAME


@pytest.mark.parametrize("place", np.linspace(-20.0, 20.0, 17))
def test_a_point_lies_in_the_last_round_and_is_moved_by_whole_rounds(place: float) -> None:
    latent = np.array([place, 0.4])
    last = FRAME.in_last(latent)
    assert FRAME.last <= last[0] < FRAME.last + FRAME.period
    assert last[1] == latent[1]
    rounds = FRAME.rounds_to(latent, last)
    assert rounds == pytest.approx(round(rounds), abs=1e-12)
    np.testing.assert_allclose(FRAME.moved(latent, rounds), last)
    near = FRAME.nearest(latent, np.array([1.0, 0.0]))
    assert abs(near[0] - 1.0) <= 0.5 * FRAME.period + 1e-12
