"""Flicker of a lamp in a video: how the light of a region changes from frame to frame, in three indices."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isfinite, nan, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.disk.files import shown
from ..core.errors import InputError
from ..core.quantity import Z_95, Interval, Quantity
from .arrays import light_array, numeric_array
from .beat import FEWEST_BEATS, Wave, find_wave, smoothed

_Array = NDArray[np.float64]

#: Fewest phases of the lamp by which flicker is known.
FEWEST_PHASES = 20.0
#: Simulated recordings that intervals are made of, at most and at least, and values of all of them.
_REPEATS, _FEWEST_REPEATS, _MOST_VALUES = 400, 100, 4_000_000
#: Values of them that are held at once, and simulated recordings for the bias of smoothing.
_VALUES_AT_ONCE, _SMOOTHED_AGAIN = 1_000_000, 32
#: Frames by which the interval of a share is wider, for the light that its steps follow from is not known exactly.
_SHARE_MARGIN = 0.05
#: Phases at which the light of a wave is averaged.
_GRID = 8192
#: Quantiles of a normal distribution, by which the noise of simulated recordings differs.
_NORMAL_QUANTILES = (-1.2816, -0.5244, 0.0, 0.5244, 1.2816)
_NOISES = len(_NORMAL_QUANTILES)
#: Part of the distance of frames by which times may be rounded.
_ROUNDED = 0.2
#: Lags of a correlation that are added up are above this many of their standard deviations.
_SIGNIFICANT_LAG = 2.0
#: Width of the middle quarter of a normal distribution, in standard deviations.
_QUARTER_OF_NORMAL = 0.637
#: Of the largest of n values: standard deviation in those of the values; and how far beyond it the largest possible one
#: may lie (95 %), in distances to the tenth largest: of n values at random, 3.7 / n of all are beyond.
_U_OF_LARGEST, _TENTH, _BEYOND = 0.45, 10, 0.37


@dataclass(frozen=True)
class Flicker:
    """Flicker of a region, by the values of its frames.

    Parameters
    ----------
    fmi : Quantity
        Flicker modulation index: (maximum - minimum) / (maximum + minimum).
    fdi : Quantity
        Flicker detection index: share of the frames whose light is above that of the lamp when it is off by more than
        `threshold` of the latter; nan if that is not above 0.
    mmp : Quantity
        Modulation mitigation probability: share of the frames that differ from the mean by less than `tolerance` of it.
    maximum, minimum, mean : float
        Of the frames that have a value.
    n_frames, n_evaluated : int
        Frames, and those that have a value.
    off, threshold, tolerance : float
        As they were given.
    wave : Wave or None
        The light over the phase of the lamp; None if it does not repeat.
    frame_interval_s : float
        Usual distance of the frames; nan where no times were given.

    Examples
    --------
    >>> from labcdp.metrics import flicker
    >>> lamp = flicker([1.0, 1.0, 2.0, 3.0])
    >>> lamp.fmi.value, lamp.mmp.value, lamp.n_evaluated, lamp.few_phases
    (0.5, 0.0, 4, True)
    """

    fmi: Quantity
    fdi: Quantity
    mmp: Quantity
    maximum: float
    minimum: float
    mean: float
    n_frames: int
    n_evaluated: int
    off: float
    threshold: float
    tolerance: float
    wave: Wave | None = None
    frame_interval_s: float = nan

    @property
    def n_phases(self) -> float:
        """Equivalent number of phases of the lamp that were seen; the frames, if their light does not repeat."""
        return float(self.n_evaluated) if self.wave is None else self.wave.n_phases

    @property
    def few_phases(self) -> bool:
        """Whether fewer than 20 phases were seen, or fewer than 1.5 beats."""
        return self.n_phases < FEWEST_PHASES or (self.wave is not None and self.wave.n_beats < FEWEST_BEATS)

    @property
    def beat_hz(self) -> float:
        """Frequency at which the lamp beats with the frame rate; nan if it is not known."""
        return nan if self.wave is None else self.wave.rate / self.frame_interval_s

    @property
    def drift(self) -> Quantity:
        """Relative change of the light over the recording, apart from the beat; nan if it is not known."""
        return Quantity(nan, nan) if self.wave is None else Quantity(self.wave.drift, self.wave.u_drift)

    @property
    def flickers(self) -> bool:
        """Whether the frames differ by more than their noise."""
        return self.fmi.interval.low > 0


def flicker(
    values: ArrayLike,
    off: float | Quantity = 0.0,
    threshold: float = 0.1,
    tolerance: float = 0.1,
    *,
    times_s: ArrayLike | None = None,
    frequency_hz: float | None = None,
    u: float | None = None,
) -> Flicker:
    """Return the flicker of a region in a video: FMI, FDI and MMP as of IEEE 2020, with their uncertainty.

    Parameters
    ----------
    values : array_like of float, shape (n,)
        Mean of the region in each frame, linear in light and without black level; nan for a frame without one.
    off : float or Quantity
        Mean with the lamp off, in the unit of the values. Without it, or if it is 0, there is no FDI.
    threshold : float
        Relative excess over `off` from which a frame shows the lamp, for the FDI.
    tolerance : float
        Relative deviation from the mean up to which a frame counts as not modulated, for the MMP.
    times_s : array_like of float, shape (n,) or None
        Start of each frame; None for frames at equal distances.
    frequency_hz : float or None
        Frequency of the lamp, where it is known: a lamp that is locked to the frames is noticed by it alone. It needs
        the times.
    u : float or None
        Standard deviation of a frame's value by noise, for light that does not repeat; None if it is not known.

    Returns
    -------
    Flicker

    Raises
    ------
    InputError
        If the values are no numbers in one dimension, the times do not increase or differ in number, or a limit is not
        above 0.

    Notes
    -----
    The values are what the definitions give, noise included. The intervals are for the indices of the lamp over all
    its phases: of the FMI without noise, of FDI and MMP with that of a frame. Lamp and frames beat, so that frames
    are not independent: their phases follow from the beat, by which 400 recordings (100 of long ones) with other
    first phases and other noise are simulated; how their indices differ from those over all phases gives the
    interval. A drift of the light that is significant is part of them. Parts of the period that no frame has seen
    widen the interval by what might be there. Where the light does not repeat, as of a lamp with a phase at random,
    frames count as independent as far as they are not correlated.

    Examples
    --------
    >>> import numpy as np
    >>> import labcdp
    >>> phases = np.arange(300) * 90 / 29.97 % 1  # a lamp of 90 Hz, frames at 29.97 Hz
    >>> lamp = labcdp.flicker(np.where(phases < 0.2, 1.0, 0.1), off=0.1)  # that is on for a fifth of the period
    >>> round(lamp.fmi.value, 3), round(lamp.mmp.value, 3), round(lamp.fdi.value, 2)
    (0.818, 0.0, 0.22)
    >>> lamp.few_phases  # the frames have seen 0.9 beats
    True
    """
    x, times = _checked(values, times_s)
    off_light = off if isinstance(off, Quantity) else Quantity(_number(off, "off", zero=True), 0.0)
    bands = _Bands(_number(threshold, "threshold"), _number(tolerance, "tolerance"))
    positions, interval_s = (np.arange(x.size, dtype=np.float64), nan) if times is None else _positions(times)
    rate = None if frequency_hz is None else _rate_of(_number(frequency_hz, "frequency_hz"), interval_s)
    known = np.isfinite(x)
    signal = x[known]
    wave, low, high, mean = None, nan, nan, nan
    fmi = fdi = mmp = Quantity(nan, nan, note="no frame has a value")
    if signal.size:
        low, high, mean = float(signal.min()), float(signal.max()), float(signal.mean())
        measured = _Indices(*(float(index[0]) for index in bands.indices(signal[None], np.array([off_light.value]))))
        wave = find_wave(positions[known], signal, rate)
        fmi, fdi, mmp = (
            _independent_indices(signal, measured, u)
            if wave is None
            else _wave_indices(wave, measured, off_light, bands)
        )
    return Flicker(
        fmi, fdi, mmp, high, low, mean, x.size, signal.size, off_light.value, *bands, wave=wave,
        frame_interval_s=interval_s,
    )  # fmt: skip


def _positions(times: _Array) -> tuple[_Array, float]:
    """Return the times of frames in their usual distance, and that distance.

    Containers round times: where the distances are whole numbers of frames within that, frames are taken as regular.
    """
    if times.size < 2:
        return np.zeros(times.size), nan
    steps = np.diff(times)
    interval_s = float(np.median(steps))
    n_frames = np.rint(steps / interval_s)
    if np.abs(steps / interval_s - n_frames).max() < _ROUNDED and n_frames.min() > 0:
        positions = np.concatenate([[0.0], np.cumsum(n_frames)])
        return positions, float((times[-1] - times[0]) / positions[-1])
    return (times - times[0]) / interval_s, interval_s


def _rate_of(frequency_hz: float, interval_s: float) -> float:
    """Return the periods of the beat for each frame."""
    if not isfinite(interval_s):
        raise InputError("frequency_hz is given without times_s: give the times of the frames")
    return abs(frequency_hz * interval_s - round(frequency_hz * interval_s))


class _Indices(NamedTuple):
    """FMI, FDI and MMP, numbers or of several recordings."""

    fmi: float
    fdi: float
    mmp: float


class _Bands(NamedTuple):
    """Relative limits of FDI and MMP."""

    threshold: float
    tolerance: float

    def indices(self, values: _Array, off: _Array) -> tuple[_Array, _Array, _Array]:
        """FMI, FDI and MMP of each row; nan where they are not defined."""
        mean = values.mean(axis=1)
        on = (values > (off * (1 + self.threshold))[:, None]).mean(axis=1)
        even = (np.abs(values - mean[:, None]) < self.tolerance * mean[:, None]).mean(axis=1)
        return modulation(values), np.where(off > 0, on, nan), np.where(mean > 0, even, nan)

    def over_all_phases(self, light: _Array, noise: _Array, off: float) -> tuple[float, float, float]:
        """FMI without noise, and FDI and MMP with normal noise, of the light over the phase."""
        from scipy.special import ndtr

        mean, noise = float(light.mean()), np.maximum(noise, 1e-12 * float(np.abs(light).max()))
        on = float(ndtr((light - off * (1 + self.threshold)) / noise).mean()) if off > 0 else nan
        low, high = mean * (1 - self.tolerance), mean * (1 + self.tolerance)
        even = float((ndtr((high - light) / noise) - ndtr((low - light) / noise)).mean())
        return float(modulation(light)), on, even


def modulation(values: _Array) -> _Array:
    """Return (maximum - minimum) / (maximum + minimum) along the last axis; nan without light.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics.modulation import modulation
    >>> float(modulation(np.array([1.0, 2.0, 3.0])))
    0.5
    """
    high, low = values.max(axis=-1), values.min(axis=-1)
    ratio = np.divide(high - low, high + low, out=np.full(np.shape(high), nan), where=high + low > 0)
    return np.asarray(ratio)


def _wave_indices(wave: Wave, measured: _Indices, off: Quantity, bands: _Bands) -> list[Quantity]:
    """Return the indices with the intervals that simulated recordings give."""
    rng = np.random.default_rng(0)
    light, noise = wave.at((np.arange(_GRID) + 0.5) / _GRID)
    bias = 0.0
    if wave.pulse is None:
        # Smoothing leaves some noise at the ends, or takes something from them.
        again = wave.smooth + wave.noise * rng.standard_normal((_SMOOTHED_AGAIN, wave.values.size))
        bias = abs(float(modulation(smoothed(again, wave.noise)).mean() - modulation(wave.smooth)))
    level = 1 + wave.drift * wave.times if wave.has_drift else 1.0
    n_repeats = min(max(_MOST_VALUES // wave.values.size, _FEWEST_REPEATS), _REPEATS)
    shifts = (rng.permutation(n_repeats) + rng.random(n_repeats)) / n_repeats
    n_parts = _NOISES * -(-wave.values.size * n_repeats // (_NOISES * _VALUES_AT_ONCE))
    errors = []
    for index, part in enumerate(np.array_split(shifts, n_parts)):
        # The noise is known as well as that many frames tell.
        with_noise = noise * exp(wave.u_noise_rel * _NORMAL_QUANTILES[index % _NOISES])
        at = ((wave.phases + part[:, None]) % 1 * _GRID).astype(np.intp) % _GRID
        values = (light[at] + with_noise[at] * rng.standard_normal(at.shape)) * level
        off_values = np.full(part.size, off.value) + off.u_known * rng.standard_normal(part.size)
        simulated = bands.indices(values, off_values if off.value > 0 else np.zeros(part.size))
        truth = bands.over_all_phases(light, with_noise, off.value)
        errors.append(np.array(simulated) - np.array([truth]).T + [[bias], [0.0], [0.0]])
    unseen = 1.0
    if wave.n_beats >= FEWEST_BEATS:
        unseen = float(np.maximum(wave.gaps - 1 / FEWEST_PHASES, 0).sum())
    margins = [0.0, *[_SHARE_MARGIN / wave.values.size] * 2]
    samples = [value - error for value, error in zip(measured, np.concatenate(errors, axis=1), strict=True)]
    return [
        _quantity(value, true_values, unseen, margin)
        for value, true_values, margin in zip(measured, samples, margins, strict=True)
    ]


def _quantity(value: float, samples: _Array, unseen: float, margin: float) -> Quantity:
    """Return an index with its interval by samples of the true one, a margin of shares, and what was not seen."""
    is_fmi = margin == 0
    if not isfinite(value) or not np.isfinite(samples).all():
        return _undefined(is_fmi)
    # The interval holds the value, of which noise may be the larger part.
    below = float((samples < value).mean())
    first = below if below < 0.025 else max(below - 0.95, 0.025) if below > 0.975 else 0.025
    low, high = np.quantile(samples, [first, first + 0.95]).tolist()
    low, high = min(low - margin, value), max(high + margin, value)
    if unseen > 0:
        # What was not seen may be brighter and darker, up to no light at all.
        low, high = (low, 1.0) if is_fmi else (low - unseen, high + unseen)
    return Quantity(value, float(samples.std()), ends=Interval(max(low, 0.0), max(min(high, 1.0), value)))


def _undefined(is_fmi: bool) -> Quantity:
    return Quantity(nan, nan, note="no light" if is_fmi else "no light of the lamp when it is off")


def _independent_indices(values: _Array, measured: _Indices, u: float | None) -> list[Quantity]:
    """Return the indices with the intervals of frames at random."""
    n_independent = values.size / _inflation(values)
    quantities = [_fmi_at_random(values, measured.fmi, u)]
    for share in (measured.fdi, measured.mmp):
        if not isfinite(share):
            quantities.append(_undefined(is_fmi=False))
            continue
        deviation = sqrt(share * (1 - share) / n_independent)
        quantities.append(Quantity(share, deviation, ends=_wilson(share, n_independent)))
    return quantities


def _fmi_at_random(values: _Array, value: float, u: float | None) -> Quantity:
    """Return the FMI of frames at random, whose largest value may be noise, and need not be the largest possible."""
    if not isfinite(value):
        return _undefined(is_fmi=True)
    unknown = u is None
    if u is None:
        u = float(values.std(ddof=1)) if values.size > 1 and _is_normal(values) else _most_noise(values)
    (high, beyond_high), (low, beyond_low) = _largest(values, u), _largest(-values, u)
    middle, half = (high - low) / 2, max((high + low) / 2, 0.0)
    if middle <= 0:
        return Quantity(value, nan, ends=Interval(0.0, max(1.0, value)))
    u_half, beyond = _U_OF_LARGEST * u / sqrt(2), (beyond_high + beyond_low) / 2
    lower, upper = max(half - Z_95 * u_half, 0.0) / middle, (half + Z_95 * u_half + beyond) / middle
    if unknown:
        upper = max(upper, value + beyond / middle)
    return Quantity(value, u_half / middle, ends=Interval(min(lower, value), max(min(upper, 1.0), value)))


def _largest(values: _Array, u: float) -> tuple[float, float]:
    """Return the largest value without its noise, and how far a larger one may lie beyond."""
    from scipy.special import ndtri

    largest = np.sort(values)[::-1]
    n_near = int((largest > largest[0] - 4 * u).sum())
    # Expected largest of normal values (G. Blom, Statistical Estimates and Transformed Beta-Variables, 1958).
    excess = u * max(float(ndtri((n_near - 0.375) / (n_near + 0.25))), 0.0)
    spread = float(largest[0] - largest[min(_TENTH, largest.size - 1)])
    return float(largest[0]) - excess, _BEYOND * spread if spread > 4 * u else 0.0


def _most_noise(values: _Array) -> float:
    """Return the standard deviation that noise has at most, by the shortest range of a quarter of the values."""
    ordered = np.sort(values)
    n_quarter = max(ordered.size // 4, 2)
    if ordered.size <= n_quarter:
        return 0.0
    return float((ordered[n_quarter:] - ordered[:-n_quarter]).min()) / _QUARTER_OF_NORMAL


def _is_normal(values: _Array) -> bool:
    """Whether skewness and kurtosis are those of normal noise."""
    deviations = values - values.mean()
    variance = float((deviations**2).mean())
    if variance == 0:
        return True
    skewness = float((deviations**3).mean()) / variance**1.5
    kurtosis = float((deviations**4).mean()) / variance**2
    return abs(skewness) < 4 * sqrt(6 / values.size) and abs(kurtosis - 3) < 4 * sqrt(24 / values.size)


def _inflation(values: _Array) -> float:
    """Return by how much correlation of the frames raises the variance of their mean."""
    deviations = values - values.mean()
    total = float(deviations @ deviations)
    inflation = 1.0
    for lag in range(1, values.size // 4):
        correlation = float(deviations[lag:] @ deviations[:-lag]) / total if total else 0.0
        if correlation < _SIGNIFICANT_LAG / sqrt(values.size):
            break
        inflation += 2 * correlation
    return inflation


def _wilson(share: float, n: float) -> Interval:
    """Return the 95 % interval of a share (E. B. Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    squared = Z_95**2 / n
    centre = (share + squared / 2) / (1 + squared)
    half = sqrt(squared * (share * (1 - share) + squared / 4)) / (1 + squared)
    return Interval(max(min(centre - half, share), 0.0), min(max(centre + half, share), 1.0))


def _checked(values: ArrayLike, times_s: ArrayLike | None) -> tuple[_Array, _Array | None]:
    x = light_array(values, "values")
    if x.ndim != 1:
        raise InputError(f"values has the shape {x.shape}: give one for each frame")
    if times_s is None:
        return x, None
    times = numeric_array(times_s, "times_s").astype(np.float64)
    if times.shape != x.shape:
        raise InputError(f"times_s has the shape {times.shape} and values {x.shape}: give a time for each frame")
    if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
        raise InputError("times_s does not increase: give the times of the frames in their order")
    return x, times


def _number(value: float, name: str, zero: bool = False) -> float:
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.number) or not isfinite(value):
        raise InputError(f"{name} is {shown(value)}: give a number")
    if not (value > 0 or zero):
        raise InputError(f"{name} is {value:g}: give a number above 0")
    return float(value)
