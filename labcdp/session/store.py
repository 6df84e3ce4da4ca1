"""Session: a folder that holds one measurement and can be read, checked and replayed."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from itertools import count
from os import PathLike
from pathlib import Path
from typing import Any, Self

from ..core.clock import Clock, SystemClock
from ..core.disk.files import SESSION_JOURNAL, shown
from ..core.errors import InputError, SessionError
from ..core.frame import Frame
from ..core.reading import Reading
from .configuration import SessionConfiguration
from .folder import create_folder, given_up, problems, read_configuration, remove_session, require_session, unrecorded
from .frames import FrameFolder, frame_from_tiff, read_checked, require_sizes
from .journal import CLOCK, Entry, Journal, read_journal
from .records import (
    EXPOSURES,
    ROLES,
    SUPERSEDED,
    EventRecord,
    FrameRecord,
    ReadingRecord,
    Record,
    Role,
    counting,
    event_record,
    frame_record,
    reading_record,
    record,
)

_OWN_KINDS = ("session", "readme", "frame", "reading", "torn line", CLOCK, SUPERSEDED)
_SYSTEM_CLOCK = SystemClock()

_log = logging.getLogger(__name__)


class Session:
    """A recorded session; made by `create` or `open`, a context manager.

    Whatever an ``add_`` method has returned is on the disk, and stays there if the process is killed; where it cannot
    be written, the method raises SessionError, and the session is as it was before. One process at a time may write,
    any number may read. A session is not for several threads at once.

    Parameters
    ----------
    path : Path
        The session's folder.
    entries : list of Entry
        The journal's lines; the list grows while the session is recorded.
    journal : Journal or None
        The journal if open for writing.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> len(session.frames()), len(session.readings())
    (12, 32)
    """

    def __init__(self, path: Path, entries: list[Entry], journal: Journal | None) -> None:
        self.path = path
        self._entries = entries
        self._records: list[Record] = []
        self.configuration = read_configuration(path, entries)
        self._journal = journal
        self._folder = None if journal is None else FrameFolder(path, entries[0].content["compress"])

    @classmethod
    def create(
        cls,
        path: str | PathLike[str],
        configuration: SessionConfiguration,
        compress: bool = False,
        clock: Clock = _SYSTEM_CLOCK,
    ) -> Self:
        """Make a new session and open it for writing.

        Parameters
        ----------
        path : path
            A folder that does not exist yet, or is empty.
        configuration : SessionConfiguration
            Configuration: devices, target and plan.
        compress : bool
            Whether frames are compressed without loss; for a session that is to be small rather than quick.
        clock : Clock
            Where the times of the records come from.

        Raises
        ------
        SessionError
            If there is something at `path` already, or it cannot be written.
        """
        path = Path(path)
        journal = create_folder(path, configuration, compress, clock)
        try:
            return cls(path, journal.entries, journal)
        except BaseException:
            journal.close()
            raise

    @classmethod
    def open(cls, path: str | PathLike[str], writable: bool = False, clock: Clock = _SYSTEM_CLOCK) -> Self:
        """Open a session and verify its journal and configuration.

        Reading changes nothing. Opening for writing puts right what a killed writer left behind: temporary
        files are removed, a torn last line of the journal is kept in a file of its own.

        Raises
        ------
        SessionError
            If it is no session, the journal or the configuration was altered, or another process writes to it.
        """
        if not isinstance(path, str | PathLike):
            raise SessionError(f"the session is {shown(path)}: give the path of its folder")
        path = Path(path)
        require_session(path)
        if not writable:
            entries, _, torn = read_journal(path)
            if torn:
                _log.warning("%s: the last line is incomplete and ignored", path / SESSION_JOURNAL)
            return cls(path, entries, None)
        journal = Journal.open(path, clock)
        try:
            session = cls(path, journal.entries, journal)
            session._recover()
        except BaseException:
            journal.close()
            raise
        return session

    def close(self) -> None:
        """Let others write; may be called twice. What was recorded can still be read."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def __enter__(self) -> Self:
        """Return the session."""
        return self

    def __exit__(self, *exc: object) -> None:
        """Close."""
        self.close()

    @property
    def records(self) -> list[Record]:
        """All records in the order they were made."""
        self._records += [record(entry) for entry in self._entries[len(self._records) :]]
        return list(self._records)

    def frames(self, role: Role | None = None) -> list[FrameRecord]:
        """List the records of the frames that count, or of those with a role, in order."""
        return [r for r in counting(self.records) if isinstance(r, FrameRecord) and role in (None, r.role)]

    def readings(self) -> list[ReadingRecord]:
        """List the records of the meter's readings that count, in order."""
        return [r for r in counting(self.records) if isinstance(r, ReadingRecord)]

    @property
    def exposures_s(self) -> tuple[float, ...] | None:
        """Exposures of the plan, or those last found where the plan has none; None if they are still to be found."""
        if self.configuration.plan.exposures_s is not None:
            return self.configuration.plan.exposures_s
        events = [r for r in self.records if isinstance(r, EventRecord) and r.kind == EXPOSURES]
        return tuple(events[-1].content["exposures_s"]) if events else None

    def load(self, frame: FrameRecord) -> Frame:
        """Read a frame, bit for bit; raises SessionError if its file is missing, truncated or altered."""
        data, curve = read_checked(self.path, frame.file), self.configuration.camera.curve
        return frame_from_tiff(data, str(self.path / frame.file.name), curve)

    def settings(self, frame: FrameRecord) -> Frame:
        """Return the settings of a frame, with all pixels 0, from the journal alone; raises SessionError."""
        return frame.without_pixels(self.configuration.camera.curve)

    def require_unaltered(self, frames: Iterable[FrameRecord]) -> None:
        """Read the files of frames and check their hashes; raises SessionError as `load`."""
        for frame in frames:
            read_checked(self.path, frame.file)

    def damaged(self) -> list[tuple[FrameRecord, str]]:
        """List the frames whose files are missing or altered, each with its fault; those too that were taken again."""
        damaged, lost = [], given_up(self._entries)
        for frame in (r for r in self.records if isinstance(r, FrameRecord) and r.sequence not in lost):
            try:
                read_checked(self.path, frame.file)
            except SessionError as error:
                damaged.append((frame, str(error)))
        return damaged

    def require_files(self) -> None:
        """Check that every recorded file is there with its size, without reading it; `verify` reads them all.

        Raises
        ------
        SessionError
            If one is not; names the first and how many there are.
        """
        lost = given_up(self._entries)
        files = [entry.file for entry in self._entries if entry.file is not None and entry.sequence not in lost]
        require_sizes(self.path, files)

    def unrecorded(self) -> list[str]:
        """Files in the folder that the journal does not know, also of a writer that was killed, as names inside it."""
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
        problems = self.problems()
        if problems:
            raise SessionError(problems[0] + (f" (fault 1 of {len(problems)})" if len(problems) > 1 else ""))

    def add_frame(self, frame: Frame, role: Role = "light", patch: str | None = None) -> FrameRecord:
        """Record a frame; as `add_frames`."""
        return self.add_frames([(frame, role, patch)])[0]

    def add_frames(self, frames: Sequence[tuple[Frame, Role, str | None]]) -> list[FrameRecord]:
        """Record frames together, which takes less time than one by one.

        Parameters
        ----------
        frames : sequence of (Frame, str, str or None)
            Each with its role, and the patch that was before the camera where patches are shown one by one.

        Raises
        ------
        InputError
            If a role is not 'light' or 'dark', or the configuration has no such patch.
        """
        frames = [(self.configuration.camera.stated(frame), role, patch) for frame, role, patch in frames]
        for _, role, patch in frames:
            if role not in ROLES:
                raise InputError(f"role is {role!r}: give 'light' or 'dark'")
            if patch is not None:
                self._require_patch(patch)
        journal, folder = self._writer(), self._frame_folder()
        first = folder.next_number
        files = folder.write([(frame, role) for frame, role, _ in frames])
        lines = []
        for number, (frame, role, patch), file in zip(count(first), frames, files, strict=False):
            height, width = frame.shape
            content = {"number": number, "role": role, "width": width, "height": height, "frame": frame.metadata()}
            lines.append(("frame", content | ({} if patch is None else {"patch": patch}), file))
        try:
            entries = journal.append_several(lines)
        except BaseException:
            # Ctrl-C may come when the lines are written.
            if not {entry.file for entry in self._entries[-len(files) :]} & set(files):
                folder.take_back(first, [file.name for file in files])
            raise
        return [frame_record(entry) for entry in entries]

    def supersede(
        self, records: Sequence[FrameRecord | ReadingRecord], reason: str, *, damaged: bool = False
    ) -> EventRecord:
        """Let frames and readings no longer count, because they are taken again; they stay on the disk.

        The files of `damaged` ones are not checked any more.
        """
        lines = [record.sequence for record in records]
        content = {"lines": lines, "reason": reason} | ({"damaged": True} if damaged else {})
        return event_record(self._writer().append(SUPERSEDED, content))

    def add_reading(self, reading: Reading, patch: str) -> ReadingRecord:
        """Record a reading of the meter, taken on a patch of the target.

        Raises
        ------
        InputError
            If the configuration has no such patch.
        """
        self._require_patch(patch)
        return reading_record(self._writer().append("reading", {"patch": patch, "reading": reading.to_dict()}))

    def add_event(self, kind: str, content: Mapping[str, Any]) -> EventRecord:
        """Record anything else, as values JSON can hold.

        Raises
        ------
        InputError
            If `kind` is empty or one of the session's own, or `content` has values JSON does not have.
        """
        if not kind or kind in _OWN_KINDS:
            raise InputError(f"kind is {kind!r}: give a name that is not one of {', '.join(_OWN_KINDS)}")
        return event_record(self._writer().append(kind, content))

    def remove(self) -> None:
        """Remove a session that is open for writing, with its folder, and close it.

        Raises
        ------
        SessionError
            If the folder holds anything else, or a file of the session was altered; then nothing is removed.
        """
        self._writer()
        if self.problems():
            raise SessionError(f"{self.path} was altered and is not removed: choose a new folder")
        remove_session(self.path, [entry.file.name for entry in self._entries if entry.file])
        self.close()

    def _require_patch(self, patch: str) -> None:
        names = [known.name for known in self.configuration.target.patches]
        if patch not in names:
            raise InputError(f"patch is {patch!r}: give one of the target's, {', '.join(names)}")

    def _writer(self) -> Journal:
        if self._journal is None:
            raise SessionError(f"{self.path} is not open for writing: open it with writable=True")
        return self._journal

    def _frame_folder(self) -> FrameFolder:
        assert self._folder is not None, "a session that is not open for writing has refused before"
        return self._folder

    def _recover(self) -> None:
        """Put right what a killed writer left behind."""
        journal = self._writer()
        self._frame_folder().recover(entry.file.name for entry in self._entries if entry.file)
        if journal.torn:
            journal.set_torn_line_aside()
        for name in self.unrecorded():
            _log.warning(
                "%s is not in the journal: it is left untouched and is not part of the session", self.path / name
            )
