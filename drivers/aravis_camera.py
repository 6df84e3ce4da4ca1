"""GigE Vision and USB3 Vision cameras through Aravis (https://github.com/AravisProject/aravis).

Needs Debian's ``gir1.2-aravis-0.8`` and ``python3-gi``; they are imported when a camera is looked for or opened.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import astuple
from math import isfinite
from typing import Any, Self

from ..errors import InputError
from ..frame import CameraIdentity, Frame
from .aravis_connection import Connection
from .aravis_features import execute_feature, read_feature, readable_features, write_feature
from .aravis_settings import configure as change_settings
from .aravis_settings import exposure_range_s, known_formats, read_settings
from .aravis_stream import Conditions, Reception
from .camera import (
    CameraError,
    CameraLostError,
    CameraSettingError,
    CameraSettings,
    FeatureValue,
    Gap,
    Refused,
    Region,
    StreamStatistics,
    Trigger,
)
from .device import Device

#: A day; longer waits overflow where Aravis counts microseconds.
_LONGEST_WAIT_S = 86_400

#: Longest wait for a frame beyond the exposure time, unless told.
_TIMEOUT_S = 2.0


class AravisCamera(Device):
    """A camera through Aravis.

    Each `grab` has a stream of its own on a network port of its own, opened after the last change of a setting:
    a frame exposed before it cannot arrive there. Opening switches off automatic exposure and gain and all
    triggers, and sets the whole sensor without binning and a gamma of 1, where the camera has these.

    A frame's pixels lie where they were received; the memory is used again once nobody holds them.

    Parameters
    ----------
    selector : str or None
        Serial number, address or model of the camera; None takes the only one there is.
    patience_s : float
        How long to wait for a camera that was lost to come back; what was under way then goes on with all settings
        restored, and `gaps` tells. 0 raises CameraLostError at once.

    Raises
    ------
    InputError
        If `patience_s` is negative or not finite.
    """

    def __init__(self, selector: str | None = None, *, patience_s: float = 0.0) -> None:
        if not (isfinite(patience_s) and patience_s >= 0):
            raise InputError(f"patience_s is {patience_s}: give 0 or more seconds")
        self._connection = Connection(selector, patience_s)
        self._reception: Reception | None = None
        self._counted = StreamStatistics()
        self._size: tuple[int, int] | None = None

    def open(self) -> Self:
        """Connect and take control; a camera that was lost is connected anew.

        Raises
        ------
        CameraNotFoundError
            If no camera, or more than one, fits the selector.
        CameraBusyError
            If another program controls it.
        """
        if not self._connection.usable:
            self.close()
            self._connection.open()
            self._counted = StreamStatistics()
            self._learn_size()
        return self

    def close(self) -> None:
        """Let go of the camera, also in the middle of a grab; may be called twice."""
        reception, self._reception = self._reception, None
        if reception is not None:
            reception.stop()
            self._count(reception)
        self._connection.close()

    @property
    def identity(self) -> CameraIdentity:
        """Vendor, model and serial number; raises CameraError if not open."""
        return self._connection.link.identity

    @property
    def settings(self) -> CameraSettings:
        """Settings in force, read from the camera."""
        return self._connection.ask("its settings cannot be read", read_settings)

    @property
    def pixel_formats(self) -> list[str]:
        """Names of the pixel formats that both the camera and this driver know."""
        return self._connection.ask("its pixel formats cannot be read", known_formats)

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure the camera takes with its present settings, in seconds."""
        return self._connection.ask("its exposure range cannot be read", exposure_range_s)

    @property
    def temperature_c(self) -> float | None:
        """Temperature of the device now, in degrees Celsius; None if it does not tell."""
        return self._connection.ask("its temperature cannot be read", _temperature_c)

    @property
    def statistics(self) -> StreamStatistics:
        """Counters of all streams since the camera was opened."""
        reception = self._reception
        return self._counted if reception is None else _sum(self._counted, reception.statistics)

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Times in which the camera was lost since it was opened, and survived."""
        return self._connection.gaps

    def configure(
        self,
        *,
        exposure_s: float | None = None,
        gain_db: float | None = None,
        pixel_format: str | None = None,
        region: Region | None = None,
        binning: tuple[int, int] | None = None,
        black_level_dn: float | None = None,
        frame_rate_hz: float | None = None,
        trigger: Trigger | None = None,
    ) -> CameraSettings:
        """Change what is given, keep the rest, and return what the camera applied.

        Parameters
        ----------
        exposure_s, gain_db, black_level_dn, frame_rate_hz : float or None
            Exposure time, analogue gain, DN added to each pixel, frames per second when free-running.
        pixel_format : str or None
            GenICam PFNC name.
        region : Region or None
            Part of the sensor to read out.
        binning : (int, int) or None
            Columns and rows to join; without `region`, the whole sensor is read out afterwards.
        trigger : Trigger or None
            What starts an exposure.

        Raises
        ------
        CameraSettingError
            If the camera lacks a setting or does not take a value; then all are as they were.
        CameraError
            If a grab is under way.
        CameraLostError
            If the camera does not answer.
        """
        given = {
            "exposure_s": exposure_s,
            "gain_db": gain_db,
            "pixel_format": pixel_format,
            "region": region,
            "binning": binning,
            "black_level_dn": black_level_dn,
            "frame_rate_hz": frame_rate_hz,
            "trigger": trigger,
        }
        wanted = {name: value for name, value in given.items() if value is not None}
        self._refuse_while_grabbing("a change of settings")
        for name in self._connection.survive(lambda link: change_settings(link, wanted)):
            self._connection.changes.setting(name, wanted[name])
        if "region" in wanted or "binning" in wanted:
            self._learn_size()
        return self.settings

    def feature(self, name: str) -> FeatureValue:
        """Read a GenICam feature.

        Raises
        ------
        CameraSettingError
            If the camera has no such feature, or it cannot be read; the message suggests names.
        """
        return self._connection.ask(f"feature {name} cannot be read", lambda camera: read_feature(camera, name))

    def set_feature(self, name: str, value: FeatureValue) -> FeatureValue:
        """Write a GenICam feature, and return what the camera made of it.

        Raises
        ------
        CameraSettingError
            If there is no such feature, or it does not take the value; the message gives its range.
        CameraError
            If a grab is under way.
        """
        self._refuse_while_grabbing("a change of settings")
        applied = self._connection.ask(
            f"feature {name} cannot be set", lambda camera: write_feature(camera, name, value)
        )
        self._connection.changes.feature(name, value)
        self._learn_size()
        return applied

    def execute(self, name: str) -> None:
        """Carry out a GenICam command, for example ``TimestampReset``; raises CameraSettingError if there is none."""
        self._connection.ask(f"command {name} cannot be carried out", lambda camera: execute_feature(camera, name))
        self._learn_size()

    def features(self) -> dict[str, FeatureValue]:
        """Read all GenICam features that can be read, by name: a snapshot to keep with what is recorded."""
        return self._connection.ask("its features cannot be read", lambda camera: dict(readable_features(camera)))

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Take one frame; see `grab`."""
        (frame,) = self.grab(1, timeout_s)
        return frame

    def grab(self, n: int, timeout_s: float | None = None, on_refused: Refused | None = None) -> Iterator[Frame]:
        """Take `n` whole frames in a row, yielding each as it arrives.

        With a software trigger, each is triggered when it is asked for.

        Parameters
        ----------
        n : int
            How many.
        timeout_s : float or None
            Longest wait for a frame beyond the exposure time; None for 2 s.
        on_refused : callable or None
            Told of each frame that came incomplete, which is then taken again, up to 20 in a row; None raises the
            error instead.

        Raises
        ------
        FrameTimeoutError
            If no frame comes, though the camera answers.
        IncompleteFrameError
            If a frame comes with data missing, of a wrong size or out of order; it is never returned.
        CameraLostError
            If the camera stops answering, within 1 s after a frame was due; with patience, if it does not come back.
        CameraError
            If another grab is under way, or the camera is closed meanwhile.
        InputError
            If `timeout_s` is negative or longer than a day.
        """
        wait_s = _TIMEOUT_S if timeout_s is None else timeout_s
        if not 0 <= wait_s < _LONGEST_WAIT_S:
            raise InputError(f"timeout_s is {timeout_s}: give 0 to {_LONGEST_WAIT_S} seconds")
        self._refuse_while_grabbing("another grab")
        n_taken = 0
        while n_taken < n:
            try:
                with self._receiving(wait_s, on_refused) as reception:
                    while n_taken < n:
                        # Not kept here while the next is waited for: its memory is wanted back.
                        yield reception.next()
                        n_taken += 1
            except CameraLostError as error:
                loss = error
            else:
                return
            try:
                self._connection.recover(loss)
            finally:
                del loss  # holds this frame, and the frames of the camera that was lost

    @contextlib.contextmanager
    def _receiving(self, timeout_s: float, on_refused: Refused | None) -> Iterator[Reception]:
        """Receive frames; settings must not change meanwhile, or frames would tell wrong ones."""
        link = self._connection.link
        with link.using("its settings cannot be read") as camera:
            settings = read_settings(camera)
            conditions = Conditions(settings, _temperature_c(camera), self._connection.changes.features)
        self._require_size(settings)
        reception = Reception(link, conditions, timeout_s, on_refused)
        self._reception = reception
        try:
            with reception:
                yield reception
        finally:
            if self._reception is reception:
                self._reception = None
                self._count(reception)

    def _learn_size(self) -> None:
        settings = self.settings
        self._size = (settings.width, settings.height)

    def _require_size(self, settings: CameraSettings) -> None:
        """Refuse frames of a size that somebody else has set."""
        if self._size != (settings.width, settings.height):
            assert self._size is not None
            raise CameraSettingError(
                f"{self.identity} is set to {settings.width} x {settings.height} pixels, not to the {self._size[0]} x "
                f"{self._size[1]} of before: something else has changed it; configure the region, or open it again"
            )

    def _count(self, reception: Reception) -> None:
        self._counted = _sum(self._counted, reception.statistics)

    def _refuse_while_grabbing(self, what: str) -> None:
        if self._reception is not None:
            raise CameraError(
                f"{self.identity} is still grabbing: finish that loop, or close its iterator, before {what}"
            )


def _temperature_c(camera: Any) -> float | None:
    name = "DeviceTemperature"
    return float(camera.get_float(name)) if camera.is_feature_available(name) else None


def _sum(one: StreamStatistics, other: StreamStatistics) -> StreamStatistics:
    return StreamStatistics(*(a + b for a, b in zip(astuple(one), astuple(other), strict=True)))
