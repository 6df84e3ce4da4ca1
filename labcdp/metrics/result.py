"""Result records of the contrast detection probability."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .interval import ContrastDefinition, Epsilon


@dataclass(frozen=True)
class DetectionResult:
    """Share of pairs of pixels whose contrast counts as detected; all shares are fractions of all pairs.

    Parameters
    ----------
    cdp : float
        Share of pairs whose contrast lies in `interval`, ends included.
    standard_error : float
        Standard error of `cdp`; nan where there are too few pixels.
    confidence_interval : (float, float)
        95 % interval of `cdp`; (nan, nan) where the standard error is nan.
    contrast : float
        Target contrast.
    epsilon : float or DetectionInterval
        Its tolerance.
    definition : {'weber', 'michelson'}
        Definition of the contrast.
    interval : (float, float)
        Lowest and highest contrast that counts as detected; -inf or inf for an end that is open.
    below, above : float
        Share of pairs with a lower or a higher contrast; `below` + `cdp` + `above` is 1.
    undefined : float
        Share of pairs in which no pixel is above 0; they are part of `below`.
    """

    cdp: float
    standard_error: float
    confidence_interval: tuple[float, float]
    contrast: float
    epsilon: Epsilon
    definition: ContrastDefinition
    interval: tuple[float, float]
    below: float
    above: float
    undefined: float


@dataclass(frozen=True)
class CdpResult(DetectionResult):
    """Contrast detection probability between two regions; see `DetectionResult` for the fields before these.

    The standard error assumes independent pixels, unless it is from `cdp_correlated`. It is nan if a region has one
    pixel only or weights that are not counts.

    Parameters
    ----------
    bright : {'a', 'b'}
        Which region was the bright one.
    bright_size, dark_size : int or None
        Pixels of the two regions; None if the weights are not counts.
    correlation_inflation : float
        Factor by which noise correlated from pixel to pixel raised the standard error; 1 if it was not estimated.
    """

    bright: Literal["a", "b"]
    bright_size: int | None
    dark_size: int | None
    correlation_inflation: float


@dataclass(frozen=True)
class NeighbourCdp(DetectionResult):
    """Nearest-neighbour contrast detection probability; see `DetectionResult` for the fields before this.

    Parameters
    ----------
    pairs : int
        Number of pairs of neighbours.
    """

    pairs: int
