"""Time of an exact all-pairs CDP over the time of counting or sorting the pixels alone.

Run ``python benchmarks/bench_cdp.py``. The two regions of 1000 x 1000 pixels make 10^12 pairs. Each ratio compares
medians of calls that took turns in this run, so it holds on any machine; for floats it depends on how fast NumPy sorts
on this processor. The last line is the definition itself, every pair visited, on regions of 100 x 100 pixels.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

import labcdp

REPEATS = 15
CONTRAST, EPSILON = 0.1, 0.5


def regions(side: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(1)
    return rng.normal(1100, 35, (side, side)), rng.normal(1000, 30, (side, side))


def interleaved_ms(*actions: Callable[[], object]) -> list[float]:
    times: list[list[float]] = [[] for _ in actions]
    for _ in range(REPEATS):
        for action, taken in zip(actions, times, strict=True):
            start = time.perf_counter()
            action()
            taken.append(time.perf_counter() - start)
    return [median(taken) * 1e3 for taken in times]


def count(*arrays: NDArray[np.uint16]) -> None:
    for array in arrays:
        np.bincount(array.ravel())


def sort(*arrays: NDArray[np.floating[Any]]) -> None:
    for array in arrays:
        np.sort(array, axis=None)


def double_loop(a: NDArray[np.uint16], b: NDArray[np.uint16]) -> float:
    low, high = 1 + CONTRAST * (1 - EPSILON), 1 + CONTRAST * (1 + EPSILON)
    bright, dark = a.ravel().tolist(), b.ravel().tolist()
    inside = 0
    for d in dark:
        for x in bright:
            if low * d <= x <= high * d:
                inside += 1
    return inside / (len(bright) * len(dark))


def report(label: str, floor: str, floor_ms: float, cdp_ms: float) -> None:
    print(f"{label:34s}  {cdp_ms:8.1f} ms   {floor} {floor_ms:7.1f} ms   ratio {cdp_ms / floor_ms:.3g}")


def main() -> None:
    a, b = regions(1000)
    dn_a, dn_b = a.round().astype(np.uint16), b.round().astype(np.uint16)

    counting, cdp = interleaved_ms(partial(count, dn_a, dn_b), partial(labcdp.cdp, dn_a, dn_b, CONTRAST, EPSILON))
    report("12 bit, 1 megapixel each", "np.bincount of both", counting, cdp)
    for label, float_a, float_b in (
        ("floats from 12 bit, 1 megapixel", dn_a * 0.37, dn_b * 0.37),
        ("floats all distinct, 1 megapixel", a, b),
    ):
        sorting, cdp = interleaved_ms(
            partial(sort, float_a, float_b), partial(labcdp.cdp, float_a, float_b, CONTRAST, EPSILON)
        )
        report(label, "np.sort of both    ", sorting, cdp)

    small_a, small_b = (x.round().astype(np.uint16) for x in regions(100))
    start = time.perf_counter()
    visited = double_loop(small_a, small_b)
    loop_ms = (time.perf_counter() - start) * 1e3
    (cdp,) = interleaved_ms(partial(labcdp.cdp, small_a, small_b, CONTRAST, EPSILON))
    report("12 bit, 100 x 100 pixels each", "double loop        ", loop_ms, cdp)
    print(f"CDP {labcdp.cdp(small_a, small_b, CONTRAST, EPSILON).cdp}, by the double loop {visited}")


if __name__ == "__main__":
    main()
