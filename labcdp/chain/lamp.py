"""A pulsed lamp, and what frames with an exposure time see of it, in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from .parameters import Fraction, Number, Parameters, Ratio

_Array = NDArray[np.float64]

#: Distance of two phases that count as one, in periods.
_SAME_PHASE = 1e-12
#: Difference of two shares of the pulse's light that counts as none.
_SAME_LIGHT = 1e-9
#: Noise below which shares are those without noise, relative to the mean.
_NO_NOISE = 1e-12


class CaptureTime(NamedTuple):
    """Exposure time of a capture, and its start after that of the frame.

    Parameters
    ----------
    exposure_s : float
        Exposure time in seconds.
    start_s : float
        Start after that of the frame in seconds.

    Examples
    --------
    >>> from labcdp.chain import CaptureTime
    >>> CaptureTime(0.004).start_s
    0.0
    """

    exposure_s: float
    start_s: float = 0.0


@dataclass(frozen=True)
class PredictedFlicker:
    """Flicker of a lamp over all its phases, as `labcdp.flicker` measures it in frames.

    Parameters
    ----------
    fmi : float
        Flicker modulation index, without noise.
    fdi, mmp : float
        Flicker detection index, nan for a lamp without light when it is off, and modulation mitigation probability.
    maximum, minimum, mean : float
        Light of a frame relative to that of the pulse, without noise.

    Examples
    --------
    >>> from labcdp.chain import PulsedLamp
    >>> PulsedLamp(90, 0.5).flicker(1 / 180).maximum
    1.0
    """

    fmi: float
    fdi: float
    mmp: float
    maximum: float
    minimum: float
    mean: float


@dataclass(frozen=True)
class PulsedLamp(Parameters):
    """A lamp that is dimmed by pulses: its light is 1 during a part of each period, and lower in between.

    Parameters
    ----------
    frequency_hz : float
        Pulses in a second.
    duty : float
        Share of the period in which it is on, above 0, up to 1.
    off_level : float
        Light in between, and of the surroundings, relative to that of the pulse.

    Raises
    ------
    InputError
        If a value is out of its range.

    Notes
    -----
    Frames begin at any phase of the lamp with the same probability. With period T, exposure t = n T + r and pulses of b
    = D T, a frame collects o t + (1 - o)(n b + g), where g runs from max(0, r + b - T) to min(r, b) as a trapezoid over
    the phase. The mean of rows, and of captures, is a sum of such trapezoids: linear between their corners, so that its
    distribution is a mixture of uniform ones, and with normal noise the integral of the normal distribution.

    Examples
    --------
    >>> from labcdp.chain import PulsedLamp
    >>> lamp = PulsedLamp(frequency_hz=90, duty=0.1, off_level=0.1)
    >>> seen = lamp.flicker(exposure_s=0.001)
    >>> round(seen.fmi, 5), round(seen.mmp, 4), round(seen.fdi, 4)
    (0.81818, 0.0076, 0.188)
    >>> lamp.flicker(exposure_s=2 / 90).mmp  # two whole periods
    1.0
    """

    frequency_hz: Annotated[float, Number("Hz", 1e-3, 1e7)]
    duty: Fraction
    off_level: Annotated[float, Ratio("(a fraction)", 0, 1)] = 0.0

    @property
    def mean_level(self) -> float:
        """Mean of its light over a period, relative to that of the pulse."""
        return self.off_level + (1 - self.off_level) * self.duty

    def collected(self, exposure_s: float, phase: ArrayLike) -> Any:
        """Light that an exposure collects, in seconds of the pulse's light.

        Parameters
        ----------
        exposure_s : float
            Exposure time.
        phase : array_like of float
            Phase at its start, in periods after that of a pulse.

        Returns
        -------
        float or ndarray of float
            Of the shape of `phase`.

        Examples
        --------
        >>> from labcdp.chain import PulsedLamp
        >>> PulsedLamp(frequency_hz=100, duty=0.25).collected(0.004, [0.0, 0.125, 0.5]).round(5).tolist()
        [0.0025, 0.00125, 0.0]
        """
        period_s = 1 / self.frequency_hz
        start = np.asarray(phase, dtype=np.float64)
        end = start + exposure_s / period_s

        def pulses(at: _Array) -> _Array:
            """Light of the pulses from phase 0 on, in periods."""
            return np.asarray(np.floor(at) * self.duty + np.minimum(at % 1, self.duty))

        light = self.off_level * exposure_s + (1 - self.off_level) * (pulses(end) - pulses(start)) * period_s
        return light if light.ndim else float(light)

    def flicker(
        self,
        exposure_s: float | Sequence[float],
        *,
        noise_rel: float = 0.0,
        threshold: float = 0.1,
        tolerance: float = 0.1,
        n_rows: int = 1,
        row_time_s: float = 0.0,
        start_s: float | Sequence[float] = 0.0,
        weights: Sequence[float] | None = None,
    ) -> PredictedFlicker:
        """Predict the flicker of a region of frames, without random numbers.

        Parameters
        ----------
        exposure_s : float or sequence of float
            Exposure time; of several captures that are merged, that of each.
        noise_rel : float
            Standard deviation of the region's mean from frame to frame, relative to the mean over all phases. FDI and
            MMP include it, FMI does not.
        threshold, tolerance : float
            As of `labcdp.flicker`.
        n_rows : int
            Rows of the region.
        row_time_s : float
            Time by which each row of a rolling shutter begins later; 0 for a global shutter.
        start_s : float or sequence of float
            Start of each capture after that of the frame.
        weights : sequence of float or None
            Shares of the captures in the merged light, whose sum is 1; None for equal ones.

        Returns
        -------
        PredictedFlicker

        Raises
        ------
        InputError
            If a value is out of its range, or there are not as many starts and weights as captures.

        Examples
        --------
        >>> from labcdp.chain import PulsedLamp
        >>> lamp = PulsedLamp(frequency_hz=90, duty=0.1, off_level=0.1)
        >>> round(lamp.flicker(0.001, n_rows=400, row_time_s=20e-6).fmi, 3)  # rows of 8 ms
        0.385
        >>> round(lamp.flicker([0.011, 0.001], start_s=[0.0, 0.011]).mmp, 3)  # a long and a short capture
        0.016
        """
        captures = _captures(exposure_s, start_s, weights)
        if not noise_rel >= 0 or not row_time_s >= 0 or n_rows < 1 or not (threshold > 0 and tolerance > 0):
            raise InputError(
                f"noise_rel is {noise_rel:g}, row_time_s {row_time_s:g}, n_rows {n_rows}, threshold {threshold:g}, "
                f"tolerance {tolerance:g}: give noise and row time from 0 on, a row or more, and limits above 0"
            )
        phases, light = self._corners(captures, np.arange(n_rows, dtype=np.float64) * (row_time_s * self.frequency_hz))
        mean = self.mean_level
        return flicker_of_light(phases, light, mean, self.off_level, noise_rel * mean, threshold, tolerance)

    def phase_nodes(self, captures: Sequence[CaptureTime], n: int) -> _Array:
        """Return phases over a period between which the light of a frame's captures is linear.

        Parameters
        ----------
        captures : sequence of CaptureTime
            The captures.
        n : int
            Phases, about, where the light of a capture changes with the phase.

        Returns
        -------
        ndarray
            Rising from a phase to the same one of the next period.
        """
        corners = self._linear_between([(capture, np.zeros(1)) for capture in captures])
        seen = [
            self.collected(exposure_s, corners + start_s * self.frequency_hz) / exposure_s
            for exposure_s, start_s in captures
        ]
        is_even = np.all(np.abs(np.diff(seen, axis=1)) < _SAME_LIGHT, axis=0)
        lengths = np.diff(corners)
        changing = float(lengths[~is_even].sum()) or 1.0
        parts = np.where(is_even, 1, np.ceil(n * lengths / changing)).astype(int)
        part = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        inner = np.repeat(corners[:-1], parts) + part * np.repeat(lengths / parts, parts)
        return np.append(inner, corners[-1])

    def _linear_between(self, captures: Sequence[tuple[CaptureTime, NDArray[np.floating[Any]]]]) -> _Array:
        """Phases, over a period, between which the light of captures with rows that begin later is linear."""
        edges = [
            late + (start_s + change_s) * self.frequency_hz - shift
            for (exposure_s, start_s), late in captures
            for shift in (0.0, self.duty)
            for change_s in (0.0, exposure_s)
        ]
        # A frame's light changes its slope where an exposure begins or ends with a pulse.
        corners = np.unique(np.concatenate([-edge % 1 for edge in edges]))
        corners = corners[np.diff(corners, prepend=-1.0) > _SAME_PHASE]
        return np.concatenate([corners, corners[:1] + 1])

    def _corners(self, captures: Sequence[_Capture], late: NDArray[np.floating[Any]]) -> tuple[_Array, _Array]:
        """Phases from 0 to 1 between which the light of a frame is linear, and that light in them."""
        phases = self._linear_between([(CaptureTime(c.exposure_s, c.start_s), late) for c in captures])
        starts = [late + capture.start_s * self.frequency_hz for capture in captures]
        light = np.zeros(phases.size)
        for capture, start in zip(captures, starts, strict=True):
            seen = self.collected(capture.exposure_s, phases + start[:, None]).mean(axis=0)
            light += capture.weight * seen / capture.exposure_s
        return phases, light


def flicker_of_light(
    phases: _Array, light: _Array, mean: float, off: float, noise: float, threshold: float = 0.1, tolerance: float = 0.1
) -> PredictedFlicker:
    """Return the flicker of light that is linear between phases over a period.

    Parameters
    ----------
    phases, light : ndarray, shape (n,)
        Phases from one to the same of the next period, and the light of a frame at each.
    mean, off : float
        Light over all phases, and with the lamp off; 0 for none.
    noise : float
        Standard deviation of the light of a frame.
    threshold, tolerance : float
        As of `labcdp.flicker`.
    """
    distribution = _Distribution(np.diff(phases), light[:-1], light[1:], noise)
    even = distribution.below(mean * (1 + tolerance)) - distribution.below(mean * (1 - tolerance))
    on = 1 - distribution.below(off * (1 + threshold)) if off > 0 else nan
    highest, lowest = float(light.max()), float(light.min())
    return PredictedFlicker((highest - lowest) / (highest + lowest), on, even, highest, lowest, mean)


class _Capture(NamedTuple):
    exposure_s: float
    start_s: float
    weight: float


def _captures(
    exposure_s: float | Sequence[float], start_s: float | Sequence[float], weights: Sequence[float] | None
) -> list[_Capture]:
    """Return the captures of a frame; raises InputError if they do not fit together."""
    try:
        exposures = np.atleast_1d(np.asarray(exposure_s, dtype=np.float64))
        starts = np.asarray(start_s, dtype=np.float64)
        shares = np.full(exposures.shape, 1 / exposures.size) if weights is None else np.asarray(weights, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("an exposure time, a start or a weight is not a number: give times in s") from error
    if starts.ndim == 0:
        starts = np.full(exposures.shape, float(starts))
    if exposures.ndim != 1 or not starts.shape == shares.shape == exposures.shape:
        raise InputError(
            f"there are {exposures.size} exposure times, {starts.size} starts and {shares.size} weights: give as many "
            "of each"
        )
    if not ((exposures > 0) & np.isfinite(exposures) & (starts >= 0) & (shares >= 0)).all():
        raise InputError("an exposure time is not above 0, or a start or a weight below it: give times in s")
    if abs(float(shares.sum()) - 1) > 1e-9:
        raise InputError(f"the weights add up to {shares.sum():g}: give shares of the light, with a sum of 1")
    return [_Capture(*values) for values in zip(exposures.tolist(), starts.tolist(), shares.tolist(), strict=True)]


class _Distribution(NamedTuple):
    """A mixture of uniform distributions, plus normal noise."""

    shares: _Array
    starts: _Array
    ends: _Array
    noise: float

    def below(self, limit: float) -> float:
        """Probability of a value below a limit."""
        low, high = np.minimum(self.starts, self.ends), np.maximum(self.starts, self.ends)
        width = high - low
        even = width <= max(self.noise * 1e-9, float(high.max()) * 1e-12)
        if self.noise <= _NO_NOISE * float(high.max()):
            part = np.clip(np.divide(limit - low, width, out=np.zeros(width.size), where=~even), 0, 1)
            return float(self.shares @ np.where(even, low < limit, part))
        from scipy.special import ndtr

        def integral(z: _Array) -> _Array:
            """Integral of the normal distribution function."""
            return np.asarray(z * ndtr(z) + np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi))

        to_low, to_high = (limit - low) / self.noise, (limit - high) / self.noise
        sloped = np.divide(integral(to_low) - integral(to_high), to_low - to_high, out=ndtr(to_low), where=~even)
        return float(self.shares @ sloped)
