"""Features of an Aravis camera by name, and its known photometric state: whole sensor, no automatics, linear DN."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterable, Iterator
from typing import Any

from ..camera import CameraSettingError
from ..camera_settings import FeatureDescription, FeatureValue
from .library import aravis, device_text, gerror


def read_feature(camera: Any, name: str) -> FeatureValue:
    """Return the value of a feature.

    Parameters
    ----------
    camera : Aravis.Camera
        Open.
    name : str
        GenICam name, for example ``DeviceTemperature``.

    Raises
    ------
    CameraSettingError
        If there is no such feature, or it cannot be read.
    """
    node = _node(camera, name)
    if not _allows(node, "R"):
        raise CameraSettingError(f"feature {name} cannot be read: the camera has it, but not for reading now")
    return _value(node)


def write_feature(camera: Any, name: str, value: FeatureValue) -> FeatureValue:
    """Change a feature and return the value in effect. Parameters as `read_feature`.

    Raises
    ------
    CameraSettingError
        If there is no such feature, it cannot be written, or the value is of a wrong type or out of range.
    """
    arv = aravis()
    node = _node(camera, name)
    if not _allows(node, "W"):
        raise CameraSettingError(f"feature {name} cannot be written: it is read-only, or locked by another setting")
    if isinstance(node, arv.GcEnumeration):
        camera.set_string(name, _one_of(camera, name, value))
    elif isinstance(node, arv.GcBoolean):
        camera.set_boolean(name, _of_type(name, value, bool))
    elif isinstance(node, arv.GcInteger):
        camera.set_integer(name, _in_range(name, _of_type(name, value, int), *_integer_range(camera, name)))
    elif isinstance(node, arv.GcFloat):
        camera.set_float(name, _in_range(name, float(_of_type(name, value, float)), *camera.get_float_bounds(name)))
    elif isinstance(node, arv.GcString):
        camera.set_string(name, _of_type(name, value, str))
    else:
        raise CameraSettingError(f"feature {name} has no value that could be written: it is {_kind(node)}")
    return _value(node) if _allows(node, "R") else value


def readable_features(camera: Any) -> Iterator[tuple[str, FeatureValue]]:
    """Yield name and value of every readable feature, in the camera's order; raises errors of Aravis."""
    for node in _nodes(camera):
        if _allows(node, "R") and _has_value(node):
            yield node.get_name(), _value(node)


def described_features(camera: Any) -> Iterator[FeatureDescription]:
    """Yield every readable feature with range and unit, in the camera's order; raises errors of Aravis."""
    arv = aravis()
    for node in _nodes(camera):
        if not (_allows(node, "R") and _has_value(node)):
            continue
        name, number = node.get_name(), isinstance(node, arv.GcFloat | arv.GcInteger)
        choices: tuple[str, ...] = ()
        unit, limits = "", None
        if isinstance(node, arv.GcEnumeration):
            choices = tuple(camera.dup_available_enumerations_as_strings(name))
        elif number and not isinstance(node, arv.GcBoolean):
            kind = arv.GcFloat if isinstance(node, arv.GcFloat) else arv.GcInteger
            unit = kind.get_unit(node) or ""
            # A register without limits of its own may refuse to say them.
            with contextlib.suppress(gerror()):
                limits = (kind.get_min(node), kind.get_max(node))
        yield FeatureDescription(name, _value(node), _allows(node, "W"), unit, limits, choices)


def available(camera: Any, *names: str) -> str | None:
    """Return the first of these names that the camera has; None if it has none."""
    return next((name for name in names if camera.is_feature_available(name)), None)


def writable(camera: Any, name: str) -> bool:
    """Whether the camera has a feature that is currently writable."""
    return bool(camera.is_feature_available(name)) and _allows(_node(camera, name), "W")


def _node(camera: Any, name: str) -> Any:
    node = camera.get_device().get_feature(name)
    if node is None or not isinstance(node, aravis().GcFeatureNode) or not camera.is_feature_available(name):
        close = difflib.get_close_matches(name, [each.get_name() for each in _nodes(camera)], n=3)
        hint = f"did you mean {' or '.join(close)}?" if close else "features() lists what can be read"
        raise CameraSettingError(f"the camera has no feature {name!r} now: {hint}")
    return node


def _nodes(camera: Any) -> Iterator[Any]:
    """Walk the features of all categories, each once."""
    genicam = camera.get_device().get_genicam()
    seen = {"Root"}
    waiting = [genicam.get_node("Root")]
    while waiting:
        node = waiting.pop(0)
        if isinstance(node, aravis().GcCategory):
            names = [name for name in node.get_features() if name not in seen]
            seen.update(names)
            waiting.extend(found for name in names if (found := genicam.get_node(name)) is not None)
        elif node.is_available():
            yield node


def _allows(node: Any, letter: str) -> bool:
    """Whether a node is currently readable (R) or writable (W)."""
    # Check both: either feature or register may restrict access.
    modes = (node.get_actual_access_mode(), node.get_imposed_access_mode())
    return all(letter in mode.value_nick.upper() for mode in modes) and not (letter == "W" and node.is_locked())


def _has_value(node: Any) -> bool:
    arv = aravis()
    return not isinstance(node, arv.GcCommand) and isinstance(
        node, (arv.GcInteger, arv.GcBoolean, arv.GcFloat, arv.GcString)
    )


def _value(node: Any) -> FeatureValue:
    arv = aravis()
    value: FeatureValue
    if isinstance(node, arv.GcEnumeration):
        value = device_text(node.get_string_value)
    elif isinstance(node, arv.GcBoolean):
        value = bool(node.get_value())
    elif isinstance(node, arv.GcString):
        value = device_text(arv.GcString.get_value, node)
    elif isinstance(node, arv.GcFloat):
        value = float(arv.GcFloat.get_value(node))
    elif isinstance(node, arv.GcInteger):
        value = int(arv.GcInteger.get_value(node))
    else:
        raise CameraSettingError(f"feature {node.get_name()} has no value that could be read: it is {_kind(node)}")
    return value


def _kind(node: Any) -> str:
    return "a " + type(node).__name__.removeprefix("Gc").removesuffix("Node").lower()


def _of_type(name: str, value: FeatureValue, wanted: type) -> Any:
    accepted = {bool: (bool,), int: (int,), float: (int, float), str: (str,)}[wanted]
    if not isinstance(value, accepted) or (isinstance(value, bool) and wanted is not bool):
        article = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}[wanted]
        raise CameraSettingError(f"feature {name} takes {article}, not {value!r}")
    return value


def _one_of(camera: Any, name: str, value: FeatureValue) -> str:
    entries = camera.dup_available_enumerations_as_strings(name)
    if value not in entries:
        raise CameraSettingError(f"feature {name} has no value {value!r}: choose one of {', '.join(entries)}")
    return str(value)


def _integer_range(camera: Any, name: str) -> tuple[int, int, int]:
    try:
        step = camera.get_integer_increment(name)
    except gerror():
        # A register node may have no increment, which Aravis reports as an error.
        step = 1
    return *camera.get_integer_bounds(name), step


def _in_range(name: str, value: Any, low: float, high: float, step: int = 1) -> Any:
    if not low <= value <= high or (isinstance(value, int) and step > 1 and (value - low) % step):
        steps = f" in steps of {step}" if step > 1 else ""
        raise CameraSettingError(f"feature {name} is {value:g}: the camera takes {low:g} to {high:g}{steps}")
    return value


#: What is set where the camera has it, in this order.
_STATE: tuple[tuple[str, FeatureValue], ...] = (
    ("ExposureAuto", "Off"),
    ("ExposureMode", "Timed"),
    ("GainAuto", "Off"),
    ("BlackLevelAuto", "Off"),
    ("BalanceWhiteAuto", "Off"),
    ("GammaEnable", False),
    ("GammaEnabled", False),
    ("Gamma", 1.0),
    ("LUTEnable", False),
    ("ColorTransformationEnable", False),
    ("DecimationHorizontal", 1),
    ("DecimationVertical", 1),
    ("ReverseX", False),
    ("ReverseY", False),
    ("TestPattern", "Off"),
    ("TestImageSelector", "Off"),
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
        # A gamma that is switched off may keep its value: many cameras lock it then.
        is_off = name == "Gamma" and available(camera, "GammaEnable", "GammaEnabled") is not None
        if not (is_off and not writable(camera, name)):
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
