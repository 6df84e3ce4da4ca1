"""Spatial non-uniformity: DSNU and PRNU, and their parts by row, column and pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rounding import Range, variance_before_rounding
from .result import Quantity
from .statistics import NoiseParts


@dataclass(frozen=True)
class Estimate:
    """A variance and its standard uncertainty, both in DN^2."""

    value: float
    uncertainty: float


@dataclass(frozen=True)
class SpatialVariance:
    """Spatial variances of a mean image in DN^2, temporal noise taken off.

    Parameters
    ----------
    total, pixel, column, row : Estimate
        Of all pixels (EMVA 1288 Release 3.1, section 8.2), and its parts (Release 4.0 Linear, section 4.2). May be
        negative where they are smaller than their uncertainty.
    """

    total: Estimate
    pixel: Estimate
    column: Estimate
    row: Estimate


def spatial_variance(mean_image: NDArray[np.floating[Any]], noise: NoiseParts) -> SpatialVariance:
    """Spatial variance of a mean image, and its parts.

    With s^2 = variance of all pixels, s_c^2 and s_r^2 = variances of the means of columns and rows of an image of
    M rows and N columns, all less what temporal noise leaves in them, s^2 = row + column + pixel,
    s_c^2 = column + pixel / M, s_r^2 = row + pixel / N are solved for the three parts.

    Parameters
    ----------
    mean_image : ndarray of float, shape (height, width)
        Mean of the frames.
    noise : NoiseParts
        What temporal noise leaves in it.

    Returns
    -------
    SpatialVariance
        The uncertainty of the total is sqrt((m4 - s^4) / n) with the fourth central moment m4, so that single hot
        pixels count; that of column and row means is the one of normal values.
    """
    image = np.asarray(mean_image, dtype=np.float64)
    height, width = image.shape
    deviation = image - image.mean()
    measured = float(np.sum(deviation**2)) / (image.size - 1)
    fourth = float(np.mean(deviation**4))
    columns = float(deviation.mean(axis=0).var(ddof=1))
    rows = float(deviation.mean(axis=1).var(ddof=1))
    total = measured - noise.pixel
    pixel = (total - (columns - noise.column) - (rows - noise.row)) / (1 - 1 / width - 1 / height)
    u_pixels = sqrt(max(fourth - measured**2, 0.0) / image.size)
    # A pattern of columns or rows has only as many values as there are columns or rows.
    u_columns, u_rows = columns * sqrt(2 / (width - 1)), rows * sqrt(2 / (height - 1))
    return SpatialVariance(
        Estimate(total, sqrt(u_pixels**2 + u_columns**2 + u_rows**2)),
        Estimate(pixel, u_pixels),
        Estimate(columns - noise.column - pixel / height, u_columns),
        Estimate(rows - noise.row - pixel / width, u_rows),
    )


def dsnu_e(variance: Estimate, k: Quantity, note: str = "") -> Quantity:
    """DSNU in electrons: sqrt(s_dark^2) / K (EMVA 1288 Release 3.1, section 8.4)."""
    root, uncertainty = _root(variance)
    value = root / k.value
    relative = (k.standard_uncertainty / k.value) * value
    return Quantity(value, float(np.hypot(uncertainty / k.value, relative)), "e-", _note(variance, note))


def widened_by_rounding(
    dsnu: Sequence[Quantity], k: Quantity, temporal_dn2: float, spatial_dn2: float
) -> tuple[Quantity, ...]:
    """Widen DSNU by what rounding may have done where darkness has less noise than about a DN.

    Parameters
    ----------
    dsnu : sequence of Quantity
        All pixels first, then parts and others that share its relative error.
    k : Quantity
        Overall system gain.
    temporal_dn2, spatial_dn2 : float
        Temporal variance of darkness, and variance of its mean image, as rounded.
    """
    together, alone = variance_before_rounding(temporal_dn2 + spatial_dn2), variance_before_rounding(temporal_dn2)
    left = Range(max(together.least - alone.largest, 0.0), max(together.largest - alone.least, 0.0)).root()
    by_rounding = left.error_of(sqrt(spatial_dn2)) / k.value
    whole = dsnu[0].value
    return tuple(
        replace(one, standard_uncertainty=hypot(one.standard_uncertainty, by_rounding * (one.value / whole)))
        if whole > 0
        else replace(one, standard_uncertainty=hypot(one.standard_uncertainty, by_rounding))
        for one in dsnu
    )


def prnu_rel(bright: Estimate, dark: Estimate, net_dn: float, note: str = "") -> Quantity:
    """PRNU as a fraction: sqrt(s_bright^2 - s_dark^2) / (mean - mean_dark) (Release 3.1, section 8.4)."""
    difference = Estimate(bright.value - dark.value, float(np.hypot(bright.uncertainty, dark.uncertainty)))
    root, uncertainty = _root(difference)
    return Quantity(root / net_dn, uncertainty / net_dn, "1", _note(difference, note))


def _root(variance: Estimate) -> tuple[float, float]:
    """Square root with its uncertainty; 0 for a variance below 0, with the root of its uncertainty."""
    if variance.value <= variance.uncertainty:
        return sqrt(max(variance.value, 0.0)), sqrt(variance.uncertainty)
    return sqrt(variance.value), variance.uncertainty / (2 * sqrt(variance.value))


def _note(variance: Estimate, note: str) -> str:
    if variance.value > variance.uncertainty:
        return note
    return f"{note}, " * bool(note) + "not more than temporal noise leaves"


@dataclass(frozen=True, eq=False)
class DarkPattern:
    """Pattern of darkness over the exposure: each pixel's own line.

    Parameters
    ----------
    offset_dn : ndarray of float, shape (height, width)
        At zero exposure.
    rate_dn_s : ndarray of float, shape (height, width)
        Growth per second.
    offset_noise, rate_noise : NoiseParts
        What temporal noise leaves in them, in DN^2 and (DN/s)^2.
    """

    offset_dn: NDArray[np.float64]
    rate_dn_s: NDArray[np.float64]
    offset_noise: NoiseParts
    rate_noise: NoiseParts


def dark_pattern(
    images: Sequence[NDArray[np.floating[Any]]], exposures_s: Sequence[float], noise: Sequence[NoiseParts]
) -> DarkPattern:
    """Fit each pixel's darkness by a line over the exposure, all exposures alike.

    Parameters
    ----------
    images : sequence of ndarray of float, shape (height, width)
        Mean dark image for each exposure, of two exposures at least.
    exposures_s : sequence of float
        Exposure times.
    noise : sequence of NoiseParts
        What temporal noise leaves in each.
    """
    t = np.array(exposures_s)
    to_offset, to_rate = np.linalg.pinv(np.column_stack([np.ones_like(t), t]))
    offset, rate = np.zeros(images[0].shape), np.zeros(images[0].shape)
    for image, by_offset, by_rate in zip(images, to_offset, to_rate, strict=True):
        offset += by_offset * image
        rate += by_rate * image
    return DarkPattern(offset, rate, _combined(noise, to_offset), _combined(noise, to_rate))


def _combined(noise: Sequence[NoiseParts], weights: NDArray[np.float64]) -> NoiseParts:
    scaled = [part.scaled(float(weight**2)) for part, weight in zip(noise, weights, strict=True)]
    return NoiseParts(sum(p.pixel for p in scaled), sum(p.column for p in scaled), sum(p.row for p in scaled))


def flat_variance(
    values: NDArray[np.floating[Any]],
    rows: NDArray[np.integer[Any]],
    columns: NDArray[np.integer[Any]],
    noise_dn2: float,
) -> Estimate:
    """Variance from pixel to pixel of a patch, its slow gradients taken off.

    A surface of second order in row and column is fitted and removed; it follows vignetting and uneven light, and only
    6 of the pixels' degrees of freedom.

    Parameters
    ----------
    values : ndarray of float, shape (n,)
        Mean of the patch's pixels, n above 6.
    rows, columns : ndarray of int, shape (n,)
        Where they are.
    noise_dn2 : float
        What temporal noise leaves in a value.

    Returns
    -------
    Estimate
        May be below 0.
    """
    y, x = (2 * (place - place.min()) / max(np.ptp(place), 1) - 1 for place in (rows, columns))
    surface = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    fitted, *_ = np.linalg.lstsq(surface, values)
    freedom = values.size - surface.shape[1]
    measured = float(np.sum((values - surface @ fitted) ** 2)) / freedom
    return Estimate(measured - noise_dn2, measured * sqrt(2 / freedom))


def combined(estimates: Sequence[Estimate]) -> Estimate:
    """Mean of independent estimates, weighted with the inverse squares of their uncertainties."""
    weights = [1 / estimate.uncertainty**2 for estimate in estimates]
    value = sum(weight * estimate.value for weight, estimate in zip(weights, estimates, strict=True))
    return Estimate(value / sum(weights), 1 / sqrt(sum(weights)))
