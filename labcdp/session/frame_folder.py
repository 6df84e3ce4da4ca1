"""The folder of a session's frames: numbered files, written together or not at all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ..core.frame import Frame
from .files import FRAMES, StoredFile, remove_partial, reported, write_several
from .frame_file import frame_file_name, tiff_parts
from .journal_text import Entry
from .records import Role


class FrameFolder:
    """Writes the frames of a session.

    Parameters
    ----------
    session : Path
        The session's folder.
    compress : bool
        Whether frames are compressed.
    """

    def __init__(self, session: Path, compress: bool) -> None:
        self._session = session
        self._compress = compress
        self.next_number = 1

    def recover(self, entries: Sequence[Entry]) -> None:
        """Remove what a killed writer left half done, and find the next number; raises SessionError."""
        frames = self._session / FRAMES
        with reported(frames, "written"):
            # Programs that copy or pack folders may leave out an empty one.
            frames.mkdir(exist_ok=True)
            remove_partial(self._session)
            remove_partial(frames)
        names = [path.name for path in frames.iterdir()] + [entry.file.name for entry in entries if entry.file]
        numbers = [int(found[1]) for name in names if (found := re.match(rf"(?:{FRAMES}/)?(\d+)_", name))]
        self.next_number = max(numbers, default=0) + 1

    def write(self, frames: Sequence[tuple[Frame, Role]]) -> list[StoredFile]:
        """Write frames with the next numbers; raises SessionError, and then none is there."""
        first = self.next_number
        names = [
            f"{FRAMES}/{frame_file_name(number, role, frame.exposure_s)}"
            for number, (frame, role) in enumerate(frames, start=first)
        ]
        parts = (tiff_parts(frame, self._compress) for frame, _ in frames)
        # Counted first: a number is used again only if its file is surely gone.
        self.next_number += len(frames)
        try:
            with reported(self._session / names[0], "written"):
                return write_several(self._session, zip(names, parts, strict=True))
        except BaseException:
            self.take_back(first, names)
            raise

    def take_back(self, first: int, names: Sequence[str]) -> None:
        """Remove files that the journal does not know; their numbers are free again if all are surely gone."""
        with suppress(OSError):
            for name in names:
                (self._session / name).unlink(missing_ok=True)
            self.next_number = first
