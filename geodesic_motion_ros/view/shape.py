"""A shape of what a planner shows."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

#: The group of the spheres that stand for the arm in the certificate.
BODY = "tool"


class Shape(NamedTuple):
    """A shape in the frame of all that is shown.

    group, number : its name. position (3,) [m], wxyz (4,), size (3,) [m] : of the bounding box, of a line its width.
    colour : red, green, blue, opacity, 0 to 1. points (n, 3) [m] : of a line; of `boxes` their centres.
    """

    group: str
    number: int
    kind: Literal["sphere", "box", "cylinder", "line", "boxes"]
    position: tuple[float, float, float]
    wxyz: tuple[float, float, float, float]
    size: tuple[float, float, float]
    colour: tuple[float, float, float, float]
    points: np.ndarray
