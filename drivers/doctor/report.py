"""Files for a report of a problem: a camera's description and features, and the bytes exchanged with a meter."""

from __future__ import annotations

import json
import platform
import re
import tempfile
from contextlib import closing, suppress
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from ...core.reading import SerialMeterModel
from ..aravis.connection import take_snapshot
from ..aravis.features import readable_features
from ..aravis.known_state import not_understood
from ..aravis.library import CameraInfo, genicam_xml
from ..aravis.link import connect
from ..aravis.settings import understood_gains
from ..meter import MeterError
from ..minolta.ls import MinoltaLS
from ..minolta.models import DRIVERS
from .computer import debian_packages


def camera_files(info: CameraInfo) -> dict[str, bytes]:
    """Read a camera without changing it.

    Returns
    -------
    dict of str to bytes
        Its GenICam description (XML), and its features with what labcdp knows of them (JSON), by file name.

    Raises
    ------
    CameraError
        If it is absent or busy.
    """
    with closing(connect(info, prepare=False)) as link:
        writable = take_snapshot(link)
        with link.using("it cannot be read") as camera:
            features = dict(readable_features(camera))
            xml, gains = genicam_xml(camera), understood_gains(camera)
    about = {
        "camera": asdict(info),
        "versions": {
            "labcdp": version("labcdp"),
            "packages": debian_packages() or {},
            "Python": platform.python_version(),
            "system": platform.platform(),
        },
        "features": features,
        "writable": list(writable),
        "not understood": list(not_understood(writable, gains)),
    }
    name = "camera-" + re.sub(r"\W", "_", info.serial or info.address)
    text = json.dumps(about, indent=1, default=repr)
    return {f"{name}.json": text.encode(), f"{name}.xml": xml}


def meter_files(port: str, model: SerialMeterModel, timeout_s: float = 6.0) -> dict[str, bytes]:
    """Set a meter's modes, measure once and read its display; return the transcript of the bytes by file name.

    Errors of the meter are part of the transcript.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "meter.jsonl")
        driver = DRIVERS[model].configured(port, timeout_s=timeout_s, transcript=path)
        with suppress(MeterError), driver as meter:
            for use in (meter.measure, *([meter.read_held] if isinstance(meter, MinoltaLS) else [])):
                with suppress(MeterError):
                    use()
        return {path.name: path.read_bytes()} if path.exists() else {}
