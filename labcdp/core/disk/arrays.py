"""Arrays on disk: NumPy's files, read only after what they announce fits what they have, and arrays as fields."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cached_property
from io import BytesIO
from math import prod
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..errors import InputError
from .files import damage_reported, quoted

#: Most arrays in an archive; more indicate damage.
_MOST_ARRAYS = 1000
_NO_ARRAY = "it is not a NumPy array, or is damaged"


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
    with damage_reported(_NO_ARRAY):
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
    with damage_reported("it is not a NumPy archive, or is damaged"), zipfile.ZipFile(BytesIO(data)) as archive:
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
    with damage_reported(_NO_ARRAY):
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
        if dtype.kind not in "biufcU" or any(n < 0 for n in shape):
            raise InputError(f"it holds {quoted(str(dtype))}: give numbers")
        return ArrayHeader(shape, dtype, file.tell())


def _require_values(header: ArrayHeader, n_bytes: int) -> None:
    if header.end > n_bytes:
        raise InputError(f"it is truncated: its values reach to byte {header.end}, it has {n_bytes}")


def read_only(array: NDArray[Any], dtype: DTypeLike) -> NDArray[Any]:
    """Return a read-only array of this type; copied only if writable elsewhere."""
    values = np.ascontiguousarray(array, dtype=dtype)
    if values.flags.writeable or (isinstance(values.base, np.ndarray) and values.base.flags.writeable):
        values = values.copy()
        values.flags.writeable = False
    return values


class EqualByContent:
    """Dataclass with arrays: two of a class are equal if their `content_sha256` is."""

    @cached_property
    def content_sha256(self) -> str:
        """Hash over all values, and over types and shapes of arrays."""
        digest = hashlib.sha256()
        for value in (getattr(self, one.name) for one in fields(self)):  # type: ignore[arg-type]
            if isinstance(value, np.ndarray):
                digest.update(f"{value.dtype.str}{value.shape}".encode())
                digest.update(np.ascontiguousarray(value).data)
            else:
                # A number is the same in NumPy, in Python and read from a file.
                digest.update(f"{np.asarray(value).tolist()}".encode())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return NotImplemented
        return self is other or bool(self.content_sha256 == other.content_sha256)

    def __hash__(self) -> int:
        return hash(self.content_sha256)


@dataclass(frozen=True)
class StoredArray:
    """Pydantic serialisation of an array field: the array in a separate file, and a reference in the JSON text.

    For use in ``Annotated[NDArray[np.float32], StoredArray("float32", 2)]``. Writing puts the array into the dictionary
    ``context["arrays"]``, reading takes it from there.

    Parameters
    ----------
    dtype : str
        NumPy's name of the type.
    ndim : int
        Number of dimensions.
    """

    dtype: str
    ndim: int

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return the schema of the reference in the JSON text, followed by the array look-up."""
        from pydantic_core import core_schema as cs

        reference = cs.typed_dict_schema(
            {
                "array": cs.typed_dict_field(cs.str_schema()),
                "dtype": cs.typed_dict_field(cs.literal_schema([self.dtype])),
                "shape": cs.typed_dict_field(
                    cs.list_schema(cs.int_schema(ge=0), min_length=self.ndim, max_length=self.ndim)
                ),
            },
            extra_behavior="forbid",
        )
        return cs.chain_schema(
            [reference, cs.with_info_plain_validator_function(self._read)],
            serialization=cs.plain_serializer_function_ser_schema(
                self._write, info_arg=True, is_field_serializer=True, return_schema=reference
            ),
        )

    def _read(self, reference: Any, info: Any) -> NDArray[Any]:
        arrays = (info.context or {}).get("arrays", {})
        name = reference["array"]
        if name not in arrays:
            raise ValueError(f"there is no array {quoted(name)} in the accompanying file")
        array: NDArray[Any] = arrays[name]
        if str(array.dtype) != self.dtype or list(array.shape) != reference["shape"]:
            raise ValueError(f"array {quoted(name)} is {array.dtype} of shape {array.shape}, not as it is described")
        return read_only(array, self.dtype)

    def _write(self, _owner: Any, array: NDArray[Any], info: Any) -> dict[str, Any]:
        arrays = (info.context or {}).get("arrays")
        if arrays is None:
            raise InputError("an array cannot be written as JSON text alone: use labcdp.calibration.save")
        name = f"{info.field_name}_{len(arrays)}"
        arrays[name] = array
        return {"array": name, "dtype": self.dtype, "shape": list(array.shape)}
