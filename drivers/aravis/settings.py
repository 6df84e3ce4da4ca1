"""Settings of an Aravis camera, changed in an order that the camera accepts.

Feature names are those of the GenICam Standard Features Naming Convention (SFNC 2.7) and the older ones of Prosilica
used by the Allied Vision Manta (``ExposureTimeAbs``, ``AcquisitionFrameRateAbs``). Aravis supports both for exposure,
gain, black level, binning and region.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final, TypedDict

from ...core.dn import PIXEL_FORMATS, PixelFormat, pixel_format
from ...core.errors import InputError
from ...core.frame import Readout
from ..camera import CameraSettingError
from ..camera_settings import CameraSettings, Region, Trigger
from .features import available, read_feature, require_range, text_of, unit_of, writable, write_feature
from .known_state import show_whole_sensor
from .link import Link
from .trigger import change_trigger, read_trigger

_EXPOSURES = ("ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw")
#: The gain, in dB unless its unit says otherwise, and its name in the SFNC 1, in dB only if its unit says so. GainRaw,
#: which older cameras have instead, counts in steps of their own, but in dB in those of these vendors.
_GAIN, _ABSOLUTE_GAIN, _RAW_GAIN = "Gain", "GainAbs", "GainRaw"
_GAIN_SELECTOR = "GainSelector"
_RAW_GAIN_IN_DB = ("Allied Vision", "AVT", "Prosilica")
#: Names of the black level; old Mantas have the last, and a category called as the first.
_BLACK_LEVELS = ("BlackLevel", "BlackLevelRaw", "BlackLevelValue")
#: Names of the device temperature; the latter is that of older Basler cameras.
_TEMPERATURES = ("DeviceTemperature", "TemperatureAbs")
_FRAME_RATES = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
_FRAME_RATE_AUTO = "AcquisitionFrameRateAuto"
_FRAME_RATE_SWITCHES = ("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled")
#: Feature with the frame rate that a camera reaches if its frame rate is not controlled.
_RESULTING_FRAME_RATES = ("ResultingFrameRateAbs", "ResultingFrameRate", "AcquisitionResultingFrameRate")


class SettingChanges(TypedDict, total=False):
    """Settings that `AravisCamera.configure` changes; None leaves one as it is."""

    exposure_s: float | None
    gain_db: float | None
    pixel_format: str | None
    region: Region | None
    binning: tuple[int, int] | None
    black_level: float | None
    frame_rate_hz: float | None
    trigger: Trigger | None


def read_settings(camera: Any) -> CameraSettings:
    """Read the settings in force; raises errors of Aravis."""
    x, y, width, height = camera.get_region()
    return CameraSettings(
        exposure_s=float(read_feature(camera, _exposure(camera))) * 1e-6,
        gain_db=float(read_feature(camera, gain)) if (gain := _gain(camera)) is not None else 0.0,
        pixel_format=camera.get_pixel_format_as_string(),
        width=width,
        height=height,
        readout=_read_readout(camera, x, y),
        black_level=_black_level(camera),
        frame_rate_hz=_frame_rate_hz(camera),
        trigger=read_trigger(camera),
    )


def _frame_rate_hz(camera: Any) -> float | None:
    switch = available(camera, *_FRAME_RATE_SWITCHES)
    is_off = switch is not None and not read_feature(camera, switch)
    name = available(camera, *(_RESULTING_FRAME_RATES if is_off else _FRAME_RATES))
    return None if name is None else float(camera.get_float(name))


def _gain(camera: Any) -> str | None:
    """Name of the gain in dB, None if the camera has none."""
    if available(camera, _GAIN) is not None:
        # A unit that is none may be that of a factor, which begins at 1.
        unit = unit_of(camera, _GAIN).casefold()
        return _GAIN if unit == "db" or (not unit and _bounds(camera, _GAIN)[0] != 1) else None
    if available(camera, _ABSOLUTE_GAIN) is not None and unit_of(camera, _ABSOLUTE_GAIN).casefold() == "db":
        return _ABSOLUTE_GAIN
    raw_in_db = text_of(camera, "DeviceVendorName").startswith(_RAW_GAIN_IN_DB)
    return available(camera, _RAW_GAIN) if raw_in_db else None


def understood_gains(camera: Any) -> tuple[str, ...]:
    """Return the features of the gain that `read_settings` reads; the selector where there is one gain to select."""
    gain = _gain(camera)
    selector = available(camera, _GAIN_SELECTOR)
    is_only = selector is not None and len(camera.dup_available_enumerations_as_strings(selector)) < 2
    return tuple(name for name in (gain, _GAIN_SELECTOR if is_only else None) if name is not None)


def _black_level(camera: Any) -> float:
    name = available(camera, *_BLACK_LEVELS)
    return 0.0 if name is None else float(read_feature(camera, name))


def _read_readout(camera: Any, x: int, y: int) -> Readout:
    def pair(first: str, other: str, otherwise: Any) -> Any:
        return tuple(read_feature(camera, name) if available(camera, name) else otherwise for name in (first, other))

    size = pair("WidthMax", "HeightMax", None)
    return Readout(
        x,
        y,
        binning=tuple(camera.get_binning()) if available(camera, "BinningHorizontal") else (1, 1),
        decimation=pair("DecimationHorizontal", "DecimationVertical", 1),
        mirrored=pair("ReverseX", "ReverseY", False),
        sensor_size=None if None in size else size,
    )


def temperature_c(camera: Any) -> float | None:
    """Return the temperature of the device in degrees Celsius, None if it has none; raises errors of Aravis."""
    name = available(camera, *_TEMPERATURES)
    return None if name is None else float(camera.get_float(name))


def layout_of(settings: CameraSettings) -> PixelFormat:
    """Return the current pixel format; raises CameraSettingError if labcdp does not support it."""
    try:
        return pixel_format(settings.pixel_format)
    except InputError as error:
        raise CameraSettingError(str(error)) from error


def exposure_range_s(camera: Any) -> tuple[float, float]:
    """Return the shortest and longest exposure in seconds; raises errors of Aravis."""
    low_us, high_us = _bounds(camera, _exposure(camera))
    return low_us * 1e-6, high_us * 1e-6


def _exposure(camera: Any) -> str:
    """Name of the exposure time in us. Aravis takes the range of an older Basler from a register in other units."""
    name = available(camera, *_EXPOSURES)
    if name is None:
        raise CameraSettingError(f"the camera has none of {', '.join(_EXPOSURES)}", "use another camera")
    return name


def _bounds(camera: Any, name: str) -> tuple[float, float]:
    is_whole = isinstance(read_feature(camera, name), int)
    low, high = camera.get_integer_bounds(name) if is_whole else camera.get_float_bounds(name)
    return low, high


def configure(link: Link, wanted: Mapping[str, Any]) -> list[str]:
    """Change settings in a valid order; if the camera rejects one, all are restored.

    The camera must not be acquiring; `wanted` are parameters of `AravisCamera.configure`. Returns the names of the
    changed settings, in order.

    Raises
    ------
    CameraSettingError
        If the camera has no such setting, or rejects the value.
    """
    with link.using("its settings cannot be read") as camera:
        before = read_settings(camera)
    try:
        names = _in_order(wanted, before)
        for name in names:
            with link.using(f"{name} cannot be changed") as camera:
                change_setting(camera, name, wanted[name])
    except CameraSettingError as error:
        # A binning changes the region, too.
        touched = {*wanted, "region"} if "binning" in wanted else wanted
        old = {name: value for name in touched if (value := getattr(before, name, None)) is not None}
        with link.using("its settings cannot be read") as camera:
            now = read_settings(camera)
        for name in _in_order(old, now):
            with suppress(CameraSettingError), link.using(f"{name} cannot be set back") as camera:
                change_setting(camera, name, old[name])
        raise CameraSettingError(f"{link.identity}", f"{error}") from error
    return names


def _in_order(wanted: Mapping[str, Any], now: CameraSettings) -> list[str]:
    order = list(_CHANGERS)
    # Frame rate and exposure limit each other: change the one that relaxes the other first.
    if wanted.get("exposure_s", 0.0) > now.exposure_s:
        order[3], order[4] = order[4], order[3]
    unknown = sorted(wanted.keys() - set(order))
    if unknown:
        raise CameraSettingError(f"{unknown[0]} is not a setting", f"use {', '.join(order)}, or set a feature by name")
    return [name for name in order if name in wanted]


def change_setting(camera: Any, name: str, value: Any) -> None:
    """Change one setting, a parameter of `AravisCamera.configure`, of a camera that does not acquire.

    Raises errors of Aravis, and CameraSettingError if the camera has no such setting or rejects the value; the message
    states the accepted values.
    """
    _CHANGERS[name](camera, value)


def _change_pixel_format(camera: Any, name: str) -> None:
    known = [known for known in camera.dup_available_pixel_formats_as_strings() if known in PIXEL_FORMATS]
    if name not in known:
        raise CameraSettingError(f"the camera has no pixel format {name!r}", f"choose one of {', '.join(known)}")
    camera.set_pixel_format_from_string(name)


def _change_binning(camera: Any, binning: tuple[int, int]) -> None:
    if available(camera, "BinningHorizontal") is None:
        if tuple(binning) != (1, 1):
            raise CameraSettingError("the camera has no binning", f"ask for (1, 1), not {tuple(binning)}")
        return
    columns, rows = binning
    x_step, y_step = camera.get_x_binning_increment(), camera.get_y_binning_increment()
    require_range("binning of columns", columns, camera.get_x_binning_bounds(), step=x_step)
    require_range("binning of rows", rows, camera.get_y_binning_bounds(), step=y_step)
    camera.set_binning(columns, rows)
    show_whole_sensor(camera)


def _change_region(camera: Any, region: Region) -> None:
    before = camera.get_region()
    show_whole_sensor(camera)
    try:
        require_range("width", region.width, camera.get_width_bounds(), step=camera.get_width_increment())
        require_range("height", region.height, camera.get_height_bounds(), step=camera.get_height_increment())
        _, _, width, height = camera.get_region()
        if (region.x, region.y) != (0, 0) and available(camera, "OffsetX") is None:
            raise CameraSettingError("the camera has no offset", f"ask for x and y 0, not {region.x} and {region.y}")
        require_range("x", region.x, (0, width - region.width), step=camera.get_x_offset_increment())
        require_range("y", region.y, (0, height - region.height), step=camera.get_y_offset_increment())
    except CameraSettingError:
        camera.set_region(*before)
        raise
    camera.set_region(region.x, region.y, region.width, region.height)


def _change_exposure(camera: Any, exposure_s: float) -> None:
    require_range("exposure_s", exposure_s, exposure_range_s(camera), "s")
    # Rounded: a camera with whole microseconds would truncate 1000.9999999 to 1000.
    _write_number(camera, _exposure(camera), round(exposure_s * 1e6, 3))


def _change_frame_rate(camera: Any, frame_rate_hz: float) -> None:
    switch = available(camera, *_FRAME_RATE_SWITCHES)
    if switch is not None and not read_feature(camera, switch):
        write_feature(camera, switch, True)
    if writable(camera, _FRAME_RATE_AUTO):
        write_feature(camera, _FRAME_RATE_AUTO, "Off")
    name = available(camera, *_FRAME_RATES)
    if name is None:
        raise CameraSettingError("the camera has no frame rate to set", f"leave out frame_rate_hz {frame_rate_hz:g}")
    require_range("frame_rate_hz", frame_rate_hz, camera.get_float_bounds(name), "Hz")
    # Aravis' own function would switch triggers off.
    camera.set_float(name, frame_rate_hz)


def _change_gain(camera: Any, gain_db: float) -> None:
    name = _gain(camera)
    if name is None:
        if gain_db != 0:
            other = available(camera, _GAIN, _ABSOLUTE_GAIN, _RAW_GAIN)
            state = "no gain" if other is None else f"its gain not in dB but as {other}, a feature to set by name"
            raise CameraSettingError(f"the camera has {state}", f"ask for 0 dB, not {gain_db:g} dB")
        return
    require_range("gain_db", gain_db, _bounds(camera, name), "dB")
    _write_number(camera, name, gain_db)


def _change_black_level(camera: Any, black_level: float) -> None:
    name = available(camera, *_BLACK_LEVELS)
    if name is None or not writable(camera, name):
        now = _black_level(camera)
        if black_level != now:
            raise CameraSettingError("the camera's black level cannot be set", f"ask for {now:g}, not {black_level:g}")
        return
    require_range("black_level", black_level, _bounds(camera, name))
    _write_number(camera, name, black_level)


def _write_number(camera: Any, name: str, value: float) -> None:
    """Write a number that some cameras have as a whole one."""
    write_feature(camera, name, round(value) if isinstance(read_feature(camera, name), int) else value)


#: How each setting is changed, in an order that the camera accepts.
_CHANGERS: Final[dict[str, Callable[[Any, Any], None]]] = {
    "pixel_format": _change_pixel_format,
    "binning": _change_binning,
    "region": _change_region,
    "exposure_s": _change_exposure,
    "frame_rate_hz": _change_frame_rate,
    "gain_db": _change_gain,
    "black_level": _change_black_level,
    "trigger": change_trigger,
}
