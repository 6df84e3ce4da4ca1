"""Time of a simulated exposure over the time of drawing its random numbers alone.

Run ``python benchmarks/bench_sensor.py``. The ratio tells what the sensor model costs beyond its randomness, on
any machine; 1 is the floor.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from labcdp.chain import Chain, Sensor
from labcdp.chain.fixed_pattern import Stream, block_generator, for_each_block

REPEATS = 5
EXPOSURE_S = 1e-3


def best_s(action: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def expose(sensor: Sensor, electrons: float, threads: int | None) -> None:
    sensor.expose(electrons / EXPOSURE_S, EXPOSURE_S, temperature_c=30.0, seed=1, exposure_index=0, threads=threads)


def draw(sensor: Sensor, electrons: float, threads: int | None) -> None:
    # Of the same means: a Poisson number of mean 0 needs no random numbers, and dark current is never 0.
    dark_e = sensor.dark_current_at(30.0) * EXPOSURE_S
    mean_e = np.broadcast_to(np.float32(electrons + dark_e), sensor.shape)

    def draw_rows(block: int, rows: slice) -> None:
        rng = block_generator(1, Stream.NOISE, 0, block)
        rng.poisson(mean_e[rows])
        rng.standard_normal(mean_e[rows].shape, dtype=np.float32)

    for_each_block(sensor.height, draw_rows, threads)


def main() -> None:
    sensor = replace(Chain.load("manta-g505").camera().sensor, width=2048, height=2048)
    expose(sensor, 0.0, None)  # draws the fixed pattern
    print("2048 x 2048 pixels    exposure    draws alone    ratio    megapixel/s")
    for threads in (1, None):
        for electrons in (0.0, 10.0, 3000.0):
            exposure = best_s(partial(expose, sensor, electrons, threads))
            floor = best_s(partial(draw, sensor, electrons, threads))
            label = f"{electrons:4.0f} e-, {'all threads' if threads is None else '1 thread'}"
            megapixels_s = 2048 * 2048e-6 / exposure
            print(f"{label:20s}  {exposure:7.3f} s     {floor:7.3f} s   {exposure / floor:6.2f}   {megapixels_s:8.1f}")

    full = Chain.load("manta-g505").camera().sensor
    expose(full, 3000.0, None)
    print(f"2452 x 2056 pixels, 3000 e-, all threads: {best_s(partial(expose, full, 3000.0, None)):.3f} s")
    tracemalloc.start()
    expose(full, 3000.0, None)
    peak = tracemalloc.get_traced_memory()[1]
    print(f"memory beyond the fixed pattern: {peak / 1e6:.1f} MB, of it the frame {2452 * 2056 * 2e-6:.1f} MB")


if __name__ == "__main__":
    main()
