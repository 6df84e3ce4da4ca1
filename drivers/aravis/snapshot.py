"""All settings of a camera, so that one which lost power continues with the same."""

from __future__ import annotations

from collections.abc import Mapping
from math import isclose

from ..camera import CameraSettingError, FeatureValue
from .features import readable_features, writable, write_feature
from .link import Link

#: First letters of features that belong to a connection or an operation and not to the picture: transport and clock
#: of GigE Vision, events, stored sets, files, locks. `transport` sets those of the stream anew.
_NOT_OF_THE_PICTURE = ("Gev", "Stream", "DeviceLink", "Ptp", "Event", "UserSet", "File", "Action", "TLParams")
#: Rounds of writing; one feature may be locked, or have another range, until another one is restored.
_MAX_ROUNDS = 5

Snapshot = Mapping[str, FeatureValue]


def take_snapshot(link: Link) -> Snapshot:
    """Read all writable features that may change a picture, by name in the camera's order."""
    with link.using("its settings cannot be read") as camera:
        return {
            name: value
            for name, value in readable_features(camera)
            if not name.startswith(_NOT_OF_THE_PICTURE) and writable(camera, name)
        }


def restore_snapshot(link: Link, wanted: Snapshot) -> None:
    """Write the features that differ from a snapshot, and verify all of them by reading back.

    Raises
    ------
    CameraSettingError
        If some still differ, or are missing; the message names them.
    """
    different = _different(wanted, take_snapshot(link))
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
        now = take_snapshot(link)
        different = _different(wanted, now)
    if different:
        named = ", ".join(f"{name} = {now.get(name, 'missing')}, not {wanted[name]}" for name in different)
        reason = "" if refused is None else f" [{refused}]"
        raise CameraSettingError(
            f"{link.identity} came back with other settings, which it does not change: {named}{reason}"
        )


def _different(wanted: Snapshot, now: Snapshot) -> list[str]:
    return [name for name, value in wanted.items() if name not in now or not _same(value, now[name])]


def _same(one: FeatureValue, other: FeatureValue) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)
    return one == other
