"""A recorded session in place of the bench: the camera and the meter give again what they gave then.

A replay is strict. It gives each recorded frame and reading once, in the order of the recording, and never
anything that was not recorded. What was left over at the end stands in ``unused``; a procedure that runs
exactly as the recorded one did leaves nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from typing import Self

from ..frame import CameraIdentity, Frame
from ..reading import MeterIdentity, Reading
from ..session import FrameRecord, ReadingRecord, Session
from .camera import CameraError, CameraNotFoundError, CameraSettingError, CameraSettings
from .meter import MeterError, MeterNotFoundError

#: A camera rounds an exposure to what it can do; a replay takes the recorded one nearest to the one asked for,
#: at most this far from it, as a fraction.
EXPOSURE_TOLERANCE_REL = 0.01
#: The same for the gain, in decibels: half the step of cameras that set it in tenths.
GAIN_TOLERANCE_DB = 0.05


class ReplayCamera:
    """The camera of a recorded session, with the protocol of `Camera`.

    Light and dark frames come in recorded order for each setting, so a procedure that takes them in the same order
    gets the same ones. A damaged frame is a SessionError. Frames given once are not given again after closing
    and opening.

    Parameters
    ----------
    session : Session or path
        The session, or its folder.
    """

    def __init__(self, session: Session | str | PathLike[str]) -> None:
        self._source = session
        self._session: Session | None = None
        self._recorded: list[FrameRecord] = []
        self._left: list[FrameRecord] = []
        self._settings: CameraSettings | None = None
        self._is_open = False

    def open(self) -> Self:
        """Read the session's journal.

        Raises
        ------
        SessionError
            If it is no session, or its journal was altered.
        CameraNotFoundError
            If it holds no frame.
        """
        if self._session is None:
            session = _session(self._source)
            frames = session.frames()
            if not frames:
                raise CameraNotFoundError(f"{session.path} holds no frames: give a session with frames")
            self._session, self._recorded, self._left = session, frames, list(frames)
            self._settings = _settings(frames[0])
        self._is_open = True
        return self

    def close(self) -> None:
        """Give no more frames; may be called twice."""
        self._is_open = False

    def __enter__(self) -> Self:
        """Open."""
        return self.open()

    def __exit__(self, *exc: object) -> None:
        """Close."""
        self.close()

    @property
    def identity(self) -> CameraIdentity:
        """Who took the first frame; raises CameraError if not open."""
        self._opened()
        return self._recorded[0].camera

    @property
    def settings(self) -> CameraSettings:
        """Settings in force: at first those of the first frame; raises CameraError if not open."""
        self._opened()
        assert self._settings is not None
        return self._settings

    @property
    def unused(self) -> tuple[FrameRecord, ...]:
        """Recorded frames that nobody asked for so far; none before the first `open`."""
        return tuple(self._left)

    def configure(
        self,
        *,
        exposure_s: float | None = None,
        gain_db: float | None = None,
        pixel_format: str | None = None,
    ) -> CameraSettings:
        """Choose among the recorded settings: change what is given, keep the rest.

        Raises
        ------
        CameraSettingError
            If nothing was recorded with these settings; the message lists what was.
        """
        now = self.settings
        exposure_s = now.exposure_s if exposure_s is None else exposure_s
        gain_db = now.gain_db if gain_db is None else gain_db
        pixel_format = pixel_format or now.pixel_format
        recorded = dict.fromkeys(_settings(frame) for frame in self._recorded)
        fitting = [
            settings
            for settings in recorded
            if settings.pixel_format == pixel_format
            and abs(settings.gain_db - gain_db) <= GAIN_TOLERANCE_DB
            and abs(settings.exposure_s - exposure_s) <= EXPOSURE_TOLERANCE_REL * exposure_s
        ]
        if not fitting:
            raise CameraSettingError(
                f"nothing was recorded with {exposure_s:g} s, {gain_db:g} dB, {pixel_format}: this session has "
                f"{'; '.join(map(_text, recorded))}"
            )
        self._settings = min(fitting, key=lambda s: (abs(s.exposure_s - exposure_s), abs(s.gain_db - gain_db)))
        return self._settings

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Give the next frame recorded with the settings in force; it never has to wait.

        Raises
        ------
        CameraError
            If all of them were given; the message says how many there were.
        SessionError
            If the frame's file is missing or damaged.
        """
        session = self._opened()
        for index, record in enumerate(self._left):
            if _settings(record) == self._settings:
                frame = session.load(record)
                del self._left[index]
                return frame
        settings = self.settings
        n = sum(_settings(frame) == settings for frame in self._recorded)
        raise CameraError(
            f"{n} frames were recorded with {_text(settings)}, and all were given: ask for no more than {n}"
        )

    def grab(self, n: int, timeout_s: float | None = None) -> Iterator[Frame]:
        """Give `n` frames in a row, each as by `snap`."""
        for _ in range(n):
            yield self.snap(timeout_s)

    def _opened(self) -> Session:
        if self._session is None or not self._is_open:
            raise CameraError("the replayed camera is not open: open it first")
        return self._session


class ReplayMeter:
    """The luminance meter of a recorded session, with the protocol of `Meter`.

    Readings given once are not given again after closing and opening.

    Parameters
    ----------
    session : Session or path
        The session, or its folder.
    """

    def __init__(self, session: Session | str | PathLike[str]) -> None:
        self._source = session
        self._recorded: list[ReadingRecord] = []
        self._given = 0
        self._is_open = False

    def open(self) -> Self:
        """Read the session's journal.

        Raises
        ------
        SessionError
            If it is no session, or its journal was altered.
        MeterNotFoundError
            If it holds no reading.
        """
        if not self._recorded:
            session = _session(self._source)
            self._recorded = session.readings()
            if not self._recorded:
                raise MeterNotFoundError(f"{session.path} holds no readings: give a session with readings")
        self._is_open = True
        return self

    def close(self) -> None:
        """Give no more readings; may be called twice."""
        self._is_open = False

    def __enter__(self) -> Self:
        """Open."""
        return self.open()

    def __exit__(self, *exc: object) -> None:
        """Close."""
        self.close()

    @property
    def identity(self) -> MeterIdentity:
        """The meter of the first reading; raises MeterError if not open."""
        self._require_open()
        return self._recorded[0].reading.meter

    @property
    def unused(self) -> tuple[ReadingRecord, ...]:
        """Recorded readings that nobody asked for so far; none before the first `open`."""
        return tuple(self._recorded[self._given :])

    def measure(self) -> Reading:
        """Give the next reading; it never has to wait.

        Raises
        ------
        MeterError
            If all of them were given; the message says how many there were.
        """
        self._require_open()
        if self._given == len(self._recorded):
            raise MeterError(
                f"{self._given} readings were recorded, and all were given: ask for no more than {self._given}"
            )
        self._given += 1
        return self._recorded[self._given - 1].reading

    def _require_open(self) -> None:
        if not self._is_open:
            raise MeterError("the replayed meter is not open: open it first")


def _session(source: Session | str | PathLike[str]) -> Session:
    return source if isinstance(source, Session) else Session.open(source)


def _settings(frame: FrameRecord) -> CameraSettings:
    height, width = frame.shape
    return CameraSettings(frame.exposure_s, frame.gain_db, frame.pixel_format, width, height)


def _text(settings: CameraSettings) -> str:
    return (
        f"{settings.exposure_s:g} s, {settings.gain_db:g} dB, {settings.pixel_format}, "
        f"{settings.width} x {settings.height} pixels"
    )
