"""Sidesteps: a tool that stands, and has no refuge on its skill's sheet, moves straight aside as it is.

It goes to places alone that a motion may start at: from there the way on is found as from any start.
"""

from __future__ import annotations

from itertools import product

import numpy as np

#: A sidestep is free for so long at least [s]: what comes may turn by then, and another one is looked for.
SOON = 0.6
#: Of the margin among what moves a stop on a sidestep keeps this share: to stay is to be touched.
STOP_SHARE = 0.5
#: Unit vectors (26, 3) along the edges of a cube, and the diagonals of its faces and of itself.
_DIRECTIONS = np.array([step for step in product((-1.0, 0.0, 1.0), repeat=3) if any(step)])
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
#: How far to go [m].
_LENGTHS = (0.025, 0.05)


def places_beside(position: np.ndarray) -> np.ndarray:
    """Places (52, 3) [m] all around a position (3,), the nearer ones first."""
    return np.concatenate([position + length * _DIRECTIONS for length in _LENGTHS])
