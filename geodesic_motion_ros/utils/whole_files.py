"""Files that are whole or as they were before, whenever the program is interrupted."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Where to write what the path is to hold: a part beside it, which takes its place when all is written. Several
    programs and threads may do so at once: one of them is the last.
    """
    if path.exists() and not path.is_file():  # a pipe or a terminal
        yield path
        return
    whole = path.resolve()
    part = whole.with_name(f"{whole.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        yield part
        part.replace(whole)
    finally:
        part.unlink(missing_ok=True)
