"""Features of an Aravis camera by name, and its known photometric state: whole sensor, no automatics, linear DN."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterable, Iterator
from typing import Any, Final

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
    node, said = _node(camera, name), f"feature {name}"
    if not _allows(node, "W"):
        raise CameraSettingError(f"{said} cannot be written: it is read-only, or locked by another setting")
    kind = _kind(node)
    if not kind:
        raise CameraSettingError(f"{said} has no value that could be written: it is {_what(node)}")
    accepted, words = _KINDS[kind]
    if kind == "GcEnumeration":
        entries = camera.dup_available_enumerations_as_strings(name)
        if value not in entries:
            raise CameraSettingError(f"{said} has no value {value!r}: choose one of {', '.join(entries)}")
    elif not isinstance(value, accepted) or isinstance(value, bool) != (kind == "GcBoolean"):
        raise CameraSettingError(f"{said} takes {words}, not {value!r}")
    if kind == "GcInteger":
        require_range(said, value, camera.get_integer_bounds(name), step=_increment(camera, name))
    elif kind == "GcFloat":
        value = float(value)
        require_range(said, value, camera.get_float_bounds(name))
    setters = {"GcInteger": camera.set_integer, "GcFloat": camera.set_float, "GcBoolean": camera.set_boolean}
    setters.get(kind, camera.set_string)(name, value)
    return _value(node) if _allows(node, "R") else value


def _increment(camera: Any, name: str) -> int:
    # A register node may have no increment, which Aravis reports as an error.
    with contextlib.suppress(gerror()):
        return int(camera.get_integer_increment(name))
    return 1


def readable_features(camera: Any) -> Iterator[tuple[str, FeatureValue]]:
    """Yield name and value of every readable feature, in the camera's order; raises errors of Aravis."""
    for node in _readable(camera):
        yield node.get_name(), _value(node)


def described_features(camera: Any) -> Iterator[FeatureDescription]:
    """Yield every readable feature with range and unit, in the camera's order; raises errors of Aravis."""
    arv = aravis()
    for node in _readable(camera):
        name, kind = node.get_name(), _kind(node)
        choices = camera.dup_available_enumerations_as_strings(name) if kind == "GcEnumeration" else ()
        unit, limits = "", None
        if kind in ("GcInteger", "GcFloat"):
            number = getattr(arv, kind)
            unit = number.get_unit(node) or ""
            # A register without limits of its own may refuse to say them.
            with contextlib.suppress(gerror()):
                limits = (number.get_min(node), number.get_max(node))
        yield FeatureDescription(name, _value(node), _allows(node, "W"), unit, limits, tuple(choices))


def _readable(camera: Any) -> Iterator[Any]:
    return (node for node in _nodes(camera) if _allows(node, "R") and _kind(node))


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


#: Kinds of features that have a value, as Aravis names them, and what that is in Python, in types and in words. An
#: enumeration and a boolean are integers, too, and therefore come first.
_KINDS: Final[dict[str, tuple[Any, str]]] = {
    "GcEnumeration": (str, "one of its names"),
    "GcBoolean": (bool, "true or false"),
    "GcString": (str, "a text"),
    "GcFloat": (int | float, "a number"),
    "GcInteger": (int, "a whole number"),
}


def _kind(node: Any) -> str:
    """Return the kind of a feature as of `_KINDS`; empty for what has no value."""
    arv = aravis()
    kinds = (kind for kind in _KINDS if isinstance(node, getattr(arv, kind)))
    return "" if isinstance(node, arv.GcCommand) else next(kinds, "")


def _value(node: Any) -> FeatureValue:
    kind = _kind(node)
    if not kind:
        raise CameraSettingError(f"feature {node.get_name()} has no value that could be read: it is {_what(node)}")
    if kind == "GcEnumeration":
        return device_text(node.get_string_value)
    get = getattr(aravis(), kind).get_value
    if kind == "GcString":
        return device_text(get, node)
    value: FeatureValue = {"GcBoolean": bool, "GcFloat": float, "GcInteger": int}[kind](get(node))
    return value


def _what(node: Any) -> str:
    return "a " + type(node).__name__.removeprefix("Gc").removesuffix("Node").lower()


def require_range(name: str, value: Any, limits: tuple[float, float], unit: str = "", *, step: int = 1) -> None:
    """Refuse a number that is out of its range or between its steps; raises CameraSettingError, which states both."""
    low, high = limits
    if not low <= value <= high or (step > 1 and (value - low) % step):
        unit = f" {unit}" if unit else ""
        steps = f" in steps of {step}" if step > 1 else ""
        raise CameraSettingError(f"{name} is {value:g}{unit}: the camera takes {low:g} to {high:g}{unit}{steps}")


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
