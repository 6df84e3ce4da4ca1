"""The beat between lamp and frame rate: the phases at which frames saw the lamp, and its light over them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, nan, sqrt

import numpy as np
from numpy.typing import NDArray

from .pulse import Pulse, fit_pulse

_Array = NDArray[np.float64]

#: Frames that the search for the beat and the fit of a pulsed lamp take at most: enough for any beat.
_MOST_SEARCHED = 4096
#: Peaks of the spectrum that may be the beat or a harmonic of it, and harmonics up to which they are taken for one.
_PEAKS, _HARMONICS = 3, 3
#: Candidates whose rate is refined, and how much rougher than the best one another may be that a pulsed lamp explains.
_REFINED, _ROUGHER = 4, 10.0
#: Steps of the search to either side.
_STEPS = np.linspace(-1, 1, 17)
#: A signal repeats if neighbours in phase differ by less than frames at random do, by this many standard deviations:
#: more than the best of all beats that are tried has by chance.
_BY_CHANCE = 5.0
#: Fewest frames of which a beat can be told.
_FEWEST = 12
#: Standard uncertainties from which a drift counts.
SIGNIFICANT = 3.0
#: Normal standard deviations per median absolute deviation.
_PER_MAD = 1.4826
#: Frames of a group that noise is estimated of, and most groups.
_PER_GROUP, _MOST_GROUPS = 40, 8
#: Windows of the smoothed light, in frames, and how many standard deviations of their noise they may disagree by.
_WINDOWS, _AGREEMENT = (1, 3, 5, 9, 17, 33, 65, 129), 3.0
#: Fewest beats in a recording by which phases are known.
FEWEST_BEATS = 1.5
#: Phases up to which a lamp that is nearly locked to the frames is recognised.
_MOST_LOCKED = 10


@dataclass(frozen=True, eq=False)
class Wave:
    """The signal of a region over the phase of a lamp, as frames saw it.

    Parameters
    ----------
    rate : float
        Periods of the beat for each frame, 0 to 0.5: the lamp's frequency over the frame rate, less whole periods, and
        counted backwards if it is more than half of one.
    length : float
        Frames from the first to the last one, including those without a value.
    times : ndarray of float, shape (n,)
        Times of the frames with a value over the recording, -0.5 to 0.5.
    phases : ndarray of float, shape (n,)
        Their phases in periods, 0 to 1.
    values : ndarray of float, shape (n,)
        Their signal, without a drift that is significant.
    drift, u_drift : float
        Relative change of the light over the recording, apart from the beat, with its standard uncertainty.
    pulse : Pulse or None
        The light of a pulsed lamp, if it describes the signal.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics.beat import find_wave
    >>> frames = np.arange(200.0)
    >>> wave = find_wave(frames, 1 + 0.5 * np.sin(2 * np.pi * 0.2345 * frames))
    >>> round(wave.rate, 4), wave.n_phases > 100
    (0.2345, True)
    """

    rate: float
    length: float
    times: _Array
    phases: _Array
    values: _Array
    drift: float = 0.0
    u_drift: float = inf
    pulse: Pulse | None = None

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """Frames in the order of their phases."""
        return np.argsort(self.phases, kind="stable")

    @cached_property
    def gaps(self) -> _Array:
        """Distances from each phase to the next one, in that order; their sum is 1."""
        phases = self.phases[self.order]
        return np.diff(phases, append=phases[0] + 1)

    @property
    def n_phases(self) -> float:
        """Equivalent number of phases at equal distances: 1 over the mean gap about a phase at random.

        Not more than 1 to 10 if the lamp is nearly locked to as many frames, with less than 1.5 beats of the slow
        change: how far the phases lie apart is not known then.
        """
        n_equivalent = 1 / float(self.gaps @ self.gaps)
        slow = np.flatnonzero(self._beats < FEWEST_BEATS)
        return min(n_equivalent, float(slow[0] + 1)) if slow.size else n_equivalent

    @property
    def n_beats(self) -> float:
        """Beats in the recording; of a lamp that is nearly locked to two to ten frames, those of its slow change."""
        return float(self._beats.min())

    @property
    def _beats(self) -> _Array:
        multiples = np.arange(1, _MOST_LOCKED + 1) * self.rate
        return np.asarray(np.abs(multiples - np.rint(multiples)) * self.length)

    @property
    def has_drift(self) -> bool:
        """Whether the drift is significant."""
        return abs(self.drift) > SIGNIFICANT * self.u_drift

    @cached_property
    def noise(self) -> _Array:
        """Standard deviation of the noise of each frame, in the order of the phases.

        By the differences from the light of the pulsed lamp, or from the mean of the neighbours in phase, which a ramp
        does not change; in groups of values, as photon noise grows with the light.
        """
        values = self.values[self.order]
        neighbours = (np.roll(values, 1) + np.roll(values, -1)) / 2
        level = neighbours if self.pulse is None else self.pulse.light(self.phases[self.order])
        groups = np.array_split(np.argsort(level, kind="stable"), self._n_groups)
        differences = np.abs(values - level)
        if self.pulse is None:
            # The variance of a difference is that of a frame and half of it.
            spread = [_PER_MAD / sqrt(1.5) * float(np.median(differences[group])) for group in groups]
        else:
            spread = [sqrt(float((differences[group] ** 2).mean())) for group in groups]
        return np.interp(level, [float(np.median(level[group])) for group in groups], spread)

    @property
    def u_noise_rel(self) -> float:
        """Relative standard uncertainty of `noise`: of a mean square, or of a median of differences that overlap."""
        per_group = max(self.values.size / self._n_groups, 1)
        return 1.4 / sqrt(per_group) if self.pulse is None else 1 / sqrt(2 * per_group)

    @property
    def _n_groups(self) -> int:
        return min(max(self.values.size // _PER_GROUP, 1), _MOST_GROUPS)

    @cached_property
    def smooth(self) -> _Array:
        """Signal without noise, in the order of the phases: that of the pulsed lamp, or `smoothed`."""
        if self.pulse is not None:
            return self.pulse.light(self.phases[self.order])
        return smoothed(self.values[self.order], self.noise)

    def at(self, phases: _Array) -> tuple[_Array, _Array]:
        """Signal without noise, and standard deviation of the noise, at any phases."""
        known = self.phases[self.order]
        noise = np.interp(phases, known, self.noise, period=1)
        if self.pulse is not None:
            return self.pulse.light(phases), noise
        return np.interp(phases, known, self.smooth, period=1), noise


def smoothed(values: _Array, noise: _Array) -> _Array:
    """Return values over a cycle without their noise.

    The mean over as many neighbours to either side, or to one, as agree with each other (A. Goldenshluger and A.
    Nemirovski, On spatially adaptive estimation of nonparametric regression, Math. Methods Stat. 6, 1997): plateaus
    become even, and steps stay.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics.beat import smoothed
    >>> values = np.array([1.1, 0.9, 1.1, 0.9, 5.0, 5.2, 5.0, 5.2, 5.0, 5.2, 5.0, 0.9])
    >>> smoothed(values, np.full(12, 0.1)).round(1)[2:6].tolist()
    [1.0, 1.0, 5.1, 5.1]
    """
    n = values.shape[-1]
    best, best_u = values.copy(), np.broadcast_to(noise, values.shape).copy()
    sums = np.cumsum(np.concatenate([np.zeros((*values.shape[:-1], 1)), *[values] * 3], axis=-1), axis=-1)
    here = np.arange(n) + n
    for to_left, to_right in ((1, 1), (1, 0), (0, 1)):
        low, high = np.full(values.shape, -inf), np.full(values.shape, inf)
        for window in _WINDOWS:
            if window > n // 4:
                break
            reach = window // 2 if to_left and to_right else window - 1
            first, last = here - reach * to_left, here + reach * to_right + 1
            mean, u = (sums[..., last] - sums[..., first]) / window, noise / sqrt(window)
            low, high = np.maximum(low, mean - _AGREEMENT * u), np.minimum(high, mean + _AGREEMENT * u)
            better = (low <= high) & (u < best_u)
            best, best_u = np.where(better, mean, best), np.where(better, u, best_u)
    return best


def find_wave(positions: _Array, values: _Array, rate: float | None = None) -> Wave | None:
    """Find the beat of a signal and the phases at which frames saw it.

    Parameters
    ----------
    positions : ndarray of float, shape (n,)
        Times of the frames over their usual distance, increasing.
    values : ndarray of float, shape (n,)
        Signal, finite.
    rate : float or None
        Periods of the beat for each frame, where it is known; it is looked for nearby only.

    Returns
    -------
    Wave or None
        None if the signal does not repeat, or too few frames tell, and the rate is not known.

    Notes
    -----
    Peaks of the spectrum give candidates; the one counts by which neighbours in phase differ least (J. Lafler and T. D.
    Kinman, An RR Lyrae star survey with the Lick 20-inch astrograph II, Astrophys. J. Suppl. 11, 1965), or which a
    pulsed lamp explains (`labcdp.metrics.pulse.fit_pulse`).

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics.beat import find_wave
    >>> find_wave(np.arange(50.0), np.random.default_rng(0).normal(size=50)) is None
    True
    """
    n = values.size
    changes = n > 1 and float(values.std()) > 1e-12 * float(np.abs(values).max())
    if n < _FEWEST or not changes:
        return None if rate is None or n < 2 else _wave(positions, values, rate, sure=True)
    signal = positions[:_MOST_SEARCHED] - positions[0], values[:_MOST_SEARCHED]
    length = float(signal[0][-1]) + 1
    candidates, harmonics = _candidates(*signal) if rate is None else (np.array([rate]), np.ones(1))
    near = [_smoothest(signal, candidate + _STEPS / length) for candidate in candidates.tolist()]
    # One with several periods would seldom be less smooth.
    likely = np.argsort(np.array([rough for _, rough in near]) * harmonics, kind="stable")[:_REFINED].tolist()
    refined = sorted(
        (rough * float(harmonics[index]), best)
        for index in likely
        for best, rough in (_refined(signal, near[index][0], 1 / length / 8),)
    )
    rates = [best for rough, best in refined if rough <= _ROUGHER * refined[0][0]]
    if rate is None:
        # The smoothest one may have several periods after all.
        multiples = [_folded(harmonic * rates[0]) for harmonic in range(2, _HARMONICS + 1)]
        rates += [_refined(signal, multiple, 1 / length / 8)[0] for multiple in multiples]
    waves = []
    for best in rates:
        if n > _MOST_SEARCHED:
            step = -(-n // _MOST_SEARCHED)
            spread = positions[::step] - positions[0], values[::step]
            best = _refined(spread, best, 2 / length / _MOST_SEARCHED)[0]
        wave = _wave(positions, values, best)
        if wave is not None and wave.pulse is not None:
            return wave
        waves += [] if wave is None else [wave]
    if waves or rate is None:
        return waves[0] if waves else None
    return _wave(positions, values, rate, sure=True)


def _wave(positions: _Array, values: _Array, rate: float, sure: bool = False) -> Wave | None:
    """Return the wave of a beat, if the signal has it or is sure to have it, with the drift of the light."""
    length = float(positions[-1] - positions[0])
    times = (positions - positions[0]) / length - 0.5
    wave = Wave(rate, length + 1, times, (positions - positions[0]) * rate % 1, values)
    if not sure and not _repeats(wave):
        return None
    if values.size < _FEWEST or not float(np.ptp(values)) > 0:
        return wave
    some = slice(None, None, -(-values.size // _MOST_SEARCHED))
    order = wave.order[some]
    pulse = fit_pulse(wave.phases[order], times[order], values[order], wave.noise[some])
    if pulse is not None:
        better = replace(wave, rate=rate + pulse.rate / length, phases=(wave.phases + pulse.rate * times) % 1)
        drift, u = pulse.drift, pulse.u_drift
    else:
        better, (drift, u) = wave, _drift_of(wave)
    level = 1 + drift * times if abs(drift) > SIGNIFICANT * u else 1.0
    return replace(better, values=values / level, drift=drift, u_drift=u, pulse=pulse)


def _repeats(wave: Wave) -> bool:
    rough = float(_roughness(wave.phases[None], wave.values)[0])
    return rough < 1 - _BY_CHANCE / sqrt(wave.values.size)


def _drift_of(wave: Wave) -> tuple[float, float]:
    """Return the drift, and its standard uncertainty, by which neighbours in phase differ."""
    apart = np.diff(wave.times[wave.order], append=wave.times[wave.order[0]])
    changes = np.diff(wave.values[wave.order], append=wave.values[wave.order[0]]) / float(wave.values.mean())
    # Steps of the wave are no drift.
    usual = np.abs(changes) <= 4 * _PER_MAD * np.median(np.abs(changes))
    weight = float(apart[usual] @ apart[usual])
    if weight == 0:
        return 0.0, inf
    drift = float(apart[usual] @ changes[usual]) / weight
    rest = changes[usual] - drift * apart[usual]
    return drift, float(sqrt(rest @ rest / max(rest.size - 1, 1) / weight))


def _candidates(positions: _Array, values: _Array) -> tuple[_Array, _Array]:
    """Rates of which one of the highest peaks of the spectrum may be a harmonic, and which one."""
    at = np.rint(positions).astype(np.intp)
    signal = np.zeros(int(at[-1]) + 1)
    signal[at] = values - values.mean()
    n_fft = 1 << int(np.ceil(np.log2(4 * signal.size)))
    power = np.abs(np.fft.rfft(signal, n_fft)) ** 2
    peaks = np.flatnonzero((power >= np.roll(power, 1)) & (power >= np.roll(power, -1)))
    highest = peaks[np.argsort(power[peaks])[::-1][:_PEAKS]] / n_fft
    tried = [
        ((sign * peak + whole) / harmonic, harmonic)
        for peak in highest
        for harmonic in range(1, _HARMONICS + 1)
        for whole in range(harmonic)
        for sign in (1, -1)
    ]
    unique = sorted({(round(_folded(rate), 9), harmonic) for rate, harmonic in tried})
    return np.array([rate for rate, _ in unique]), np.array([float(harmonic) for _, harmonic in unique])


def _folded(rate: float) -> float:
    """Return a rate between 0 and 0.5 at which frames see the same."""
    return min(rate % 1, 1 - rate % 1)


def _refined(signal: tuple[_Array, _Array], rate: float, width: float) -> tuple[float, float]:
    """Return the smoothest rate within a width, so that no phase is off by more than part of a gap; and how rough."""
    least = 0.02 / (float(signal[0][-1]) + 1) / signal[0].size
    rough = nan
    while width > least:
        rate, rough = _smoothest(signal, rate + _STEPS * width)
        width /= _STEPS.size // 2
    return rate, rough


def _smoothest(signal: tuple[_Array, _Array], rates: _Array) -> tuple[float, float]:
    """Return the rate with the smoothest wave, and how rough that is."""
    positions, values = signal
    rough = _roughness(rates[:, None] * positions % 1, values)
    at = int(np.argmin(rough))
    return float(rates[at]), float(rough[at])


def _roughness(phases: _Array, values: _Array) -> _Array:
    """Mean squared difference of neighbours in phase over that of frames at random, for each row of phases."""
    ordered = values[np.argsort(phases, axis=1)]
    squares = np.diff(ordered, axis=1, append=ordered[:, :1]) ** 2
    return np.asarray(squares.mean(axis=1) / (2 * values.var()))
