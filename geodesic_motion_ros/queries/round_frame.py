"""RoundFrame: where motions of a closed skill begin and end on its sheet, a cylinder that is unrolled over some rounds.

Latent points a period apart on the first axis decode to the same. A goal lies in one certain round, the *last*, of the
sheet, so that its node is the same however often the arm has come round; a motion begins before it, by as much of the
round as is left, or by whole rounds more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.skill.skill import LearnedModel

#: The last round begins this many rounds behind the beginning of the sheet: motions of one and a half rounds fit before
#: every goal in it, with a quarter at either end.
_LAST_ROUND = 1.75


@dataclass(frozen=True)
class RoundFrame:
    """The period of a sheet, and where its last round begins on the first latent axis."""

    period: float
    last: float

    @classmethod
    def of(cls, model: LearnedModel) -> RoundFrame | None:
        """Return the frame of a closed skill; None for one that is not closed."""
        if model.period is None:
            return None
        first = 0.5 * (model.latent_lower[0] + model.latent_upper[0]) - 1.5 * model.period
        return cls(model.period, float(first + _LAST_ROUND * model.period))

    def moved(self, latent: np.ndarray, rounds: float) -> np.ndarray:
        """Return a latent point (d,) so many rounds further on."""
        return np.concatenate([latent[:1] + rounds * self.period, latent[1:]])

    def in_last(self, latent: np.ndarray) -> np.ndarray:
        """Return where a latent point (d,) lies in the last round."""
        return self.moved(latent, -np.floor((latent[0] - self.last) / self.period))

    def rounds_to(self, latent: np.ndarray, goal: np.ndarray) -> float:
        """Return how many rounds a latent point (d,) lies before a goal (d,); behind it the number is negative."""
        return float(goal[0] - latent[0]) / self.period

    def nearest(self, latent: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return where a latent point (d,) lies in the round in which it is nearest to another one (d,)."""
        return self.moved(latent, np.round(self.rounds_to(latent, other)))
