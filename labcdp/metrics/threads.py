"""Parallel execution of independent parts of a calculation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_Part = TypeVar("_Part")
_Result = TypeVar("_Result")

#: Number of values from which threads are worth their overhead (a few tenths of a millisecond).
LONG = 2**16


def each_in_thread(function: Callable[[_Part], _Result], parts: Sequence[_Part], size: int) -> list[_Result]:
    """Call a function for each of a few parts, in threads if the parts process `LONG` values or more.

    NumPy releases the GIL while it sorts and searches. The parts are the same with and without threads, and so are the
    results.
    """
    if size < LONG:
        return [function(part) for part in parts]
    with ThreadPoolExecutor(len(parts)) as pool:
        return list(pool.map(function, parts))
