"""Exact probabilities of digital numbers, CDP and its relatives of two uniform patches."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError
from ..sensor import Sensor
from ..signal import ExposureSettings
from .camera import CameraModel
from .pairs import COLUMNS, Cells, evaluate_cells
from .value_table import value_table


def dn_distribution(
    sensor: Sensor, electron_rate_e_s: ArrayLike, exposure_s: float, gain_db: float = 0.0, *, temperature_c: float
) -> NDArray[np.float64]:
    """Probability of each DN of a pixel of a uniform patch, over its noise and over all pixels' fixed patterns.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    electron_rate_e_s : array_like of float, shape (n,), or float
        Mean photo-electrons per second and pixel; 0.0 is the lens cap.
    exposure_s, gain_db, temperature_c : float
        As for `Sensor.expose`.

    Returns
    -------
    ndarray, shape (n, 2^bits), or (2^bits,) for a number
        Rows add up to 1. Cumulative probabilities are right to about 1e-7.

    Raises
    ------
    InputError
        If a rate is negative or not finite, or a setting out of its range.

    Notes
    -----
    Photo and dark electrons are one Poisson count, clipped by the well; read noise and offsets of pixel, row and
    column are normal and add up; the sum is amplified, rounded and clipped (EMVA 1288 Release 3.1, section 2). Gains
    (PRNU) and dark currents of the pixels are integrated over. Offsets of a row or column are those of all rows and
    columns of such sensors, of which a small patch sees few.
    """
    rates = checked_rates("electron_rate_e_s", electron_rate_e_s)
    camera = CameraModel(sensor, ExposureSettings((exposure_s,), gain_db, temperature_c))
    table = value_table(camera, rates)
    order = np.argsort(rates, axis=None)
    share = np.zeros((rates.size, 2**sensor.bits))
    for part, first, block, _ in table.blocks(rates.ravel()[order]):
        share[order[part], first : first + block.shape[1]] = np.maximum(block, 0)
    return share.reshape(*rates.shape, -1)


def checked_rates(name: str, rates_e_s: ArrayLike) -> NDArray[np.float64]:
    """Return rates as an array; raises InputError if one is negative or not finite."""
    rates = np.asarray(rates_e_s, dtype=np.float64)
    if rates.size == 0 or not (rates.min() >= 0 and rates.max() < np.inf):
        raise InputError(f"{name} has no value, or one that is negative or not finite: give rates in e-/s from 0 on")
    return rates


FloatArray = NDArray[np.float64]

#: Rates of the parts of a patch, and shares of its pixels, both along the last axis.
Patch = tuple[FloatArray, FloatArray]

#: Cells evaluated at once in a thread: their bright patches are held, up to 32 MB for each 1000 DN of a patch's width.
_CHUNK = 2048


@dataclass(frozen=True, eq=False)
class PatchRates:
    """Mean photo-electrons per second and pixel of pairs of patches; the shapes broadcast together.

    Parameters
    ----------
    dark_e_s, bright_e_s : array_like of float
        Of the two patches, the veil included; the larger is the bright one, unless there are shares.
    veil_e_s : array_like of float
        Of the veil (windscreen glare) over both, which is subtracted before contrasts are formed.
    dark_shares, bright_shares : ndarray or None
        Shares of a patch's pixels that have each of the rates along the last axis of `dark_e_s` or `bright_e_s`, of
        the same shape; None for patches of one rate.

    Raises
    ------
    InputError
        If a rate is negative or not finite, or the shapes do not fit together.
    """

    dark_e_s: ArrayLike
    bright_e_s: ArrayLike
    veil_e_s: ArrayLike = 0.0
    dark_shares: FloatArray | None = None
    bright_shares: FloatArray | None = None

    def __post_init__(self) -> None:
        names = ("dark_e_s", "bright_e_s", "veil_e_s")
        checked = [checked_rates(name, getattr(self, name)) for name in names]
        for name, rates in zip(names, checked, strict=True):
            object.__setattr__(self, name, rates)
        _broadcast(*(_mean_rate(patch) for patch in self.patches()), checked[2])

    def patches(self) -> tuple[Patch, Patch]:
        """Dark and bright patch; of patches of one rate, the larger is the bright one."""
        dark, bright = np.asarray(self.dark_e_s), np.asarray(self.bright_e_s)
        if self.dark_shares is not None and self.bright_shares is not None:
            return (dark, self.dark_shares), (bright, self.bright_shares)
        dark, bright = _broadcast(dark, bright)
        ones = np.ones((*dark.shape, 1))
        return (np.minimum(dark, bright)[..., None], ones), (np.maximum(dark, bright)[..., None], ones)


@dataclass(frozen=True, eq=False)
class ExactPrediction:
    """What all pairs of pixels of two patches come to; arrays of one shape.

    Parameters
    ----------
    cdp, below, above : ndarray
        Share of pairs whose contrast lies in the interval, below or above it, as those of `labcdp.metrics.cdp`.
    mean_contrast : ndarray
        Mean Weber contrast over the pairs with a dark value above 0. Where dark values come close to 0, few pairs
        decide it.
    csnr : ndarray
        `mean_contrast` over the standard deviation of the contrast (contrast signal-to-noise ratio).
    snr_dark, snr_bright : ndarray
        Mean over standard deviation of the linear signal of each patch; inf without noise.
    saturated_share, saturated_share_dark : ndarray
        Share of saturated pixels in the bright and in the dark patch.
    """

    cdp: FloatArray
    below: FloatArray
    above: FloatArray
    mean_contrast: FloatArray
    csnr: FloatArray
    snr_dark: FloatArray
    snr_bright: FloatArray
    saturated_share: FloatArray
    saturated_share_dark: FloatArray


def predict(camera: CameraModel, rates: PatchRates, contrast: ArrayLike, epsilon: float = 0.5) -> ExactPrediction:
    """Predict the CDP of pairs of uniform patches.

    Parameters
    ----------
    camera : CameraModel
        Sensor, settings, merge and tone curve.
    rates : PatchRates
        The patches.
    contrast : array_like of float
        Weber target contrast, fractions above 0, of a shape that broadcasts with the rates.
    epsilon : float
        Relative tolerance of the contrast, above 0 and up to 1.

    Returns
    -------
    ExactPrediction

    Raises
    ------
    InputError
        If contrast or epsilon is out of range, or shapes do not fit together.
    """
    asked = np.asarray(contrast, dtype=np.float64)
    if not (asked > 0).all() or not np.isfinite(asked).all():
        raise InputError("a contrast is not above 0 or not finite: give fractions above 0 (1.0 is 100 %)")
    if not 0 < epsilon <= 1:
        raise InputError(f"epsilon is {epsilon}: give a fraction above 0, up to 1")
    return predict_interval(camera, rates, asked * (1 - epsilon), asked * (1 + epsilon))


def predict_interval(camera: CameraModel, rates: PatchRates, low: ArrayLike, high: ArrayLike) -> ExactPrediction:
    """Predict how many pairs have a contrast in an interval; everything else as `predict`.

    Parameters
    ----------
    camera, rates
        As for `predict`.
    low, high : array_like of float
        Lowest and highest Weber contrast that counts as detected, fractions; -inf or inf for an open end.

    Returns
    -------
    ExactPrediction

    Raises
    ------
    InputError
        If an end is nan, `low` is below 0 but not -inf, or above `high`, or shapes do not fit together.

    Notes
    -----
    All noise of the two patches is independent. The two patches have other pixels and thus other fixed patterns, and
    both see the patterns of all pixels; rows or columns the patches have in common are not taken into account. Values
    are distributed as `labcdp.chain.predict.value_table` tabulates them; luminance is proportional to the value less
    that of dark signal and veil. Ends, and values of 0 and below, count as in `labcdp.metrics.cdp`.
    """
    lows, highs = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    if not (((lows >= 0) | np.isneginf(lows)).all() and (lows <= highs).all()):
        raise InputError("an interval of contrasts starts below 0 or ends before it starts: give 0 <= low <= high")
    means = (_mean_rate(patch) for patch in rates.patches())
    dark_mean, _, veil, lows, highs = _broadcast(*means, rates.veil_e_s, lows, highs)
    shape = dark_mean.shape
    zero = camera.dark_dn + camera.dn_per_e_s * veil.ravel()
    dark, bright = (_parts_of_cells(patch, shape) for patch in rates.patches())
    cells = Cells(dark, bright, zero, lows.ravel(), highs.ravel())
    table = value_table(camera, np.concatenate([dark[0].ravel(), bright[0].ravel()]))
    order = np.argsort(dark_mean.ravel(), kind="stable")
    chunks = [order[begin : begin + _CHUNK] for begin in range(0, order.size, _CHUNK)]
    result = np.empty((order.size, len(COLUMNS)))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        evaluated = pool.map(lambda chunk: evaluate_cells(table, cells.take(chunk)), chunks)
        for chunk, values in zip(chunks, evaluated, strict=True):
            result[chunk] = values
    return ExactPrediction(*(column.reshape(shape) for column in result.T))


def _mean_rate(patch: Patch) -> FloatArray:
    """Mean rate of a patch."""
    mean: FloatArray = np.einsum("...p,...p->...", *patch)
    return mean


def _parts_of_cells(patch: Patch, shape: tuple[int, ...]) -> Patch:
    """Rates and shares of a patch of each cell, shape (cells, parts)."""
    rates, shares = (np.broadcast_to(array, (*shape, array.shape[-1])) for array in patch)
    return rates.reshape(-1, rates.shape[-1]), shares.reshape(-1, shares.shape[-1])


def _broadcast(*arrays: ArrayLike) -> list[FloatArray]:
    try:
        return [np.asarray(array) for array in np.broadcast_arrays(*arrays)]
    except ValueError:
        shapes = [np.shape(array) for array in arrays]
        raise InputError(f"shapes {shapes} do not broadcast together: give arrays of one shape, or numbers") from None
