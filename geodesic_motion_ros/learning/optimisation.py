"""How networks are fitted: reproducible from a seed, by Adam or by L-BFGS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import torch
from torch import Tensor

#: Rows that deviations are fitted on at most, as 33 demonstrations have: with 500 kernels they take 0.64 GB.
MOST_DRAWN = 80_000
#: Fraction of the steps over which the learning rate rises, and the largest norm of a gradient: whole steps from a
#: random start, or after a rare batch, throw the codes so far about that the model never finds back to the strip.
WARM_UP, LARGEST_GRADIENT = 0.1, 10.0
#: Called as progress(stage, step, steps) while training.
Progress = Callable[[str, int, int], None]


@contextmanager
def one_seeded_thread(seed: int) -> Iterator[None]:
    """One thread (the networks are too small for more) and torch's global generator seeded; both restored
    after.
    """
    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def drawn_rows(rows: int, draws: int) -> Tensor:
    """Indices of rows that deviations are fitted on, each `draws` times; of more than MOST_DRAWN so many at random."""
    indices = torch.arange(rows).repeat(draws)
    return indices if len(indices) <= MOST_DRAWN else indices[torch.randperm(len(indices))[:MOST_DRAWN]]


def descend(
    loss: Callable[[int], Tensor],
    parameters: Iterable[Tensor],
    steps: int,
    learning_rate: float,
    stage: str,
    progress: Progress | None,
    gently: bool = True,
) -> None:
    """Lower loss(step), drawn anew at every step, by Adam with cosine decay of the rate.

    gently : whether the rate rises to `learning_rate` first, and gradients are shortened to LARGEST_GRADIENT.
    """
    parameters = list(parameters)
    optimiser = torch.optim.Adam(parameters, lr=learning_rate)
    schedule: torch.optim.lr_scheduler.LRScheduler
    if gently:
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimiser, learning_rate, total_steps=steps + 1, pct_start=WARM_UP, cycle_momentum=False
        )
    else:
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for step in range(steps):
        value = loss(step)
        optimiser.zero_grad()
        value.backward()
        if gently:
            torch.nn.utils.clip_grad_norm_(parameters, LARGEST_GRADIENT)
        optimiser.step()
        schedule.step()
        if progress is not None:
            progress(stage, step + 1, steps)


def minimise(
    objective: Callable[[], Tensor],
    parameters: list[Tensor],
    iterations: int,
    stage: str,
    progress: Progress | None,
) -> None:
    """L-BFGS in blocks of ten iterations, which keep the curvature they have learned."""
    block = 10
    optimiser = torch.optim.LBFGS(parameters, max_iter=block, history_size=20, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        optimiser.zero_grad()
        loss = objective()
        loss.backward()
        return loss

    for done in range(0, iterations, block):
        optimiser.step(closure)
        if progress is not None:
            progress(stage, min(done + block, iterations), iterations)
