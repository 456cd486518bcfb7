"""What a training is about to do, and the memory it takes, from its settings: to be said before it begins."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from geodesic_motion_ros.learning.optimisation import MOST_DRAWN
from geodesic_motion_ros.learning.settings import CommonSettings

#: Rows of a sample, and of the draws, that steps are timed with.
_COORDINATES, _TIMED_ROWS = 8, 4000
#: What losses, schedules and line searches take besides, as a factor.
_OTHER_WORK = 2.0


@dataclass(frozen=True)
class Workload:
    """The size of a training.

    Attributes
    ----------
    demonstrations, samples : that are learned; the canonical sheet learns blends of demonstrations, too.
    fitted : draws from these that the deviations are fitted on, by so many `kernels`.
    memory : the largest arrays [bytes], those of the kernels' activations; the program's own is not counted.
    """

    demonstrations: int
    samples: int
    fitted: int
    kernels: int
    memory: int
    settings: CommonSettings

    @classmethod
    def of(cls, demonstrations: int, settings: CommonSettings, signs: int = 1) -> Workload:
        """The size of a training on so many demonstrations; signs : 2 where both q and -q are learned, if raw."""
        curves = demonstrations * (1 + settings.blends if settings.sheet == "canonical" else signs)
        samples = curves * settings.samples
        two_stage = settings.schedule == "two_stage"
        fitted = min(samples * settings.precision_samples, MOST_DRAWN) if two_stage else samples
        kernels = min(settings.kernels, samples // 2)
        # A kernel's activation needs its exponent before and after its bound at once, all of one precision.
        memory = 2 * fitted * kernels * (8 if two_stage else 4)
        return cls(demonstrations, samples, fitted, kernels, memory, settings)

    def measure_seconds(self) -> float:
        """Time a few steps of each stage on this machine, on networks as large; returns what all take, about [s]."""
        import torch

        from geodesic_motion_ros.learning.autoencoder import DecoderNetwork, EncoderNetwork
        from geodesic_motion_ros.learning.optimisation import one_seeded_thread

        settings, rows = self.settings, min(self.fitted, _TIMED_ROWS)
        sizes = settings.latent_dimension, settings.hidden, torch.zeros(_COORDINATES), torch.ones(())
        with one_seeded_thread(settings.seed):
            encoder = EncoderNetwork(*sizes)
            decoder = DecoderNetwork(sizes[0], settings.hidden[::-1], *sizes[2:])
            optimiser = torch.optim.Adam([*encoder.parameters(), *decoder.parameters()])
            batch = torch.randn(settings.batch, _COORDINATES)
            activations = torch.rand(rows, self.kernels, dtype=torch.double)
            weights = torch.rand(_COORDINATES, self.kernels, dtype=torch.double, requires_grad=True)

            def descend() -> None:
                optimiser.zero_grad()
                (decoder.means(encoder(batch)[0]).coordinates - batch).square().sum().backward()
                optimiser.step()

            def fit() -> None:
                weights.grad = None
                (activations @ weights.T).log().sum().backward()

            seconds = _OTHER_WORK * settings.steps * _fastest(descend)
            if settings.schedule == "two_stage":
                seconds += _OTHER_WORK * settings.precision_iterations * _fastest(fit) * self.fitted / rows
        return seconds

    def __str__(self) -> str:
        steps, memory = self.settings.steps, f"{1e-9 * self.memory:.2f} GB of memory beside the program's own"
        several = "s" if self.demonstrations > 1 else ""
        learned = f"learning {self.samples} samples of {self.demonstrations} demonstration{several}: {steps} steps"
        if self.settings.schedule == "two_stage":
            learned += (
                f" of the means, then {self.settings.precision_iterations} of the deviations, {self.kernels} kernels "
                f"on {self.fitted} draws"
            )
        return f"{learned}; {memory}"


def _fastest(work: Callable[[], None], times: int = 5) -> float:
    """The shortest time [s] that some work takes, of a few times."""
    found = []
    for _ in range(times):
        begun = time.perf_counter()
        work()
        found.append(time.perf_counter() - begun)
    return min(found)
