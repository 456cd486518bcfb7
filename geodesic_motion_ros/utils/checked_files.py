"""Files that other people wrote: only regular files are opened, and what they declare is checked before it is read.

A file of a kilobyte can declare an array of terabytes, a member of an archive that inflates a thousandfold, or lists in
lists without end. Nothing here takes more memory than twice what the file really holds, nothing is ever unpickled, and
what the parsers of the formats raise, their advice included, becomes a FileError of one line.
"""

from __future__ import annotations

import math
import os
import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
import yaml
from numpy.lib import format as npy
from safetensors.numpy import load as load_tensors

from geodesic_motion_ros.utils.errors import FileError, GeodesicMotionError

#: An archive may inflate to so many times its size. Real recordings shrink to a half, those of a simulated arm that
#: stands still for half of the time to a fifth; a bomb grows a thousandfold.
LARGEST_INFLATION = 50
#: Archives of so few bytes [B] may inflate further, as arrays of zeros do, and arrays without numbers may have so long
#: other dimensions, as the shares of a graph that has no mean path: that much memory is always there.
SMALL = 4 << 20
#: Size of the directory of an archive, and of the header of a file of tensors [B]: each array takes about 100 of them.
LARGEST_DIRECTORY = 64 << 10
#: Lists and tables in one another; a skill's settings take 4.
DEEPEST = 20

#: libyaml's, which a PyYAML that was built without it lacks.
_SAFE_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_KINDS = {stat.S_IFDIR: "a directory", stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}
_ARCHIVE_END = 22
_LARGE_ARCHIVE_LOCATOR = 20


def brief(value: object, longest: int = 80) -> str:
    """A value as Python writes it, cut after `longest` characters: one line for a message, whatever the file holds."""
    text = repr(value)
    return text if len(text) <= longest else f"{text[:longest]}..."


@contextmanager
def opened(path: Path, largest: int) -> Iterator[IO[bytes]]:
    """Open a regular file of at most `largest` bytes for reading.

    Raises
    ------
    OSError : it does not exist or cannot be read.
    FileError : it is a directory, a pipe or a device, or too large.
    """
    # A pipe that nobody writes to would be waited for.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise FileError(f"is {_KINDS.get(stat.S_IFMT(status.st_mode), 'no file')}; a regular file is needed")
        if status.st_size > largest:
            raise FileError(f"is {status.st_size / 1e6:.1f} MB large; at most {largest / 1e6:.1f} MB are read")
        with os.fdopen(descriptor, "rb", closefd=False) as stream:
            yield stream
    finally:
        os.close(descriptor)


def read_array(stream: IO[bytes]) -> np.ndarray:
    """The array of a `.npy` file; it cannot be written to. FileError: another format, pickled objects, a wrong size."""
    return _read_array(stream, _size(stream))


def read_arrays(stream: IO[bytes]) -> dict[str, np.ndarray]:
    """The arrays of a `.npz` file by name; they cannot be written to. FileError names the array that cannot be read."""
    with _archive(stream) as archive:
        arrays = {}
        for member in archive.infolist():
            name = member.filename.removesuffix(".npy")
            try:
                with _parsing("is damaged"), archive.open(member) as content:
                    arrays[name] = _read_array(content, member.file_size)
            except FileError as error:
                raise FileError(f"array {brief(name)}: {error}") from error
        return arrays


def array_names(stream: IO[bytes]) -> set[str]:
    """Names of the arrays of a `.npz` file, which are not read. FileError: it is none."""
    with _archive(stream) as archive:
        return {name.removesuffix(".npy") for name in archive.namelist()}


def read_tensors(content: bytes) -> dict[str, np.ndarray]:
    """The arrays of a safetensors file by name. FileError: another format, or sizes that are not those of the file."""
    header = int.from_bytes(content[:8], "little")
    if header > min(LARGEST_DIRECTORY, len(content)):
        raise FileError(
            f"declares a header of {header:.3g} bytes; {len(content)} bytes are there and {LARGEST_DIRECTORY} are read"
        )
    with _parsing("is no safetensors file, or its declared sizes are not those of the file"):
        return load_tensors(content)


def read_yaml(content: bytes) -> Any:
    """Plain values out of YAML. FileError: tags, anchors, aliases, lists and tables in one another beyond DEEPEST."""
    with _parsing("is no readable YAML", quote=True):
        text = content.decode("utf-8")
        _refuse_what_grows(text)
        return load_yaml(text)


def load_yaml(text: str) -> Any:
    """Values out of YAML as `yaml.safe_load` finds them, by libyaml where it is there, in a tenth of the time."""
    return yaml.load(text, _SAFE_LOADER)


class PlainDumper(yaml.SafeDumper):
    """Writes what `read_yaml` reads: a list that stands in two places is written out twice."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _refuse_what_grows(text: str) -> None:
    """Refuse what small files make large values of, or values of other types, before any value is built."""
    depth = 0
    for event in yaml.parse(text, _SAFE_LOADER):
        if isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.NodeEvent):
            line = event.start_mark.line + 1
            if event.anchor is not None or getattr(event, "tag", None) is not None:
                raise FileError(f"line {line}: has an anchor, alias or tag; plain values are needed")
            if depth == DEEPEST:
                raise FileError(f"line {line}: lists and tables are nested more than {DEEPEST} deep")
            depth += isinstance(event, yaml.CollectionStartEvent)


class _Header(NamedTuple):
    """What the beginning of a `.npy` file declares."""

    shape: tuple[int, ...]
    in_fortran_order: bool
    dtype: np.dtype


def _read_array(stream: IO[bytes], size: int) -> np.ndarray:
    """The array of a stream that declares to hold `size` bytes in all."""
    header = _header(stream)
    declared = math.prod(header.shape) * header.dtype.itemsize
    there = size - stream.tell()
    # Dimensions beside a zero are not in the product, and strings of no length take no bytes.
    without_zeros = math.prod(length for length in header.shape if length) * max(header.dtype.itemsize, 1)
    if declared != there or without_zeros > max(size, SMALL) or min(header.shape, default=0) < 0:
        raise FileError(
            f"declares {brief(header.shape)} numbers of type {header.dtype}, {declared:.3g} bytes, and holds {there}"
        )
    content = stream.read(there)
    if len(content) != there:
        raise FileError(f"is cut short: {len(content)} of {there} bytes are there")
    if header.in_fortran_order:
        return np.frombuffer(content, header.dtype).reshape(header.shape[::-1]).T
    return np.frombuffer(content, header.dtype).reshape(header.shape)


def _header(stream: IO[bytes]) -> _Header:
    with _parsing("does not begin as numpy's format for arrays does (pickled objects are refused: save numbers)"):
        version = npy.read_magic(stream)
        read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}[version]
        header = _Header(*read(stream))
    if header.dtype.hasobject:
        raise FileError("holds Python objects; pickled objects are refused, save a numeric array instead")
    if header.dtype.kind not in "biufcSU" or header.dtype.itemsize == 0:
        raise FileError(f"holds elements of type {brief(header.dtype)}; numbers are needed")
    return header


@contextmanager
def _archive(stream: IO[bytes]) -> Iterator[zipfile.ZipFile]:
    """A `.npz` file whose directory, and whose arrays together, are not larger than the file explains."""
    size = _size(stream)
    stream.seek(max(0, size - _ARCHIVE_END - _LARGE_ARCHIVE_LOCATOR))
    tail = stream.read()
    end = tail[-_ARCHIVE_END:]
    if len(end) != _ARCHIVE_END or not end.startswith(b"PK\5\6"):
        raise FileError("is no archive of arrays as numpy writes it: damaged or cut short")
    directory = int.from_bytes(end[12:16], "little")
    if directory > LARGEST_DIRECTORY or tail.startswith(b"PK\6\7"):
        raise FileError(f"has a directory of more than {LARGEST_DIRECTORY} bytes: too many arrays")
    with _parsing("is no archive of arrays as numpy writes it: damaged or cut short"):
        archive = zipfile.ZipFile(stream)
    with archive:
        members = archive.infolist()
        # Others than deflate take memory for tables of any size that they declare.
        if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members):
            raise FileError("has arrays that are compressed otherwise than numpy does")
        inflated = sum(member.file_size for member in members)
        if inflated > max(SMALL, LARGEST_INFLATION * size):
            raise FileError(
                f"inflates from {size / 1e6:.3g} to {inflated / 1e6:.3g} MB; arrays of recordings and skills grow at "
                f"most {LARGEST_INFLATION} times"
            )
        yield archive


def _size(stream: IO[bytes]) -> int:
    """Bytes in a file; the stream stands at its beginning then."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    return size


@contextmanager
def _parsing(failed: str, quote: bool = False) -> Iterator[None]:
    """Turn any exception of a parser into a FileError: on rubbish they raise what the step at hand happens to raise.

    Unless `quote` is set its text is left out, which may advise to load the file unsafely.
    """
    try:
        yield
    except GeodesicMotionError:
        raise
    except Exception as error:
        said = f": {brief(' '.join(str(error).split()), 200)}" if quote else f" ({type(error).__name__})"
        raise FileError(failed + said) from error
