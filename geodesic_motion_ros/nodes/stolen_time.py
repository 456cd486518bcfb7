"""The share of a virtual machine's time that its host gave to others meanwhile: no rate is kept in time that is not
there.
"""

from __future__ import annotations

from pathlib import Path

_COUNTERS = Path("/proc/stat")


class StolenTime:
    """A measurement of the share of processor time that the hypervisor of a virtual machine took, since it was made.

    /proc/stat sums up over all cores the ticks of each kind of use (man 5 proc).
    """

    def __init__(self) -> None:
        self._begin = _counters()

    def percent(self) -> float:
        """Return the share of the time since then, over all cores [%]; nan where the system does not tell."""
        kinds = [now - then for now, then in zip(_counters(), self._begin, strict=True)]
        # user, nice, system, idle, iowait, irq, softirq, steal
        return 100.0 * kinds[7] / sum(kinds) if len(kinds) == 8 and sum(kinds) > 0 else float("nan")


def _counters() -> list[int]:
    try:
        return [int(count) for count in _COUNTERS.read_text().split("\n", 1)[0].split()[1:9]]
    except OSError:
        return []
