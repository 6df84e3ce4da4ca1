"""Arrays as fields of values that are kept in files: immutable, equal by content, and apart from the JSON text."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..errors import InputError
from .quoting import quoted


def read_only(array: NDArray[Any], dtype: DTypeLike) -> NDArray[Any]:
    """Return a read-only array of this type; copied only if writable elsewhere."""
    values = np.ascontiguousarray(array, dtype=dtype)
    if values.flags.writeable or (isinstance(values.base, np.ndarray) and values.base.flags.writeable):
        values = values.copy()
        values.flags.writeable = False
    return values


def content_sha256(*arrays: NDArray[Any]) -> str:
    """Hash over types, shapes and values of arrays."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


class EqualByContent:
    """Values with arrays: two of a class are equal if their `content_sha256` is."""

    content_sha256: Any

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
            raise ValueError(f"there is no array {quoted(name)} in the file beside it")
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
