"""Fixed pattern of a device, and the blocks of rows with random streams of their own that it is drawn in."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache, wraps
from threading import Lock
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

#: How many results of a function are kept, one for each capture of a sensor; maps of a large sensor take 20 MB.
_MOST = 4


def kept(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Keep the last results of a function of hashable arguments; threads that ask at once wait for one of them."""
    cached = lru_cache(maxsize=_MOST)(function)
    lock = Lock()

    @wraps(function)
    def call(*arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        with lock:
            return cached(*arguments, **named)  # type: ignore[arg-type]

    return call


#: Rows of a block. Simulated values depend on it: do not tune it to a machine.
BLOCK_ROWS = 64


class Stream(IntEnum):
    """Purpose of random numbers, which keeps their streams apart even if device and exposure have the same seed."""

    NOISE = 0
    FIXED_PATTERN = 1


def block_generator(seed: int, stream: Stream, index: int, block: int) -> np.random.Generator:
    """Return the generator of one block.

    Parameters
    ----------
    seed : int
        Seed of the exposures or of the device, at least 0.
    stream : Stream
        Purpose of the random numbers.
    index : int
        Number of the exposure or pattern, at least 0.
    block : int
        Number of the block.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream, index, block)))


def for_each_block(height: int, work: Callable[[int, slice], None], threads: int | None = None) -> None:
    """Call `work(block, rows)` for each block of an image, in parallel (NumPy lets go of the interpreter lock).

    Parameters
    ----------
    height : int
        Rows of the image.
    work : callable
        Takes the number of the block and its rows; must touch no other rows.
    threads : int or None
        Number of threads, None for one a processor.
    """
    blocks = [slice(row, min(row + BLOCK_ROWS, height)) for row in range(0, height, BLOCK_ROWS)]
    with ThreadPoolExecutor(min(len(blocks), os.cpu_count() or 1 if threads is None else threads)) as pool:
        # list() waits for all and raises what one of them raised.
        list(pool.map(work, range(len(blocks)), blocks))


FloatMap = NDArray[np.float32]

# Numbers of the random streams of a device; those of its further photodiodes and readouts follow.
_PHOTO_RESPONSE, _DARK_CURRENT, _OFFSET, _COLUMN, _ROW = _STREAMS = range(5)


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
def draw_photo_response(shape: tuple[int, int], device_seed: int, prnu_rel: float, photodiode: int = 0) -> FloatMap:
    """Draw the gain of a photodiode of each pixel: normal, mean 1, standard deviation `prnu_rel`."""
    if prnu_rel == 0:
        return np.broadcast_to(np.float32(1), shape)
    response = _draw(shape, device_seed, _stream(_PHOTO_RESPONSE, photodiode), _normal)
    response *= np.float32(prnu_rel)
    response += np.float32(1)
    return response


@kept
def draw_dark_current(shape: tuple[int, int], device_seed: int, spread_rel: float, photodiode: int = 0) -> FloatMap:
    """Draw the relative dark current of a photodiode of each pixel: mean 1, standard deviation `spread_rel`.

    It follows a gamma distribution, which has the long tail of warm pixels and no negative currents.
    """
    if spread_rel == 0:
        return np.broadcast_to(np.float32(1), shape)
    order = spread_rel**-2
    current = _draw(
        shape,
        device_seed,
        _stream(_DARK_CURRENT, photodiode),
        lambda rng, size: rng.standard_gamma(order, size=size, dtype=np.float32),
    )
    current /= np.float32(order)
    return current


@kept
def draw_offset(
    shape: tuple[int, int],
    device_seed: int,
    dsnu_e: float,
    column_dsnu_e: float,
    row_dsnu_e: float,
    readout: int = 0,
) -> FloatMap:
    """Draw the offset of a readout of each pixel, electrons: normal parts of pixels, columns and rows, mean 0."""
    if dsnu_e == column_dsnu_e == row_dsnu_e == 0:
        return np.broadcast_to(np.float32(0), shape)
    height, width = shape
    offset = _draw(shape, device_seed, _stream(_OFFSET, readout), _normal)
    offset *= np.float32(dsnu_e)
    offset += np.float32(column_dsnu_e) * _normal(_generator(device_seed, _stream(_COLUMN, readout), 0), (1, width))
    offset += np.float32(row_dsnu_e) * _normal(_generator(device_seed, _stream(_ROW, readout), 0), (height, 1))
    return offset


def _stream(pattern: int, part: int) -> int:
    """Return the number of a pattern's stream in a photodiode or readout."""
    return pattern + part * len(_STREAMS)


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
