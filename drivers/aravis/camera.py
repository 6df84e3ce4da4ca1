"""GigE Vision and USB3 Vision cameras through Aravis (https://github.com/AravisProject/aravis).

Requires Debian's ``gir1.2-aravis-0.8`` and ``python3-gi``; they are imported when cameras are listed or opened.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import astuple
from functools import partial
from math import isfinite
from typing import Self, Unpack, get_args

from ...core.errors import InputError
from ...core.frame import CameraIdentity, Frame
from ..camera import Camera, CameraError, CameraLostError, CameraSettingError, Gap, Refused, StreamStatistics
from ..camera_settings import CameraSettings, CameraSetup, FeatureDescription, FeatureValue, PacketResend
from .chunks import ChunkData
from .connection import Connection, require_kept, take_snapshot
from .features import described_features, read_feature, readable_features, write_feature
from .known_state import not_understood
from .library import aravis_version
from .settings import SettingChanges, change_setting, exposure_range_s, read_settings, temperature_c, understood_gains
from .settings import configure as change_settings
from .stream import FrameStream

#: One day; longer waits overflow Aravis' microseconds.
_LONGEST_WAIT_S = 86_400


class AravisCamera(Camera):
    """A camera through Aravis.

    Each `grab` opens a new stream on a new network port after the last change of a setting, so that it receives no
    earlier frames. Opening switches off automatic exposure and gain and all triggers, and selects the whole sensor, no
    binning and a gamma of 1, where available.

    Pixels are not copied from the receive buffer, which is reused when no array refers to it.

    Parameters
    ----------
    selector : str or None
        Serial number, address or model of the camera; None for the only one.
    patience_s : float
        How long to wait for a lost camera to come back. The interrupted operation then continues with all settings
        restored, and `gaps` records the interruption. 0 raises CameraLostError immediately.
    packet_resend : {'always', 'never'}
        Whether missing packets are asked for again. Cameras and switches whose resent packets come twice, late or with
        a wrong number put stripes into frames that count as complete; with ``'never'``, frames with a gap are refused.

    Raises
    ------
    InputError
        If `patience_s` is negative or not finite, or `packet_resend` is neither.

    Examples
    --------
    >>> from labcdp.drivers import AravisCamera
    >>> camera = AravisCamera("50-0503363706", patience_s=10.0)  # connects when it is opened
    >>> camera.live
    True
    """

    live = True

    def __init__(
        self, selector: str | None = None, *, patience_s: float = 0.0, packet_resend: PacketResend = "always"
    ) -> None:
        if packet_resend not in get_args(PacketResend):
            raise InputError(f"packet_resend is {packet_resend!r}: give 'always' or 'never'")
        self._packet_resend: PacketResend = packet_resend
        if not (isfinite(patience_s) and patience_s >= 0):
            raise InputError(f"patience_s is {patience_s}: give 0 or more seconds")
        self._connection = Connection(selector, patience_s)
        self._frame_stream: FrameStream | None = None
        self._counted = StreamStatistics()
        self._chunk_data = ChunkData()
        # Of frames since the last change that may have altered it.
        self._size: tuple[int, int] | None = None

    def open(self) -> Self:
        """Connect and take control; reconnects to a lost camera.

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
            self._counted, self._chunk_data, self._size = StreamStatistics(), ChunkData(), None
        return self

    def close(self) -> None:
        """Release the camera, also during a grab; may be called twice."""
        frame_stream, self._frame_stream = self._frame_stream, None
        if frame_stream is not None:
            frame_stream.stop()
            self._count(frame_stream)
        self._connection.close()

    def be_patient(self, patience_s: float) -> None:
        """Wait this long for the camera when it is lost; call it before `open`, so that its settings are restored."""
        self._connection.patience_s = patience_s

    @property
    def identity(self) -> CameraIdentity:
        """Vendor, model and serial number; raises CameraError if not open."""
        return self._connection.link.identity

    @property
    def driver(self) -> str:
        """Aravis, with its version and where its library is."""
        return f"Aravis {aravis_version()}"

    @property
    def settings(self) -> CameraSettings:
        """Settings in force, read from the camera."""
        return self._connection.ask("its settings cannot be read", read_settings)

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure of the camera with its current settings, in seconds."""
        return self._connection.ask("its exposure range cannot be read", exposure_range_s)

    @property
    def temperature_c(self) -> float | None:
        """Current temperature of the device in degrees Celsius; None if not available."""
        return self._connection.ask("its temperature cannot be read", temperature_c)

    @property
    def statistics(self) -> StreamStatistics:
        """Counters of all streams since the camera was opened."""
        frame_stream = self._frame_stream
        return self._counted if frame_stream is None else _sum(self._counted, frame_stream.statistics)

    @property
    def chunk_data(self) -> ChunkData:
        """Values that the camera sent with the last frame: exposure, gain, timestamp and frame counter."""
        frame_stream = self._frame_stream
        return self._chunk_data if frame_stream is None else frame_stream.chunk_data

    @property
    def path_packet_bytes(self) -> int | None:
        """Largest packet that came through from the camera when it was opened; None if no test packet was sent."""
        return self._connection.link.path_packet_bytes

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Interruptions since the camera was opened, after which it was reconnected."""
        return self._connection.gaps

    def configure(self, **wanted: Unpack[SettingChanges]) -> CameraSettings:
        """Change the given settings and return those in effect.

        Parameters
        ----------
        exposure_s, gain_db, black_level, frame_rate_hz : float or None
            Exposure time, analogue gain, register of the black level, frames per second when free-running.
        pixel_format : str or None
            GenICam PFNC name.
        region : Region or None
            Part of the sensor to read out.
        binning : (int, int) or None
            Columns and rows to bin; without `region`, the whole sensor is read out afterwards.
        trigger : Trigger or None
            Trigger of an exposure.

        Raises
        ------
        CameraSettingError
            If the camera lacks a setting or rejects a value; all settings are then restored.
        CameraError
            If a grab is in progress.
        CameraLostError
            If the camera does not answer.
        """
        self._refuse_while_grabbing("a change of settings")
        given = {name: value for name, value in wanted.items() if value is not None}
        if not given.keys().isdisjoint(("region", "binning")):
            self._size = None
        for name in self._connection.retry_after_reconnect(lambda link: change_settings(link, given)):
            self._connection.note_change(name, partial(change_setting, name=name, value=given[name]))
        self._connection.remember_settings()
        return self.settings

    def prepare(self, wanted: CameraSetup) -> None:
        """Apply the settings of a measurement, and verify all of them by reading back.

        Raises
        ------
        CameraSettingError
            If the camera has no such setting, rejects a value, or keeps another one.
        """
        if wanted.settings:
            self.configure(**wanted.settings)
        for name, value in wanted.features.items():
            self.set_feature(name, value)
        if wanted.packet_resend is not None:
            self._packet_resend = wanted.packet_resend
        require_kept(self.identity, wanted, self.settings, self.feature)

    def feature(self, name: str) -> FeatureValue:
        """Read a GenICam feature.

        Raises
        ------
        CameraSettingError
            If the camera has no such feature, or it cannot be read; the message suggests names.
        """
        return self._connection.ask(f"feature {name} cannot be read", lambda camera: read_feature(camera, name))

    def set_feature(self, name: str, value: FeatureValue) -> FeatureValue:
        """Write a GenICam feature and return the value in effect.

        Raises
        ------
        CameraSettingError
            If there is no such feature, or it rejects the value; the message states its range.
        CameraError
            If a grab is in progress.
        """
        self._refuse_while_grabbing("a change of settings")
        self._size = None
        write = partial(write_feature, name=name, value=value)
        applied = self._connection.ask(f"feature {name} cannot be set", write)
        self._connection.note_change(name, write)
        self._connection.remember_settings()
        return applied

    def features(self) -> dict[str, FeatureValue]:
        """Read all readable GenICam features by name, as a snapshot for a recording."""
        return self._connection.ask("its features cannot be read", lambda camera: dict(readable_features(camera)))

    def describe_features(self) -> tuple[FeatureDescription, ...]:
        """Read all readable GenICam features with range and unit, in the camera's order."""
        return self._connection.ask("its features cannot be read", lambda camera: tuple(described_features(camera)))

    @property
    def not_understood(self) -> tuple[str, ...]:
        """Names of writable features of which labcdp does not know what they do to a picture."""
        gains = self._connection.ask("its gain cannot be read", understood_gains)
        return not_understood(self._connection.retry_after_reconnect(take_snapshot), gains)

    def grab(self, n: int, timeout_s: float | None = None, on_refused: Refused | None = None) -> Iterator[Frame]:
        """Take `n` complete consecutive frames, yielding each as it arrives.

        With a software trigger, each frame is triggered when requested.

        Parameters
        ----------
        n : int
            Number of frames.
        timeout_s : float or None
            Longest wait for a frame beyond the exposure time; None for the frame period plus 10 s, longer on a busy
            computer. A camera that stops answering is always noticed within 3 s.
        on_refused : callable or None
            Called for each incomplete frame, which is then repeated, up to 20 consecutive times; None raises the error
            instead.

        Raises
        ------
        FrameTimeoutError
            If no frame arrives although the camera answers.
        IncompleteFrameError
            If a frame arrives incomplete, with a wrong size or out of order, or if its chunk data say that it was not
            taken as set; it is never returned.
        CameraLostError
            If the camera stops answering, within 3 s after a frame was due; with `patience_s`, if it does not come
            back.
        CameraSettingError
            If something else has changed the size of the frames.
        CameraError
            If another grab is in progress, or the camera is closed in the meantime.
        InputError
            If `timeout_s` is negative or longer than a day.
        """
        if timeout_s is not None and not 0 <= timeout_s < _LONGEST_WAIT_S:
            raise InputError(f"timeout_s is {timeout_s}: give 0 to {_LONGEST_WAIT_S} seconds")
        self._refuse_while_grabbing("another grab")
        n_taken = 0
        while n_taken < n:
            try:
                with self._receiving(n - n_taken, timeout_s, on_refused) as frame_stream:
                    while n_taken < n:
                        # Drop the reference while waiting for the next frame, so that its buffer can be reused.
                        yield frame_stream.next()
                        n_taken += 1
            except CameraLostError as error:
                loss = error
            else:
                return
            try:
                self._connection.recover(loss)
            finally:
                del loss  # the traceback refers to this frame and those of the lost camera

    @contextlib.contextmanager
    def _receiving(self, n: int, timeout_s: float | None, on_refused: Refused | None) -> Iterator[FrameStream]:
        """Receive frames; settings are locked meanwhile, so that frames state the correct ones."""
        link = self._connection.link
        with link.using("its settings cannot be read") as camera:
            settings = read_settings(camera)
        size = (settings.width, settings.height)
        if self._size not in (None, size):
            raise CameraSettingError(
                f"{self.identity} is set to {size[0]} x {size[1]} pixels, not as before",
                "something else has changed it; configure the region, or open it again",
            )
        self._size = size
        changed, resend = self._connection.changed, self._packet_resend
        frame_stream = FrameStream(link, settings, changed, n, timeout_s, on_refused, resend)
        self._frame_stream = frame_stream
        try:
            with frame_stream:
                yield frame_stream
        finally:
            if self._frame_stream is frame_stream:
                self._frame_stream = None
                self._count(frame_stream)

    def _count(self, frame_stream: FrameStream) -> None:
        self._counted = _sum(self._counted, frame_stream.statistics)
        self._chunk_data = frame_stream.chunk_data

    def _refuse_while_grabbing(self, what: str) -> None:
        if self._frame_stream is not None:
            raise CameraError(
                f"{self.identity} is still grabbing", f"finish that loop, or close its iterator, before {what}"
            )


def _sum(earlier: StreamStatistics, other: StreamStatistics) -> StreamStatistics:
    return StreamStatistics(*(a + b for a, b in zip(astuple(earlier), astuple(other), strict=True)))
