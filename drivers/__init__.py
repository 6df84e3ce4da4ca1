"""Drivers: cameras and luminance meters, real, replayed and simulated, behind two protocols."""

from ..core.disk.files import shown
from ..core.reading import MeterIdentity, SerialMeterModel
from .aravis.camera import AravisCamera
from .aravis.library import CameraInfo, discover
from .camera import Camera, CameraError
from .camera_settings import CameraSettings
from .meter import Meter, MeterError
from .minolta.cs100a import MinoltaCS100A
from .minolta.ls import MinoltaLS100, MinoltaLS110
from .minolta.meter import SerialMeter, find_meter_ports
from .minolta.models import DRIVERS
from .minolta.program import MinoltaCS150, MinoltaCS160, MinoltaLS150, MinoltaLS160
from .replay import ReplayCamera, ReplayMeter
from .shutter import SerialShutter, Shutter, ShutterError

__all__ = [
    "AravisCamera",
    "Camera",
    "CameraError",
    "CameraInfo",
    "CameraSettings",
    "Meter",
    "MeterError",
    "MinoltaCS100A",
    "MinoltaCS150",
    "MinoltaCS160",
    "MinoltaLS100",
    "MinoltaLS110",
    "MinoltaLS150",
    "MinoltaLS160",
    "ReplayCamera",
    "ReplayMeter",
    "SerialShutter",
    "Shutter",
    "ShutterError",
    "discover",
    "find_meter_ports",
    "open_camera",
    "open_meter",
]


def open_camera(selector: str | None = None, patience_s: float = 0.0) -> AravisCamera:
    """Open a camera; close it, or use it as a context manager.

    Parameters
    ----------
    selector : str or None
        Serial number, address or model; None for the only one.
    patience_s : float
        How long to wait for a lost camera to come back.

    Raises
    ------
    CameraError
        If it is absent or busy, or Aravis is not installed.

    Examples
    --------
    >>> from labcdp.drivers import open_camera
    >>> with open_camera("50-0503363706") as camera:  # doctest: +SKIP
    ...     camera.identity.model
    'Manta_G-505B'
    """
    return AravisCamera(selector, patience_s=patience_s).open()


def open_meter(port: str, model: SerialMeterModel = "LS-110", identity: MeterIdentity | None = None) -> SerialMeter:
    """Open a luminance meter; close it, or use it as a context manager.

    Parameters
    ----------
    port : str
        Serial port, for example ``/dev/ttyUSB0``; ``socket://HOST:PORT`` for a meter behind a program.
    model : str
        Its model, which it cannot report: a key of `labcdp.drivers.minolta.models.DRIVERS`.
    identity : MeterIdentity or None
        Serial number and calibration date, for its readings.

    Raises
    ------
    MeterError
        If the port cannot be opened or no meter answers.

    Examples
    --------
    >>> from labcdp.drivers import MeterError, open_meter
    >>> try:
    ...     meter = open_meter("no-such-port", "LS-100")
    ... except MeterError as error:
    ...     print(type(error).__name__)
    MeterNotFoundError
    """
    if not isinstance(port, str) or model not in DRIVERS:
        raise MeterError(
            f"port is {shown(port)}, model {shown(model)}", f"give a port, and one of {', '.join(DRIVERS)}"
        )
    meter = DRIVERS[model].configured(port, identity).open()
    meter.ask_if_simulated()
    return meter
