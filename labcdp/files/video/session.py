"""The light frames of a recorded session as a video."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ...core.errors import InputError
from ...core.finding import Finding, info, warning
from ...core.frame import Frame
from ...session import FrameRecord, Session
from ..formats.colour import Encoding
from ..picture.picture import PictureOptions, contradictions, overridden_frame
from .source import Entry


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
        Of these only exposure and gain count that the user gave.
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
    def encoding(self) -> Encoding:
        """As given; frames are recorded in proportion to light."""
        return self.options.encoding or "linear"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Where the times come from; exposures and gains that were given instead, or differ, which looks like light."""
        settings = {(record.exposure_s, record.gain_db) for record in self.records}
        found = [info("session-frames")]
        found += [finding for setting in sorted(settings) for finding in contradictions(*setting, self.options)]
        if "bit_depth" in self.options.overrides:
            found.append(warning("session-bit-depth"))
        if len(settings) > 1:
            found.append(warning("session-settings-differ"))
        return tuple(found)

    def entries(self) -> Iterator[Entry]:
        """Go through all frames."""
        for number, record in enumerate(self.records):
            yield Entry(number, self._time_s(record), None, partial(self._load, record))

    def _load(self, record: FrameRecord) -> Frame:
        return overridden_frame(self.session.load(record), self.options)

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
        raise InputError(f"{path} is a session without light frames: resume the acquisition")
    return SessionVideo(path, session, records, options)
