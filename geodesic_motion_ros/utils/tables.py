"""Tables and files that experiments hand over their figures in."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from geodesic_motion_ros.utils.whole_files import written_whole

Cell = str | int | float | None


def text_table(
    head: Sequence[str], rows: Sequence[Sequence[Cell]], digits: int = 2, left: Sequence[int] = (0,)
) -> str:
    """Columns under their names, those numbered in `left` to the left; a dash where there is no value."""
    lines = [list(head), *([shown_cell(cell, digits) for cell in row] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    sides = [str.ljust if i in left else str.rjust for i in range(len(head))]
    texts = ["  ".join(side(*cell) for side, *cell in zip(sides, line, widths, strict=True)).rstrip() for line in lines]
    return "\n".join([texts[0], "-" * max(map(len, texts)), *texts[1:]])


def write_json(path: str | Path, content: Any) -> Path:
    """Write valid JSON (what is not finite becomes null), creating the folder. Returns the path.

    A file is whole or as it was before, whenever the program is interrupted.
    """
    target, text = Path(path), json.dumps(_plain(content), indent=1, allow_nan=False) + "\n"
    target.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(target) as part:
        part.write_text(text)
    return target


def shown_cell(cell: Cell, digits: int) -> str:
    """A cell as text, a dash where there is no value."""
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return "-"
    if isinstance(cell, float):
        return f"{cell:.{digits}f}" if abs(cell) < 1e5 else f"{cell:.{digits}e}"
    return str(cell)


def _plain(value: Any) -> Any:
    """Lists, dictionaries and plain numbers out of what experiments keep their figures in."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
