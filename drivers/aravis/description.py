"""Check of a camera's GenICam description before Aravis parses it: it may end the process or fill the memory."""

from __future__ import annotations

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any, Final
from xml.parsers import expat

from ..camera import CameraError
from . import gvcp

#: Bootstrap registers with the place of the description, the second for want of the first, and their size in bytes
#: (GigE Vision 2.0, section 28).
_URLS, _URL_BYTES = (0x0200, 0x0400), 512
#: Bytes read at once.
_BLOCK_BYTES: Final = 512
#: Largest description, as the camera keeps it and as text: those of cameras have up to about 5 MB.
_MOST_KEPT_BYTES, _MOST_TEXT_BYTES = 8 * 2**20, 32 * 2**20
#: Deepest nesting of elements, and longest chain of features of which each follows from the next.
_MOST_NESTED, _MOST_IN_CHAIN = 32, 256

#: References by which a value follows from another one, and categories hold features. Bounds and locks are left out:
#: they are read for themselves, and those of two features may depend on each other's values.
_FOLLOWS: Final = frozenset(
    {"pValue", "pVariable", "pAddress", "pIndex", "pLength", "pFeature", "pValueDefault", "pValueIndexed", "pOffset"}
)


class UnusableError(Exception):
    """A description that cannot be used."""


def check_description(address: str) -> None:
    """Refuse a GigE Vision camera whose description Aravis would not survive.

    Parameters
    ----------
    address : str
        Network address of the camera.

    Raises
    ------
    CameraError
        Naming what is wrong.
    """
    urls = ((_read(address, register, _URL_BYTES) or b"").split(b"\0")[0].decode("latin-1") for register in _URLS)
    url = next(filter(None, urls), "")
    location = re.fullmatch(r"local:([^;]*);(?:0x)?([0-9a-f]{1,16});(?:0x)?([0-9a-f]{1,16})(\?.*)?", url, re.IGNORECASE)
    if location is None:
        raise _refused(address, f"it is not kept in the camera but at {url[:80]!r}" if url else "the camera has none")
    name, start, size = location[1], int(location[2], 16), int(location[3], 16)
    if size > _MOST_KEPT_BYTES:
        raise _refused(address, f"it has {size} bytes, more than {_MOST_KEPT_BYTES}")
    data = _read(address, start, size) if start + size <= 2**32 else None
    if not data:
        raise _refused(address, "it cannot be read")
    try:
        check_text(_unpacked(data) if name.lower().endswith(".zip") else data)
    except UnusableError as error:
        raise _refused(address, str(error)) from error


def _refused(address: str, fault: str) -> CameraError:
    return CameraError(
        f"the GenICam description of the camera at {address} cannot be used", f"{fault}; update the camera's firmware"
    )


def _read(address: str, start: int, n_bytes: int) -> bytes | None:
    """Read memory of the camera; None if it does not give it."""
    data = bytearray()
    while len(data) < n_bytes:
        # Counts are multiples of 4.
        count = min(_BLOCK_BYTES, -(-(n_bytes - len(data)) // 4) * 4)
        answer = gvcp.ask(address, gvcp.READ_MEMORY, struct.pack(">II", start + len(data), count), tries=10)
        if answer is None or answer.status != 0 or len(answer.payload) != 4 + count:
            return None
        data += answer.payload[4:]
    return bytes(data[:n_bytes])


def _unpacked(data: bytes) -> bytes:
    """Return the text of a ZIP archive; raises UnusableError."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
            if not entries:
                raise UnusableError("its ZIP archive is empty")
            if any(entry.file_size > _MOST_TEXT_BYTES for entry in entries):
                raise UnusableError(f"its ZIP archive unpacks to more than {_MOST_TEXT_BYTES} bytes")
            with archive.open(entries[0]) as packed:
                return packed.read(_MOST_TEXT_BYTES + 1)
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, NotImplementedError, RuntimeError) as error:
        raise UnusableError(f"its ZIP archive cannot be unpacked ({error})") from error


def check_text(text: bytes) -> None:
    """Refuse a description that Aravis cannot read.

    Parameters
    ----------
    text : bytes
        XML.

    Raises
    ------
    UnusableError
        Naming what is wrong.
    """
    if len(text) > _MOST_TEXT_BYTES:
        raise UnusableError(f"it has more than {_MOST_TEXT_BYTES} bytes")
    nodes = _Nodes()
    try:
        nodes.parser.Parse(text.rstrip(b"\0"), True)
    except expat.ExpatError as error:
        raise UnusableError(f"it is not valid XML ({error})") from error
    _check_chains(nodes.references)


class _Nodes:
    """Features of a description, each with the features that its value is computed from; filled while parsing."""

    def __init__(self) -> None:
        self.references: dict[str, list[str]] = {}
        self._names: list[str | None] = []
        self._text: list[str] | None = None
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.StartDoctypeDeclHandler = self._refuse_entities

    @staticmethod
    def _refuse_entities(*_: Any) -> None:
        raise UnusableError("it declares a document type, which may hold entities")

    def _start(self, tag: str, attributes: Mapping[str, str]) -> None:
        self._text = [] if tag in _FOLLOWS else None
        self._names.append(None if tag in _FOLLOWS else attributes.get("Name"))
        if len(self._names) > _MOST_NESTED:
            raise UnusableError(f"its elements are nested more than {_MOST_NESTED} deep")

    def _characters(self, text: str) -> None:
        if self._text is not None:
            self._text.append(text)

    def _end(self, tag: str) -> None:
        self._names.pop()
        if self._text is not None and tag in _FOLLOWS:
            node = next((name for name in reversed(self._names) if name), None)
            if node is not None:
                self.references.setdefault(node, []).append("".join(self._text).strip())
        self._text = None


def _check_chains(references: Mapping[str, list[str]]) -> None:
    """Refuse features that are computed from themselves, or through too long a chain of others."""
    lengths: dict[str, int] = {}
    for first in references:
        path, waiting = [first], {first: iter(references[first])}
        while path:
            node = path[-1]
            if node in lengths:
                path.pop()
                continue
            follows = next(waiting[node], None)
            if follows is None:
                lengths[node] = 1 + max(
                    (lengths.get(reference, 0) for reference in references.get(node, ())), default=0
                )
                if lengths[node] > _MOST_IN_CHAIN:
                    raise UnusableError(f"{node[:80]!r} follows from a chain of more than {_MOST_IN_CHAIN} features")
            elif follows in waiting and follows not in lengths:
                raise UnusableError(f"{follows[:80]!r} follows from itself")
            elif follows not in lengths:
                path.append(follows)
                waiting[follows] = iter(references.get(follows, ()))
