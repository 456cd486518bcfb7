"""The progress of a long command on a bar."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(name: str) -> Iterator[Callable[[str, int, int], None]]:
    """Show progress(stage, step, steps) on a bar while the context lasts; every stage starts it anew."""
    # loaded here, for most commands are done at once
    from tqdm import tqdm

    # A log that no person watches gets a line now and then.
    interval = 0.1 if sys.stderr.isatty() else 10.0
    with tqdm(desc=name, unit="step", mininterval=interval) as bar:

        def show(stage: str, step: int, steps: int) -> None:
            if bar.postfix != stage or bar.total != steps:
                bar.reset(total=steps)
                bar.set_postfix_str(stage)
            bar.update(step - bar.n)

        yield show
