"""What a training is about to do, and the memory it takes, from its settings: to be said before it begins."""

from __future__ import annotations

from dataclasses import dataclass

from geodesic_motion_ros.learning.optimisation import MOST_DRAWN
from geodesic_motion_ros.learning.settings import CommonSettings


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
        """The size of a training on so many demonstrations; signs : 2 where q and -q are both learned."""
        curves = demonstrations * (1 + settings.blends if settings.sheet == "canonical" else 1)
        samples = signs * curves * settings.samples
        two_stage = settings.schedule == "two_stage"
        fitted = min(samples * settings.precision_samples, MOST_DRAWN) if two_stage else samples
        kernels = min(settings.kernels, samples // 2)
        # A kernel's activation needs its exponent before and after its bound at once, all of one precision.
        memory = 2 * fitted * kernels * (8 if two_stage else 4)
        return cls(demonstrations, samples, fitted, kernels, memory, settings)

    def __str__(self) -> str:
        steps, memory = self.settings.steps, f"{1e-9 * self.memory:.2f} GB of memory beside the program's own"
        several = "s" if self.demonstrations > 1 else ""
        learned = f"learning {self.samples} samples of {self.demonstrations} demonstration{several}: {steps} steps"
        if self.settings.schedule == "two_stage":
            learned += (
                f" of the means, then {self.settings.precision_iterations} of the deviations, {self.kernels} kernels "
                f"on {self.fitted} draws"
            )
        return f"{learned}; {memory}; the bar shows the time left of each stage"
