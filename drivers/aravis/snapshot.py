"""All settings of a camera: read back, compared with those wanted, and restored after a loss of power."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isclose
from typing import Any

from ...core.frame import CameraIdentity
from ..camera import CameraSettingError
from ..camera_settings import CameraSettings, CameraSetup, FeatureValue
from .features import available, read_feature, readable_features, writable, write_feature
from .link import Link

#: First letters of features that belong to a connection or an operation and not to the picture: transport and clock
#: of GigE Vision, events, stored sets, files, locks. `transport` sets those of the stream anew.
_NOT_OF_THE_PICTURE = ("Gev", "Stream", "DeviceLink", "Ptp", "Event", "UserSet", "File", "Action", "TLParams")
#: Those of the stream that `transport` sets.
_OF_THE_STREAM = (
    "GevSCPSPacketSize",
    "GevSCPD",
    "StreamBytesPerSecond",
    "DeviceLinkThroughputLimitMode",
    "DeviceLinkThroughputLimit",
)
#: Relative difference from a wanted number that a camera may round to.
_ROUNDED_REL = 0.01
#: Rounds of writing; one feature may be locked, or have another range, until another one is restored.
_MAX_ROUNDS = 5

Snapshot = Mapping[str, FeatureValue]


def take_snapshot(link: Link, *, stream: bool = False) -> Snapshot:
    """Read all writable features that may change a picture, by name in the camera's order; `stream` adds its own."""
    with link.using("its settings cannot be read") as camera:
        return {
            name: value
            for name, value in readable_features(camera)
            if (not name.startswith(_NOT_OF_THE_PICTURE) or (stream and name in _OF_THE_STREAM))
            and writable(camera, name)
        }


def restore_snapshot(link: Link, wanted: Snapshot) -> None:
    """Write the features that differ from a snapshot, and verify all of them by reading back.

    Raises
    ------
    CameraSettingError
        If some still differ, or are missing; the message names them.
    """
    now = take_snapshot(link, stream=True)
    different = _different(wanted, now)
    for _ in range(_MAX_ROUNDS):
        if not different:
            return
        refused: CameraSettingError | None = None
        for name in different:
            try:
                with link.using(f"{name} cannot be restored") as camera:
                    write_feature(camera, name, wanted[name])
            except CameraSettingError as error:
                refused = error
        now = take_snapshot(link, stream=True)
        different = _different(wanted, now)
    if different:
        named = ", ".join(f"{name} = {now.get(name, 'missing')}, not {wanted[name]}" for name in different)
        reason = "" if refused is None else f" [{refused}]"
        raise CameraSettingError(
            f"{link.identity} has other settings than before, which it does not change: {named}{reason}"
        )


def trigger_modes(link: Link) -> Snapshot:
    """Read the mode of every trigger that the camera can select."""
    modes: dict[str, FeatureValue] = {}
    with link.using("its triggers cannot be read") as camera:
        if available(camera, "TriggerMode") is None or not writable(camera, "TriggerSelector"):
            return modes
        selected = read_feature(camera, "TriggerSelector")
        for trigger in camera.dup_available_enumerations_as_strings("TriggerSelector"):
            write_feature(camera, "TriggerSelector", trigger)
            modes[trigger] = read_feature(camera, "TriggerMode")
        write_feature(camera, "TriggerSelector", selected)
    return modes


def restore_trigger_modes(link: Link, modes: Snapshot) -> None:
    """Write the modes of `trigger_modes`; the selection is left at the last one."""
    with link.using("its triggers cannot be restored") as camera:
        for trigger, mode in modes.items():
            write_feature(camera, "TriggerSelector", trigger)
            if read_feature(camera, "TriggerMode") != mode:
                write_feature(camera, "TriggerMode", mode)


def require_kept(
    who: CameraIdentity, wanted: CameraSetup, settings: CameraSettings, feature: Callable[[str], FeatureValue]
) -> None:
    """Refuse a camera that keeps other settings than those it was given.

    Parameters
    ----------
    who : CameraIdentity
        The camera.
    wanted : CameraSetup
        What it was given.
    settings : CameraSettings
        In force.
    feature : callable
        Reads a feature by name.

    Raises
    ------
    CameraSettingError
        Naming the first that differs.
    """
    pairs = {name: (value, getattr(settings, name)) for name, value in wanted.settings.items()}
    pairs |= {name: (value, feature(name)) for name, value in wanted.features.items()}
    for name, (value, kept) in pairs.items():
        if not _same(value, kept, _ROUNDED_REL):
            raise CameraSettingError(f"{who} keeps {name} at {kept}, not {value}: give a value that it keeps")


def _different(wanted: Snapshot, now: Snapshot) -> list[str]:
    return [name for name, value in wanted.items() if name not in now or not _same(value, now[name])]


def _same(one: Any, other: Any, rounded_rel: float = 1e-9) -> bool:
    if isinstance(one, float) and isinstance(other, int | float):
        return isclose(one, other, rel_tol=rounded_rel, abs_tol=1e-12)
    return bool(one == other)
