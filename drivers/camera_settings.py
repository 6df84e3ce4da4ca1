"""Settings of a camera: those in force, those of a measurement, and their parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import isfinite
from typing import Any, Literal

from ..core.frame import Readout

#: Whether missing packets of a stream are asked for again.
PacketResend = Literal["always", "never"]
#: Value of a GenICam feature.
FeatureValue = bool | int | float | str


@dataclass(frozen=True)
class FeatureDescription:
    """A GenICam feature as it is now.

    Parameters
    ----------
    name : str
        GenICam name.
    value : bool, int, float or str
        Its value.
    writable : bool
        Whether it can be changed now.
    unit : str
        Unit as the camera states it; empty if it states none.
    limits : (float, float) or None
        Lowest and highest value of a number; None if they are not known.
    choices : tuple of str
        Values of an enumeration.

    Examples
    --------
    >>> from labcdp.drivers.camera_settings import FeatureDescription
    >>> FeatureDescription("Gain", 0.0, writable=True, unit="dB", limits=(0.0, 33.0)).limits
    (0.0, 33.0)
    """

    name: str
    value: FeatureValue
    writable: bool = False
    unit: str = ""
    limits: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()


def json_features(features: Mapping[str, FeatureValue]) -> dict[str, FeatureValue]:
    """Return features as values JSON can hold: numbers that are not finite become text.

    Examples
    --------
    >>> from labcdp.drivers.camera_settings import json_features
    >>> json_features({"Gain": 0.0, "Temperature": float("nan")})
    {'Gain': 0.0, 'Temperature': 'nan'}
    """
    return {
        name: repr(value) if isinstance(value, float) and not isfinite(value) else value
        for name, value in features.items()
    }


@dataclass(frozen=True)
class Trigger:
    """Trigger of an exposure.

    Parameters
    ----------
    source : str or None
        None for free-running; ``Software`` for a command from this computer; else the camera's name of a line,
        for example ``Line1`` (SFNC TriggerSource).
    activation : {'RisingEdge', 'FallingEdge', 'AnyEdge', 'LevelHigh', 'LevelLow'}
        Active edge or level of the line (SFNC TriggerActivation); ignored for other sources.

    Examples
    --------
    >>> from labcdp.drivers.camera_settings import Trigger
    >>> Trigger("Line1").activation
    'RisingEdge'
    """

    source: str | None = None
    activation: Literal["RisingEdge", "FallingEdge", "AnyEdge", "LevelHigh", "LevelLow"] = "RisingEdge"


FREE_RUN = Trigger()
SOFTWARE_TRIGGER = Trigger("Software")


@dataclass(frozen=True)
class Region:
    """Part of the sensor that is read out, in pixels after binning (SFNC OffsetX, OffsetY, Width, Height).

    Parameters
    ----------
    x, y : int
        First column and row.
    width, height : int
        Size.

    Examples
    --------
    >>> from labcdp.drivers.camera_settings import CameraSetup, Region
    >>> CameraSetup(region=Region(x=100, y=40, width=640, height=480)).settings["region"].width
    640
    """

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class CameraSetup:
    """Settings of a measurement besides exposure, gain and pixel format; None leaves those after opening.

    Parameters
    ----------
    binning : (int, int) or None
        Columns and rows to bin.
    region : Region or None
        Part of the sensor to read out.
    frame_rate_hz : float or None
        Frame rate of a free-running camera.
    black_level : float or None
        Register of the black level.
    trigger : Trigger or None
        Trigger of an exposure.
    features : mapping of str to bool, int, float or str
        GenICam features by name, set last.
    packet_resend : {'always', 'never'} or None
        Whether missing packets are asked for again.

    Examples
    --------
    >>> from labcdp.drivers.camera_settings import CameraSetup
    >>> CameraSetup(binning=(2, 2), black_level=4.0).settings
    {'binning': (2, 2), 'black_level': 4.0}
    """

    binning: tuple[int, int] | None = None
    region: Region | None = None
    frame_rate_hz: float | None = None
    black_level: float | None = None
    trigger: Trigger | None = None
    features: Mapping[str, FeatureValue] = field(default_factory=dict)
    packet_resend: PacketResend | None = None

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of the camera that are given, by name."""
        others = ("features", "packet_resend")
        return {f.name: v for f in fields(self) if f.name not in others and (v := getattr(self, f.name)) is not None}


#: Tolerated delay of a frame beyond its exposure and period, for a busy computer. A camera that stops answering is
#: noticed earlier.
FRAME_ALLOWANCE_S = 10.0


@dataclass(frozen=True)
class CameraSettings:
    """Settings in effect.

    Parameters
    ----------
    exposure_s, gain_db : float
        Exposure time in seconds and analogue gain in decibels.
    pixel_format : str
        GenICam PFNC name.
    width, height : int
        Size of a frame in pixels.
    readout : Readout
        Part of the sensor that is read out, and how.
    black_level : float
        Value of the camera's register, in its own unit, which need not be DN of the pixel format; 0 without one.
    frame_rate_hz : float or None
        Frame rate of a free-running camera; None if unknown.
    trigger : Trigger
        Trigger of an exposure.

    Examples
    --------
    >>> from labcdp.drivers import CameraSettings
    >>> CameraSettings(exposure_s=0.01, gain_db=0.0, pixel_format="Mono12", width=2452, height=2056).pixel_format
    'Mono12'
    """

    exposure_s: float
    gain_db: float
    pixel_format: str
    width: int
    height: int
    readout: Readout = field(default_factory=Readout)
    black_level: float = 0.0
    frame_rate_hz: float | None = None
    trigger: Trigger = FREE_RUN

    @property
    def region(self) -> Region:
        """Part of the sensor that is read out."""
        return Region(int(self.readout.x), int(self.readout.y), self.width, self.height)

    @property
    def binning(self) -> tuple[int, int]:
        """Columns and rows that are binned."""
        return self.readout.binning

    def longest_wait_s(self, timeout_s: float | None = None, overload: float = 1.0) -> float:
        """Return how long to wait for a frame: the exposure time and `timeout_s`, None for a default.

        The default leaves the frame period and `FRAME_ALLOWANCE_S`, longer by the factor of the computer's `overload`.
        """
        if timeout_s is not None:
            return self.exposure_s + timeout_s
        period_s = 1 / self.frame_rate_hz if self.frame_rate_hz and self.trigger == FREE_RUN else 0.0
        return self.exposure_s + period_s + FRAME_ALLOWANCE_S * overload
