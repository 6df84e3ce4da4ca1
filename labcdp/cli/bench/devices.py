"""Commands devices, snap and meter: connected devices, one frame of a camera, readings of a luminance meter."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np

from ...core.errors import InputError
from ...core.frame import Frame
from ...core.reading import Reading, ReadingSeries
from ...core.result import Finding, NamedValue, Result, info, quantity_table, warning
from ...core.table import Column, Table, uncertain
from ...drivers.aravis.camera import AravisCamera
from ...drivers.aravis.gvcp import set_address as change_address
from ...drivers.aravis.library import discover
from ...drivers.camera import CameraError, take_again
from ...drivers.camera_settings import json_features
from ...drivers.meter import measure_series
from ...drivers.minolta.ls import MinoltaLS
from ...drivers.minolta.meter import find_meter_ports
from ...drivers.minolta.models import DRIVERS
from ...drivers.minolta.protocol import MeterMode
from ...output import write_file
from ...session.frames import frame_to_tiff
from ..commands import As
from ..options import Force, MeterModel, MeterPort, Seconds, output_file
from ..terminal import print_result, say
from .options import DeviceOptions


def devices(*, set_address: str | None = None) -> None:
    """List cameras and serial ports.

    Parameters
    ----------
    set_address : SERIAL=ADDRESS
        First assign this camera an address in one of this computer's networks, until it is switched off.
    """
    if set_address is not None:
        serial, separator, address = set_address.partition("=")
        if not (serial and separator):
            raise InputError(f"--set-address is {set_address!r}: give SERIAL=ADDRESS, for example 50-1=192.168.7.20")
        say(f"Camera {serial} now has {change_address(serial, address)}, until it is switched off")
    findings: list[Finding] = []
    try:
        cameras = discover()
        if not cameras:
            findings.append(info("no-camera"))
    except CameraError as error:
        cameras = []
        findings.append(warning("cameras-unknown", reason=str(error)))
    ports = find_meter_ports()
    if not ports:
        findings.append(info("no-serial-port"))
    names = ("vendor", "model", "serial", "address", "protocol")
    of_ports = (Column("device", "port"), Column("description", "description"))
    tables = (
        Table.of_items("cameras", "Cameras", [Column(name, name) for name in names], cameras),
        Table.of_items("serial_ports", "Serial ports", of_ports, ports),
    )
    print_result(Result("devices", "Connected devices", tables, tuple(findings)))


def snap(
    file: Path,
    *,
    camera: str | None = None,
    exposure: Seconds = 0.01,
    pixel_format: str = "Mono12",
    force: Force = False,
) -> None:
    """Take one frame, to draw the regions of the patches in it.

    Parameters
    ----------
    file
        TIFF file to write, with the camera's features; an 8-bit PNG to look at is written beside it.
    camera
        Serial number, address or model; default: the only one.
    exposure
        Exposure time, for example 5ms.
    pixel_format
        GenICam pixel format.
    """
    picture = file.with_suffix(".png")
    if picture == file:
        raise InputError(f"{file} is reserved for the preview: give a name that ends with .tif")
    for path in (file, picture):
        output_file(path, force, option="FILE")
    with AravisCamera(camera, patience_s=DeviceOptions.patience) as opened:
        opened.configure(exposure_s=exposure, pixel_format=pixel_format)
        frame = opened.snap(on_refused=take_again)
        features = json_features(opened.features())
    write_file(file, frame_to_tiff(frame, False, features), force=force)
    write_file(picture, _picture(frame), force=force)
    height, width = frame.shape
    quantities = [
        NamedValue("width", width, "px"),
        NamedValue("height", height, "px"),
        NamedValue("exposure", 1e3 * frame.exposure_s, "ms"),
        NamedValue("gain", frame.gain_db, "dB"),
        NamedValue("mean", float(frame.dn.mean()), "DN", f"saturated from {frame.saturation_dn:g} DN"),
        NamedValue("saturated", float(frame.saturated.mean()), "%", "share of the pixels"),
        NamedValue("temperature", frame.temperature_c, "°C", "of the camera"),
    ]
    table = quantity_table("frame", f"{frame.camera}, {frame.pixel_format}", quantities)
    result = Result("snap", str(file), (table,), configuration=frame.metadata(), simulated=frame.camera.simulated)
    print_result(result, f"Written: {file}, {picture}")


def _picture(frame: Frame) -> bytes:
    """Return an 8-bit PNG that looks like the scene: sRGB of the DN, white at saturation, colours of a Bayer filter."""
    levels = frame.levels
    share = np.clip(levels.values_dn / frame.linear_saturation_dn, 0.0, 1.0)
    srgb = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    grey = np.rint(255 * srgb).astype(np.uint8)[levels.index]
    codes = {
        "RG": cv2.COLOR_BayerRGGB2BGR,
        "GB": cv2.COLOR_BayerGBRG2BGR,
        "GR": cv2.COLOR_BayerGRBG2BGR,
        "BG": cv2.COLOR_BayerBGGR2BGR,
    }
    code = codes.get(frame.colour_filter or "")
    shown = grey if code is None else cv2.cvtColor(grey, code)
    return bytes(cv2.imencode(".png", shown)[1])


def meter(
    *,
    port: MeterPort = None,
    n: Annotated[int, As(names=("-n",), least=1)] = 5,
    model: MeterModel = "LS-110",
    slow: bool = False,
    peak: bool = False,
    transcript: Path | None = None,
) -> None:
    """Take readings of a luminance meter, with their mean and scatter.

    Parameters
    ----------
    n
        Number of readings.
    slow
        Use the SLOW response, for flickering light.
    peak
        Measure the peak value instead of the current one.
    transcript
        New file for the bytes exchanged with the meter.
    """
    driver = DRIVERS[model]
    if peak and not issubclass(driver, MinoltaLS):
        raise InputError(f"--peak is a mode of the LS-100 and LS-110: leave it out for the {model}")
    options: dict[str, Any] = {"modes": [MeterMode.PEAK]} if peak else {}
    options |= {"response": "slow" if slow else "fast", "transcript": transcript}
    with driver.configured(port or _only_port(), **options) as opened:
        opened.ask_if_simulated()
        series = measure_series(opened, n)
    print_result(_result(series))


def _only_port() -> str:
    ports = find_meter_ports()
    if not ports:
        raise InputError("no serial port was found: connect the adapter, or give --meter")
    if len(ports) > 1:
        raise InputError(f"there are several serial ports ({', '.join(p.device for p in ports)}): give --meter")
    return str(ports[0].device)


def _chromaticity_columns(series: ReadingSeries) -> list[Column]:
    """Return columns of x and y if the meter measures them."""
    if all(reading.chromaticity is None for reading in series.readings):
        return []

    def coordinate(index: int) -> Callable[[Reading], float | None]:
        return lambda reading: None if reading.chromaticity is None else reading.chromaticity[index]

    return [
        Column(name, name, "", f"Chromaticity coordinate {name} of CIE 1931.", value=coordinate(index))
        for index, name in enumerate(("x", "y"))
    ]


def _result(series: ReadingSeries) -> Result:
    columns = (
        Column("number", "number", value=lambda reading: 1 + series.readings.index(reading)),
        Column("as_sent", "as sent", "", "Value and unit on the display of the meter.",
               value=lambda reading: f"{reading.value:g} {reading.unit}"),
        *uncertain(Column("luminance_cd_m2", "luminance", "cd/m²", "U and u without the meter's scale error."),
                   "standard_uncertainty_random_cd_m2"),
        *_chromaticity_columns(series),
        Column("time", "time", "", "Time of the reading.", value=lambda reading: reading.timestamp.isoformat()),
        Column("value", "value", "", "Value on the display.", shown=False),
        Column("unit", "unit", "", "Unit on the display.", shown=False),
        Column("peak", "peak", "", "Whether it is a held peak.", shown=False),
        Column("raw", "raw", "", "Bytes on the wire.", shown=False),
    )  # fmt: skip
    several = len(series.readings) > 1
    quantities = [
        NamedValue("mean", series.mean_cd_m2, "cd/m²", "scale excluded", series.standard_uncertainty_random_cd_m2),
        NamedValue("scatter", series.scatter_cd_m2 if several else None, "cd/m²", "standard deviation of the readings"),
        NamedValue("relative scatter", series.scatter_rel if several else None, "%"),
        NamedValue("u of the meter's scale", series.standard_uncertainty_common_rel, "%", "common to all readings"),
    ]
    tables = (
        Table.of_items("readings", "Readings", columns, series.readings),
        quantity_table("series", "All readings", quantities),
    )
    meter = series.readings[0].meter
    return Result("meter", f"{meter.model} {meter.serial}", tables, simulated=meter.simulated)
