"""Triggers of an Aravis camera, which may have several of which one is selected, or a single one."""

from __future__ import annotations

from typing import Any

from ..camera import CameraSettingError
from ..camera_settings import FREE_RUN, Trigger
from .features import available, read_feature, writable, write_feature

_MODE, _SELECTOR, _SOURCE, _ACTIVATION = "TriggerMode", "TriggerSelector", "TriggerSource", "TriggerActivation"
#: The trigger of a frame, by the first of these names that a camera has.
_OF_A_FRAME = ("FrameStart", "ExposureStart", "AcquisitionStart")


def clear_triggers(camera: Any) -> None:
    """Switch all triggers off; Aravis' own function fails where the only one cannot be selected."""
    triggers = camera.dup_available_enumerations_as_strings(_SELECTOR) if writable(camera, _SELECTOR) else ["the one"]
    for trigger in triggers:
        if len(triggers) > 1:
            write_feature(camera, _SELECTOR, trigger)
        if available(camera, _MODE) and read_feature(camera, _MODE) != "Off":
            write_feature(camera, _MODE, "Off")


def change_trigger(camera: Any, trigger: Trigger) -> None:
    """Set the trigger of a frame; raises CameraSettingError if the camera has no such trigger."""
    if trigger.source is None:
        clear_triggers(camera)
        return
    if available(camera, _MODE) is None or available(camera, _SOURCE) is None:
        raise CameraSettingError("the camera has no trigger", f"leave it free-running, not on {trigger.source}")
    sources = camera.dup_available_trigger_sources()
    if trigger.source not in sources:
        raise CameraSettingError(
            f"the camera has no trigger source {trigger.source!r}", f"choose one of {', '.join(sources)}"
        )
    clear_triggers(camera)
    _select(camera)
    write_feature(camera, _SOURCE, trigger.source)
    if trigger != Trigger(trigger.source) or available(camera, _ACTIVATION) is not None:
        write_feature(camera, _ACTIVATION, trigger.activation)
    write_feature(camera, _MODE, "On")


def read_trigger(camera: Any) -> Trigger:
    """Return the trigger that is selected; raises errors of Aravis.

    It is not selected anew: reading changes nothing. Where one is on, `change_trigger` has selected it.
    """
    if available(camera, _MODE) is None or read_feature(camera, _MODE) != "On":
        return FREE_RUN
    activation: Any = read_feature(camera, _ACTIVATION) if available(camera, _ACTIVATION) else "RisingEdge"
    return Trigger(str(read_feature(camera, _SOURCE)), activation)


def _select(camera: Any) -> None:
    """Select the trigger of a frame, where there are several."""
    if not writable(camera, _SELECTOR):
        return
    kinds = camera.dup_available_enumerations_as_strings(_SELECTOR)
    wanted = next((kind for kind in _OF_A_FRAME if kind in kinds), None)
    if wanted is not None and read_feature(camera, _SELECTOR) != wanted:
        write_feature(camera, _SELECTOR, wanted)
