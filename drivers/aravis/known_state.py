"""Known photometric state of an Aravis camera: whole sensor, no automatics, filters or sequences, linear DN."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from ..camera import CameraSettingError
from ..camera_settings import FeatureValue
from .chunks import switch_on_chunks
from .features import available, is_same, read_feature, writable, write_feature
from .trigger import clear_triggers

#: Relative difference that a number may be rounded by.
_ROUNDED_REL = 1e-3

#: Features that are set in this order if the camera has them. The first ones lock others; a program that was killed
#: leaves the parameters of the transport layer locked.
_STATE: tuple[tuple[str, FeatureValue], ...] = (
    ("TLParamsLocked", 0),
    *((name, "Off") for name in ("SequencerMode", "ImageCompressionMode")),
    *((name, False) for name in ("SequenceEnable", "CenterX", "CenterY", "ChunkModeActive", "pgrHDRModeEnabled")),
    ("ExposureMode", "Timed"),
    *((f"{of}Auto", "Off") for of in ("Exposure", "Gain", "BlackLevel", "BalanceWhite", "Sharpness")),
    ("pgrExposureCompensationAuto", "Off"),
    ("GammaEnable", False),
    ("GammaEnabled", False),
    ("Gamma", 1.0),
    ("DigitalShift", 0),
    *((name, False) for name in ("LUTEnable", "ColorTransformationEnable", "ColorAdjustmentEnable", "FfcEnable")),
    *((name, False) for name in ("SharpeningAuto", "SharpeningEnable", "SharpnessEnabled", "DenoisingEnable")),
    *((name, False) for name in ("MedianFilter", "ProcessedRawEnable")),
    *((name, "Off") for name in ("EdgeFilter", "PgiMode", "VignettingCorrectionMode")),
    ("DecimationHorizontal", 1),
    ("DecimationVertical", 1),
    ("ReverseX", False),
    ("ReverseY", False),
    ("TestPattern", "Off"),
    ("TestImageSelector", "Off"),
)

_STATE_NAMES = frozenset(name for name, _ in _STATE)
#: Start of the names of features that `settings` and the plan set, that have no effect in the state above or on raw
#: pixels, or that change no picture, such as lines, timers and counters.
_UNDERSTOOD = (
    *("Acquisition", "Binning", "BlackLevel", "Exposure", "Height", "OffsetX", "OffsetY", "Trigger", "Width"),
    *("PixelFormat", "PixelColorFilter", "PixelCoding", "PixelDynamicRange", "PixelSize"),
    *("Auto", "Color", "DSPSubregion", "GainAuto", "GrayValueAdjustment", "Hue", "LightSource", "RgbTransform"),
    *("Saturation", "Sequence", "BalanceWhite", "TestPattern", "pgrExposureCompensation", "pgrHDR"),
    *("BandwidthControlMode", "Counter", "Device", "ExpertFeature", "Line", "LogicBlock", "ParameterSelector"),
    *("Recorder", "RemoveLimits", "Serial", "SoftwareSignal", "Strobe", "Sync", "Timer", "Transfer", "UserDefined"),
    "UserOutput",
)


#: Start of the names of features without effect if the camera has one of these switches, which are off.
_SWITCHED_OFF = {
    "Gamma": ("GammaEnable", "GammaEnabled"),
    "LUT": ("LUTEnable",),
    "Sharp": ("SharpeningEnable", "SharpnessEnabled"),
}
#: Part of the names of features that multiply the DN.
_GAIN = "gain"


def not_understood(names: Iterable[str], gains: Collection[str] = ()) -> tuple[str, ...]:
    """Return those of a camera's writable features of which labcdp does not know what they do to a picture.

    Parameters
    ----------
    names : iterable of str
        All of them.
    gains : collection of str
        Those of the gain that is read in dB; any other gain is not understood.
    """
    every = tuple(names)
    off = tuple(start for start, switches in _SWITCHED_OFF.items() if not set(switches).isdisjoint(every))

    def is_understood(name: str) -> bool:
        if _GAIN in name.casefold() and not name.startswith(("GainAuto", "Auto")):
            return name in gains
        return name in _STATE_NAMES or name.startswith((*_UNDERSTOOD, *off))

    return tuple(name for name in every if not is_understood(name))


def bring_to_known_state(camera: Any) -> None:
    """Reset what other programs left: acquisition, triggers, automatics, tone curve, binning, mirroring and region.

    Chunk data are switched on, as far as frames can be compared with them.

    Raises
    ------
    CameraSettingError
        If a feature that changes the DN keeps another value; the message names it.
    """
    camera.stop_acquisition()
    clear_triggers(camera)
    for name, value in _STATE:
        # A gamma that is switched off may keep its value: many cameras lock it then.
        is_off = name == "Gamma" and available(camera, "GammaEnable", "GammaEnabled") is not None
        if not (is_off and not writable(camera, name)):
            _require(camera, name, value)
    if available(camera, "BinningHorizontal") is not None:
        camera.set_binning(1, 1)
    show_whole_sensor(camera)
    switch_on_chunks(camera)


def show_whole_sensor(camera: Any) -> None:
    """Select the largest region: that of WidthMax and HeightMax, as not every camera has SensorWidth."""
    if available(camera, "OffsetX") is not None:
        camera.set_integer("OffsetX", 0)
        camera.set_integer("OffsetY", 0)
    camera.set_region(0, 0, camera.get_width_bounds()[1], camera.get_height_bounds()[1])


def _require(camera: Any, name: str, value: FeatureValue) -> None:
    if available(camera, name) is None or is_same(now := read_feature(camera, name), value, _ROUNDED_REL):
        return
    # Of a few old cameras a mode of exposure is something else.
    if isinstance(value, str) and value not in camera.dup_available_enumerations_as_strings(name):
        return
    if writable(camera, name):
        now = write_feature(camera, name, value)
    if not is_same(now, value, _ROUNDED_REL):
        raise CameraSettingError(
            f"feature {name} is {now} and does not accept {value}", "set it with the camera's own program"
        )
