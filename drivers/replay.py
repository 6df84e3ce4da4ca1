"""Replay of a recorded session: camera and luminance meter.

A replay is strict. It returns each recorded frame and reading once, in recorded order, and nothing else. Those not
requested are listed in ``unused``; a procedure identical to the recorded one leaves none. Replay is immediate, at the
recorded speed, or at a multiple of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from math import isfinite
from os import PathLike
from typing import Self

from ..core.clock import Clock, SystemClock, exposure_text
from ..core.errors import InputError
from ..core.frame import CameraIdentity, Frame, Readout, black_levels
from ..core.reading import MeterIdentity, Reading
from ..session import EventRecord, FrameRecord, ReadingRecord, Session
from .camera import Camera, CameraError, CameraNotFoundError, CameraSettingError, Refused, StreamStatistics
from .camera_settings import CameraSettings, CameraSetup, FeatureValue
from .meter import Meter, MeterError, MeterNotFoundError

#: Relative tolerance of the exposure: cameras round exposures, so the nearest recorded one is used.
EXPOSURE_TOLERANCE_REL = 0.01
#: Tolerance of the gain in decibels: half a step of 0.1 dB.
GAIN_TOLERANCE_DB = 0.05

#: Kind of the event with a camera's GenICam features.
FEATURES_EVENT = "camera features"


class _Replay:
    """A session that is replayed at the pace of its recording, or at a multiple of it; parameters as `ReplayCamera`."""

    def __init__(
        self, session: Session | str | PathLike[str], speed: float | None = None, clock: Clock | None = None
    ) -> None:
        if speed is not None and not (isfinite(speed) and speed > 0):
            raise InputError(
                f"speed is {speed}: give a factor above 0, 1 for the pace of the recording, or None not to wait"
            )
        self._source = session
        self._speed = speed
        self._clock = clock or SystemClock()
        self._last: tuple[datetime, float] | None = None
        self._is_open = False

    def close(self) -> None:
        """Stop the replay; may be called twice."""
        self._is_open = False

    def _session(self) -> Session:
        return self._source if isinstance(self._source, Session) else Session.open(self._source)

    def _keep_pace(self, recorded: datetime) -> None:
        """Wait until the item recorded at this time is due; not if the recording's clock stepped back."""
        if self._speed is None:
            return
        if self._last is not None:
            last, given_s = self._last
            due_s = given_s + max(0.0, (recorded - last).total_seconds()) / self._speed
            self._clock.sleep(due_s - self._clock.monotonic_s())
        self._last = recorded, self._clock.monotonic_s()


class ReplayCamera(_Replay, Camera):
    """The camera of a recorded session, with the protocol of `Camera`.

    Light and dark frames come in recorded order for each setting, so a procedure that takes them in the same order gets
    the same ones. A damaged frame is a SessionError. Frames are not repeated after closing and reopening.

    Parameters
    ----------
    session : Session or path
        The session, or its folder.
    speed : float or None
        None for no delays; 1 for the recorded intervals between frames, 10 for a tenth of them. Time between two calls
        counts.
    clock : Clock
        Clock to wait with.

    Raises
    ------
    InputError
        If `speed` is not a number above 0.

    Examples
    --------
    >>> from labcdp.drivers import ReplayCamera
    >>> from labcdp.session import Session, example_session
    >>> with ReplayCamera(Session.open(example_session())) as camera:
    ...     frame = camera.snap()
    >>> frame.bit_depth
    12
    """

    live = False
    _opened_session: Session | None = None
    _recorded: tuple[FrameRecord, ...] = ()
    #: Recorded frames not requested so far; none before the first `open`.
    unused: list[FrameRecord] = []  # noqa: RUF012 - replaced when it is opened
    _chosen: CameraSettings
    _temperature_c: float | None = None

    def open(self) -> Self:
        """Read the session's journal.

        Raises
        ------
        SessionError
            If it is not a session, or its journal was altered.
        CameraNotFoundError
            If it contains no frame.
        """
        if self._opened_session is None:
            session = self._session()
            self._recorded = tuple(session.frames())
            self.unused = list(self._recorded)
            if not self._recorded:
                raise CameraNotFoundError(f"{session.path} holds no frames", "give a session with frames")
            self._opened_session, self._chosen = session, _settings(self._recorded[0])
        self._is_open = True
        return self

    @property
    def identity(self) -> CameraIdentity:
        """Camera of the first frame; raises CameraError if not open."""
        self._opened()
        return self._recorded[0].camera

    @property
    def settings(self) -> CameraSettings:
        """Settings in force: at first those of the first frame; raises CameraError if not open."""
        self._opened()
        first = next(frame for frame in self._recorded if _settings(frame) == self._chosen)
        return replace(self._chosen, black_level=black_levels(first.metadata)["black_level_register"] or 0.0)

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure recorded, in seconds; raises CameraError if not open."""
        self._opened()
        exposures_s = [frame.exposure_s for frame in self._recorded]
        return min(exposures_s), max(exposures_s)

    @property
    def temperature_c(self) -> float | None:
        """Recorded temperature of the last returned frame, in degrees Celsius; None before the first one."""
        self._opened()
        return self._temperature_c

    @property
    def statistics(self) -> StreamStatistics:
        """Number of frames returned so far; recorded frames are always complete."""
        self._opened()
        return StreamStatistics(completed=len(self._recorded) - len(self.unused))

    def features(self) -> dict[str, FeatureValue]:
        """Return the last recorded GenICam features of the camera; empty if there are none."""
        records = reversed(self._opened().records)
        events = (record for record in records if isinstance(record, EventRecord) and record.kind == FEATURES_EVENT)
        return dict(next((event.content["features"] for event in events), {}))

    def configure(
        self, *, exposure_s: float | None = None, gain_db: float | None = None, pixel_format: str | None = None
    ) -> CameraSettings:
        """Select among the recorded settings: change those given, keep the rest.

        Raises
        ------
        CameraSettingError
            If nothing was recorded with these settings; the message lists the recorded ones.
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
                f"nothing was recorded with {exposure_text(exposure_s, 6)}, {gain_db:g} dB, {pixel_format}",
                f"this session has {'; '.join(map(_text, recorded))}",
            )
        self._chosen = min(fitting, key=lambda s: (abs(s.exposure_s - exposure_s), abs(s.gain_db - gain_db)))
        return self.settings

    def prepare(self, wanted: CameraSetup) -> None:
        """Do nothing: the settings are those of the recording."""

    def grab(self, n: int, timeout_s: float | None = None, on_refused: Refused | None = None) -> Iterator[Frame]:
        """Yield the next `n` frames recorded with the current settings; never times out.

        Raises
        ------
        CameraError
            If all of them have been returned; the message states their number.
        SessionError
            If a frame's file is missing or damaged.
        """
        for _ in range(n):
            session = self._opened()
            index = next((i for i, record in enumerate(self.unused) if _settings(record) == self._chosen), None)
            if index is None:
                count = sum(_settings(frame) == self._chosen for frame in self._recorded)
                raise CameraError(
                    f"{count} frames were recorded with {_text(self._chosen)}, and all have been used",
                    f"ask for at most {count}",
                )
            frame = session.load(self.unused[index])
            self._keep_pace(frame.timestamp)
            del self.unused[index]
            self._temperature_c = frame.temperature_c
            yield frame

    def _opened(self) -> Session:
        if self._opened_session is None or not self._is_open:
            raise CameraError("the replayed camera is not open", "open it first")
        return self._opened_session


def _settings(frame: FrameRecord) -> CameraSettings:
    height, width = frame.shape
    readout = Readout.from_json(frame.metadata.get("readout") or {})
    return CameraSettings(frame.exposure_s, frame.gain_db, frame.pixel_format, width, height, readout)


def _text(settings: CameraSettings) -> str:
    return (
        f"{exposure_text(settings.exposure_s, 6)}, {settings.gain_db:g} dB, {settings.pixel_format}, "
        f"{settings.width} x {settings.height} pixels"
    )


class ReplayMeter(_Replay, Meter):
    """The luminance meter of a recorded session, with the protocol of `Meter`; parameters as of `ReplayCamera`.

    Readings are not repeated after closing and reopening.

    Examples
    --------
    >>> from labcdp.drivers import ReplayMeter
    >>> from labcdp.session import Session, example_session
    >>> with ReplayMeter(Session.open(example_session())) as meter:
    ...     reading = meter.measure()
    >>> reading.unit
    'cd/m2'
    """

    _recorded: tuple[ReadingRecord, ...] = ()
    #: Recorded readings not requested so far; none before the first `open`.
    unused: Sequence[ReadingRecord] = ()

    live = False

    def open(self) -> Self:
        """Read the session's journal.

        Raises
        ------
        SessionError
            If it is not a session, or its journal was altered.
        MeterNotFoundError
            If it contains no reading.
        """
        if not self._recorded:
            session = self._session()
            self._recorded = self.unused = tuple(session.readings())
            if not self._recorded:
                raise MeterNotFoundError(f"{session.path} holds no readings", "give a session with readings")
        self._is_open = True
        return self

    @property
    def identity(self) -> MeterIdentity:
        """The meter of the first reading; raises MeterError if not open."""
        self._require_open()
        return self._recorded[0].reading.meter

    def measure(self) -> Reading:
        """Return the next reading; never times out.

        Raises
        ------
        MeterError
            If all of them have been returned; the message states their number.
        """
        self._require_open()
        if not self.unused:
            count = len(self._recorded)
            raise MeterError(f"{count} readings were recorded, and all have been used", f"ask for at most {count}")
        reading = self.unused[0].reading
        self._keep_pace(reading.timestamp)
        self.unused = self.unused[1:]
        return reading

    def _require_open(self) -> None:
        if not self._is_open:
            raise MeterError("the replayed meter is not open", "open it first")
