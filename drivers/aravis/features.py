"""Features of an Aravis camera, by name."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Callable, Iterator
from math import isclose
from typing import Any, Final, TypeVar

from ..camera import CameraSettingError
from ..camera_settings import FeatureDescription, FeatureValue
from .library import aravis, device_text, gerror, is_of_transport

_T = TypeVar("_T")


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
        raise CameraSettingError(f"feature {name} cannot be read", "it cannot be read at the moment")
    return _value(node)


def write_feature(camera: Any, name: str, value: FeatureValue) -> FeatureValue:
    """Change a feature and return the value in effect. Parameters as `read_feature`.

    Raises
    ------
    CameraSettingError
        If there is no such feature, it cannot be written, or the value is of a wrong type or out of range.
    """
    node, subject = _node(camera, name), f"feature {name}"
    if not _allows(node, "W"):
        raise CameraSettingError(f"{subject} cannot be written", "it is read-only, or locked by another setting")
    kind = _kind(node)
    if not kind:
        raise CameraSettingError(f"{subject} is {_kind_text(node)}, so it has no value that could be written")
    accepted, words = _KINDS[kind]
    if kind == "GcEnumeration":
        entries = camera.dup_available_enumerations_as_strings(name)
        if value not in entries:
            raise CameraSettingError(f"{subject} has no value {value!r}", f"choose one of {', '.join(entries)}")
    elif not isinstance(value, accepted) or isinstance(value, bool) != (kind == "GcBoolean"):
        raise CameraSettingError(f"{subject} takes {words}, not {value!r}")
    if kind == "GcInteger":
        require_range(subject, value, camera.get_integer_bounds(name), step=_increment(camera, name))
    elif kind == "GcFloat":
        value = float(value)
        require_range(subject, value, camera.get_float_bounds(name))
    setters = {"GcInteger": camera.set_integer, "GcFloat": camera.set_float, "GcBoolean": camera.set_boolean}
    setters.get(kind, camera.set_string)(name, value)
    return _value(node) if _allows(node, "R") else value


def is_same(value: Any, other: Any, rounded_rel: float = 1e-9) -> bool:
    """Whether two values of a feature are the same, numbers within a relative difference."""
    if isinstance(value, float) and isinstance(other, int | float):
        return isclose(value, other, rel_tol=rounded_rel, abs_tol=1e-12)
    return bool(value == other)


def _increment(camera: Any, name: str) -> int:
    # A register node may have no increment, which Aravis reports as an error.
    with contextlib.suppress(gerror()):
        return int(camera.get_integer_increment(name))
    return 1


def readable_features(
    camera: Any, *, access: str = "R", left_out: tuple[str, ...] = ()
) -> Iterator[tuple[str, FeatureValue]]:
    """Yield name and value of every feature that can be read now, in the camera's order.

    Parameters
    ----------
    camera : Aravis.Camera
        Open.
    access : {'R', 'RW'}
        'RW' for those that can also be written now.
    left_out : tuple of str
        First letters of names to leave out.

    Raises
    ------
    GLib.Error
        If the camera does not answer.
    """
    for node in _nodes(camera):
        if not node.get_name().startswith(left_out) and (value := _value_now(node, access)) is not None:
            yield node.get_name(), value


def described_features(camera: Any) -> Iterator[FeatureDescription]:
    """Yield every readable feature with range and unit, in the camera's order; raises as `readable_features`."""
    arv = aravis()
    for node in _nodes(camera):
        if (value := _value_now(node)) is None:
            continue
        name, kind = node.get_name(), _kind(node)
        unit, limits, choices = "", None, ()
        if kind == "GcEnumeration":
            choices = tuple(camera.dup_available_enumerations_as_strings(name))
        elif kind in ("GcInteger", "GcFloat"):
            number = getattr(arv, kind)
            unit = number.get_unit(node) or ""
            # A register without limits of its own may refuse to say them.
            limits = _answer(lambda: (number.get_min(node), number.get_max(node)), None)  # noqa: B023 - called at once
        yield FeatureDescription(name, value, _allows(node, "W"), unit, limits, choices)


def _answer(question: Callable[[], _T], otherwise: _T) -> _T:
    """Ask a camera; a feature that cannot be read is tolerated, unlike a camera that does not answer.

    Features of chunks and events have no value without one, and a formula may divide by a register that is 0.
    """
    try:
        return question()
    except gerror() as error:
        if is_of_transport(error):
            raise
        return otherwise


def _value_now(node: Any, access: str = "R") -> FeatureValue | None:
    """Return the value of a feature; None if the camera does not have it now, or not with this access."""

    def value() -> FeatureValue | None:
        has_it = _kind(node) and all(_allows(node, letter) for letter in access) and _is_there(node)
        return _value(node) if has_it else None

    return _answer(value, None)


def _is_there(node: Any) -> bool:
    """Whether the camera has a feature now; Aravis does not ask whether this model implements it."""
    arv = aravis()
    is_feature = isinstance(node, arv.GcFeatureNode) and not isinstance(node, arv.GcCategory)
    return is_feature and _answer(lambda: bool(node.is_implemented() and node.is_available()), False)


def available(camera: Any, *names: str) -> str | None:
    """Return the first of these names that the camera has; None if it has none."""
    device = camera.get_device()
    return next((name for name in names if _is_there(device.get_feature(name))), None)


def kind_of(camera: Any, name: str) -> str:
    """Return the kind of a feature as of `_KINDS`, whether it has a value now or not; empty if the camera lacks it."""
    node = camera.get_device().get_feature(name)
    return "" if node is None else _kind(node)


def unit_of(camera: Any, name: str) -> str:
    """Return the unit of a feature, empty if the camera does not state it."""
    node = camera.get_device().get_feature(name)
    kind = _kind(node)
    return getattr(aravis(), kind).get_unit(node) or "" if kind in ("GcInteger", "GcFloat") else ""


def text_of(camera: Any, name: str) -> str:
    """Return the text of a feature; empty if the camera does not have it."""
    return device_text(camera.get_string, name) if available(camera, name) is not None else ""


def writable(camera: Any, name: str) -> bool:
    """Whether the camera has a feature that is currently writable."""
    return available(camera, name) is not None and _allows(_node(camera, name), "W")


def _node(camera: Any, name: str) -> Any:
    if available(camera, name) is None:
        close = difflib.get_close_matches(name, [known.get_name() for known in _nodes(camera)], n=3)
        hint = f"did you mean {' or '.join(close)}?" if close else "features() lists what can be read"
        raise CameraSettingError(f"the camera has no feature {name!r} now", hint)
    return camera.get_device().get_feature(name)


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
            waiting.extend(child for name in names if (child := genicam.get_node(name)) is not None)
        else:
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
        raise CameraSettingError(
            f"feature {node.get_name()} is {_kind_text(node)}, so it has no value that could be read"
        )
    if kind == "GcEnumeration":
        return device_text(node.get_string_value)
    get = getattr(aravis(), kind).get_value
    if kind == "GcString":
        return device_text(get, node)
    value: FeatureValue = {"GcBoolean": bool, "GcFloat": float, "GcInteger": int}[kind](get(node))
    return value


def _kind_text(node: Any) -> str:
    return "a " + type(node).__name__.removeprefix("Gc").removesuffix("Node").lower()


def require_range(name: str, value: Any, limits: tuple[float, float], unit: str = "", *, step: int = 1) -> None:
    """Refuse a number that is out of its range or between its steps; raises CameraSettingError, which states both."""
    low, high = limits
    if not low <= value <= high or (step > 1 and (value - low) % step):
        unit = f" {unit}" if unit else ""
        steps = f" in steps of {step}" if step > 1 else ""
        raise CameraSettingError(f"{name} is {value:g}{unit}", f"the camera takes {low:g} to {high:g}{unit}{steps}")
