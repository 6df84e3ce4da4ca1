"""EMVA 1288 Release 4.0 General: cameras that are not linear, or of several captures, without a model of the sensor.

The characteristic curve is the mean above dark over the stimulus. Noise at the output divided by the slope of the curve
is noise at the input: sigma_p = sigma_y / (d mu_y / d mu_p).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, log10, sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError

Array = NDArray[np.float64]
#: Definitions that were used.
DEFINITION_GENERAL = "EMVA 1288 Release 4.0 General"
#: Logarithm of the ratio of stimuli within which points determine the slope of the curve at a point.
_NEAR = log(3.0)
#: Fewest points of a local slope, of stimuli that differ.
_LEAST = 3
#: Ratio of stimuli that count as one level, and the relative fall of the SNR that is a dip: twice what noise and slope
#: of few points are known to. Judgements.
_ONE_LEVEL, _DIP_REL = 1.1, 0.1


@dataclass(frozen=True)
class GeneralPoint:
    """A point of the characteristic curve.

    Parameters
    ----------
    label : str
        Patch; empty for a data set.
    exposure_s : float
        Exposure time.
    stimulus : float
        Stimulus, in the model's unit.
    net_dn, noise_dn : float
        Mean above dark, and temporal noise of a pixel.
    slope : float
        Slope of the characteristic curve, DN per unit of the stimulus.
    noise_u_rel : float
        Relative standard uncertainty of the noise, by the number of values.
    """

    label: str
    exposure_s: float
    stimulus: float
    net_dn: float
    noise_dn: float
    slope: float
    noise_u_rel: float

    @property
    def noise_stimulus(self) -> float:
        """Noise at the input, in the unit of the stimulus."""
        return self.noise_dn / self.slope

    @property
    def snr(self) -> float:
        """SNR at the input."""
        return self.stimulus / self.noise_stimulus

    @property
    def snr_u(self) -> float:
        """Standard uncertainty of `snr` by that of the noise."""
        return self.snr * self.noise_u_rel


@dataclass(frozen=True)
class SnrDip:
    """A place where the SNR falls although the stimulus rises.

    Parameters
    ----------
    stimulus : float
        From which it falls.
    snr_before, snr_after : float
        Before and at the bottom.
    """

    stimulus: float
    snr_before: float
    snr_after: float

    @property
    def fall_db(self) -> float:
        """How much it falls, in dB (20 log10 of the ratio)."""
        return 20 * log10(self.snr_before / self.snr_after)


@dataclass(frozen=True)
class GeneralModel:
    """Characteristic curve of a camera, with noise and SNR at the input.

    Parameters
    ----------
    unit : str
        Unit of the stimulus.
    points : tuple of GeneralPoint
        In rising order of the stimulus, none of them saturated.
    threshold : float
        Stimulus at which the SNR is 1.
    saturated : bool
        Whether brighter points were saturated; if not, the range ends above the last point.
    """

    unit: str
    points: tuple[GeneralPoint, ...]
    threshold: float
    saturated: bool

    @property
    def highest(self) -> float:
        """Highest stimulus that is not saturated: a lower limit of the saturation."""
        return self.points[-1].stimulus

    @property
    def dynamic_range(self) -> float:
        """Ratio of the highest stimulus and the threshold."""
        return self.highest / self.threshold

    @property
    def dips(self) -> tuple[SnrDip, ...]:
        """Falls of the SNR of more than a tenth, with rising stimulus."""
        levels = _levels(self.points)
        dips, top = [], levels[0]
        bottom = top
        for level in levels[1:]:
            if level[1] < bottom[1]:
                bottom = level
            elif level[1] > (1 + _DIP_REL) * bottom[1] or level[1] >= top[1]:
                dips += [SnrDip(top[0], top[1], bottom[1])] if bottom[1] < (1 - _DIP_REL) * top[1] else []
                top = bottom = level
        dips += [SnrDip(top[0], top[1], bottom[1])] if bottom[1] < (1 - _DIP_REL) * top[1] else []
        return tuple(dips)


def _levels(points: Sequence[GeneralPoint]) -> list[tuple[float, float]]:
    """Stimulus and SNR of points of nearly one stimulus, geometric means."""
    groups: list[list[GeneralPoint]] = []
    for point in points:
        if groups and point.stimulus <= _ONE_LEVEL * groups[-1][0].stimulus:
            groups[-1].append(point)
        else:
            groups.append([point])
    means = [np.exp(np.mean(np.log([(p.stimulus, p.snr) for p in group]), axis=0)) for group in groups]
    return [(float(stimulus), float(ratio)) for stimulus, ratio in means]


def local_slopes(stimulus: Array, net_dn: Array) -> Array:
    """Slope of the characteristic curve at each of its points.

    A power law is fitted to the points within a factor of three, with tricube weights (W. S. Cleveland, J. Am. Stat.
    Assoc. 74 (1979) 829), in logarithms: for a straight line through the origin the slope is y / x.

    Parameters
    ----------
    stimulus, net_dn : ndarray of float, shape (n,)
        Points, above 0.

    Returns
    -------
    ndarray of float, shape (n,)
        DN per unit of the stimulus.

    Examples
    --------
    >>> x = np.geomspace(1, 100, 17)
    >>> np.allclose(local_slopes(x, 2 * np.sqrt(x)), 1 / np.sqrt(x))
    True
    """
    x, y = np.log(stimulus), np.log(net_dn)
    slopes = net_dn / stimulus
    for number, at in enumerate(x):
        distance = np.abs(x - at) / _NEAR
        near = distance < 1
        if np.unique(x[near].round(2)).size < _LEAST:
            continue
        weight = (1 - distance[near] ** 3) ** 3
        dx = x[near] - np.average(x[near], weights=weight)
        slopes[number] *= (weight * dx) @ y[near] / ((weight * dx) @ dx)
    return slopes


def general_model(
    points: Sequence[tuple[str, float, float, float, float, int]], dark_noise_dn: float, unit: str, saturated: bool
) -> GeneralModel:
    """Make the model of measured points.

    Parameters
    ----------
    points : sequence of (str, float, float, float, float, int)
        Label, exposure in s, stimulus, mean above dark in DN, temporal variance of a pixel in DN^2, and its degrees of
        freedom; none saturated.
    dark_noise_dn : float
        Temporal noise in the dark.
    unit : str
        Unit of the stimulus.
    saturated : bool
        Whether brighter points were saturated.

    Raises
    ------
    CalibrationError
        If fewer than three points are above the dark signal.
    """
    lit = sorted((point for point in points if point[2] > 0 and point[3] > 0), key=lambda point: point[2])
    if len(lit) < _LEAST:
        raise CalibrationError(
            f"{len(lit)} points are above the dark signal, a characteristic curve needs {_LEAST}: record more light"
        )
    stimulus, net = (np.array([point[column] for point in lit]) for column in (2, 3))
    made = tuple(
        GeneralPoint(label, exposure_s, x, y, sqrt(max(variance, 0.0)), float(slope), sqrt(1 / (2 * max(dof, 1))))
        for (label, exposure_s, x, y, variance, dof), slope in zip(lit, local_slopes(stimulus, net), strict=True)
        if slope > 0 and variance > 0
    )
    if len(made) < _LEAST:
        raise CalibrationError("the mean does not rise with the light, or has no noise: check the frames")
    return GeneralModel(unit, made, _threshold(made, dark_noise_dn), saturated)


def _threshold(points: Sequence[GeneralPoint], dark_noise_dn: float) -> float:
    """Stimulus of an SNR of 1: between points, or below the first with noise between that and the dark noise."""
    ratios = np.array([point.snr for point in points])
    below = np.flatnonzero(ratios <= 1)
    if below.size and below[-1] + 1 < len(points):
        first, then = points[below[-1]], points[below[-1] + 1]
        share = log(1 / first.snr) / log(then.snr / first.snr)
        return float(first.stimulus * (then.stimulus / first.stimulus) ** share)
    first = points[0]
    # Variance grows in proportion from the dark: x^2 = (s_d^2 + a x) / R^2.
    growth = max(first.noise_dn**2 - dark_noise_dn**2, 0.0) / first.stimulus
    half = growth / (2 * first.slope**2)
    return half + sqrt(half**2 + (dark_noise_dn / first.slope) ** 2)
