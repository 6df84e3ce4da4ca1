"""Replay of a recorded session: luminance meter, and the speed of a replay."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from math import isfinite
from os import PathLike
from typing import Self

from ..core.clock import Clock, SystemClock
from ..core.errors import InputError
from ..core.frame import CameraIdentity, Frame, Readout, black_levels
from ..core.reading import MeterIdentity, Reading
from ..session import EventRecord, FrameRecord, ReadingRecord, Session
from .camera import Camera, CameraError, CameraNotFoundError, CameraSettingError, Refused, StreamStatistics
from .camera_settings import CameraSettings, CameraSetup, FeatureValue
from .meter import Meter, MeterError, MeterNotFoundError


class Pace:
    """Reproduces the intervals of a recording, or a fraction or multiple of them.

    Parameters
    ----------
    speed : float or None
        Speed relative to the recording; None never waits.
    clock : Clock or None
        Clock to wait with; None for the system clock.

    Raises
    ------
    InputError
        If `speed` is not a number above 0.
    """

    def __init__(self, speed: float | None, clock: Clock | None) -> None:
        if speed is not None and not (isfinite(speed) and speed > 0):
            raise InputError(
                f"speed is {speed}: give a factor above 0, 1 for the pace of the recording, or None not to wait"
            )
        self._speed = speed
        self._clock = clock or SystemClock()
        self._last: tuple[datetime, float] | None = None

    def keep(self, recorded: datetime) -> None:
        """Wait until the item recorded at this time is due; not if the recording's clock stepped back."""
        if self._speed is None:
            return
        if self._last is not None:
            last, given_s = self._last
            due_s = given_s + max(0.0, (recorded - last).total_seconds()) / self._speed
            self._clock.sleep(due_s - self._clock.monotonic_s())
        self._last = recorded, self._clock.monotonic_s()


class ReplayMeter(Meter):
    """The luminance meter of a recorded session, with the protocol of `Meter`.

    Readings are not repeated after closing and reopening.

    Parameters
    ----------
    session : Session or path
        The session, or its folder.
    speed : float or None
        None for no delays; 1 for the recorded intervals between readings, 10 for a tenth of them. Time between two
        calls counts.
    clock : Clock
        Clock to wait with.

    Raises
    ------
    InputError
        If `speed` is not a number above 0.
    """

    def __init__(
        self, session: Session | str | PathLike[str], speed: float | None = None, clock: Clock | None = None
    ) -> None:
        self._source = session
        self._pace = Pace(speed, clock)
        self._recorded: list[ReadingRecord] = []
        self._given = 0
        self._is_open = False

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
            session = self._source if isinstance(self._source, Session) else Session.open(self._source)
            self._recorded = session.readings()
            if not self._recorded:
                raise MeterNotFoundError(f"{session.path} holds no readings: give a session with readings")
        self._is_open = True
        return self

    def close(self) -> None:
        """Stop the replay; may be called twice."""
        self._is_open = False

    @property
    def identity(self) -> MeterIdentity:
        """The meter of the first reading; raises MeterError if not open."""
        self._require_open()
        return self._recorded[0].reading.meter

    @property
    def unused(self) -> tuple[ReadingRecord, ...]:
        """Recorded readings not requested so far; none before the first `open`."""
        return tuple(self._recorded[self._given :])

    def measure(self) -> Reading:
        """Return the next reading; never times out.

        Raises
        ------
        MeterError
            If all of them have been returned; the message states their number.
        """
        self._require_open()
        if self._given == len(self._recorded):
            raise MeterError(f"{self._given} readings were recorded, and all were given: ask for at most {self._given}")
        reading = self._recorded[self._given].reading
        self._pace.keep(reading.timestamp)
        self._given += 1
        return reading

    def _require_open(self) -> None:
        if not self._is_open:
            raise MeterError("the replayed meter is not open: open it first")


__all__ = ["EXPOSURE_TOLERANCE_REL", "FEATURES_EVENT", "GAIN_TOLERANCE_DB", "ReplayCamera", "ReplayMeter"]

#: Relative tolerance of the exposure: cameras round exposures, so the nearest recorded one is used.
EXPOSURE_TOLERANCE_REL = 0.01
#: Tolerance of the gain in decibels: half a step of 0.1 dB.
GAIN_TOLERANCE_DB = 0.05

#: Kind of the event with a camera's GenICam features.
FEATURES_EVENT = "camera features"


class ReplayCamera(Camera):
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
    """

    live = False

    def __init__(
        self, session: Session | str | PathLike[str], speed: float | None = None, clock: Clock | None = None
    ) -> None:
        self._source = session
        self._pace = Pace(speed, clock)
        self._session: Session | None = None
        self._recorded: list[FrameRecord] = []
        self._left: list[FrameRecord] = []
        self._settings: CameraSettings | None = None
        self._temperature_c: float | None = None
        self._is_open = False

    def open(self) -> Self:
        """Read the session's journal.

        Raises
        ------
        SessionError
            If it is not a session, or its journal was altered.
        CameraNotFoundError
            If it contains no frame.
        """
        if self._session is None:
            session = self._source if isinstance(self._source, Session) else Session.open(self._source)
            frames = session.frames()
            if not frames:
                raise CameraNotFoundError(f"{session.path} holds no frames: give a session with frames")
            self._session, self._recorded, self._left = session, frames, list(frames)
            self._settings = _settings(frames[0])
        self._is_open = True
        return self

    def close(self) -> None:
        """Stop the replay; may be called twice."""
        self._is_open = False

    @property
    def identity(self) -> CameraIdentity:
        """Camera of the first frame; raises CameraError if not open."""
        self._opened()
        return self._recorded[0].camera

    @property
    def settings(self) -> CameraSettings:
        """Settings in force: at first those of the first frame; raises CameraError if not open."""
        self._opened()
        assert self._settings is not None
        first = next(frame for frame in self._recorded if _settings(frame) == self._settings)
        return replace(self._settings, black_level=black_levels(first.metadata)["black_level_register"] or 0.0)

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
        return StreamStatistics(completed=len(self._recorded) - len(self._left))

    def features(self) -> dict[str, FeatureValue]:
        """Return the last recorded GenICam features of the camera; empty if there are none.

        Raises
        ------
        CameraError
            If not open.
        """
        events = [
            event for event in self._opened().records if isinstance(event, EventRecord) and event.kind == FEATURES_EVENT
        ]
        return dict(events[-1].content["features"]) if events else {}

    @property
    def unused(self) -> tuple[FrameRecord, ...]:
        """Recorded frames not requested so far; none before the first `open`."""
        return tuple(self._left)

    def configure(
        self,
        *,
        exposure_s: float | None = None,
        gain_db: float | None = None,
        pixel_format: str | None = None,
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
                f"nothing was recorded with {exposure_s:g} s, {gain_db:g} dB, {pixel_format}: this session has "
                f"{'; '.join(map(_text, recorded))}"
            )
        self._settings = min(fitting, key=lambda s: (abs(s.exposure_s - exposure_s), abs(s.gain_db - gain_db)))
        return self.settings

    def prepare(self, wanted: CameraSetup) -> None:
        """Do nothing: the settings are those of the recording."""

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Return the next frame recorded with the current settings; never times out.

        Raises
        ------
        CameraError
            If all of them have been returned; the message states their number.
        SessionError
            If the frame's file is missing or damaged.
        """
        session = self._opened()
        for index, record in enumerate(self._left):
            if _settings(record) == self._settings:
                frame = session.load(record)
                self._pace.keep(frame.timestamp)
                del self._left[index]
                self._temperature_c = frame.temperature_c
                return frame
        settings = self._settings
        assert settings is not None
        n = sum(_settings(frame) == settings for frame in self._recorded)
        raise CameraError(f"{n} frames were recorded with {_text(settings)}, and all were given: ask for at most {n}")

    def grab(self, n: int, timeout_s: float | None = None, on_refused: Refused | None = None) -> Iterator[Frame]:
        """Yield `n` consecutive frames, each as by `snap`; recorded frames are always complete."""
        for _ in range(n):
            yield self.snap(timeout_s)

    def _opened(self) -> Session:
        if self._session is None or not self._is_open:
            raise CameraError("the replayed camera is not open: open it first")
        return self._session


def _settings(frame: FrameRecord) -> CameraSettings:
    height, width = frame.shape
    readout = Readout.from_json(frame.metadata.get("readout") or {})
    return CameraSettings(frame.exposure_s, frame.gain_db, frame.pixel_format, width, height, readout)


def _text(settings: CameraSettings) -> str:
    return (
        f"{settings.exposure_s:g} s, {settings.gain_db:g} dB, {settings.pixel_format}, "
        f"{settings.width} x {settings.height} pixels"
    )
