"""Plain CDR, as messages come over the wire (OMG DDS-XTypes 1.3, 7.4.1): read without a Python object for each field.

Numbers lie at multiples of their size from where the message begins, and what has no fixed length begins with its
length. Readers raise struct.error where a message ends before it should.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from geodesic_motion_ros.nodes.messages import MessageRefused

#: What precedes a message: plain CDR in this machine's order of bytes.
ENCAPSULATION = bytes([0, int(sys.byteorder == "little"), 0, 0])
LENGTH = struct.Struct("=I")
_STAMP = struct.Struct("=iI")
_NO_NUMBERS = np.zeros(0)


class Stamp(NamedTuple):
    """A builtin_interfaces/Time or Duration."""

    sec: int
    nanosec: int


class StampedFrame(NamedTuple):
    """A std_msgs/Header."""

    stamp: Stamp
    frame_id: str


def checked_plain(wire: bytes, what: str) -> bytes:
    """Return what follows the encapsulation of a message, which must be that of plain CDR."""
    if wire[:2] != ENCAPSULATION[:2]:
        raise MessageRefused(f"{what} are written as {wire[:2].hex()}, expected plain CDR, {ENCAPSULATION[:2].hex()}")
    return wire[4:]


@contextmanager
def refusing_short(data: bytes, what: str) -> Iterator[None]:
    """Refuse a message that ends before it should."""
    try:
        yield
    except struct.error as error:
        raise MessageRefused(f"{what} end before they should, after {len(data)} bytes") from error


def multiple(at: int, size: int) -> int:
    """Return the next multiple of a power of two at or after a byte."""
    return (at + size - 1) & -size


def stamp(data: bytes, at: int) -> Stamp:
    """Return the time or duration that begins at a byte, eight bytes long."""
    return Stamp._make(_STAMP.unpack_from(data, at))


def text(data: bytes, at: int) -> tuple[str, int]:
    """Return the text that begins at a byte, and where what follows does."""
    (length,) = LENGTH.unpack_from(data, at)
    end = at + 4 + length
    # A zero ends it.
    return data[at + 4 : max(at + 4, end - 1)].decode(errors="replace"), multiple(end, 4)


def texts(data: bytes, at: int) -> tuple[list[str], int]:
    """Return the texts of a sequence, and where what follows begins."""
    (count,), at = LENGTH.unpack_from(data, at), at + 4
    found = []
    for _ in range(count):
        one, at = text(data, at)
        found.append(one)
    return found, at


def numbers(data: bytes, at: int) -> tuple[np.ndarray, int]:
    """Return the doubles (n,) of a sequence that begins at a byte, read-only, and where it ends."""
    (count,) = LENGTH.unpack_from(data, at)
    if not count:
        return _NO_NUMBERS, at + 4
    begin = multiple(at + 4, 8)
    end = begin + 8 * count
    if end > len(data):
        raise struct.error
    return np.frombuffer(data, "=f8", count, begin), end
