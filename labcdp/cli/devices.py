"""Commands devices and snap: what is connected, and what the camera sees."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import typer

from ..errors import InputError
from .terminal import JSON_OPTION, print_json, print_table, say


def devices(as_json: bool = JSON_OPTION) -> None:
    """List cameras and serial ports."""
    from ..drivers.aravis_library import discover
    from ..drivers.camera import CameraError
    from ..drivers.minolta_ls import find_meter_ports

    problem = None
    try:
        cameras = discover()
    except CameraError as error:
        cameras, problem = [], str(error)
    ports = find_meter_ports()
    if as_json:
        print_json(
            {"cameras": [asdict(c) for c in cameras], "serial_ports": [asdict(p) for p in ports], "problem": problem}
        )
        return
    if problem:
        say(f"labcdp: {problem}")
    print_table(
        "Cameras" if cameras else "No camera answers",
        ("vendor", "model", "serial", "address", "protocol"),
        [(c.vendor, c.model, c.serial, c.address, c.protocol) for c in cameras],
    )
    print_table(
        "Serial ports" if ports else "No serial port found",
        ("port", "description"),
        [(p.device, p.description) for p in ports],
    )


def snap(
    file: Path = typer.Argument(help="TIFF file to write."),
    camera: str | None = typer.Option(None, help="Serial number, address or model; default: the only one."),
    exposure_s: float = typer.Option(0.01, help="Exposure time in seconds."),
    pixel_format: str = typer.Option("Mono12", help="GenICam pixel format."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Take one frame, to look up the regions of the patches in it."""
    from ..drivers.aravis_camera import AravisCamera
    from ..session.files import write_whole
    from ..session.frame_file import frame_to_tiff

    with AravisCamera(camera) as opened:
        opened.configure(exposure_s=exposure_s, pixel_format=pixel_format)
        frame = opened.snap()
    try:
        write_whole(file.parent, file.name, frame_to_tiff(frame, False))
    except OSError as error:
        raise InputError(f"{file} cannot be written ({error.strerror}): give another file") from error
    saturated = float(frame.saturated.mean())
    if as_json:
        print_json({"file": str(file), "mean_dn": float(frame.dn.mean()), "saturated": saturated, **frame.metadata()})
        return
    say(
        f"{file}: {frame.shape[1]} x {frame.shape[0]} pixels, mean {frame.dn.mean():.0f} of {frame.saturation_dn:.0f} "
        f"DN, {saturated:.1%} saturated"
    )
