"""What a session recorded: its records, frames and readings, and whether all of it is sound."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..core.errors import SessionError
from ..core.frame import Frame
from .files import read_checked
from .folder import problems, read_configuration, unrecorded
from .frame_file import frame_from_tiff
from .journal_text import Entry
from .records import EXPOSURES, EventRecord, FrameRecord, ReadingRecord, Record, Role, record, superseded


class RecordedSession:
    """The part of a session that only reads.

    Parameters
    ----------
    path : Path
        The session's folder.
    entries : list of Entry
        The journal's lines; the list grows while the session is recorded.
    """

    def __init__(self, path: Path, entries: list[Entry]) -> None:
        self.path = path
        self._entries = entries
        self._records: list[Record] = []
        self.configuration = read_configuration(path, entries)

    @property
    def records(self) -> list[Record]:
        """All records in the order they were made."""
        self._records += [record(entry) for entry in self._entries[len(self._records) :]]
        return list(self._records)

    def frames(self, role: Role | None = None) -> list[FrameRecord]:
        """List the records of the frames that count, or of those with a role, in order."""
        return [r for r in self._counting() if isinstance(r, FrameRecord) and role in (None, r.role)]

    def readings(self) -> list[ReadingRecord]:
        """List the records of the meter's readings that count, in order."""
        return [r for r in self._counting() if isinstance(r, ReadingRecord)]

    def _counting(self) -> Iterator[Record]:
        records = self.records
        left_out = superseded(records)
        return (r for r in records if r.sequence not in left_out)

    @property
    def exposures_s(self) -> tuple[float, ...] | None:
        """Exposures of the plan, or those last found where the plan has none; None if they are still to be found."""
        if self.configuration.plan.exposures_s is not None:
            return self.configuration.plan.exposures_s
        found = [r for r in self.records if isinstance(r, EventRecord) and r.kind == EXPOSURES]
        return tuple(found[-1].content["exposures_s"]) if found else None

    def load(self, frame: FrameRecord) -> Frame:
        """Read a frame, bit for bit as it was recorded.

        Raises
        ------
        SessionError
            If its file is missing, truncated or altered.
        """
        return frame_from_tiff(read_checked(self.path, frame.file), str(self.path / frame.file.name))

    def damaged(self) -> list[tuple[FrameRecord, str]]:
        """List the frames that count whose files are missing or altered, each with its fault."""
        found = []
        for frame in self.frames():
            try:
                read_checked(self.path, frame.file)
            except SessionError as error:
                found.append((frame, str(error)))
        return found

    def unrecorded(self) -> list[str]:
        """Files in the folder that the journal does not know, as names inside it.

        A whole frame is among them if its writer was killed just before it could add the line to the journal.
        """
        return unrecorded(self.path, self._entries)

    def problems(self) -> list[str]:
        """Check the journal on the disk and every file in it; one line for each fault, none if all is sound."""
        return problems(self.path, self._entries)

    def verify(self) -> None:
        """Check everything, as `problems` does.

        Raises
        ------
        SessionError
            If something is missing, truncated or altered; names the first fault and how many there are.
        """
        found = self.problems()
        if found:
            raise SessionError(found[0] + (f" (fault 1 of {len(found)})" if len(found) > 1 else ""))
