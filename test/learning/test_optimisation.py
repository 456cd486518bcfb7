"""How networks are fitted: to the minimum, the same every time, leaving torch as it was."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.optimisation import (
    MOST_DRAWN,
    WARM_UP,
    descend,
    drawn_rows,
    minimise,
    one_seeded_thread,
)

TARGET = torch.tensor([1.0, -2.0, 0.5], dtype=torch.double)


def test_what_is_drawn_depends_on_the_seed_alone() -> None:
    draws = []
    for seed in (3, 3, 4):
        with one_seeded_thread(seed):
            draws.append(torch.rand(5))
            assert torch.get_num_threads() == 1
    assert torch.equal(draws[0], draws[1])
    assert not torch.equal(draws[0], draws[2])


def test_rows_are_drawn_as_often_as_requested_up_to_what_memory_holds() -> None:
    assert drawn_rows(3, 2).tolist() == [0, 1, 2, 0, 1, 2]
    assert len(drawn_rows(MOST_DRAWN // 2, 2)) == MOST_DRAWN
    many = drawn_rows(MOST_DRAWN, 3)
    assert len(many) == MOST_DRAWN
    assert torch.bincount(many, minlength=MOST_DRAWN).max() <= 3


def test_threads_and_the_global_generator_come_back_even_after_an_error() -> None:
    def fails() -> None:
        with one_seeded_thread(0):
            torch.rand(10)
            raise RuntimeError("in the midst")

    threads, state = torch.get_num_threads(), torch.random.get_rng_state()
    torch.set_num_threads(2)
    try:
        with pytest.raises(RuntimeError, match="midst"):
            fails()
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(torch.random.get_rng_state(), state)


@pytest.mark.parametrize("fit", ["adam", "lbfgs"])
def test_a_bowl_is_fitted_to_its_bottom_and_every_step_is_reported(fit) -> None:
    at = torch.zeros(3, dtype=torch.double, requires_grad=True)
    reported: list[tuple[str, int, int]] = []

    def height() -> torch.Tensor:
        return ((at - TARGET) ** 2 * torch.tensor([1.0, 5.0, 0.5])).sum()

    if fit == "adam":
        descend(lambda _: height(), [at], 600, 0.05, "bowl", lambda *where: reported.append(where))
    else:
        minimise(height, [at], 25, "bowl", lambda *where: reported.append(where))
    torch.testing.assert_close(at.detach(), TARGET, atol=1e-3, rtol=0.0)
    steps = 600 if fit == "adam" else 25
    assert reported[-1] == ("bowl", steps, steps)
    assert [step for _, step, _ in reported] == sorted({step for _, step, _ in reported})


@pytest.mark.parametrize(("gently", "highest"), [(True, WARM_UP * 100), (False, 0)])
def test_the_rate_rises_if_gently_and_falls(gently, highest) -> None:
    at, places = torch.zeros(1, requires_grad=True), []

    def slope(_: int) -> torch.Tensor:
        places.append(at.item())
        return at.sum()

    descend(slope, [at], 100, 0.01, "slope", None, gently)
    steps = -np.diff(places)
    np.testing.assert_allclose(steps.max(), 0.01, rtol=1e-3)
    assert abs(int(steps.argmax()) - highest) <= 1
    assert steps[-1] < 0.05 * steps.max()
    assert bool(steps[0] < 0.05 * steps.max()) is gently


def test_a_rare_batch_does_not_throw_the_parameters_about() -> None:
    """Adam divides by the largest gradient of late: after one of a million the next thousand count for nothing."""

    def descended(rare: float, gently: bool) -> float:
        at = torch.zeros(1, requires_grad=True)
        descend(lambda step: (rare if step == 20 else 1.0) * at.sum(), [at], 100, 0.01, "slope", None, gently)
        return at.item()

    assert descended(-1e6, True) < 0.5 * descended(1.0, True) < 0.0
    assert descended(-1e6, False) > 0.5 * descended(1.0, False)
