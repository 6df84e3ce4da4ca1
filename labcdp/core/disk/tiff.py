"""Files whose libraries may loop or crash: TIFF, checked before it is followed, and reading in a child process."""

from __future__ import annotations

import importlib
import os
import pickle
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..errors import InputError
from .files import damage_reported, reason

#: Pages from which a file is refused: following them takes seconds, and no file of one picture has as many.
MOST_PAGES = 1000
#: Compressions (TIFF 6.0, and the two codes of Deflate in Technical Note 3).
_UNCOMPRESSED, _DEFLATE, _PACK_BITS = 1, (8, 32946), 32773
#: By version of the format (TIFF 6.0 and BigTIFF): where the first offset is; sizes of the count of entries and of an
#: entry; codes of the count and of an offset.
_LAYOUTS = {42: (4, 2, 12, "H", "I"), 43: (8, 8, 20, "Q", "Q")}


def require_end(data: bytes, path: Path) -> None:
    """Refuse a TIFF whose directories lead back to an earlier one, which would be followed for ever, or do not end.

    Parameters
    ----------
    data : bytes
        The whole file; one that is no TIFF passes, and so does a chain that leaves the file: it ends there.
    path : Path
        For messages.

    Raises
    ------
    InputError
        If a directory comes twice, or there are more than `MOST_PAGES`.
    """
    order = {b"II": "<", b"MM": ">"}.get(bytes(data[:2]))
    if order is None or len(data) < 4:
        return
    layout = _LAYOUTS.get(struct.unpack_from(f"{order}H", data, 2)[0])
    if layout is None:
        return
    at, count_size, entry_size, count_code, offset_code = layout
    seen: set[int] = set()
    while at + struct.calcsize(offset_code) <= len(data):
        (directory,) = struct.unpack_from(order + offset_code, data, at)
        if directory == 0:
            return
        if directory in seen:
            raise InputError(
                f"{path} is damaged: its list of pages leads back to byte {directory} and never ends: copy or save it "
                "again"
            )
        if len(seen) == MOST_PAGES:
            raise InputError(
                f"{path} holds more than {MOST_PAGES} pages, which labcdp does not read: split it, or convert it to a "
                "video in FFV1"
            )
        seen.add(directory)
        if directory + count_size > len(data):
            return
        (entries,) = struct.unpack_from(order + count_code, data, directory)
        at = directory + count_size + entries * entry_size


@contextmanager
def open_tiff(data: bytes, path: Path) -> Iterator[Any]:
    """Open the bytes of a file as tifffile.TiffFile; whatever goes wrong with it becomes one InputError.

    Parameters
    ----------
    data : bytes
        The whole file.
    path : Path
        For messages.

    Raises
    ------
    InputError
        If it is no TIFF or damaged, or its list of pages does not end.
    """
    import tifffile

    require_end(data, path)
    damage = damage_reported(
        f"{path} cannot be read as TIFF", ": if another program opens it, save it there again, without compression"
    )
    with damage, tifffile.TiffFile(BytesIO(data)) as tiff:
        yield tiff


def pixels_of(page: Any, path: Path) -> NDArray[Any]:
    """Decode a page, whose strips or tiles must not hold fewer or more pixels than they should: some count as 0.

    Parameters
    ----------
    page : tifffile.TiffPage
        The page. Of compressions, Deflate and PackBits are checked; others are for their decoders.
    path : Path
        For messages.

    Raises
    ------
    InputError
        If a strip or tile is missing, too short, or inflates to more than it should; else what tifffile does.
    """
    segments = list(zip(page.dataoffsets, page.databytecounts, strict=False))
    if sum(1 for offset, count in segments if offset and count) < prod(page.chunked):
        # Programs of maps leave out parts without data (GDAL, SPARSE_OK).
        raise InputError(
            f"{path} has data for a part of its pixels only, since it is truncated or was written without empty "
            "parts: copy it again, or save it in full"
        )
    samples = page.samplesperpixel if page.planarconfig == 1 else 1
    columns, rows = page.tilewidth, page.tilelength
    if not page.is_tiled:
        columns, rows = page.imagewidth, min(page.rowsperstrip, page.imagelength)
    row_bytes = (columns * samples * page.bitspersample + 7) // 8
    for at, (offset, count) in enumerate(segments[: prod(page.chunked)]):
        most = least = rows * row_bytes
        if not page.is_tiled:
            # The last strip ends with the picture, but may be filled up.
            first = at % -(-page.imagelength // rows) * rows
            least = min(rows, page.imagelength - first) * row_bytes
        found = _decoded_bytes(page, offset, count, most)
        if found < least or (found > most and page.compression != _UNCOMPRESSED):
            raise InputError(
                f"{path} is damaged: its part at byte {offset} holds {'fewer' if found < least else 'more'} pixels "
                "than it should: copy it again"
            )
    values: NDArray[Any] = page.asarray()
    return values


def _decoded_bytes(page: Any, offset: int, count: int, most: int) -> int:
    """Bytes that a strip or tile decodes to, counted up to one more than `most`; `most` if that is not known here."""
    if page.compression == _UNCOMPRESSED:
        return count
    if page.compression not in (*_DEFLATE, _PACK_BITS):
        return most
    page.parent.filehandle.seek(offset)
    data = page.parent.filehandle.read(count)
    if page.compression == _PACK_BITS:
        return _unpacked_bytes(data)
    return len(zlib.decompressobj().decompress(data, most + 1))


def _unpacked_bytes(data: bytes) -> int:
    """Length of data that PackBits packed (TIFF 6.0, section 9)."""
    at = length = 0
    while at < len(data):
        n = data[at]
        length += n + 1 if n < 128 else 257 - n if n > 128 else 0
        at += n + 2 if n < 128 else 2 if n > 128 else 1
    return length


#: Memory in addition to that of Python and its libraries, time a file has, and its size adds.
_MOST_MEMORY = 2**32
_SECONDS, _BYTES_PER_SECOND = 8, 10_000_000
_PROGRAM = "from labcdp.core.disk.tiff import _work; _work()"


def read_in_child(reader: str, data: bytes) -> Any:
    """Have a function read bytes in a child process that is killed when it takes too long.

    Parameters
    ----------
    reader : str
        Module and name of the function, ``package.module:function``; it takes the bytes.
    data : bytes
        The file.

    Returns
    -------
    object
        What the function returns; it is pickled in between.

    Raises
    ------
    InputError
        If the function raises anything, crashes, or needs more time or memory.
    """
    # Of the processor; in all it may be more, as other programs run too.
    seconds = _SECONDS + len(data) // _BYTES_PER_SECOND
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", _PROGRAM, reader, str(seconds)]
    try:
        done = subprocess.run(  # noqa: S603 (our own interpreter and arguments)
            command, input=data, capture_output=True, timeout=10 * seconds, env=environment, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise InputError("it is not read in a reasonable time") from error
    if done.returncode != 0:
        raise InputError("the library that reads it stopped, because of damage or lack of memory")
    succeeded, result = pickle.loads(done.stdout)  # noqa: S301 (written by `_work`)
    if not succeeded:
        raise InputError(result)
    return result


def _work() -> None:
    """Be the child: read bytes from standard input, and write the pickled result to standard output."""
    reader, seconds = sys.argv[1], int(sys.argv[2])
    # Libraries write where they like: not between our bytes.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    module, _, name = reader.partition(":")
    read = getattr(importlib.import_module(module), name)
    data = sys.stdin.buffer.read()
    _limit(seconds, _MOST_MEMORY + len(data))
    try:
        result = True, read(data)
    # Damage can surface as almost any error of the libraries.
    except Exception as error:
        result = False, reason(error)
    pickle.dump(result, out, pickle.HIGHEST_PROTOCOL)
    out.close()


def _limit(seconds: int, most_bytes: int) -> None:
    with suppress(ImportError, OSError, ValueError):
        import resource

        with open("/proc/self/statm", encoding="ascii") as file:
            taken = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_AS, (taken + most_bytes, resource.RLIM_INFINITY))
