"""The light frames of a recorded session as a video."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..errors import InputError
from ..session import FrameRecord, Session
from .video import Entry


@dataclass(frozen=True, eq=False)
class SessionVideo:
    """Light frames of a session in the order they were recorded; made by `open_session_video`.

    Parameters
    ----------
    path : Path
        The session's folder.
    session : Session
        The session, open for reading.
    records : tuple of FrameRecord
        Its light frames; frame n is the n-th.
    """

    path: Path
    session: Session
    records: tuple[FrameRecord, ...]

    @property
    def sha256(self) -> str:
        """Hash of the hashes of the frames."""
        return hashlib.sha256("".join(record.file.sha256 for record in self.records).encode()).hexdigest()

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the first frame."""
        return self.records[0].shape

    @property
    def frame_count(self) -> int:
        """Number of light frames."""
        return len(self.records)

    @property
    def frame_rate(self) -> float | None:
        """Frames a second, by the times of the first and the last."""
        lasted = self._time_s(self.records[-1])
        return (len(self.records) - 1) / lasted if lasted > 0 else None

    @property
    def exposure_stated(self) -> bool:
        """Always: it is recorded with each frame."""
        return True

    @property
    def notes(self) -> tuple[str, ...]:
        """Where the times come from."""
        return ("light frames of a session, at the times they were recorded",)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warn if the frames differ in exposure or gain, which a relative evaluation would take for light."""
        settings = {(record.exposure_s, record.gain_db) for record in self.records}
        if len(settings) == 1:
            return ()
        return ("the frames of the session differ in exposure or gain: only with a calibration their values compare",)

    def entries(self) -> Iterator[Entry]:
        """Go through all frames."""
        for number, record in enumerate(self.records):
            yield Entry(number, self._time_s(record), "", partial(self.session.load, record))

    def _time_s(self, record: FrameRecord) -> float:
        return (record.time - self.records[0].time).total_seconds()


def open_session_video(path: Path) -> SessionVideo:
    """Open the light frames of a session.

    Raises
    ------
    SessionError
        If the session was altered.
    InputError
        If it has no light frames.
    """
    session = Session.open(path)
    records = tuple(session.frames("light"))
    if not records:
        raise InputError(f"{path} is a session without light frames: go on with the acquisition")
    return SessionVideo(path, session, records)
