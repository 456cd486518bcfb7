"""Sidesteps: a tool that stands, and has no refuge on its skill's sheet, moves straight aside as it is.

It goes no further from what was shown than a start may lie: from there the way on is found as from any start.
"""

from __future__ import annotations

from itertools import product

import numpy as np

#: A sidestep is free for so long [s]: what comes may turn by then, and another one is looked for.
SOON = 0.6
#: Of the margin among what moves a stop on a sidestep keeps this share: to stay is to be touched.
STOP_SHARE = 0.5
#: Unit vectors (26, 3) along the edges of a cube, and the diagonals of its faces and of itself.
_DIRECTIONS = np.array([step for step in product((-1.0, 0.0, 1.0), repeat=3) if any(step)])
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
#: How far to go, as shares of how far a start may lie from what was shown.
_SHARES = (0.5, 1.0)


def places_beside(position: np.ndarray, shown: np.ndarray, furthest: float) -> np.ndarray:
    """Places (n, 3) [m] all around a position (3,), no further than `furthest` [m] from what was shown (3,)."""
    places = np.concatenate([position + share * furthest * _DIRECTIONS for share in _SHARES])
    return places[np.linalg.norm(places - shown, axis=1) <= furthest]
