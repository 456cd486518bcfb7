"""Folds of a cross-validation: which demonstrations are held out together."""

from __future__ import annotations

from itertools import combinations

from geodesic_motion_ros.utils.errors import DemonstrationError, ParameterError

Fold = tuple[int, ...]
"""Indices of the demonstrations that are held out."""


def parse_folds(text: str, count: int) -> tuple[Fold, ...]:
    """Folds out of "0,3,6/1,4,7/2,5,8": indices to hold out, folds apart by slashes.

    Raises
    ------
    ParameterError
        Names the part that is no index of one of the `count` demonstrations, stands twice in a fold, or
        leaves nothing to train on.
    """
    folds = []
    for part in text.split("/"):
        try:
            fold = tuple(int(index) for index in part.split(","))
        except ValueError:
            raise ParameterError(
                f"folds '{text}': '{part}' is not a list of indices; write them like 0,3,6/1,4,7/2,5,8"
            ) from None
        wrong = [index for index in fold if index not in range(count)]
        if wrong:
            raise ParameterError(
                f"folds '{text}': there is no demonstration {wrong[0]}; the {count} are numbered 0 to {count - 1}"
            )
        if len(set(fold)) < len(fold):
            raise ParameterError(f"folds '{text}': '{part}' holds out a demonstration twice")
        if len(fold) == count:
            raise ParameterError(f"folds '{text}': '{part}' leaves no demonstration to train on")
        folds.append(fold)
    return tuple(folds)


def default_folds(count: int, folds: int = 3) -> tuple[Fold, ...]:
    """Every demonstration held out once: fold k holds out k, k + folds, k + 2 folds, ... of `count`."""
    if count < 2:
        raise DemonstrationError(f"{count} demonstration(s): at least 2 are needed to hold one out")
    folds = min(folds, count)
    return tuple(tuple(range(first, count, folds)) for first in range(folds))


def all_folds(count: int, held_out: int = 3) -> tuple[Fold, ...]:
    """Every choice of so many of `count` to hold out; DemonstrationError where none is left to train on."""
    if count <= held_out:
        raise DemonstrationError(f"{count} demonstration(s): holding out {held_out} leaves none to train on")
    return tuple(combinations(range(count), held_out))
