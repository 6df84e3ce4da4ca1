"""Speed of data of series cameras, as ratios within one run.

Run ``python benchmarks/bench_series_camera.py``. Expansion of the codes of a 12-bit frame of 8 megapixels is compared
with ``np.take`` of every pixel through a table of its linear values, and the CDP of two regions of a megapixel each of
24-bit values, at one contrast, with sorting the values of both. Each ratio compares medians of calls that took
turns in this run, so it holds on any machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from statistics import median

import numpy as np

import labcdp
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.files import shipped_curve

REPEATS = 11
#: Rows and columns of 8 megapixels, and pixels of a region.
SHAPE, REGION = (2160, 3840), 1_000_000
#: Ratios that are the goals.
MOST_EXPANSION, MOST_CDP = 1.5, 1.3


def seconds(*calls: Callable[[], object]) -> list[float]:
    """Medians of calls that take turns."""
    taken: list[list[float]] = [[] for _ in calls]
    for _ in range(REPEATS + 1):
        for times, call in zip(taken, calls, strict=True):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
    return [median(times[1:]) for times in taken]


def expansion() -> float:
    """Ratio of the time of an expansion to that of a look-up."""
    curve, rng = shipped_curve("AR0231"), np.random.default_rng(1)
    codes = curve.code(rng.lognormal(8, 1.5, SHAPE))
    codes.flags.writeable = False
    camera, at = CameraIdentity("Acme", "Front", "1"), datetime(2026, 3, 1, tzinfo=UTC)
    frame = Frame(codes, 0.01, 0.0, 12, 4000.0, None, "Mono12", None, None, at, 0, 0, camera, companding=curve)
    table = np.array(curve.linear_by_dn)
    assert np.array_equal(frame.linear_dn(), np.take(table, codes))
    ours, theirs = seconds(frame.linear_dn, lambda: np.take(table, codes))
    return ours / theirs


def cdp() -> float:
    """Ratio of the time of a CDP to that of sorting."""
    rng = np.random.default_rng(2)
    bright, dark = (np.rint(rng.normal(level, level / 50, REGION)) for level in (9e6, 6e6))

    def sorted_both() -> None:
        np.sort(bright)
        np.sort(dark)

    ours, theirs = seconds(lambda: labcdp.cdp(bright, dark, 0.5), sorted_both)
    return ours / theirs


if __name__ == "__main__":
    for name, ratio, most in (
        ("expansion of 8 megapixels of 12 bits / np.take", expansion(), MOST_EXPANSION),
        ("CDP of two regions of a megapixel of 24 bits / sorting both", cdp(), MOST_CDP),
    ):
        print(f"{name}: {ratio:.2f} (goal: at most {most:g}, {'reached' if ratio <= most else 'not reached'})")
