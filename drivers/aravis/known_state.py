"""A known photometric state: whole sensor, fixed exposure and gain, and DN as the sensor gives them.

Names of the GenICam Standard Features Naming Convention (SFNC 2.7) and the older ones of Allied Vision's Manta.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..camera import CameraSettingError, FeatureValue
from .features import available, read_feature, writable, write_feature

#: What is set where the camera has it, in this order.
_STATE: tuple[tuple[str, FeatureValue], ...] = (
    ("ExposureAuto", "Off"),
    ("ExposureMode", "Timed"),
    ("GainAuto", "Off"),
    ("BlackLevelAuto", "Off"),
    ("BalanceWhiteAuto", "Off"),
    ("Gamma", 1.0),
    ("GammaEnable", False),
    ("LUTEnable", False),
    ("ColorTransformationEnable", False),
    ("DecimationHorizontal", 1),
    ("DecimationVertical", 1),
    ("ReverseX", False),
    ("ReverseY", False),
)


#: Names and beginnings of names of what `settings` and the plan set, and of what changes no picture.
_UNDERSTOOD = (
    *(name for name, _ in _STATE),
    "Acquisition",
    "Binning",
    "BlackLevel",
    "Device",
    "Exposure",
    "Gain",
    "Height",
    "Offset",
    "PixelFormat",
    "SyncOut",
    "Trigger",
    "Width",
)


def not_understood(names: Iterable[str]) -> tuple[str, ...]:
    """Return those of a camera's writable features of which labcdp does not know what they do to a picture."""
    return tuple(name for name in names if not name.startswith(_UNDERSTOOD))


def bring_to_known_state(camera: Any) -> None:
    """Reset what other programs left: acquisition, triggers, automatics, tone curve, binning, mirroring and region.

    Raises
    ------
    CameraSettingError
        If a feature that changes the DN keeps another value; the message names it.
    """
    camera.stop_acquisition()
    if available(camera, "TriggerMode") is not None:
        camera.clear_triggers()
    for name, value in _STATE:
        _require(camera, name, value)
    if camera.is_binning_available():
        camera.set_binning(1, 1)
    show_whole_sensor(camera)


def show_whole_sensor(camera: Any) -> None:
    """Select the largest region: that of WidthMax and HeightMax, as not every camera has SensorWidth."""
    if camera.is_region_offset_available():
        camera.set_integer("OffsetX", 0)
        camera.set_integer("OffsetY", 0)
    camera.set_region(0, 0, camera.get_width_bounds()[1], camera.get_height_bounds()[1])


def _require(camera: Any, name: str, value: FeatureValue) -> None:
    if available(camera, name) is None:
        return
    if writable(camera, name):
        write_feature(camera, name, value)
    now = read_feature(camera, name)
    if now != value:
        raise CameraSettingError(f"feature {name} is {now} and does not take {value}: set it in the camera's program")
