"""Exact CDP and its relatives of two uniform patches, without random numbers."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError
from .camera import CameraModel
from .capture_table import capture_table, light_table
from .pairs import CellPatch, Cells, ExactPrediction, evaluate_cells
from .value_table import ValueTable, value_table

FloatArray = NDArray[np.float64]

#: Cells evaluated at once in a thread: their bright patches are held, up to 8 MB for each 1000 DN of a patch's width
#: or 16 MB for each 1000 bins.
_CHUNK = 512


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
        If a rate is negative or not finite.
    """

    dark_e_s: ArrayLike
    bright_e_s: ArrayLike
    veil_e_s: ArrayLike = 0.0
    dark_shares: FloatArray | None = None
    bright_shares: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("dark_e_s", "bright_e_s", "veil_e_s"):
            rates = np.asarray(getattr(self, name), dtype=np.float64)
            if rates.size == 0 or not (rates.min() >= 0 and rates.max() < np.inf):
                raise InputError(
                    f"{name} has no value, or one that is negative or not finite: give rates in e⁻/s from 0 on",
                    key=name,
                )
            object.__setattr__(self, name, rates)

    def patches_as_stated(self) -> tuple[CellPatch, CellPatch]:
        """Dark and bright patch as they are stated."""
        dark, bright = np.asarray(self.dark_e_s), np.asarray(self.bright_e_s)
        if self.dark_shares is not None and self.bright_shares is not None:
            return (dark, self.dark_shares), (bright, self.bright_shares)
        shape = _common_shape(dark, bright)
        ones = np.ones((*shape, 1))
        return (np.broadcast_to(dark, shape)[..., None], ones), (np.broadcast_to(bright, shape)[..., None], ones)

    def patches(self) -> tuple[CellPatch, CellPatch]:
        """Dark and bright patch; of patches of one rate, the larger is the bright one."""
        (dark, dark_shares), (bright, bright_shares) = self.patches_as_stated()
        if self.dark_shares is None or self.bright_shares is None:
            dark, bright = np.minimum(dark, bright), np.maximum(dark, bright)
        return (dark, dark_shares), (bright, bright_shares)


@dataclass(frozen=True, eq=False)
class CaptureRates:
    """Mean photo-electrons per second and pixel of pairs of patches, during each capture of a frame.

    Parameters
    ----------
    patches : tuple of two CellPatch
        Of both patches the rates, shape (n, parts, captures), most sensitive capture first, and the shares of the
        pixels, shape (n, parts); the brighter one by its mean value is the bright one.
    veil_e_s : ndarray, shape (n,)
        Of the veil during the most sensitive capture, which is subtracted.
    """

    patches: tuple[CellPatch, CellPatch]
    veil_e_s: FloatArray

    @classmethod
    def joined(cls, captures: Sequence[PatchRates]) -> Self:
        """Join the rates of each capture, whose parts are the same pixels."""
        first, second = zip(*(rates.patches_as_stated() for rates in captures), strict=True)
        joined = [(np.stack([rates for rates, _ in patch], axis=-1), patch[0][1]) for patch in (first, second)]
        return cls((joined[0], joined[1]), np.asarray(captures[0].veil_e_s))


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

    Notes
    -----
    All noise of the two patches is independent. The two patches have other pixels and thus other fixed patterns, and
    both see the patterns of all pixels; rows or columns the patches have in common are not taken into account. Values
    are distributed as `labcdp.chain.predict.value_table` tabulates them, and of captures that differ in more than their
    time `labcdp.chain.predict.capture_table`: where several captures count in one value by quasi-Monte Carlo, which
    keeps a CDP within 2e-4 as a rule, within 1e-3 where exposures are nearly equal, their ratios no small whole
    numbers, or the read noise below an electron; wells of some ten electrons without it are worse. Luminance is
    proportional to the value less that of dark signal and veil. Ends, and values of 0 and below, count as in
    `labcdp.metrics.cdp`.
    """
    targets = checked_targets(contrast, epsilon)
    patches = rates.patches()
    shape = _common_shape(*(rate[..., 0] for rate, _ in patches), rates.veil_e_s, targets)
    dark, bright = (_parts_of_cells(patch, shape) for patch in patches)
    veil, targets = (np.broadcast_to(values, shape).ravel() for values in (rates.veil_e_s, targets))
    zero = camera.dark_dn + camera.dn_per_e_s * veil
    cells = Cells(dark, bright, zero, targets * (1 - epsilon), targets * (1 + epsilon))
    tabulate = capture_table if camera.merges_captures else value_table
    table = tabulate(camera, np.concatenate([dark[0].ravel(), bright[0].ravel()]))
    return ExactPrediction(*(values.reshape(shape) for values in _evaluated(table, cells)))


def predict_captures(
    camera: CameraModel, rates: CaptureRates, contrast: FloatArray, epsilon: float = 0.5
) -> tuple[ExactPrediction, NDArray[np.bool_]]:
    """Predict the CDP of pairs of patches whose light may differ from capture to capture.

    Parameters
    ----------
    camera : CameraModel
        Sensor, settings, merge and tone curve.
    rates : CaptureRates
        The patches.
    contrast : ndarray, shape (n,)
        Weber target contrasts, fractions above 0.
    epsilon : float
        Relative tolerance of the contrast, above 0 and up to 1.

    Returns
    -------
    prediction : ExactPrediction
        See `predict`.
    is_second_bright : ndarray of bool, shape (n,)
        Whether the second patch is the bright one.
    """
    targets = checked_targets(contrast, epsilon)
    lights = [patch.reshape(-1, patch.shape[-1]) for patch, _ in rates.patches]
    table, keys = _table_of_lights(camera, np.concatenate(lights))
    means = np.asarray(table.rows_at(keys)[0] @ table.bins.values)
    split = len(lights[0])
    parts = [
        (key.reshape(shares.shape), np.sum(mean.reshape(shares.shape) * shares, axis=-1), shares)
        for key, mean, (_, shares) in zip(np.split(keys, [split]), np.split(means, [split]), rates.patches, strict=True)
    ]
    is_second_bright = parts[0][1] < parts[1][1]
    dark, bright = (
        (np.where(chosen, parts[0][0], parts[1][0]), np.where(chosen, parts[0][2], parts[1][2]))
        for chosen in (is_second_bright[:, None], ~is_second_bright[:, None])
    )
    zero = camera.dark_dn + camera.dn_per_e_s * rates.veil_e_s
    cells = Cells(dark, bright, zero, targets * (1 - epsilon), targets * (1 + epsilon))
    return ExactPrediction(*_evaluated(table, cells)), is_second_bright


def captured_moments(
    camera: CameraModel, rates_e_s: FloatArray, shares: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, variance and saturated share of the pixels of patches, shape (n,).

    Parameters
    ----------
    camera : CameraModel
        The camera.
    rates_e_s : ndarray, shape (n, parts, captures)
        Photo-electrons per second of each part during each capture, most sensitive first.
    shares : ndarray, shape (n, parts)
        Share of the pixels that are of each part.
    """
    table, keys = _table_of_lights(camera, rates_e_s.reshape(-1, rates_e_s.shape[-1]))
    rows, saturated = table.rows_at(keys)
    values = table.bins.values
    mean = np.asarray(rows @ values).reshape(shares.shape)
    # About the mean of all, for what rounding leaves of the difference of squares.
    centre = float(mean.mean())
    square = np.asarray(rows @ np.square(values - centre)).reshape(shares.shape)
    means = np.sum(mean * shares, axis=-1)
    variance = np.sum(square * shares, axis=-1) - np.square(means - centre)
    return means, np.maximum(variance, 0.0), np.sum(saturated.reshape(shares.shape) * shares, axis=-1)


def _table_of_lights(camera: CameraModel, rates_e_s: FloatArray) -> tuple[ValueTable, FloatArray]:
    """Return a table for rates during each capture, shape (n, captures), and what it has in place of each."""
    if rates_e_s.shape[1] > 1:
        return light_table(camera, rates_e_s)
    keys = rates_e_s[:, 0]
    return (capture_table if camera.merges_captures else value_table)(camera, keys), keys


def checked_targets(contrast: ArrayLike, epsilon: float) -> FloatArray:
    """Return target contrasts; raises InputError if they or the tolerance are out of their ranges."""
    targets = np.asarray(contrast, dtype=np.float64)
    if not (targets > 0).all() or not np.isfinite(targets).all():
        raise InputError("a contrast is not above 0 or not finite: give fractions above 0 (1.0 is 100 %)")
    if not 0 < epsilon <= 1:
        raise InputError(f"epsilon is {epsilon}: give a fraction above 0, up to 1")
    return targets


def _evaluated(table: ValueTable, cells: Cells) -> FloatArray:
    """Evaluate cells in chunks of similar light, on all processors; see `evaluate_cells`."""
    order = np.argsort(np.einsum("np,np->n", *cells.dark), kind="stable")
    chunks = [order[begin : begin + _CHUNK] for begin in range(0, order.size, _CHUNK)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        evaluated = list(pool.map(lambda chunk: evaluate_cells(table, cells.take(chunk)), chunks))
    result: FloatArray = np.concatenate(evaluated, axis=1)[:, np.argsort(order)]
    return result


def _parts_of_cells(patch: CellPatch, shape: tuple[int, ...]) -> CellPatch:
    """Rates and shares of a patch of each cell, shape (cells, parts)."""
    rates, shares = (np.broadcast_to(array, (*shape, array.shape[-1])) for array in patch)
    return rates.reshape(-1, rates.shape[-1]), shares.reshape(-1, shares.shape[-1])


def _common_shape(*arrays: ArrayLike) -> tuple[int, ...]:
    shapes = [np.shape(array) for array in arrays]
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        raise InputError(f"shapes {shapes} do not broadcast together: give arrays of one shape, or numbers") from None
