"""Result records of the contrast detection probability."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.percent import plain_contrast, plain_fraction
from ..core.result import Finding, html_table, number
from .contrast import ContrastDefinition, Epsilon, TargetContrast


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
    findings : tuple of Finding
        From `cdp_correlated`: regions in which correlation cannot be told from chance, ``a`` or ``b``.
    """

    bright: Literal["a", "b"]
    bright_size: int | None
    dark_size: int | None
    correlation_inflation: float
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class NeighbourCdp(DetectionResult):
    """Nearest-neighbour contrast detection probability; see `DetectionResult` for the fields before this.

    Parameters
    ----------
    pairs : int
        Number of pairs of neighbours.
    """

    pairs: int


_T = TypeVar("_T", float, NDArray[np.float64])


class Interval(NamedTuple, Generic[_T]):
    """Lower and upper end of an interval, scalars or arrays."""

    low: _T
    high: _T


@dataclass(frozen=True, eq=False)
class DetectionProbability(Generic[_T]):
    """Contrast detection probability (CDP) of one contrast, or of an array of them.

    All values are floats where the contrast was a number, and arrays of its shape where it was an array. Shares are
    fractions of all pairs.

    Parameters
    ----------
    cdp : float or ndarray
        Share of pairs whose contrast counts as detected.
    u : float or ndarray
        Its standard uncertainty by the finite number of pixels; nan where there are too few.
    interval : Interval
        95 % interval of `cdp`: ``low, high = result.interval``; nan where `u` is nan.
    below, above : float or ndarray
        Share of pairs with a lower or a higher contrast; `below` + `cdp` + `above` is 1.
    undefined : float or ndarray
        Share of pairs in which no pixel is above 0; they are part of `below`.
    contrast : float or ndarray
        Target contrast, a fraction.
    detected : Interval
        Lowest and highest contrast that counts as detected; -inf or inf for an end that is open.
    epsilon : float or DetectionInterval
        Relative tolerance of the contrast.
    definition : {'weber', 'michelson'}
        Definition of the contrast.
    pairs : int or None
        Number of pairs; None where the weights of a `Distribution` are not counts.
    swapped : bool
        Whether the region given as dark has the larger mean and was used as the bright one; False for neighbours.
    findings : tuple of Finding
        ``pixels-correlated`` with the factor by which correlated noise raised `u`, and ``region-correlation-unknown``
        for a region of too few pixels; for parts of images only.
    """

    cdp: _T
    u: _T
    interval: Interval[_T]
    below: _T
    above: _T
    undefined: _T
    contrast: _T
    detected: Interval[_T]
    epsilon: Epsilon
    definition: ContrastDefinition
    pairs: int | None
    swapped: bool = False
    findings: tuple[Finding, ...] = ()

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        columns = (self.contrast, self.cdp, self.interval.low, self.interval.high, self.u, self.below, self.above)
        rows = zip(*(np.ravel(column) for column in columns), strict=True)
        head = ("contrast", "CDP", "95 % from", "to", "u", "below", "above")
        return html_table(head, [[number(value) for value in row] for row in rows])


def asked_contrasts(
    contrast: ArrayLike, epsilon: Epsilon | str, definition: ContrastDefinition
) -> tuple[list[TargetContrast], tuple[int, ...]]:
    """Return the contrasts of a number or an array as a flat sequence, and the shape.

    Raises
    ------
    InputError
        If one is not a number or out of range.
    """
    plain = _plain(contrast)
    try:
        array = np.asarray(plain)
    except ValueError:
        # Lists of different lengths.
        array = np.asarray(None)
    if array.dtype.kind not in "iuf":
        raise InputError(f"contrast is {_shown(contrast)}: give fractions, or percentages such as '50%'")
    # A number is used as its shortest decimal, which for float32 differs from that of the nearest float64.
    return [TargetContrast(float(str(one)), plain_fraction(epsilon), definition) for one in array.ravel()], array.shape


def _plain(contrast: Any) -> Any:
    """Return contrasts with percentages as fractions; raises InputError for percentages without their sign."""
    if isinstance(contrast, np.ndarray):
        return np.reshape(_plain(contrast.tolist()), contrast.shape) if contrast.dtype.kind in "iuUO" else contrast
    return (
        [_plain(one) for one in contrast]
        if isinstance(contrast, list | tuple)
        else plain_contrast(contrast, "contrast")
    )


def joined(
    results: Sequence[DetectionResult],
    asked: Sequence[TargetContrast],
    shape: tuple[int, ...],
    epsilon: Epsilon | str,
    definition: ContrastDefinition,
    pairs: int | None,
    findings: tuple[Finding, ...] = (),
    swapped: bool = False,
) -> DetectionProbability[Any]:
    """Join the results of contrasts, scalars for the shape ()."""

    def values(of: Callable[[DetectionResult], float]) -> Any:
        array = np.array([of(result) for result in results], dtype=np.float64).reshape(shape)
        return array if shape else float(array)

    contrasts = np.array([one.contrast for one in asked], dtype=np.float64).reshape(shape)
    return DetectionProbability(
        cdp=values(lambda one: one.cdp),
        u=values(lambda one: one.standard_error),
        interval=Interval(*(values(lambda one, end=end: one.confidence_interval[end]) for end in (0, 1))),  # type: ignore[misc]
        below=values(lambda one: one.below),
        above=values(lambda one: one.above),
        undefined=values(lambda one: one.undefined),
        contrast=contrasts if shape else float(contrasts),
        detected=Interval(*(values(lambda one, end=end: one.interval[end]) for end in (0, 1))),  # type: ignore[misc]
        epsilon=plain_fraction(epsilon),
        definition=definition,
        pairs=pairs,
        swapped=swapped,
        findings=findings,
    )


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
