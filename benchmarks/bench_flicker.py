"""Flicker of 36 regions in a video of 900 frames, as a ratio to decoding it; and how often its intervals hold.

Run ``python benchmarks/bench_flicker.py``. The videos of the second part are 400 recordings of a region of 16 x 16
pixels, by plain NumPy: pulsed lamps of 60 to 1000 Hz, 15 to 60 frames a second, with a rolling shutter, photon and
read noise, and rounding to 12 bits. The truth is a sum over phases. A share that is truly 0 or 1 does not count, as its
interval always holds, nor does a recording of which labcdp says that too few phases were seen.
"""

from __future__ import annotations

import os
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from statistics import median

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

import cv2
import numpy as np
from numpy.typing import NDArray

import labcdp
from labcdp.core.roi import Roi
from labcdp.evaluate.flicker.page import evaluate_flicker
from labcdp.evaluate.flicker.settings import FlickerSettings

REPEATS, N_VIDEOS = 3, int(os.environ.get("N_VIDEOS", "400"))
N_FRAMES, HEIGHT, WIDTH, SIDE = 900, 720, 1280, 6
_Array = NDArray[np.float64]


def light(begins_s: _Array, frequency_hz: float, duty: float, exposure_s: float, off: float) -> _Array:
    """Mean light of exposures that begin at these times, by the integral of the pulses."""

    def pulses(at_s: _Array) -> _Array:
        periods = at_s * frequency_hz
        return np.asarray((np.floor(periods) * duty + np.minimum(periods % 1, duty)) / frequency_hz)

    return off + (1 - off) * (pulses(begins_s + exposure_s) - pulses(begins_s)) / exposure_s


def make(path: Path) -> tuple[Roi, ...]:
    """Write a video of 36 lamps of different frequencies, and return their regions."""
    rng, frame_s = np.random.default_rng(0), 1 / 30
    noise = rng.normal(0, 2, (HEIGHT + 64, WIDTH + 64))
    frequencies, duties = rng.uniform(60, 1000, SIDE * SIDE), rng.uniform(0.1, 0.6, SIDE * SIDE)
    rois = [Roi.rectangle(f"lamp {n}", 60 + 200 * (n % SIDE), 30 + 115 * (n // SIDE), 60, 60) for n in range(SIDE**2)]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (WIDTH, HEIGHT))
    for number in range(N_FRAMES):
        image = np.full((HEIGHT, WIDTH), 20.0)
        for n, roi in enumerate(rois):
            x, y, right, bottom = map(int, roi.bounds)
            seen = light(np.array([number * frame_s + 0.1]), frequencies[n], duties[n], 2e-3, 0.1)
            image[y:bottom, x:right] = 200 * seen[0]
        dy, dx = rng.integers(0, 64, 2)
        image = np.clip(image + noise[dy : dy + HEIGHT, dx : dx + WIDTH] + 0.5, 0, 255)
        writer.write(cv2.cvtColor(image.astype(np.uint8), cv2.COLOR_GRAY2BGR))
    writer.release()
    return tuple(rois)


def decode(path: Path) -> int:
    capture, n = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG), 0
    while True:
        there, image = capture.read()
        if not there:
            return n
        cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        n += 1


def speed() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lamps.avi"
        settings = FlickerSettings(rois=make(path), method="fixed", encoding="linear")
        decode(path), evaluate_flicker(path, settings)
        times: tuple[list[float], list[float]] = ([], [])
        processor: tuple[list[float], list[float]] = ([], [])
        for _ in range(REPEATS):
            for which in (0, 1):
                start, at_start = time.perf_counter(), time.process_time()
                decode(path) if which == 0 else evaluate_flicker(path, settings)
                times[which].append(time.perf_counter() - start)
                processor[which].append(time.process_time() - at_start)
    alone, whole = map(median, times)
    cpu_alone, cpu_whole = map(median, processor)
    print(
        f"36 regions, {N_FRAMES} frames of {WIDTH} x {HEIGHT}: {whole:.2f} s, {whole / alone:.2f} times decoding and "
        f"converting to grey ({alone:.2f} s); processor {cpu_whole:.2f} s, {cpu_whole / cpu_alone:.2f} times",
        flush=True,
    )


def recorded(rng: np.random.Generator) -> tuple[_Array, float, tuple[float, float, float]]:
    """Means of a region in the frames of a lamp, the light with the lamp off, and the true indices."""
    frequency_hz, rate_hz, duty = rng.uniform(60, 1000), rng.uniform(15, 60), rng.uniform(0.1, 0.6)
    exposure_s, off = float(10 ** rng.uniform(-3.5, -1.7)), float(rng.choice([0.05, 0.1, 0.3]))
    row_s, full_e = float(rng.choice([0.0, 10e-6, 20e-6])), float(10 ** rng.uniform(2.5, 4))
    lamp, rows_s = (frequency_hz, duty, exposure_s, off), np.arange(16) * row_s
    begins = np.arange(rng.integers(100, 900)) / rate_hz + rng.uniform() / frequency_hz
    rows = light(begins[:, None] + rows_s, *lamp)
    electrons = rng.poisson(full_e * np.broadcast_to(rows[..., None], (*rows.shape, 16))) + rng.normal(
        0, 5, (*rows.shape, 16)
    )
    values = np.rint(electrons / full_e * 3000).mean(axis=(1, 2)) / 3000
    phases = (np.arange(4000) + 0.5) / 4000 / frequency_hz
    over_phases = light(phases[:, None] + rows_s, *lamp).mean(axis=1)
    # Noise of the mean of 256 pixels: photons, read noise and rounding.
    noise = np.sqrt((over_phases * full_e + 25) / full_e**2 + 1 / 12 / 3000**2) / 16
    mean, z = over_phases.mean(), np.linspace(-6, 6, 241)
    weights = np.exp(-(z**2) / 2) / np.exp(-(z**2) / 2).sum()
    x = over_phases[:, None] + noise[:, None] * z
    even = float((weights * (np.abs(x - mean) < 0.1 * mean)).sum() / 4000)
    on = float((weights * (x > 1.1 * off)).sum() / 4000)
    fmi = float((over_phases.max() - over_phases.min()) / (over_phases.max() + over_phases.min()))
    return values, off, (fmi, on, even)


def coverage() -> None:
    rng, held, trials, n_few = np.random.default_rng(2020), np.zeros(3), np.zeros(3), 0
    for _ in range(N_VIDEOS):
        values, off, truth = recorded(rng)
        measured = labcdp.flicker(values, off)
        if measured.few_phases:
            n_few += 1
            continue
        for index, (quantity, true) in enumerate(zip((measured.fmi, measured.fdi, measured.mmp), truth, strict=True)):
            if 1e-3 < true < 1 - 1e-3:
                trials[index] += 1
                held[index] += quantity.interval.low - 1e-6 <= true <= quantity.interval.high + 1e-6
    shares = ", ".join(
        f"{name} {100 * count / n:.1f} % of {n:.0f}"
        for name, count, n in zip(("FMI", "FDI", "MMP"), held, trials, strict=True)
    )
    print(f"95 % intervals that hold in {N_VIDEOS} recordings: {shares}; too few phases in {n_few}")


if __name__ == "__main__":
    print(f"{datetime.now(UTC):%Y-%m-%d}, {os.cpu_count()} cores, OpenCV {cv2.__version__}")
    coverage()
    speed()
