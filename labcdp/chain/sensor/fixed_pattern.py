"""Fixed pattern: what differs from pixel to pixel of one device and stays the same in all its exposures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..scene.kept import kept
from .blocks import Stream, block_generator, for_each_block

FloatMap = NDArray[np.float32]

# Numbers of the random streams of a device.
_PHOTO_RESPONSE, _DARK_CURRENT, _OFFSET, _COLUMN, _ROW = range(5)


@dataclass(frozen=True, eq=False)
class FixedPattern:
    """Maps of the non-uniformities of EMVA 1288 Release 3.1, section 4, each of shape (height, width), read-only.

    Parameters
    ----------
    photo_response : ndarray of float32
        Gain of each pixel for light, 1 in expectation (PRNU).
    dark_current : ndarray of float32
        Dark current of each pixel over the nominal one, 1 in expectation (DSNU that grows with exposure).
    offset_e : ndarray of float32
        Electrons added on reading a pixel, 0 in expectation (DSNU that does not).
    """

    photo_response: FloatMap
    dark_current: FloatMap
    offset_e: FloatMap

    def __post_init__(self) -> None:
        for values in (self.photo_response, self.dark_current, self.offset_e):
            values.flags.writeable = False


@kept
def draw_photo_response(shape: tuple[int, int], device_seed: int, prnu_rel: float) -> FloatMap:
    """Draw the gain of each pixel: normal, mean 1, standard deviation `prnu_rel`."""
    if prnu_rel == 0:
        return np.broadcast_to(np.float32(1), shape)
    response = _draw(shape, device_seed, _PHOTO_RESPONSE, _normal)
    response *= np.float32(prnu_rel)
    response += np.float32(1)
    return response


@kept
def draw_dark_current(shape: tuple[int, int], device_seed: int, spread_rel: float) -> FloatMap:
    """Draw the relative dark current of each pixel: mean 1, standard deviation `spread_rel`.

    It follows a gamma distribution, which has the long tail of warm pixels and no negative currents.
    """
    if spread_rel == 0:
        return np.broadcast_to(np.float32(1), shape)
    order = spread_rel**-2
    current = _draw(
        shape, device_seed, _DARK_CURRENT, lambda rng, size: rng.standard_gamma(order, size=size, dtype=np.float32)
    )
    current /= np.float32(order)
    return current


@kept
def draw_offset(
    shape: tuple[int, int], device_seed: int, dsnu_e: float, column_dsnu_e: float, row_dsnu_e: float
) -> FloatMap:
    """Draw the offset of each pixel in electrons: normal parts of pixels, columns and rows, mean 0."""
    if dsnu_e == column_dsnu_e == row_dsnu_e == 0:
        return np.broadcast_to(np.float32(0), shape)
    height, width = shape
    offset = _draw(shape, device_seed, _OFFSET, _normal)
    offset *= np.float32(dsnu_e)
    offset += np.float32(column_dsnu_e) * _normal(_generator(device_seed, _COLUMN, 0), (1, width))
    offset += np.float32(row_dsnu_e) * _normal(_generator(device_seed, _ROW, 0), (height, 1))
    return offset


def _generator(device_seed: int, pattern: int, block: int) -> np.random.Generator:
    return block_generator(device_seed, Stream.FIXED_PATTERN, pattern, block)


def _normal(rng: np.random.Generator, size: tuple[int, int]) -> FloatMap:
    return rng.standard_normal(size, dtype=np.float32)


def _draw(
    shape: tuple[int, int],
    device_seed: int,
    pattern: int,
    draw: Callable[[np.random.Generator, tuple[int, int]], FloatMap],
) -> FloatMap:
    values = np.empty(shape, dtype=np.float32)

    def fill(block: int, rows: slice) -> None:
        values[rows] = draw(_generator(device_seed, pattern, block), values[rows].shape)

    for_each_block(shape[0], fill)
    return values
