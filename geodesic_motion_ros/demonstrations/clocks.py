"""Clocks of recordings: the stamps of headers and the recorder's clock, both in whole nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.demonstrations.takes import Action, Flaw

#: Stamps of a header are used where at least this share of them rises; clocks that are not set give zeros.
RISING_SHARE = 0.5
#: Stamps that fall by more than this [ns], and stay there, began again: a message that is late falls by less.
RESTART = 1_000_000_000
#: So many messages show whether stamps stay where they fell to.
STAYING = 5


@dataclass(frozen=True)
class Clock:
    """A clock that makes seconds, from the first message on, of when messages were received and stamped [ns].

    Attributes
    ----------
    begin : received and stamped [ns] of the first message.
    unset : why the recorder's clock counts; "": the stamps do.
    restarts : (R, 2) received and stamped [ns] of the first message after each restart of the stamps.
    offsets : (R + 1,) [ns] that are added to the stamps before the first restart, after it, after the second, ...
    """

    begin: tuple[int, int]
    unset: str
    restarts: np.ndarray
    offsets: np.ndarray

    @classmethod
    def of(cls, received: np.ndarray, stamps: np.ndarray, samples: int | None = None, unset: str = "") -> Clock:
        """Choose the clock of messages in the order in which they were received, at least one.

        received, stamps : (N,) [ns].
        samples : how many samples they are, where several messages make one; None: each is one.
        unset : why the stamps do not count, where that is known.

        The recorder's clock counts where stamps are not set, or do not rise from sample to sample. Stamps that begin
        again, as of a simulation that is reset, go on from the message before by the recorder's clock.
        """
        restarts = _restarts(stamps)
        if len(stamps) > 1 and np.any(stamps <= 0):
            unset = "without stamps"
        elif len(stamps) > 1 and np.sum(np.diff(stamps) > 0) < RISING_SHARE * ((samples or len(stamps)) - 1):
            unset = "with stamps that do not rise"
        if unset:
            restarts = restarts[:0]
        steps = (received - stamps)[restarts] - (received - stamps)[restarts - 1]
        return cls(
            (int(received[0]), int(stamps[0])), unset, np.stack([received[restarts], stamps[restarts]], axis=1),
            np.append(0, np.cumsum(steps)),
        )  # fmt: skip

    def nanoseconds(self, received: np.ndarray, stamps: np.ndarray) -> np.ndarray:
        """Compute times (N,) [ns] of messages (N,), from the first on."""
        if self.unset:
            return received - self.begin[0]
        return stamps - self.begin[1] + self.offsets[np.searchsorted(self.restarts[:, 0], received, "right")]

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times [s], from the first message on, at which the stamps began again."""
        return tuple((self.nanoseconds(*self.restarts.T) / 1e9).tolist())

    def flaws(self, name: str) -> tuple[Flaw, ...]:
        """List the flaws of the clock of the take `name`."""
        if self.unset:
            what, how = f"has headers {self.unset}", "the times of the recorder are used"
            return (Flaw(name, 0.0, what, Action.REPAIRED, how),)
        how = "demonstrations end there; how much later it is, the recorder's clock says"
        return tuple(
            Flaw(name, time, f"has stamps that begin again, at {stamp / 1e9:.2f} s", Action.REPAIRED, how)
            for time, stamp in zip(self.breaks, self.restarts[:, 1], strict=True)
        )


def _restarts(stamps: np.ndarray) -> np.ndarray:
    """Places of the messages whose stamps fell, by RESTART or more, and stayed there."""
    falls = np.flatnonzero(np.diff(stamps) < -RESTART) + 1
    return np.array(
        [fall for fall in falls if np.median(stamps[fall : fall + STAYING]) < stamps[fall - 1] - RESTART], dtype=int
    )


#: Seconds in a unit of files; "d" is what spreadsheets count in.
PER_UNIT = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "d": 86400.0}
#: A step from sample to sample in its unit that shows what the unit is: a recording has more than one sample a second.
_STEPS = ((1e6, "ns"), (1e3, "us"), (1.0, "ms"))
#: Days since 1900 that spreadsheets write today, and steps of recordings [s]: as seconds they were a thousandth of it.
_DAYS, _SHORTEST_STEP, _LONGEST_DAY_STEP = 3e4, 1e-3, 2.0
#: Later times than this [s] count from 1970, or from when a controller was built, and not from when it began.
_LATE = 1e6


def find_unit(times: np.ndarray) -> str:
    """Find the unit, of PER_UNIT, that times (T,) of a recording must have been written in, by their usual step."""
    steps = np.diff(times)
    usual = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    if np.median(times) > _DAYS and _SHORTEST_STEP < usual * PER_UNIT["d"] < _LONGEST_DAY_STEP:
        return "d"
    return next((unit for step, unit in _STEPS if usual >= step), "s")


def convert_to_seconds(times: np.ndarray, written: str, name: str) -> tuple[np.ndarray, tuple[Flaw, ...]]:
    """Convert times (T,) of the file `name` to seconds, late ones from the first on, with how they were read.

    written : the unit as the file says; "": it says none, and the steps show it.
    """
    unit = written or find_unit(times)
    late = len(times) > 0 and abs(times[0]) * PER_UNIT[unit] > _LATE
    # counted as they are written: milliseconds since 1970 times 0.001 are rounded
    seconds = PER_UNIT[unit] * (times - times[0] if late else times)
    if unit == "s":
        return seconds, ()
    how = "as the file says" if written else "by their steps"
    return seconds, (Flaw(name, 0.0, f"has times in {unit}", Action.READ, f"as seconds, {how}"),)


def split_runs(times: np.ndarray) -> list[slice]:
    """Split times (T,) where they begin again: at a fall, below which those that follow stay."""
    falls = np.flatnonzero(np.diff(times) < 0.0) + 1
    begins = [fall for fall in falls if np.median(times[fall : fall + STAYING]) < times[fall - 1]]
    return [slice(begin, end) for begin, end in zip([0, *begins], [*begins, len(times)], strict=True)]
