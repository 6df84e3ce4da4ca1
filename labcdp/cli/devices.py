"""Command devices: what is connected."""

from __future__ import annotations

from dataclasses import asdict

from .terminal import JSON_OPTION, print_json, print_table, say


def devices(as_json: bool = JSON_OPTION) -> None:
    """List cameras and serial ports."""
    from ..drivers.aravis_camera import discover
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
