"""Signal: what flows from stage to stage, with its inverse to the luminance of the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from .exposure import ExposureSettings

Values = NDArray[Any]

#: Quantities a signal can be of, with their units.
UNITS = {"luminance": "cd/m^2", "illuminance": "lx", "digital number": "DN"}


@dataclass(frozen=True, eq=False)
class Signal:
    """Values after a stage.

    Parameters
    ----------
    values : ndarray, shape (height, width), or (cells, levels) with `shares`
        In the unit of the quantity.
    quantity : {'luminance', 'illuminance', 'digital number'}
        What the values are.
    to_luminance : callable
        Takes values of this quantity and returns the luminance in cd/m^2 in front of the whole chain, of their shape.
    shares : ndarray of float or None, shape (cells, levels)
        None for an image. Otherwise the values are levels of luminance that a scene consists of, and these are the
        shares of its area they take; a row is a scene of its own.
    saturated : ndarray of bool or None
        Digital numbers that say at most a lowest luminance; None if nothing can be saturated.
    oversampling : int
        Values on each side of a pixel; above 1 for a scene that is sampled finer, up to the optics.
    """

    values: Values
    quantity: str
    to_luminance: Callable[[Values], Values]
    shares: NDArray[np.float64] | None = None
    saturated: NDArray[np.bool_] | None = None
    oversampling: int = 1

    def __repr__(self) -> str:
        return f"<Signal {self.quantity} in {self.unit}, shape {self.values.shape}>"

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return UNITS[self.quantity]

    @property
    def luminance_cd_m2(self) -> Values:
        """Luminance of the scene as this stage knows it, calculated anew each time to save memory."""
        return self.to_luminance(self.values)

    def scene_mean(self) -> float | NDArray[np.float64]:
        """Mean over the scene: a number for an image, shape (cells, 1) for levels."""
        if self.shares is None:
            return float(self.values.mean(dtype=np.float64))
        mean: NDArray[np.float64] = (self.values * self.shares).sum(axis=-1, keepdims=True)
        return mean


@dataclass(frozen=True)
class Context:
    """Inputs of a stage in addition to the signal.

    Parameters
    ----------
    spectrum : str
        Spectrum of the light, as `labcdp.core.spectral.photometry` takes it.
    seed : int
        Fixes everything random of a run.
    pixel_pitch_m : float or None
        Of the sensor behind the stage; None without a sensor.
    settings : ExposureSettings or None
        How the sensor is exposed; None without a sensor.
    threads : int or None
        Number of threads, None for one a processor.
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
    """

    takes: ClassVar[str]
    gives: ClassVar[str]

    def process(self, signal: Signal, context: Context) -> Signal:
        """Return the signal behind the stage, with its inverse; changes nothing in place."""
