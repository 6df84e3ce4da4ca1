"""Signals, and the protocols of stages and sensors, which hand on values with their inverse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.result import html_table, number
from .parameters import GAIN, Number, Parameters, Temperature


@dataclass(frozen=True)
class ExposureSettings(Parameters):
    """One exposure, or a bracket of several of the same scene.

    Parameters
    ----------
    exposure_s : float or sequence of float
        Exposure time in seconds, or several different ones. Held as a tuple.
    gain_db : float
        Analogue gain in dB.
    temperature_c : float
        Temperature of the sensor in degrees Celsius.

    Raises
    ------
    InputError
        If no time is given, one is not above 0, two are equal, or another value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import ExposureSettings
    >>> ExposureSettings((0.016, 0.002)).exposure_s
    (0.016, 0.002)
    """

    exposure_s: tuple[float, ...] = field(metadata={"single": True})
    gain_db: Annotated[float, GAIN] = 0.0
    temperature_c: Temperature = 25.0

    def __post_init__(self) -> None:
        given: Any = self.exposure_s
        given = given.tolist() if isinstance(given, np.ndarray) else given
        times = tuple(given) if isinstance(given, Sequence) and not isinstance(given, str | bytes) else (given,)
        if not times:
            raise InputError("exposure_s is empty: give one exposure time in s, or several")
        for time in times:
            Number("s", 1e-7, 100).check("exposure_s", time)
        if len(set(times)) < len(times):
            raise InputError(f"exposure_s has the times {list(times)} s, of which two are equal: give each time once")
        super().__post_init__()
        object.__setattr__(self, "exposure_s", tuple(float(time) for time in times))


Values = NDArray[Any]

#: Heads of a table of signals.
SIGNAL_HEADS = ("quantity", "size", "lowest", "mean", "highest")
#: Quantities a signal can be of, with their units.
UNITS = {"luminance": "cd/m²", "illuminance": "lx", "digital number": "DN"}


@dataclass(frozen=True, eq=False)
class Signal:
    """Values after a stage.

    Parameters
    ----------
    values : ndarray, shape (height, width), or (cells, levels) with `shares`
        In the unit of the quantity.
    quantity : {'luminance', 'illuminance', 'digital number'}
        Quantity of the values.
    to_luminance : callable
        Takes values of this quantity and returns the luminance in cd/m^2 in front of the whole chain, of their shape.
    shares : ndarray of float or None, shape (cells, levels)
        None for an image. Otherwise the values are levels of luminance that a scene consists of, and these are the
        shares of its area they take; a row is a scene of its own.
    saturated : ndarray of bool or None
        Digital numbers that say at most a lowest luminance; None if nothing can be saturated.
    oversampling : int
        Values on each side of a pixel; above 1 for a scene that is sampled finer, up to the optics.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.chain import Signal
    >>> behind = Signal(np.array([[5.0, 10.0]]), "luminance", to_luminance=lambda values: values / 0.5)
    >>> behind.luminance_cd_m2.tolist(), behind.unit
    ([[10.0, 20.0]], 'cd/m²')
    """

    values: Values
    quantity: str
    to_luminance: Callable[[Values], Values]
    shares: NDArray[np.float64] | None = None
    saturated: NDArray[np.bool_] | None = None
    oversampling: int = 1

    def __repr__(self) -> str:
        return f"<Signal {self.quantity} in {self.unit}, shape {self.values.shape}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return html_table(SIGNAL_HEADS, [self.summary])

    @property
    def summary(self) -> tuple[str, ...]:
        """Quantity, size, and lowest, mean and highest value, as texts under `SIGNAL_HEADS`."""
        size = " x ".join(map(str, reversed(self.values.shape)))
        values = (f"{number(float(of(self.values)))} {self.unit}" for of in (np.min, np.mean, np.max))
        return (self.quantity, size, *values)

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return UNITS[self.quantity]

    @property
    def luminance_cd_m2(self) -> Values:
        """Luminance of the scene recovered from the signal, calculated anew each time to save memory."""
        return self.to_luminance(self.values)

    def scene_mean(self) -> float | NDArray[np.float64]:
        """Mean over the scene: a number for an image, shape (cells, 1) for levels."""
        if self.shares is None:
            return float(self.values.mean(dtype=np.float64))
        mean: NDArray[np.float64] = (self.values * self.shares).sum(axis=-1, keepdims=True)
        return mean


def scene_signal(luminance_cd_m2: Values, shares: NDArray[np.float64] | None = None, oversampling: int = 1) -> Signal:
    """Return the luminance of a scene, which is its own inverse; parameters as those of `Signal`."""
    return Signal(luminance_cd_m2, "luminance", lambda luminance: luminance, shares, oversampling=oversampling)


@dataclass(frozen=True)
class Context:
    """Inputs of a stage in addition to the signal.

    Parameters
    ----------
    spectrum : str
        Spectrum of the light, as `labcdp.core.photometry` takes it.
    seed : int
        Fixes everything random of a run.
    pixel_pitch_m : float or None
        Of the sensor behind the stage; None without a sensor.
    settings : ExposureSettings or None
        Exposure settings of the sensor; None without a sensor.
    threads : int or None
        Number of threads, None for one a processor.

    Examples
    --------
    >>> from labcdp.chain import Context
    >>> Context("D65", seed=1).settings is None
    True
    """

    spectrum: str
    seed: int = 0
    pixel_pitch_m: float | None = None
    settings: ExposureSettings | None = None
    threads: int | None = None


@runtime_checkable
class Stage(Protocol):
    """Protocol of stages: frozen dataclasses of their parameters with one method.

    Attributes
    ----------
    takes, gives : str
        Quantity of the signal it takes and of that it returns, keys of `UNITS`.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.chain import Context, Signal, Stage, Windscreen
    >>> stage: Stage = Windscreen(transmittance=0.8)
    >>> scene = Signal(np.array([[10.0, 20.0]]), "luminance", to_luminance=lambda values: values)
    >>> stage.process(scene, Context("D65")).values.round(3).tolist()
    [[8.0, 16.0]]
    """

    takes: ClassVar[str]
    gives: ClassVar[str]

    def process(self, signal: Signal, context: Context) -> Signal:
        """Return the signal behind the stage, with its inverse; changes nothing in place."""


@dataclass(frozen=True, eq=False)
class Capture:
    """One exposure, or several merged into one, in digital numbers.

    Parameters
    ----------
    dn : ndarray, shape (height, width)
        Digital numbers; whole, or not for some merges.
    exposure_s : float
        Exposure time in seconds; of a merge, that of the exposure whose scale it has.
    black_level_dn : float
        DN of dark signal without dark current; 0 for a merge.
    dark_dn : float
        Mean DN of dark signal at this exposure and temperature, black level and dark current included.
    dn_per_lx : float
        Slope of the mean DN over the illuminance on the pixel.
    saturation_dn : float
        DN from which a pixel counts as saturated.
    k_dn_per_e : float
        Overall system gain, DN per electron.
    dark_noise_dn : float
        Standard deviation of the temporal noise at zero exposure, DN.
    sensitivity_s : float or None
        Signal in DN over that of a second with the sensor's own photodiode and gain, by which captures are merged;
        None for the exposure time.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.chain import Capture
    >>> capture = Capture(np.array([[164, 4095]]), 0.01, 64.0, 64.0, 10.0, 4095.0, k_dn_per_e=0.6, dark_noise_dn=2.0)
    >>> float(capture.illuminance_lx(capture.dn)[0, 0]), capture.saturated.tolist()
    (10.0, [[False, True]])
    """

    dn: NDArray[Any]
    exposure_s: float
    black_level_dn: float
    dark_dn: float
    dn_per_lx: float
    saturation_dn: float
    k_dn_per_e: float
    dark_noise_dn: float
    sensitivity_s: float | None = None

    @property
    def sensitivity(self) -> float:
        """Signal in DN over that of a second with the sensor's own photodiode and gain."""
        return self.exposure_s if self.sensitivity_s is None else self.sensitivity_s

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Which pixels are saturated, shape (height, width)."""
        return self.dn >= self.saturation_dn

    def illuminance_lx(self, dn: NDArray[Any]) -> NDArray[np.floating[Any]]:
        """Illuminance in lux from digital numbers of this exposure, shape as `dn`; noise may make it negative."""
        return (np.asarray(dn, dtype=np.float32) - np.float32(self.dark_dn)) / np.float32(self.dn_per_lx)


@runtime_checkable
class SensorModel(Protocol):
    """Protocol of sensor models: frozen dataclasses of their parameters with these members.

    Examples
    --------
    >>> from labcdp.chain import Chain, SensorModel
    >>> ((_, sensor),) = Chain.load("manta-g505").sensors
    >>> isinstance(sensor, SensorModel)
    True
    """

    @property
    def pixel_pitch_m(self) -> float:
        """Distance of pixel centres in metres."""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""

    def capture(self, signal: Signal, context: Context, index: int) -> Capture:
        """Take one exposure.

        Parameters
        ----------
        signal : Signal
            Illuminance on each pixel in lux.
        context : Context
            Spectrum, seed and settings.
        index : int
            Index of the exposure in the settings; each exposure has noise of its own.

        Raises
        ------
        InputError
            If the signal has another shape than the sensor, or the context no settings.
        """


def digital_signal(capture: Capture, before: Signal) -> Signal:
    """Return the digital numbers of a capture as a signal; `before` is the illuminance that was exposed."""
    # The numbers themselves are not kept alive twice by the inverse.
    without_dn = replace(capture, dn=capture.dn[:0])
    return replace(
        before,
        values=capture.dn,
        quantity="digital number",
        to_luminance=lambda dn: before.to_luminance(without_dn.illuminance_lx(dn)),
        saturated=capture.saturated,
    )


def check_shape(signal: Signal, shape: tuple[int, int]) -> None:
    """Refuse a signal that has not one value for each pixel of a sensor; raises InputError."""
    if signal.values.shape != shape:
        raise InputError(
            f"the scene has the shape {signal.values.shape}, the sensor has {shape}: give both the same "
            "width and height"
        )


def settings_of(context: Context) -> ExposureSettings:
    """Return the exposure settings; raises InputError without any."""
    if context.settings is None:
        raise InputError("no exposure is set: add exposure_s, one time in s or several")
    return context.settings
