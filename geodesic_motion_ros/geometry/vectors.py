"""Vectors of three numbers, for what is so little that arrays would take longer."""

from __future__ import annotations

Vector = tuple[float, float, float]


def added(one: Vector, other: Vector) -> Vector:
    """Add two vectors."""
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def difference(one: Vector, other: Vector) -> Vector:
    """Subtract the other vector from one."""
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]
