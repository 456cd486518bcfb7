"""A limit to what paths cost among obstacles: which of those that hit it refuses, and which that stay clear."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.utils.tables import Cell


@dataclass(frozen=True)
class CostLimit:
    """What paths that hit (h,) and paths that stay clear (c,) cost, over the path without obstacles."""

    hits: np.ndarray
    clear: np.ndarray

    @property
    def area(self) -> float:
        """The share of pairs of both in which the hit costs more, equal ones half: the area under the curve of hits
        refused over clear paths refused. NaN without a pair.
        """
        apart = np.sign(self.hits[:, None] - self.clear)
        return float(0.5 + 0.5 * apart.mean()) if apart.size else math.nan

    def refused(self, limit: float) -> tuple[int, int]:
        """Hits and clear paths that cost more than a limit."""
        return int(np.sum(self.hits > limit)), int(np.sum(self.clear > limit))

    def cells(self, limits: tuple[float, ...]) -> list[Cell]:
        """The row of a table under `limit_columns`."""
        refused = [self.refused(limit) for limit in limits]
        return [
            len(self.hits), len(self.clear), f"{self.area:.3f}" if self.hits.size and self.clear.size else None,
            float(self.clear.max()) if self.clear.size else None, float(self.hits.min()) if self.hits.size else None,
            *(f"{hits}, {clear}" for hits, clear in refused),
        ]  # fmt: skip


def limit_columns(limits: tuple[float, ...]) -> list[str]:
    """The head of a table of some limits' `CostLimit.cells`; under each limit hits and clear paths that it refuses."""
    return ["hits", "clear", "area", "clear at most", "hits at least", *(f"over {limit:g}" for limit in limits)]
