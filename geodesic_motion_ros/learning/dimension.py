"""How many latent dimensions the data speak for: as few as reconstruct held-out demonstrations as well as any.

Models of one dimension and more are trained on all demonstrations but those of a fold, fold after fold, and give those
back. Of the dimensions whose mean error is within one standard error of the best the smallest is chosen (L. Breiman,
J. Friedman, R. Olshen and C. Stone, "Classification and Regression Trees", 1984: the 1 SE rule). What a
demonstration is given back by is its own code: so the error falls as long as another dimension holds what people vary
in, and then no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.learning.optimisation import Progress
from geodesic_motion_ros.learning.settings import CommonSettings
from geodesic_motion_ros.learning.shown_task import ShownTask
from geodesic_motion_ros.learning.training import shown_task, train_means
from geodesic_motion_ros.utils.checked_numbers import LARGEST_DIMENSION
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Folds of demonstrations, at most, and the share of a training's steps that each model takes.
FOLDS, SHARE = 3, 0.3


@dataclass(frozen=True)
class DimensionFigures:
    """Errors (D, N) [m] with which N held-out demonstrations come back in each of the latent dimensions (D,)."""

    dimensions: tuple[int, ...]
    errors: np.ndarray

    @property
    def means(self) -> np.ndarray:
        """Mean errors (D,) [m]."""
        return self.errors.mean(axis=1)

    @property
    def standard_errors(self) -> np.ndarray:
        """Of the means, (D,) [m]."""
        return self.errors.std(axis=1, ddof=1) / np.sqrt(self.errors.shape[1])

    @property
    def chosen(self) -> int:
        """The smallest dimension within one standard error of the best."""
        best = int(np.argmin(self.means))
        return self.dimensions[int(np.argmax(self.means <= self.means[best] + self.standard_errors[best]))]

    def as_dict(self) -> dict[str, Any]:
        """What a skill keeps of them, in millimetres."""
        return {
            "dimensions": list(self.dimensions),
            "held_out_mm": (1e3 * self.means).tolist(),
            "standard_error_mm": (1e3 * self.standard_errors).tolist(),
            "chosen": self.chosen,
        }


def compare_dimensions(
    demonstrations: Demonstrations | JointDemonstrations,
    settings: CommonSettings,
    robot: str | None = None,
    progress: Progress | None = None,
    noted: Callable[[int, np.ndarray], None] | None = None,
    dimensions: tuple[int, ...] = tuple(range(1, LARGEST_DIMENSION + 1)),
) -> DimensionFigures:
    """Train models of each of the dimensions without each fold, and have them give it back.

    Parameters
    ----------
    settings : of the training; its latent dimension does not count, its steps by SHARE.
    robot : as of `train_skill`.
    noted : called with each dimension and its errors (N,) [m].

    Raises
    ------
    DemonstrationError : less than three demonstrations: none can be held out.
    """
    if len(demonstrations) < FOLDS:
        raise DemonstrationError(
            f"{len(demonstrations)} demonstrations: of less than {FOLDS} none can be held out to choose a dimension by"
        )
    brief = shortened(settings)
    errors = np.empty((len(dimensions), len(demonstrations)))
    for row, dimension in zip(errors, dimensions, strict=True):
        shown = shown_task(demonstrations, replace(brief, latent_dimension=dimension), robot)
        for learned, held_out in folds(len(demonstrations)):
            row[held_out] = _held_out_errors(shown, learned, held_out, progress)
        if noted is not None:
            noted(dimension, row)
    return DimensionFigures(dimensions, errors)


def shortened(settings: CommonSettings) -> CommonSettings:
    """Return the settings of the brief trainings that dimensions are compared by."""
    return replace(settings, steps=max(1, round(SHARE * settings.steps)))


def folds(count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Learned and held-out indices, fold after fold: every FOLDS-th demonstration is held out, so that of each family,
    which stand together in a recording, some are learned.
    """
    every = np.arange(count)
    for fold in range(FOLDS):
        yield every[every % FOLDS != fold], every[every % FOLDS == fold]


def _held_out_errors(
    shown: ShownTask, learned: np.ndarray, held_out: np.ndarray, progress: Progress | None
) -> np.ndarray:
    """Mean distance (H,) [m] of the points of demonstrations that were held out from where they are given back."""
    vae = train_means(shown.learned_curves(learned), shown.likelihood, progress)
    curves = tuple(values[held_out] for values in shown.shown_curves())
    with torch.no_grad():
        means = vae.decoder.means(vae.encoder(*map(torch.tensor, curves))[0])
    away = np.linalg.norm(shown.compared_points(means) - shown.compared_points(curves), axis=-1)
    return away.reshape(len(held_out), -1).mean(axis=1)
