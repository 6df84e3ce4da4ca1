"""The light frames of a recorded session as a video."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..errors import InputError
from ..frame import Frame
from ..session import FrameRecord, Session
from .picture_options import PictureOptions
from .told_options import contradictions, told_frame
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
    options : PictureOptions
        Of these only exposure and gain count that a person gave.
    """

    path: Path
    session: Session
    records: tuple[FrameRecord, ...]
    options: PictureOptions

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
        """Warn of exposures and gains: those a person gave instead, and different ones, which look like other light."""
        settings = {(record.exposure_s, record.gain_db) for record in self.records}
        found = [warning for setting in sorted(settings) for warning in contradictions(*setting, self.options)]
        if "bit_depth" in self.options.told:
            found.append("the bit depth that was given does not count: the session says that of its frames")
        if len(settings) > 1:
            found.append(
                "the frames of the session differ in exposure or gain: only with a calibration their values compare"
            )
        return tuple(found)

    def entries(self) -> Iterator[Entry]:
        """Go through all frames."""
        for number, record in enumerate(self.records):
            yield Entry(number, self._time_s(record), "", partial(self._load, record))

    def _load(self, record: FrameRecord) -> Frame:
        return told_frame(self.session.load(record), self.options)

    def _time_s(self, record: FrameRecord) -> float:
        return (record.time - self.records[0].time).total_seconds()


def open_session_video(path: Path, options: PictureOptions) -> SessionVideo:
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
    return SessionVideo(path, session, records, options)
