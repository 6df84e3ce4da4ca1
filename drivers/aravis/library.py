"""Loading Aravis, finding cameras, and translating its errors."""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from ...core.errors import printable
from ..camera import CameraError, CameraNotFoundError


@dataclass(frozen=True)
class CameraInfo:
    """A camera found on the network or bus.

    Parameters
    ----------
    vendor, model, serial, address, protocol : str
        As the camera announced them.
    device_id : str
        Name by which Aravis opens it; of a USB3 Vision camera it is not the serial number.
    mac : bytes
        Hardware address, where it was asked for.

    Examples
    --------
    >>> from labcdp.drivers import CameraInfo
    >>> CameraInfo("Allied Vision", "Manta G-505B", "50-0503363706", "169.254.12.7", "GigEVision").serial
    '50-0503363706'
    """

    vendor: str
    model: str
    serial: str
    address: str
    protocol: str
    device_id: str = ""
    mac: bytes = field(default=b"", compare=False, repr=False)


@cache
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
            f"Aravis cannot be loaded ({error})",
            "run 'apt install gir1.2-aravis-0.8 python3-gi' and use a virtual "
            "environment made by /usr/bin/python3 with --system-site-packages",
        ) from error
    try:
        # A library lacks what a later typelib lists.
        for name in _ENUMERATIONS:
            getattr(Aravis, name)
    except ValueError as error:
        raise CameraError(
            f"the GObject typelib of Aravis is of another version than its library, {aravis_version()} ({error})",
            "let GI_TYPELIB_PATH and LD_LIBRARY_PATH name folders of one installation, or neither",
        ) from error
    module: ModuleType = Aravis
    return module


#: Enumerations that labcdp uses.
_ENUMERATIONS = ("BufferStatus", "BufferPayloadType", "AcquisitionMode", "DeviceError", "GvStreamPacketResend")
#: Name by which Aravis' library is loaded, of any version with this interface.
_LIBRARY = "libaravis-0.8.so.0"


@cache
def aravis_c() -> ctypes.CDLL:
    """Return the library that the GObject typelib of Aravis has loaded."""
    return ctypes.CDLL(_LIBRARY)


def aravis_version() -> str:
    """Return version and path of Aravis' library, Debian's or any other with its GObject typelib.

    Examples
    --------
    >>> from labcdp.drivers.aravis.library import aravis_version
    >>> aravis_version()  # doctest: +SKIP
    '0.8.26 (/usr/lib/x86_64-linux-gnu/libaravis-0.8.so.0.8.26)'
    """
    library = aravis_c()
    version = ".".join(str(getattr(library, f"arv_get_{part}_version")()) for part in ("major", "minor", "micro"))
    loaded = [line.split(maxsplit=5)[-1].strip() for line in Path("/proc/self/maps").read_text().splitlines()]
    path = next((name for name in loaded if "libaravis-0.8" in name), "")
    return f"{version} ({path})" if path else version


def gerror() -> Any:
    """Return the exception that Aravis' functions raise."""
    from gi.repository import GLib

    return GLib.Error


#: Aravis' errors of the transport, as opposed to those of the request.
_OF_TRANSPORT = ("NOT_CONNECTED", "TRANSFER_ERROR", "TIMEOUT", "NOT_CONTROLLER")


def is_of_transport(error: Any, *more: str) -> bool:
    """Whether an error of Aravis is one of the transport, or of `more` kinds of `Aravis.DeviceError`."""
    codes = {int(getattr(aravis().DeviceError, name)) for name in (*_OF_TRANSPORT, *more)}
    return bool(error.domain == "arv-device-error-quark" and error.code in codes)


def discover() -> list[CameraInfo]:
    """List the cameras that answer within Aravis' discovery time, about a second.

    Raises
    ------
    CameraError
        If Aravis is not installed.

    Examples
    --------
    >>> from labcdp.drivers import discover
    >>> [camera.serial for camera in discover()]  # doctest: +SKIP
    ['50-0503363706']
    """
    arv = aravis()
    arv.update_device_list()
    return [
        CameraInfo(
            vendor=device_text(arv.get_device_vendor, i),
            model=device_text(arv.get_device_model, i),
            serial=device_text(arv.get_device_serial_nbr, i),
            address=device_text(arv.get_device_address, i),
            protocol=device_text(arv.get_device_protocol, i),
            device_id=device_text(arv.get_device_id, i),
        )
        for i in range(arv.get_n_devices())
    ]


def device_text(get: Callable[..., str | None], *arguments: Any) -> str:
    """Return a text of a device in printable letters: devices send any bytes, escape sequences among them."""
    try:
        text = get(*arguments) or ""
    except UnicodeDecodeError as error:
        text = error.object.decode("utf-8", "replace")
    return printable(text)


def choose(cameras: list[CameraInfo], selector: str | None) -> CameraInfo:
    """Return the camera with a serial number, address or model, or the only one.

    Raises
    ------
    CameraNotFoundError
        If none fits, or more than one.
    """
    listing = "; ".join(f"{i.vendor} {i.model}, serial {i.serial}, at {i.address}" for i in cameras) or "none"
    fitting = [i for i in cameras if selector is None or selector in (i.serial, i.address, i.model)]
    wanted = "camera" if selector is None else f"camera {selector!r} (serial number, address or model)"
    if not fitting:
        raise CameraNotFoundError(
            f"no {wanted} answers; found: {listing}", "check power, cable and that both are in one network"
        )
    if len(fitting) > 1:
        raise CameraNotFoundError(f"more than one {wanted} answers", f"give a serial number; found: {listing}")
    return fitting[0]


@cache
def _c_function(name: str) -> Any:
    """Return a function of a pointer that gives a pointer and a number of bytes."""
    function = getattr(aravis_c(), name)
    function.restype, function.argtypes = ctypes.c_void_p, [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]
    return function


def received_bytes(buffer: Any) -> int:
    """Return how many bytes of a frame came, by the C function: that of PyGObject copies them."""
    n_bytes = ctypes.c_size_t()
    _c_function("arv_buffer_get_data")(hash(buffer), ctypes.byref(n_bytes))
    return n_bytes.value


def genicam_xml(camera: Any) -> bytes:
    """Return the GenICam description of a camera, by the C function: that of PyGObject reads beyond its end."""
    n_bytes = ctypes.c_size_t()
    text = _c_function("arv_device_get_genicam_xml")(hash(camera.get_device()), ctypes.byref(n_bytes))
    return ctypes.string_at(text, n_bytes.value) if text else b""


@contextlib.contextmanager
def camera_errors(message: str, kind: type[CameraError]) -> Iterator[None]:
    """Convert Aravis' errors to those of labcdp, keeping the reason."""
    try:
        yield
    except gerror() as error:
        raise kind(f"{message} [{error.message}]") from error
