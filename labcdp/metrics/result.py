"""The record of a contrast detection probability."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.percent import plain_contrast, plain_fraction
from ..core.quantity import Interval, Number, as_number
from ..core.result import Finding, html_table, number
from .contrast import ContrastDefinition, DetectionInterval, Epsilon, checked_contrast, detected_contrasts
from .uncertainty import confidence_interval


@dataclass(frozen=True, eq=False)
class Cdp(Generic[Number]):
    """Contrast detection probability (CDP) of one target contrast, or of an array of them.

    All values are floats where the contrast was a number, and arrays of its shape where it was an array. Shares are
    fractions of all pairs. An array of contrasts can be indexed and iterated over.

    Parameters
    ----------
    contrast : float or ndarray
        Target contrast, a fraction.
    detected_range : Interval
        Lowest and highest contrast that counts as detected; -inf or inf for an end that is open.
    cdp : float or ndarray
        Share of pairs whose contrast counts as detected.
    below, above : float or ndarray
        Share of pairs with a lower or a higher contrast; `below` + `cdp` + `above` is 1.
    undefined : float or ndarray
        Share of pairs in which no pixel is above 0; they are part of `below`.
    u_pixels : float or ndarray
        Standard uncertainty of `cdp` by the finite number of pixels; nan where there are too few, or weights that are
        not counts.
    interval : Interval
        95 % interval of `cdp`: ``low, high = result.interval``; nan where `u_pixels` is nan.
    epsilon : float or DetectionInterval
        Relative tolerance of the contrast.
    definition : {'weber', 'michelson'}
        Definition of the contrast.
    pairs : int or None
        Number of pairs; None where the weights of a `Distribution` are not counts.
    correlation_inflation : float or ndarray
        Factor by which noise correlated from pixel to pixel raised `u_pixels`; 1 if it was not estimated.
    u_calibration : float or ndarray
        Standard uncertainty of `cdp` by the calibration; 0 for arrays.
    n_bright, n_dark : int or None
        Pixels of the bright and of the dark region; None for neighbours, and where `pairs` is None.
    swapped : bool
        Whether the region given as dark has the larger mean and was used as the bright one; False for neighbours.
    findings : tuple of Finding
        ``pixels-correlated`` with the factor by which correlated noise raised `u_pixels`, and
        ``region-correlation-unknown`` for a region of too few pixels; for parts of images only.

    Examples
    --------
    >>> import labcdp
    >>> result = labcdp.cdp([120, 121, 119, 120], [100, 101, 99, 100], [0.1, 0.2], epsilon=0.2)
    >>> result.cdp
    array([0., 1.])
    >>> [f"{one.contrast:.0%}: {one.cdp:.2f}" for one in result]
    ['10%: 0.00', '20%: 1.00']
    """

    contrast: Number
    detected_range: Interval[Number]
    cdp: Number
    below: Number
    above: Number
    undefined: Number
    u_pixels: Number
    interval: Interval[Number]
    epsilon: Epsilon
    definition: ContrastDefinition
    pairs: int | None
    correlation_inflation: Number
    u_calibration: Number
    n_bright: int | None = None
    n_dark: int | None = None
    swapped: bool = False
    findings: tuple[Finding, ...] = ()

    @property
    def u(self) -> Number:
        """Standard uncertainty of `cdp`, by pixels and calibration."""
        u: Number = as_number(np.hypot(self.u_pixels, self.u_calibration))
        return u

    def with_calibration(self, variance: ArrayLike) -> Cdp[Number]:
        """Return the probability with a variance by the calibration, independent of the pixels."""
        u_calibration = as_number(np.broadcast_to(np.sqrt(variance), np.shape(self.cdp)))
        interval = confidence_interval(self.cdp, np.square(self.u_pixels) + variance, self._independent_pixels)
        return replace(self, u_calibration=u_calibration, interval=interval)

    def unanswered(self) -> Cdp[Number]:
        """Return the record with nan for all that saturated pixels do not show.

        They show a lower limit of the light: whether a pair has the contrast is not known.
        """
        unknown = as_number(np.full(np.shape(self.cdp), np.nan))
        changed: dict[str, Any] = dict.fromkeys(_OF_PAIRS, unknown)
        return replace(self, interval=Interval(unknown, unknown), **changed)

    @property
    def _independent_pixels(self) -> Any:
        """Effective number of independent pixels of the smaller region."""
        if self.n_bright is None or self.n_dark is None:
            # A pixel is part of up to four pairs of neighbours.
            return np.nan if self.pairs is None else self.pairs / 4
        return min(self.n_bright, self.n_dark) / np.square(self.correlation_inflation)

    def _each(self, change: Callable[[NDArray[np.float64]], Any]) -> Cdp[Any]:
        """Return the record with all its arrays changed."""
        changed: dict[str, Any] = {name: change(np.asarray(getattr(self, name))) for name in _ARRAYS}
        for name in _INTERVALS:
            changed[name] = Interval(*(change(np.asarray(end)) for end in getattr(self, name)))
        return replace(self, **changed)

    def reshape(self, shape: tuple[int, ...]) -> Cdp[Any]:
        """Return the record with arrays of another shape, floats for the shape ()."""
        return self._each(lambda values: values.reshape(shape) if shape else float(values.item()))

    def __len__(self) -> int:
        return len(np.asarray(self.cdp))

    def __getitem__(self, index: int | slice) -> Cdp[Any]:
        return self._each(lambda values: as_number(values[index]))

    def __iter__(self) -> Iterator[Cdp[float]]:
        return (self[index] for index in range(len(self)))

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        columns = (self.contrast, self.cdp, self.interval.low, self.interval.high, self.u, self.below, self.above)
        rows = zip(*(np.ravel(column) for column in columns), strict=True)
        head = ("contrast", "CDP", "95 % from", "to", "u", "below", "above")
        return html_table(head, [[number(value) for value in row] for row in rows])


#: Fields of `Cdp` that follow from the values of the pixels.
_OF_PAIRS = ("cdp", "below", "above", "undefined", "u_pixels", "u_calibration")
#: Fields of `Cdp` that are arrays over the contrasts, and those that are intervals of arrays.
_ARRAYS = (
    "contrast", "cdp", "below", "above", "undefined", "u_pixels", "correlation_inflation", "u_calibration",
)  # fmt: skip
_INTERVALS = ("detected_range", "interval")


def cdp_record(
    contrasts: Sequence[float],
    epsilon: Epsilon,
    shares: Sequence[ArrayLike],
    variances: ArrayLike,
    *,
    definition: ContrastDefinition = "weber",
    pairs: int | None,
    inflations: ArrayLike = 1.0,
    n_bright: int | None = None,
    n_dark: int | None = None,
    swapped: bool = False,
) -> Cdp[NDArray[np.float64]]:
    """Make the record from the shares of all pairs that are below, inside and above each target, and undefined.

    `variances` are those of the shares inside by the pixels, already raised by the `inflations` of correlated noise.
    """
    below, inside, above, undefined = np.array(shares, dtype=np.float64).reshape(-1, 4).T
    ends = [detected_contrasts(contrast, epsilon) for contrast in contrasts]
    return Cdp(
        contrast=np.array(contrasts, dtype=np.float64),
        detected_range=Interval(*np.array(ends, dtype=np.float64).reshape(-1, 2).T),
        cdp=inside,
        below=below,
        above=above,
        undefined=undefined,
        u_pixels=np.sqrt(np.broadcast_to(np.asarray(variances, dtype=np.float64), inside.shape)),
        interval=Interval(inside, inside),
        epsilon=epsilon if isinstance(epsilon, DetectionInterval) else float(epsilon),
        definition=definition,
        pairs=pairs,
        correlation_inflation=np.sqrt(np.broadcast_to(np.asarray(inflations, dtype=np.float64), inside.shape)),
        u_calibration=np.zeros(inside.shape),
        n_bright=n_bright,
        n_dark=n_dark,
        swapped=swapped,
    ).with_calibration(0.0)


def target_contrasts(
    contrast: ArrayLike, epsilon: Epsilon | str, definition: ContrastDefinition
) -> tuple[list[float], Epsilon, tuple[int, ...]]:
    """Return contrasts to be detected as a flat list, their tolerance as a fraction, and the shape of the contrasts.

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
    tolerance = plain_fraction(epsilon)
    # A number is used as its shortest decimal, which for float32 differs from that of the nearest float64. `str` would
    # follow NumPy's print options, which other packages change.
    decimals = (float(np.format_float_scientific(value)) for value in array.ravel())
    return [checked_contrast(decimal, tolerance, definition) for decimal in decimals], tolerance, array.shape


def _plain(contrast: Any) -> Any:
    """Return contrasts with percentages as fractions; raises InputError for percentages without their sign."""
    if isinstance(contrast, np.ndarray):
        return np.reshape(_plain(contrast.tolist()), contrast.shape) if contrast.dtype.kind in "iuUO" else contrast
    return (
        [_plain(part) for part in contrast]
        if isinstance(contrast, list | tuple)
        else plain_contrast(contrast, "contrast")
    )


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
