"""NumPy's arrays and archives of arrays: read only after what they announce fits what they have."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from math import prod
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .quoting import quoted, reason

#: Most arrays in an archive; more indicate damage.
_MOST_ARRAYS = 1000


@dataclass(frozen=True)
class ArrayHeader:
    """What an array in NumPy's format announces.

    Parameters
    ----------
    shape : tuple of int
        Its shape.
    dtype : numpy.dtype
        Its type: numbers, truth values or text.
    start : int
        Byte at which its values begin.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    start: int

    @property
    def end(self) -> int:
        """Byte at which its values end."""
        return self.start + self.dtype.itemsize * prod(self.shape)


def npy_header(data: bytes) -> ArrayHeader:
    """Read the header of an array (.npy); raises InputError if it is none, or of objects."""
    return _header(BytesIO(data))


def parse_npy(data: bytes) -> NDArray[Any]:
    """Read an array (.npy); raises InputError as `npy_header`, or if it is truncated."""
    _require_values(npy_header(data), len(data))
    with _damage_reported("NumPy array"):
        values: NDArray[Any] = np.lib.format.read_array(BytesIO(data), allow_pickle=False)
    return values


def npz_headers(data: bytes) -> dict[str, ArrayHeader]:
    """Read the headers of the arrays in an archive (.npz) by their names; no values are inflated.

    Raises
    ------
    InputError
        If it is damaged, or holds something else than arrays, more than 1000, or one that announces more or fewer
        values than it has.
    """
    with _archive(data) as archive:
        return {name: header for name, header, _ in _members(archive)}


def parse_npz(data: bytes, most_bytes: int) -> Mapping[str, NDArray[Any]]:
    """Read the arrays in an archive (.npz); raises InputError as `npz_headers`, or if all together are larger."""
    with _archive(data) as archive:
        headers = list(_members(archive))
        if sum(header.end for _, header, _ in headers) > most_bytes:
            raise InputError(f"its arrays take more than {most_bytes / 1e9:.3g} GB")
        return {name: np.lib.format.read_array(BytesIO(archive.read(info))) for name, _, info in headers}


@contextmanager
def _archive(data: bytes) -> Iterator[zipfile.ZipFile]:
    with _damage_reported("NumPy archive"), zipfile.ZipFile(BytesIO(data)) as archive:
        if len(archive.infolist()) > _MOST_ARRAYS:
            raise InputError(f"it holds more than {_MOST_ARRAYS} arrays")
        yield archive


def _members(archive: zipfile.ZipFile) -> Iterator[tuple[str, ArrayHeader, zipfile.ZipInfo]]:
    seen: set[str] = set()
    for info in archive.infolist():
        name = info.filename.removesuffix(".npy")
        if name in seen:
            raise InputError(f"it holds two arrays {quoted(name)}")
        seen.add(name)
        with archive.open(info) as member:
            header = _header(member)
        _require_values(header, info.file_size)
        yield name, header, info


def _header(file: IO[bytes]) -> ArrayHeader:
    with _damage_reported("NumPy array"):
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
        if dtype.kind not in "biufcU" or any(n < 0 for n in shape):
            raise InputError(f"it holds {quoted(str(dtype))}: give numbers")
        return ArrayHeader(shape, dtype, file.tell())


def _require_values(header: ArrayHeader, n_bytes: int) -> None:
    if header.end > n_bytes:
        raise InputError(f"it is truncated: its values reach to byte {header.end}, it has {n_bytes}")


@contextmanager
def _damage_reported(what: str) -> Iterator[None]:
    """Turn what NumPy and zipfile raise of damage, which is nearly anything, into InputError."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        raise InputError(f"it is no {what}, or damaged ({reason(error)})") from error
