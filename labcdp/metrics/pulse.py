"""A pulsed lamp as frames see it: its light over the phase is a trapezoid, the pulse averaged over the exposure.

A rolling shutter averages the trapezoid over the rows of a region, which begin one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]

#: The trapezoid is right if the mean square of the residuals exceeds that of the noise by no more than this many
#: standard deviations of chance.
_BY_CHANCE = 5.0
#: Least noise, relative to the modulation: rounding.
_LEAST_NOISE_REL = 1e-6
#: Share of the variance that the best trapezoid of those leaves at most, besides this many times that of the noise.
_MOST_UNEXPLAINED, _MOST_OF_NOISE = 0.5, 2.0
#: Ends of the trapezoid that are tried first.
_ENDS = np.linspace(0, 0.5, 26)
#: Usual correction of the rate, to which it stays near where the frames do not tell, as of a locked lamp.
_USUAL_RATE = 0.02
#: Rows of a rolling shutter: their share of the ramp at first, with its step; the least ramp that is begun with; and
#: by how much they must lower the sum of squares.
_SHARE_OF_ROWS, _SHARE_STEP, _LEAST_RAMP, _SIGNIFICANT_ROWS = 0.5, 0.1, 0.02, 9.0
#: Periods below which ramp and rows are none.
_LEAST_ROWS = 1e-6
#: Steps of the fit at most.
_MOST_STEPS = 40
#: Steps in which the parameters of `Pulse` are looked for: of phases, and of levels relative to the modulation.
_PHASE_STEP, _LEVEL_STEP = 0.02, 0.1


@dataclass(frozen=True)
class Pulse:
    """Light of a pulsed lamp in a frame over its phase: even at the top and at the base, with a ramp between them.

    With a rolling shutter it is the mean of such trapezoids, shifted by up to `rows`.

    Parameters
    ----------
    centre : float
        Phase of the middle of the top, in periods.
    top, base : float
        Phases from the middle to the end of the top, and to where the base begins, up to 0.5.
    low, high : float
        Light at the base and at the top.
    rows : float
        Periods of the lamp from the start of the first row to that of the last one; 0 for a global shutter.
    rate : float
        Correction of the rate of the beat, in periods over the recording.
    drift : float
        Relative change of the light over the recording.
    u_drift : float
        Its standard uncertainty.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics.pulse import Pulse
    >>> Pulse(0.5, 0.1, 0.2, low=1.0, high=3.0).light(np.array([0.0, 0.35, 0.5])).round(3).tolist()
    [1.0, 2.0, 3.0]
    """

    centre: float
    top: float
    base: float
    low: float
    high: float
    rows: float = 0.0
    rate: float = 0.0
    drift: float = 0.0
    u_drift: float = inf

    def light(self, phases: _Array) -> _Array:
        """Light at phases in periods, without the drift."""
        if self.rows == 0:
            return self.low + (self.high - self.low) * _trapezoid(phases, self.centre, self.top, self.base)
        shape = _Mean.over(phases - self.centre, self.top, self.base - self.top, self.rows).shape
        return self.low + (self.high - self.low) * shape


def fit_pulse(phases: _Array, times: _Array, values: _Array, noise: _Array) -> Pulse | None:
    """Fit the light of a pulsed lamp to frames, with the rate of the beat and the drift of the light.

    Rows of a rolling shutter are part of it where the frames show them.

    Parameters
    ----------
    phases : ndarray of float, shape (n,)
        Phases of the frames in periods.
    times : ndarray of float, shape (n,)
        Their times over the recording, -0.5 to 0.5.
    values : ndarray of float, shape (n,)
        Their light.
    noise : ndarray of float, shape (n,)
        Standard deviation of the noise of each.

    Returns
    -------
    Pulse or None
        None if no pulsed lamp has this light within its noise.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics.pulse import Pulse, fit_pulse
    >>> phases = np.random.default_rng(0).random(100)
    >>> light = Pulse(0.3, 0.1, 0.2, low=1.0, high=3.0).light(phases)
    >>> pulse = fit_pulse(phases, np.linspace(-0.5, 0.5, 100), light, np.zeros(100))
    >>> round(pulse.low, 4), round(pulse.high, 4), round(pulse.top, 4)
    (1.0, 3.0, 0.1)
    """
    from scipy.optimize import least_squares

    start, unexplained = _start(phases, times, values)
    # The start explains all but the noise, and what its coarse steps leave.
    if unexplained > _MOST_UNEXPLAINED + _MOST_OF_NOISE * float((noise**2).mean() / values.var()):
        return None
    modulation = float(np.ptp(values))
    weight = 1 / np.maximum(noise, _LEAST_NOISE_REL * modulation)

    def residuals(parameters: _Array) -> _Array:
        centre, top, ramp, low, span, rate, drift = parameters
        shape = _trapezoid(phases + rate * times, centre, top, top + ramp)
        return np.append(((low + span * shape) * (1 + drift * times) - values) * weight, rate / _USUAL_RATE)

    def jacobian(parameters: _Array) -> _Array:
        centre, top, ramp, low, span, rate, drift = parameters
        distance = (phases + rate * times - centre + 0.5) % 1 - 0.5
        shape = np.clip((top + ramp - np.abs(distance)) / max(ramp, 1e-9), 0, 1)
        slope = np.where((shape > 0) & (shape < 1), span / max(ramp, 1e-9), 0.0)
        inner = slope * np.sign(distance)
        level = 1 + drift * times
        columns = inner, slope, slope * (1 - shape), np.ones(values.size), shape, -inner * times
        light = (low + span * shape) * times
        rows = np.column_stack([*(column * level * weight for column in columns), light * weight])
        return np.vstack([rows, [0, 0, 0, 0, 0, 1 / _USUAL_RATE, 0]])

    def residuals_of_rows(parameters: _Array) -> _Array:
        centre, top, ramp, low, span, rate, drift, share = parameters
        mean = _Mean.over(phases + rate * times - centre, top, ramp, share * ramp)
        return np.append(((low + span * mean.shape) * (1 + drift * times) - values) * weight, rate / _USUAL_RATE)

    def jacobian_of_rows(parameters: _Array) -> _Array:
        centre, top, ramp, low, span, rate, drift, share = parameters
        mean = _Mean.over(phases + rate * times - centre, top, ramp, share * ramp)
        level = (1 + drift * times) * weight
        by_ramp = span * (mean.by_ramp + share * mean.by_rows)
        columns = (
            -span * mean.by_phase, span * mean.by_top, by_ramp, np.ones(values.size), mean.shape,
            span * mean.by_phase * times,
        )  # fmt: skip
        light = (low + span * mean.shape) * times * weight
        rows = np.column_stack([*(column * level for column in columns), light, span * ramp * mean.by_rows * level])
        return np.vstack([rows, [0, 0, 0, 0, 0, 1 / _USUAL_RATE, 0, 0]])

    steps = [_PHASE_STEP] * 3 + [_LEVEL_STEP * modulation] * 2 + [_PHASE_STEP] * 2
    limits = [-2, 0, 0, -inf, 0, -1, -0.9], [2, 0.5, 0.5, inf, inf, 1, 0.9]
    fit = least_squares(residuals, start, jacobian, x_scale=steps, bounds=limits, max_nfev=_MOST_STEPS)
    share = 0.0
    if 2 * fit.cost / values.size > 1 - sqrt(2 / values.size):
        more = [*fit.x[:2], max(float(fit.x[2]), _LEAST_RAMP), *fit.x[3:], _SHARE_OF_ROWS]
        of_rows = least_squares(
            residuals_of_rows, more, jacobian_of_rows, x_scale=[*steps, _SHARE_STEP],
            bounds=([*limits[0], 0], [*limits[1], 1]), max_nfev=_MOST_STEPS,
        )  # fmt: skip
        if 2 * (fit.cost - of_rows.cost) > _SIGNIFICANT_ROWS * max(1.0, 2 * of_rows.cost / values.size):
            fit, share = of_rows, float(of_rows.x[-1])
    if not 2 * fit.cost / values.size < 1 + _BY_CHANCE * sqrt(2 / values.size):
        return None
    centre, top, ramp, low, span, rate, drift = fit.x[:7].tolist()
    slopes: _Array = np.asarray(fit.jac, dtype=np.float64)
    u_drift = sqrt(max(float(np.linalg.pinv(slopes.T @ slopes)[6, 6]), 0.0))
    return Pulse(centre, top, top + ramp, low, low + span, share * ramp, rate, drift, u_drift)


class _Mean(NamedTuple):
    """Mean of a trapezoid over shifts, from 0 at the base to 1 at the top, and its derivatives."""

    shape: _Array
    by_phase: _Array
    by_top: _Array
    by_ramp: _Array
    by_rows: _Array

    @classmethod
    def over(cls, phases: _Array, top: float, ramp: float, rows: float) -> _Mean:
        """Average the trapezoid whose middle is at phase 0 over shifts of -rows / 2 to rows / 2."""
        rows, ramp = max(rows, _LEAST_ROWS), max(ramp, _LEAST_ROWS)
        ends = phases + rows / 2, phases - rows / 2
        (after, after_by_top, after_by_ramp, light_after), (before, before_by_top, before_by_ramp, light_before) = (
            _integral(end, top, ramp) for end in ends
        )
        shape = (after - before) / rows
        return cls(
            shape,
            (light_after - light_before) / rows,
            (after_by_top - before_by_top) / rows,
            (after_by_ramp - before_by_ramp) / rows,
            ((light_after + light_before) / 2 - shape) / rows,
        )


def _integral(phases: _Array, top: float, ramp: float) -> tuple[_Array, _Array, _Array, _Array]:
    """Return the integral of the trapezoid from its middle on, its derivatives by top and ramp, and the trapezoid."""
    periods = np.rint(phases)
    rest = phases - periods
    distance, sign = np.abs(rest), np.sign(rest)
    shape = np.clip((top + ramp - distance) / ramp, 0, 1)
    integral = np.minimum(distance, top) + ramp / 2 * (1 - shape**2)
    return (
        (2 * top + ramp) * periods + sign * integral,
        2 * periods + sign * (1 - shape),
        periods + sign * (1 - shape) ** 2 / 2,
        shape,
    )


def _trapezoid(phases: _Array, centre: float, top: _Array | float, base: _Array | float) -> _Array:
    distance = np.abs((phases - centre + 0.5) % 1 - 0.5)
    return np.clip((base - distance) / np.maximum(np.asarray(base) - top, 1e-9), 0, 1)


def _start(phases: _Array, times: _Array, values: _Array) -> tuple[list[float], float]:
    """Return the best of some trapezoids about the centre of the light, and the share of the variance it leaves.

    A linear drift of the light is explained, too.
    """
    moment = np.sum((values - values.min()) * np.exp(2j * np.pi * phases))
    centre = float(np.angle(moment) / (2 * np.pi))
    tops, bases = (ends.ravel() for ends in np.meshgrid(_ENDS, _ENDS, indexing="ij"))
    tops, bases = tops[tops < bases, None], bases[tops < bases, None]
    shapes = _trapezoid(phases, centre, tops, bases)
    means, variances = shapes.mean(axis=1), np.maximum(shapes.var(axis=1), 1e-12)
    covariances = np.maximum(shapes @ (values - values.mean()) / values.size, 0)
    best = int(np.argmax(covariances**2 / variances))
    span = max(float(covariances[best] / variances[best]), 1e-9 * float(np.ptp(values)))
    top, base = float(tops[best, 0]), float(bases[best, 0])
    low = float(values.mean() - span * means[best])
    light = low + span * shapes[best]
    rest, late = values - light, light * times
    rest = rest - late * float(rest @ late) / float(late @ late)
    return [centre, top, base - top, low, span, 0.0, 0.0], float(rest.var() / values.var())
