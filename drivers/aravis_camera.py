"""GigE Vision and USB3 Vision cameras through Aravis (https://github.com/AravisProject/aravis).

Needs Debian's ``gir1.2-aravis-0.8`` and ``python3-gi``; they are imported when a camera is looked for or opened.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from types import ModuleType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..frame import CameraIdentity, Frame
from .camera import (
    CameraBusyError,
    CameraError,
    CameraLostError,
    CameraNotFoundError,
    CameraSettingError,
    CameraSettings,
    FrameTimeoutError,
    IncompleteFrameError,
)
from .pixel_format import PIXEL_FORMATS, PixelFormat, pixel_format
from .sockets import own_udp_sockets

_log = logging.getLogger(__name__)

#: Frames in flight: at 15 frames/s this bridges 0.4 s in which the caller does something else.
_N_BUFFERS = 6

#: What each way to fail means, by the name of the Aravis buffer status.
_INCOMPLETE = {
    "TIMEOUT": "packets stopped coming in the middle of it",
    "MISSING_PACKETS": "packets were lost on the way",
    "WRONG_PACKET_ID": "its packets were numbered wrongly",
    "SIZE_MISMATCH": "its size is not the one announced",
    "FILLING": "it was still being received",
    "ABORTED": "its reception was broken off",
    "CLEARED": "nothing of it was received",
}


@dataclass(frozen=True)
class CameraInfo:
    """A camera found on the network or bus.

    Parameters
    ----------
    vendor, model, serial, address, protocol : str
        As the camera announced them.
    """

    vendor: str
    model: str
    serial: str
    address: str
    protocol: str


def aravis() -> ModuleType:
    """Import Aravis.

    Raises
    ------
    CameraError
        If it, or PyGObject, is not installed; the message says how to install it.
    """
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
    except (ImportError, ValueError) as error:
        raise CameraError(
            f"Aravis cannot be loaded ({error}): run 'apt install gir1.2-aravis-0.8 python3-gi' and use a virtual "
            "environment made by /usr/bin/python3 with --system-site-packages"
        ) from error
    module: ModuleType = Aravis
    return module


def discover() -> list[CameraInfo]:
    """List the cameras that answer within Aravis' discovery time, about a second.

    Raises
    ------
    CameraError
        If Aravis is not installed.
    """
    arv = aravis()
    arv.update_device_list()
    return [
        CameraInfo(
            vendor=arv.get_device_vendor(i) or "",
            model=arv.get_device_model(i) or "",
            serial=arv.get_device_serial_nbr(i) or "",
            address=arv.get_device_address(i) or "",
            protocol=arv.get_device_protocol(i) or "",
        )
        for i in range(arv.get_n_devices())
    ]


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
        info = _choose(discover(), self._selector)
        with _camera_errors(f"camera {info.serial} at {info.address} cannot be opened", CameraNotFoundError):
            camera = self._arv.Camera.new(info.address if info.protocol == "GigEVision" else info.serial)
        with _camera_errors(f"camera {info.serial} at {info.address} does not tell who it is", CameraLostError):
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
        """Let go of the camera; may be called twice."""
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
        CameraLostError
            If the camera does not answer.
        """
        camera = self._opened()
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
        """
        settings = self.settings
        layout = pixel_format(settings.pixel_format)
        black_level_dn = self._float_feature("BlackLevel") or 0.0
        wait_s = (2.0 if timeout_s is None else timeout_s) + settings.exposure_s
        with _Reception(self, layout) as reception:
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
                    temperature_c=reception.temperature_c,
                    timestamp=datetime.fromtimestamp(buffer.get_system_timestamp() * 1e-9, UTC),
                    camera_timestamp_ns=buffer.get_timestamp(),
                    frame_id=buffer.get_frame_id(),
                    camera=self.identity,
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
        return _camera_errors(
            f"{self.identity} stopped answering ({what}): check power and cable, then open it again",
            CameraLostError,
        )


class _Reception:
    """One stream and its buffers, from the start of acquisition to its stop."""

    def __init__(self, owner: AravisCamera, layout: PixelFormat) -> None:
        self._owner = owner
        self._layout = layout
        self._arrays: dict[int, NDArray[np.uint8]] = {}
        self._stream: Any = None
        self.temperature_c: float | None = None

    def __enter__(self) -> Self:
        camera = self._owner._opened()
        with self._owner._losing("no stream can be opened"):
            self._stream = camera.create_stream(None, None)
            if camera.is_gv_device():
                # The default socket buffer holds a fraction of a frame and loses the rest.
                self._stream.set_property("socket-buffer", self._owner._arv.GvStreamSocketBuffer.AUTO)
                _enlarge_receive_buffer(self._stream.get_port(), camera.get_payload())
            self._payload_bytes = camera.get_payload()
            for _ in range(_N_BUFFERS):
                self._push()
            self.temperature_c = self._owner._float_feature("DeviceTemperature")
            camera.set_acquisition_mode(self._owner._arv.AcquisitionMode.CONTINUOUS)
            self._started_ns = time.time_ns()
            camera.start_acquisition()
        return self

    def __exit__(self, kind: type[BaseException] | None, *exc: object) -> None:
        # Leaving in mid-acquisition can abort the process; a camera that is lost cannot be told to stop.
        if kind is not CameraLostError:
            with contextlib.suppress(CameraLostError), self._owner._losing("acquisition cannot be stopped"):
                self._owner._opened().stop_acquisition()
        self._stream = None
        self._arrays = {}

    def _push(self) -> None:
        array = np.empty(self._payload_bytes, dtype=np.uint8)
        buffer = self._owner._arv.Buffer.new(array.nbytes, array.ctypes.data)
        self._arrays[hash(buffer)] = array
        self._stream.push_buffer(buffer)

    def next(self, wait_s: float) -> tuple[Any, NDArray[np.uint8]]:
        """Wait for the next whole frame; returns the Aravis buffer and its bytes."""
        while True:
            buffer = self._stream.timeout_pop_buffer(int(wait_s * 1e6))
            if buffer is None:
                self._explain_silence(wait_s)
            payload = self._arrays.pop(hash(buffer))
            self._push()
            status = buffer.get_status()
            if status != self._owner._arv.BufferStatus.SUCCESS:
                self._refuse(buffer, status)
            if buffer.get_system_timestamp() >= self._started_ns:
                return buffer, payload
            _log.warning("frame %d arrived before acquisition began: left out", buffer.get_frame_id())

    def _explain_silence(self, wait_s: float) -> None:
        owner = self._owner
        with owner._losing("no frame came"):
            owner._opened().get_exposure_time()
        raise FrameTimeoutError(
            f"no frame came from {owner.identity} within {wait_s:.1f} s, though it answers: check trigger mode, "
            f"packet size and firewall ({self.statistics()})"
        )

    def _refuse(self, buffer: Any, status: Any) -> None:
        name = status.value_nick.upper().replace("-", "_")
        raise IncompleteFrameError(
            f"frame {buffer.get_frame_id()} from {self._owner.identity} is incomplete, "
            f"{_INCOMPLETE.get(name, name)}: it is refused; lower the frame rate or packet size, or raise "
            f"net.core.rmem_max ({self.statistics()})"
        )

    def statistics(self) -> str:
        """Counters that say what went wrong, as a short text."""
        stream = self._stream
        counters = {stream.get_info_name(i): stream.get_info_uint64(i) for i in range(stream.get_n_infos())}
        names = ("n_completed_buffers", "n_failures", "n_missing_packets", "n_underruns")
        return ", ".join(f"{name[2:].replace('_', ' ')} {counters[name]}" for name in names if name in counters)


def _choose(found: list[CameraInfo], selector: str | None) -> CameraInfo:
    listing = "; ".join(f"{i.vendor} {i.model}, serial {i.serial}, at {i.address}" for i in found) or "none"
    fitting = [i for i in found if selector is None or selector in (i.serial, i.address, i.model)]
    wanted = "camera" if selector is None else f"camera {selector!r} (serial number, address or model)"
    if not fitting:
        raise CameraNotFoundError(
            f"no {wanted} answers; found: {listing}: check power, cable and that both are in one network"
        )
    if len(fitting) > 1:
        raise CameraNotFoundError(f"more than one {wanted} answers: give a serial number; found: {listing}")
    return fitting[0]


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


def _enlarge_receive_buffer(port: int, payload_bytes: int) -> None:
    """Set the buffer of a stream's socket now: Aravis does so at the first packet, too late for the first frame."""
    for receiver, (_, bound) in own_udp_sockets():
        if bound == port:
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, payload_bytes)


def _check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise CameraSettingError(f"{name} is {value:g} {unit}: the camera takes {low:g} to {high:g} {unit}")


def _frozen(dn: NDArray[Any], payload: NDArray[np.uint8]) -> NDArray[Any]:
    """Make the pixels read-only in place: the memory is this frame's alone."""
    payload.flags.writeable = False
    dn.flags.writeable = False
    return dn


@contextlib.contextmanager
def _camera_errors(message: str, kind: type[CameraError]) -> Iterator[None]:
    """Turn Aravis' errors into one of ours, keeping its reason."""
    from gi.repository import GLib

    try:
        yield
    except GLib.Error as error:
        raise kind(f"{message} [{error.message}]") from error
