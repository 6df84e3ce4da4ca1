"""Processor time of the CDP of all pairs of many small regions over that of sorting each and searching each pair once.

Run ``python benchmarks/bench_matrix.py``. The 180 patches are 25 x 25 distinct floats, 16,110 pairs. The times are
processor times of one thread, the least of calls that took turns in this run, as other programs may run beside. The
second part shows how the time grows with patches and pixels: by pairs times pixels.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

import labcdp
from labcdp.metrics import Distribution
from labcdp.metrics.contrast import decimal_ratio, detected_ratios
from labcdp.metrics.pairs_kernel import merge_counts
from labcdp.metrics.pixel_pairs import RELATIVE_TOLERANCE

REPEATS = 5
N_PATCHES, SIDE = 180, 25
CONTRAST = 0.5


def patches(n: int, side: int) -> dict[str, NDArray[np.float64]]:
    """Patches of a chart from 1 to 1000 cd/m^2, SNR 10 to 30."""
    rng = np.random.default_rng(1)
    levels, snr = np.geomspace(1, 1000, n), np.linspace(10, 30, n)
    return {
        str(i): rng.normal(level, level / ratio, (side, side))
        for i, (level, ratio) in enumerate(zip(levels, snr, strict=True))
    }


def least_s(*actions: Callable[[], object], repeats: int = REPEATS) -> list[float]:
    """Return the least processor time of each of several actions that take turns."""
    times: list[list[float]] = [[] for _ in actions]
    for _ in range(repeats):
        for action, taken in zip(actions, times, strict=True):
            start = time.process_time()
            action()
            taken.append(time.process_time() - start)
    return [min(taken) for taken in times]


def sort_and_search(regions: Mapping[str, NDArray[np.float64]]) -> None:
    """Sort each region, and search the limits of each pair once."""
    ordered = [np.sort(region, axis=None) for region in regions.values()]
    for i, dark in enumerate(ordered):
        limits = dark * (1 + CONTRAST / 2)
        for bright in ordered[i + 1 :]:
            bright.searchsorted(limits, side="right")


def count(regions: Mapping[str, NDArray[np.float64]]) -> None:
    """Sort each region and count the pairs of pixels of all, without uncertainties."""
    distributions = [Distribution.from_array(region) for region in regions.values()]
    low, high = (end * (1 + RELATIVE_TOLERANCE) for end in detected_ratios(CONTRAST, 0.5))
    for i, dark in enumerate(distributions):
        weights, per_dark = np.array(dark.weights), np.empty(dark.values.size)
        for bright in distributions[i + 1 :]:
            per_bright = np.empty(bright.values.size)
            merge_counts(bright.values, bright.cumulative, dark.values, weights, low, high, per_dark, per_bright)


def at_measured_contrasts(regions: Mapping[str, NDArray[np.float64]]) -> None:
    """Compute the matrix with intervals that are not known from the call before."""
    detected_ratios.cache_clear()
    decimal_ratio.cache_clear()
    labcdp.cdp_matrix(regions)


def main() -> None:
    regions = patches(N_PATCHES, SIDE)
    independent = {name: region.ravel() for name, region in regions.items()}
    labcdp.cdp_matrix(patches(3, 5), CONTRAST)
    labels = (
        "counts alone",
        "cdp_matrix, independent pixels",
        "  at the measured contrasts",
        "cdp_matrix, parts of an image",
    )
    floor, *taken = least_s(
        partial(sort_and_search, regions),
        partial(count, independent),
        partial(labcdp.cdp_matrix, independent, CONTRAST),
        partial(at_measured_contrasts, independent),
        partial(labcdp.cdp_matrix, regions, CONTRAST),
    )
    print(f"{N_PATCHES} patches of {SIDE} x {SIDE}: sorting and one search for each pair {floor:.3f} s")
    for label, seconds in zip(labels, taken, strict=True):
        print(f"{label:32s} {seconds:6.3f} s   ratio {seconds / floor:.2f}")
    smooth = {name: level + ndimage.gaussian_filter(region - level, 0.7) for name, region in regions.items()
              for level in (region.mean(),)}  # fmt: skip
    (seconds,) = least_s(partial(labcdp.cdp_matrix, smooth, CONTRAST), repeats=1)
    print(f"{'  with correlated noise':32s} {seconds:6.3f} s   ratio {seconds / floor:.2f}")
    for n, side in ((45, 25), (90, 25), (180, 25), (90, 50), (90, 100)):
        (seconds,) = least_s(partial(labcdp.cdp_matrix, [x.ravel() for x in patches(n, side).values()], CONTRAST))
        work = n * (n - 1) / 2 * side**2
        rate_ns = seconds / work * 1e9
        print(f"{n:4d} patches of {side:3d} x {side:3d}  {seconds:6.3f} s   {rate_ns:5.1f} ns a pair and pixel")


if __name__ == "__main__":
    main()
