"""The chain of a TIFF's directories, checked before a library follows it."""

from __future__ import annotations

import struct
from pathlib import Path

from ..errors import InputError

#: Pages from which a file is refused: following them takes seconds, and no file of one picture has as many.
MOST_PAGES = 1000
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
    order = {b"II": "<", b"MM": ">"}.get(data[:2])
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
            raise InputError(f"{path} holds more than {MOST_PAGES} pages: give files of one picture each")
        seen.add(directory)
        if directory + count_size > len(data):
            return
        (entries,) = struct.unpack_from(order + count_code, data, directory)
        at = directory + count_size + entries * entry_size
