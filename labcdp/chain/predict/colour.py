"""How well a chain with a colour filter tells the colours of two regions apart, without random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, PredictionError
from ..captures import PATTERNS
from ..chain import Chain
from ..colour import seen_sensor
from .camera import CameraModel
from .capture_table import capture_table
from .mixed_pixels import is_mixed
from .quantiles import normal_points
from .rates import plane_rates, scene_levels, scenes_of_cells, veil_lx
from .stage import camera_of_stage, sensor_of_stage
from .value_table import value_table

FloatArray = NDArray[np.float64]
#: Cells of a 2 x 2 pattern.
_CELLS = 4


@dataclass(frozen=True, eq=False)
class ColourPrediction:
    """Separation of the colours of two regions of scenes; arrays of shape (n,) unless stated otherwise.

    Parameters
    ----------
    planes : tuple of str
        Names of the planes.
    mean_dn, variance_dn2 : ndarray of float, shape (n, 2, planes)
        Mean and variance of the signal of dark and bright region in each plane of a cell of 2 x 2 pixels, above dark
        signal and veil; pixels of one kind in a cell are averaged.
    distance : ndarray of float
        Mahalanobis distance of the means by the pooled covariance.
    csp : ndarray of float
        Colour separation probability.
    csp_counted : ndarray of float
        Share of cells nearer to their own region, each region with a covariance of its own.
    detected : ndarray of float
        Share of the pairs of cells whose difference of chromaticity is within the tolerance of that of the means.
    """

    planes: tuple[str, ...]
    mean_dn: FloatArray
    variance_dn2: FloatArray
    distance: FloatArray
    csp: FloatArray
    csp_counted: FloatArray
    detected: FloatArray


def predict_colours(
    chain: Chain,
    scenes: Mapping[str, Sequence[Any]] | None = None,
    *,
    stage: str | None = None,
    epsilon: float = 0.5,
) -> ColourPrediction:
    """Predict how well the colours of the first pair of regions can be told apart.

    Parameters
    ----------
    chain : Chain
        With one EMVA 1288 sensor behind a colour filter.
    scenes : mapping of str to sequence, or None
        Fields of the scene with a value for each of n cells, for example ``luminance_cd_m2``; None for the scene as
        it is.
    stage : str or None
        A stage at or behind the sensor, None for the last.
    epsilon : float
        Relative tolerance of the difference of chromaticity, above 0 and up to 1.

    Returns
    -------
    ColourPrediction

    Raises
    ------
    InputError
        If the sensor has no colour filter, or the tolerance is out of its range.
    PredictionError
        If the chain cannot be predicted.

    Notes
    -----
    Mean and variance of each plane, and with them distance and CSP as of `labcdp.colour_separation`, are exact: those
    of the distribution of its pixels, with all noise, quantisation and saturation. The planes are independent. The
    other two shares take cells as normal, and are integrated with 2^15 points of a Sobol sequence.
    """
    if not 0 < epsilon <= 1:
        raise InputError(f"epsilon is {epsilon}: give a fraction above 0, up to 1")
    sensor, name = sensor_of_stage(chain, stage or chain.stage_names[-1])
    if not sensor.colour_filter:
        raise InputError("the sensor has no colour filter: give sensor.colour_filter and sensor.planes")
    if is_mixed(chain):
        raise PredictionError("the blur of the lens mixes the colours of both regions: simulate instead")
    sensor = replace(sensor, plane="")
    camera = camera_of_stage(chain, seen_sensor(sensor, chain.spectrum), name)
    cells = scenes_of_cells(chain.scene, scenes or {})
    seen_levels = scene_levels(cells)
    levels, shares, _ = seen_levels
    per_lx_s = camera.sensor.electrons_per_lx_s(chain.spectrum)
    veil_e_s = veil_lx(chain.front(levels, shares), len(cells)) * per_lx_s
    zero_dn = camera.dark_dn + camera.dn_per_e_s * veil_e_s
    names = tuple(dict.fromkeys(PATTERNS[sensor.colour_filter]))
    means, variances = [], []
    for plane, seen in plane_rates(chain, sensor, cells, per_lx_s, seen_levels):
        mean_dn, variance_dn2 = _moments(camera, np.stack([rates[:, 0] for rates, _ in seen], axis=1))
        means.append(mean_dn - zero_dn[:, None])
        variances.append(variance_dn2 / (plane.share * _CELLS))
    mean, variance = np.stack(means, axis=-1), np.stack(variances, axis=-1)
    distance, csp = _distance(mean, variance)
    counted = np.array([_counted_share(*cell) for cell in zip(mean, variance, strict=True)])
    detected = np.array([_detected_share(*cell, epsilon) for cell in zip(mean, variance, strict=True)])
    return ColourPrediction(names, mean, variance, distance, csp, counted, detected)


def _moments(camera: CameraModel, rates_e_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of pixels of the rates, of their shape."""
    tabulate = capture_table if camera.merges_captures else value_table
    table = tabulate(camera, rates_e_s)
    rows, _ = table.rows_at(rates_e_s.ravel())
    values = table.bins.values
    mean = np.asarray(rows @ values)
    # About the mean of all, for what rounding leaves of the difference of squares.
    centre = float(mean.mean())
    variance = np.asarray(rows @ np.square(values - centre)) - np.square(mean - centre)
    return mean.reshape(rates_e_s.shape), np.maximum(variance, 0.0).reshape(rates_e_s.shape)


def _distance(mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    from scipy.special import ndtr

    pooled = variance.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.sqrt((np.square(mean[:, 1] - mean[:, 0]) / pooled).sum(axis=-1))
    return distance, np.asarray(ndtr(distance / 2))


def _counted_share(mean: FloatArray, variance: FloatArray) -> float:
    """Return the share of cells nearer to their own region, of arrays of shape (2, planes)."""
    shares = []
    normal = normal_points(mean.shape[-1])
    for region in (0, 1):
        cells = mean[region][:, None] + np.sqrt(variance[region])[:, None] * normal
        scores = [
            (np.square(cells - mean[at][:, None]) / variance[at][:, None]).sum(axis=0) + np.log(variance[at]).sum()
            for at in (region, 1 - region)
        ]
        shares.append(np.mean(scores[0] < scores[1]))
    return float(np.mean(shares))


def _detected_share(mean: FloatArray, variance: FloatArray, epsilon: float) -> float:
    """Return the share of pairs of cells whose difference of chromaticity is within its tolerance."""
    planes = mean.shape[-1]
    normal = normal_points(2 * planes)
    chromaticities, centres = [], []
    for region in (0, 1):
        part = normal[region * planes : (region + 1) * planes]
        cells = mean[region][:, None] + np.sqrt(variance[region])[:, None] * part
        total = cells.sum(axis=0)
        chromaticities.append(np.divide(cells, total, out=np.full(cells.shape, np.nan), where=total > 0))
        centres.append(mean[region] / mean[region].sum())
    direction = centres[1] - centres[0]
    apart = np.linalg.norm(chromaticities[1] - chromaticities[0] - direction[:, None], axis=0)
    return float(np.mean(apart <= epsilon * np.linalg.norm(direction)))
