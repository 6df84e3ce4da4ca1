"""GigE Vision and USB3 Vision cameras through Aravis (https://github.com/AravisProject/aravis).

Needs Debian's ``gir1.2-aravis-0.8`` and ``python3-gi``; they are imported when a camera is looked for or opened.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..frame import CameraIdentity, Frame
from .aravis_library import CameraInfo, aravis, camera_errors, choose, discover, losing
from .aravis_stream import Reception
from .camera import (
    CameraBusyError,
    CameraError,
    CameraLostError,
    CameraNotFoundError,
    CameraSettingError,
    CameraSettings,
)
from .pixel_format import PIXEL_FORMATS, pixel_format

_log = logging.getLogger(__name__)

#: A day; longer waits overflow where Aravis counts microseconds.
_LONGEST_WAIT_S = 86_400


class AravisCamera:
    """A camera through Aravis.

    Each `grab` has a stream of its own on a network port of its own, opened after the last change of a setting:
    a frame exposed before it cannot arrive there. Opening switches off automatic exposure and gain, and sets the
    whole sensor without binning and a gamma of 1, where the camera has these.

    Parameters
    ----------
    selector : str or None
        Serial number, address or model of the camera; None takes the only one there is.
    """

    def __init__(self, selector: str | None = None) -> None:
        self._selector = selector
        self._arv: Any = None
        self._camera: Any = None
        self._identity: CameraIdentity | None = None
        self._reception: Reception | None = None

    def open(self) -> Self:
        """Connect and take control.

        Raises
        ------
        CameraNotFoundError
            If no camera, or more than one, fits the selector.
        CameraBusyError
            If another program controls it.
        """
        if self._camera is not None:
            return self
        self._arv = aravis()
        info = choose(discover(), self._selector)
        with camera_errors(f"camera {info.serial} at {info.address} cannot be opened", CameraNotFoundError):
            camera = self._arv.Camera.new(info.address if info.protocol == "GigEVision" else info.serial)
        with camera_errors(f"camera {info.serial} at {info.address} does not tell who it is", CameraLostError):
            self._check_control(camera, info)
            serial = camera.get_device_serial_number()
            if serial != info.serial:
                raise CameraNotFoundError(
                    f"the camera at {info.address} has serial number {serial}, not {info.serial}: two cameras "
                    "share the address; give each its own"
                )
            self._identity = CameraIdentity(info.vendor, info.model, info.serial, simulated=_says_simulated(camera))
            if camera.is_gv_device():
                camera.gv_auto_packet_size()
            _bring_to_known_state(camera)
        self._camera = camera
        _log.info("opened %s at %s", self._identity, info.address)
        return self

    @staticmethod
    def _check_control(camera: Any, info: CameraInfo) -> None:
        if camera.is_gv_device() and not camera.get_device().is_controller():
            raise CameraBusyError(
                f"camera {info.serial} at {info.address} is controlled by another program: close that program, "
                "or wait a few seconds if it was killed"
            )

    def close(self) -> None:
        """Let go of the camera, also in the middle of a grab; may be called twice."""
        if self._reception is not None:
            self._reception.stop()
            self._reception = None
        self._camera = None
        self._identity = None

    def __enter__(self) -> Self:
        """Open."""
        return self.open()

    def __exit__(self, *exc: object) -> None:
        """Close."""
        self.close()

    @property
    def identity(self) -> CameraIdentity:
        """Vendor, model and serial number; raises CameraError if not open."""
        if self._identity is None:
            raise CameraError("the camera is not open: use it as a context manager or call open() first")
        return self._identity

    @property
    def settings(self) -> CameraSettings:
        """Settings in force, read from the camera."""
        camera = self._opened()
        with self._losing("its settings cannot be read"):
            _, _, width, height = camera.get_region()
            return CameraSettings(
                exposure_s=camera.get_exposure_time() * 1e-6,
                gain_db=camera.get_gain() if camera.is_gain_available() else 0.0,
                pixel_format=camera.get_pixel_format_as_string(),
                width=width,
                height=height,
            )

    @property
    def pixel_formats(self) -> list[str]:
        """Names of the pixel formats that both the camera and this driver know."""
        with self._losing("its pixel formats cannot be read"):
            names = self._opened().dup_available_pixel_formats_as_strings()
        return [name for name in names if name in PIXEL_FORMATS]

    def configure(
        self,
        *,
        exposure_s: float | None = None,
        gain_db: float | None = None,
        pixel_format: str | None = None,
    ) -> CameraSettings:
        """Change what is given, keep the rest, and return what the camera applied.

        Raises
        ------
        CameraSettingError
            If a value is out of the camera's range, or it lacks the pixel format.
        CameraError
            If a grab is under way.
        CameraLostError
            If the camera does not answer.
        """
        camera = self._opened()
        self._refuse_while_grabbing("a change of settings")
        if pixel_format is not None and pixel_format not in self.pixel_formats:
            raise CameraSettingError(
                f"{self.identity} has no pixel format {pixel_format!r}: choose one of {', '.join(self.pixel_formats)}"
            )
        with self._losing("a setting cannot be changed"):
            if pixel_format is not None:
                camera.set_pixel_format_from_string(pixel_format)
            if exposure_s is not None:
                low_us, high_us = camera.get_exposure_time_bounds()
                _check_range("exposure_s", exposure_s, low_us * 1e-6, high_us * 1e-6, "s")
                # Rounded: a camera that keeps whole microseconds would cut 1000.9999999 to 1000.
                camera.set_exposure_time(round(exposure_s * 1e6, 3))
            if gain_db is not None:
                self._set_gain(camera, gain_db)
        return self.settings

    def _set_gain(self, camera: Any, gain_db: float) -> None:
        if not camera.is_gain_available():
            if gain_db != 0:
                raise CameraSettingError(f"{self.identity} has no gain: ask for 0 dB, not {gain_db:g} dB")
            return
        low_db, high_db = camera.get_gain_bounds()
        _check_range("gain_db", gain_db, low_db, high_db, "dB")
        camera.set_gain(gain_db)

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Take one frame; see `grab`."""
        (frame,) = self.grab(1, timeout_s)
        return frame

    def grab(self, n: int, timeout_s: float | None = None) -> Iterator[Frame]:
        """Take `n` frames in a row, yielding each as it arrives.

        Parameters
        ----------
        n : int
            How many.
        timeout_s : float or None
            Longest wait for a frame beyond the exposure time; None for 2 s.

        Raises
        ------
        FrameTimeoutError
            If no frame comes, though the camera answers.
        IncompleteFrameError
            If a frame comes with data missing; it is never returned.
        CameraLostError
            If the camera stops answering.
        CameraError
            If another grab is under way, or the camera is closed meanwhile.
        InputError
            If `timeout_s` is negative or longer than a day.
        """
        if timeout_s is not None and not 0 <= timeout_s < _LONGEST_WAIT_S:
            raise InputError(f"timeout_s is {timeout_s}: give 0 to {_LONGEST_WAIT_S} seconds")
        settings = self.settings
        identity = self.identity
        layout = pixel_format(settings.pixel_format)
        black_level_dn = self._float_feature("BlackLevel") or 0.0
        temperature_c = self._float_feature("DeviceTemperature")
        wait_s = (2.0 if timeout_s is None else timeout_s) + settings.exposure_s
        with self._receiving() as reception:
            for _ in range(n):
                buffer, payload = reception.next(wait_s)
                yield Frame(
                    dn=_frozen(layout.unpack(payload, (settings.height, settings.width)), payload),
                    exposure_s=settings.exposure_s,
                    gain_db=settings.gain_db,
                    bit_depth=layout.bit_depth,
                    saturation_dn=2**layout.bit_depth - 1,
                    black_level_dn=black_level_dn,
                    pixel_format=layout.name,
                    colour_filter=layout.colour_filter,
                    temperature_c=temperature_c,
                    timestamp=datetime.fromtimestamp(buffer.get_system_timestamp() * 1e-9, UTC),
                    camera_timestamp_ns=buffer.get_timestamp(),
                    frame_id=buffer.get_frame_id(),
                    camera=identity,
                )

    def _float_feature(self, name: str) -> float | None:
        camera = self._opened()
        with self._losing(f"its {name} cannot be read"):
            return float(camera.get_float(name)) if camera.is_feature_available(name) else None

    def _opened(self) -> Any:
        if self._camera is None:
            raise CameraError("the camera is not open: use it as a context manager or call open() first")
        return self._camera

    def _losing(self, what: str) -> contextlib.AbstractContextManager[None]:
        return losing(self.identity, what)

    @contextlib.contextmanager
    def _receiving(self) -> Iterator[Reception]:
        """Receive frames; settings must not change meanwhile, or frames would tell wrong ones."""
        self._refuse_while_grabbing("another grab")
        self._reception = Reception(self._opened(), self.identity)
        try:
            with self._reception as reception:
                yield reception
        finally:
            self._reception = None

    def _refuse_while_grabbing(self, what: str) -> None:
        if self._reception is not None:
            raise CameraError(
                f"{self.identity} is still grabbing: finish that loop, or close its iterator, before {what}"
            )


def _says_simulated(camera: Any) -> bool:
    name = "DeviceManufacturerInfo"
    text = camera.get_string(name) if camera.is_feature_available(name) else ""
    return "simulated" in (text or "").lower() or camera.get_vendor_name() == "Aravis"


def _bring_to_known_state(camera: Any) -> None:
    """Undo what another program may have left: automatics, gamma, binning, and an image region off the axis."""
    for name in ("ExposureAuto", "GainAuto"):
        if camera.is_feature_available(name):
            camera.set_string(name, "Off")
    if camera.is_feature_available("Gamma"):
        camera.set_float("Gamma", 1.0)
    if camera.is_binning_available():
        camera.set_binning(1, 1)
    camera.set_region(0, 0, *camera.get_sensor_size())


def _check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise CameraSettingError(f"{name} is {value:g} {unit}: the camera takes {low:g} to {high:g} {unit}")


def _frozen(dn: NDArray[Any], payload: NDArray[np.uint8]) -> NDArray[Any]:
    """Make the pixels read-only in place: the memory is this frame's alone."""
    payload.flags.writeable = False
    dn.flags.writeable = False
    return dn
