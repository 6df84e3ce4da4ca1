"""Blocks of rows, each with its own random stream: results do not depend on the number of threads."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from enum import IntEnum

import numpy as np

#: Rows of a block. Simulated values depend on it: do not tune it to a machine.
BLOCK_ROWS = 64


class Stream(IntEnum):
    """What random numbers are for; keeps streams apart even if device and exposure have the same seed."""

    NOISE = 0
    FIXED_PATTERN = 1


def block_generator(seed: int, stream: Stream, index: int, block: int) -> np.random.Generator:
    """Return the generator of one block.

    Parameters
    ----------
    seed : int
        Seed of the exposures or of the device, at least 0.
    stream : Stream
        What the numbers are for.
    index : int
        Which exposure or which pattern, at least 0.
    block : int
        Which block.
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
