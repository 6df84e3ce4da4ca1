"""Exact probabilities of the digital numbers of a uniform patch."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError
from ..camera_model import CameraModel
from ..exposure import ExposureSettings
from ..sensor.emva import Sensor
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
