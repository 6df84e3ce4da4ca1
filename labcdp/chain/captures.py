"""Captures of a sensor, the photodiodes that they read out, and the planes of a colour filter: parameters only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from ..core.disk.files import shown
from ..core.errors import InputError
from ..core.frame import FILTER_NAMES
from ..core.photometry import QuantumEfficiency, as_quantum_efficiency
from .parameters import Bits, ElectronRate, Fraction, FullWell, Noise, Number, Parameters, Ratio, SystemGain

#: Planes of the first 2 x 2 pixels of each colour filter, row by row.
PATTERNS = {name: tuple(name) for name in FILTER_NAMES} | {"RGB-IR": ("R", "G", "IR", "B")}
#: What is looked at in place of a plane: the luminance combined of all.
LUMINANCE = "luminance"


@dataclass(frozen=True)
class ColourPlane(Parameters):
    """The pixels behind one filter.

    Parameters
    ----------
    name : str
        R, G, B, C (clear) or IR.
    quantum_efficiency : float or tuple of (float, float)
        Electrons per photon, the filter included.
    luminance_weight : float or None
        Weight in the luminance of a cell of 2 x 2 pixels, over any scale; None for those by V(lambda), or for 0 where
        another plane states one.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import ColourPlane
    >>> ColourPlane("R", [(560, 0.0), (600, 0.5), (680, 0.4)]).name
    'R'
    """

    name: str
    quantum_efficiency: QuantumEfficiency
    luminance_weight: Annotated[float | None, Number("", -100, 100)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_name(self.name, "plane")
        object.__setattr__(self, "quantum_efficiency", as_quantum_efficiency(self.quantum_efficiency))


@dataclass(frozen=True)
class Photodiode(Parameters):
    """A second photodiode in each pixel; what is not stated is that of the sensor.

    Parameters
    ----------
    name : str
        Name, by which captures refer to it.
    light_share : float
        Electrons per photon over those of the sensor's `quantum_efficiency`, which count the area: above 0, up to 1.
    quantum_efficiency : float, tuple of (float, float) or None
        Electrons per photon of a photodiode with a curve of its own, times `light_share`.
    full_well_e : float or None
        Most electrons that it holds.
    dark_current_e_s : float or None
        Mean dark current at the sensor's reference temperature, electrons per second.
    prnu_rel : float or None
        Standard deviation of the gains of these photodiodes over their mean; they are others than those of the sensor.
    dsnu_e_s : float or None
        Standard deviation of their dark currents, electrons per second; None for that of the sensor, in proportion to
        the dark current.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import Photodiode
    >>> Photodiode("small", light_share=0.01, full_well_e=7900).light_share
    0.01
    """

    name: str
    light_share: Fraction = 1.0
    quantum_efficiency: QuantumEfficiency | None = None
    full_well_e: FullWell | None = None
    dark_current_e_s: ElectronRate | None = None
    prnu_rel: Annotated[float | None, Ratio("(a fraction)", 0, 0.1)] = None
    dsnu_e_s: ElectronRate | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_name(self.name, "photodiode")
        if self.quantum_efficiency is not None:
            object.__setattr__(self, "quantum_efficiency", as_quantum_efficiency(self.quantum_efficiency))


@dataclass(frozen=True)
class CaptureSettings(Parameters):
    """One of several captures of a sensor; what is not stated is that of the sensor, or of the exposure settings.

    Captures of one photodiode with the same start and exposure time are one charge, which is read out more than once:
    they share photons and dark electrons, and have noise of reading of their own.

    Parameters
    ----------
    name : str
        Name, such as ``high gain``.
    photodiode : str
        Name of its photodiode; empty for that of the sensor itself.
    exposure_s, start_s : float
        Exposure time, None for that of the settings; and start of the exposure after that of the frame, in seconds.
    k_dn_per_e : float or None
        Overall system gain K at 0 dB, DN per electron.
    read_noise_e : float or None
        Standard deviation of the noise of reading, electrons.
    full_well_e : float or None
        Most electrons that this readout sees; None for those that the photodiode holds. A capture that reads the
        capacitor of a lateral overflow (LOFIC) too has more.
    dsnu_e : float or None
        Standard deviation of the offsets of this readout, electrons. Captures of one photodiode and one K have the same
        offsets.
    bits : int or None
        Bits of the converter.
    black_level_dn : float or None
        DN of dark signal without dark current.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import CaptureSettings
    >>> CaptureSettings("low gain", k_dn_per_e=0.18, read_noise_e=3.05).k_dn_per_e
    0.18
    """

    name: str
    photodiode: str = ""
    exposure_s: Annotated[float | None, Number("s", 1e-7, 100)] = None
    start_s: Annotated[float, Number("s", 0, 100)] = 0.0
    k_dn_per_e: SystemGain | None = None
    read_noise_e: Noise | None = None
    full_well_e: FullWell | None = None
    dsnu_e: Noise | None = None
    bits: Bits | None = None
    black_level_dn: Annotated[float | None, Number("DN", 0, 65535)] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_name(self.name, "capture")
        if not isinstance(self.photodiode, str):
            raise InputError(f"photodiode is {shown(self.photodiode)}: give its name in quotes", key="photodiode")


def _check_name(name: Any, what: str) -> None:
    if not isinstance(name, str) or not name:
        raise InputError(f"name is {shown(name)}: give the {what} a name in quotes", key="name")


def checked_parts(sensor_values: Any) -> None:
    """Refuse photodiodes and captures of a sensor that do not belong together; raises InputError."""
    for key, cls in (("photodiodes", Photodiode), ("captures", CaptureSettings), ("planes", ColourPlane)):
        parts = getattr(sensor_values, key)
        if not isinstance(parts, list | tuple) or not all(isinstance(part, cls) for part in parts):
            raise InputError(f"{key} is {shown(parts)}: give a list of labcdp.chain.{cls.__name__}", key=key)
        object.__setattr__(sensor_values, key, tuple(parts))
        names = [part.name for part in parts]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise InputError(f"{key} has {shown(twice)} twice: give each a name of its own", key=key)
    _check_filter(sensor_values)
    known = [photodiode.name for photodiode in sensor_values.photodiodes]
    for capture in sensor_values.captures:
        if capture.photodiode and capture.photodiode not in known:
            raise InputError(
                f"capture {shown(capture.name)} has the photodiode {shown(capture.photodiode)}: give "
                f"{', '.join(known) or 'none, as the sensor has no other'}",
                key="captures",
            )


def _check_filter(sensor_values: Any) -> None:
    """Refuse a colour filter without its planes, and planes without a colour filter."""
    name, plane = sensor_values.colour_filter, sensor_values.plane
    if not isinstance(name, str) or name not in ("", *PATTERNS):
        raise InputError(f"colour_filter is {shown(name)}: give one of {', '.join(PATTERNS)}", key="colour_filter")
    wanted = dict.fromkeys(PATTERNS.get(name, ()))
    stated = [plane.name for plane in sensor_values.planes]
    if sorted(stated) != sorted(wanted):
        raise InputError(
            f"planes has {', '.join(stated) or 'none'}: give {', '.join(wanted) or 'none without a colour_filter'}",
            key="planes",
        )
    curved = [part.name for part in sensor_values.photodiodes if part.quantum_efficiency is not None]
    if wanted and curved:
        raise InputError(
            f"photodiode {shown(curved[0])} has a quantum_efficiency beside the planes of a colour_filter: give its "
            "light_share instead",
            key="photodiodes",
        )
    choices = (*wanted, LUMINANCE) if wanted else ()
    if not isinstance(plane, str) or plane not in ("", *choices):
        raise InputError(
            f"plane is {shown(plane)}: give {', '.join(choices) or 'none'}, or nothing for each pixel as it is",
            key="plane",
        )
