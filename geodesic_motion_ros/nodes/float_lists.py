"""Lists of numbers in parameters: [0, 0.5] is read as [0.0, 0.5], where ROS refuses lists of two types.

Only the text of such lists is changed: what else a parameter file says is read by ROS as it stands.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

_LIST = re.compile(r"\[[^\[\]]*\]")
_INTEGER = re.compile(r"[+-]?\d+")


def with_floats(text: str) -> str:
    """Write the integers as floats in those of a text's lists that hold both."""
    return _LIST.sub(_as_floats, text)


def arguments_with_floats(arguments: Sequence[str], folder: Path) -> list[str]:
    """Return command-line arguments of ROS in which lists hold no integers beside floats.

    folder : where parameter files that had such lists are written anew.
    """
    changed = list(arguments)
    for place, (option, value) in enumerate(pairwise(arguments), start=1):
        if option in ("-p", "--param"):
            changed[place] = with_floats(value)
        elif option == "--params-file":
            # What cannot be read is named by ROS.
            with suppress(OSError, UnicodeDecodeError):
                changed[place] = _file_with_floats(Path(value), folder / f"{place}.yaml")
    return changed


def _file_with_floats(file: Path, new: Path) -> str:
    text = file.read_text()
    if (corrected := with_floats(text)) == text:
        return str(file)
    new.write_text(corrected)
    return str(new)


def _as_floats(found: re.Match[str]) -> str:
    items = found[0][1:-1].split(",")
    whole = [_INTEGER.fullmatch(item.strip()) is not None for item in items]
    if all(whole) or not any(whole) or not all(map(_is_number, items)):
        return found[0]
    written = [f"{item.strip()}.0" if is_whole else item.strip() for item, is_whole in zip(items, whole, strict=True)]
    return f"[{', '.join(written)}]"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
