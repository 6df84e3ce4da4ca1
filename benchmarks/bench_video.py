"""Throughput of labcdp's evaluation of a video over that of OpenCV decoding and converting to grey alone.

Run ``python benchmarks/bench_video.py``, or with videos of your own as arguments. Without any it makes a drive-like
scene of 1920 x 1080 pixels in H.264, MPEG-4, Motion JPEG and FFV1. Both passes take turns in this run and each
decodes the whole file; ratios are of the medians, so they hold on any machine with as many cores that does nothing
else. The processor time, of all threads, says more on a busy one. What a process does once, such as loading modules,
is done before, in a first pass that does not count.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from statistics import median

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from labcdp.core.roi import Roi
from labcdp.evaluate.video.evaluate import evaluate_parts
from labcdp.evaluate.video.settings import VideoSettings

REPEATS = 3
N_FRAMES = int(os.environ.get("N_FRAMES", "250"))
HEIGHT, WIDTH = 1080, 1920
#: Pixels that the camera sways to each side.
SWAY = 64
ROIS = (Roi.rectangle("bright", 410, 505, 80, 90), Roi.rectangle("dark", 560, 505, 80, 90))
TEN_ROIS = tuple(
    Roi.rectangle(f"{name} {row}", x, 505 + 18 * row, 80, 15)
    for row in range(5)
    for name, x in (("bright", 410), ("dark", 560))
)
#: Codec of PyAV, its pixels, and the ending of a file's name.
CODECS = (
    ("libx264", "yuv420p", "mp4"),
    ("mpeg4", "yuv420p", "mp4"),
    ("mjpeg", "yuvj420p", "avi"),
    ("ffv1", "gray", "mkv"),
)
#: Bits a second, so that there is something to be followed in a noisy scene.
BIT_RATE = 20_000_000
TEN = tuple(round(0.1 * n, 1) for n in range(1, 11))
#: What is measured: name, contrasts, regions, method.
RUNS: tuple[tuple[str, tuple[float, ...], tuple[Roi, ...]], ...] = (
    ("nearest-neighbour, 1 contrast", (1.0,), ()),
    ("nearest-neighbour, 10 contrasts", TEN, ()),
    ("two tracked regions, 1 contrast", (1.0,), ROIS),
    ("two tracked regions, 10 contrasts", TEN, ROIS),
    ("ten tracked regions, 1 contrast", (1.0,), TEN_ROIS),
)


def scene() -> Callable[[int], NDArray[np.uint8]]:
    """Return a camera that sways before a textured scene with two patches, and its noise."""
    rng = np.random.default_rng(1)
    size = (HEIGHT + 2 * SWAY, WIDTH + 2 * SWAY)
    ground = cv2.GaussianBlur(rng.normal(0, 1, size).astype(np.float32), (0, 0), 6)
    ground = 90 + 25 * ground / ground.std()
    for left, value in ((400, 190), (550, 40)):
        patch = np.s_[495 + SWAY : 605 + SWAY, left + SWAY : left + 100 + SWAY]
        ground[patch] = value + 0.1 * (ground[patch] - 90)
    noise = rng.normal(0, 2, (HEIGHT + 64, WIDTH + 64)).astype(np.float32)

    def frame(number: int) -> NDArray[np.uint8]:
        y, x = SWAY + round(8 * np.sin(number / 23)), SWAY + round((SWAY - 2) * np.sin(number / 40))
        dy, dx = rng.integers(0, 64, 2)
        image = ground[y : y + HEIGHT, x : x + WIDTH] + noise[dy : dy + HEIGHT, dx : dx + WIDTH]
        return np.asarray(np.clip(image + 0.5, 0, 255), dtype=np.uint8)

    return frame


def make(folder: Path, codecs: Sequence[tuple[str, str, str]] = CODECS, n_frames: int = N_FRAMES) -> list[Path]:
    made = []
    for codec, pixels, suffix in codecs:
        made.append(folder / f"{codec}.{suffix}")
        frame = scene()
        with av.open(str(made[-1]), "w") as container:
            stream = container.add_stream(codec, rate=25, width=WIDTH, height=HEIGHT, pix_fmt=pixels)
            assert isinstance(stream, av.VideoStream)
            stream.bit_rate = BIT_RATE
            for number in range(n_frames):
                image = av.VideoFrame.from_ndarray(frame(number), format="gray").reformat(format=pixels)
                container.mux(stream.encode(image))
            container.mux(stream.encode())
    return made


def decode(path: Path) -> int:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    n = 0
    while True:
        there, image = capture.read()
        if not there:
            return n
        cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        n += 1


def evaluate(path: Path, contrasts: tuple[float, ...], rois: tuple[Roi, ...]) -> None:
    pairs = [rois[first : first + 2] for first in range(0, len(rois), 2)] or [()]
    evaluate_parts(path, [VideoSettings(contrasts, pair) for pair in pairs])


def measure(path: Path) -> None:
    n = decode(path)
    size = path.stat().st_size / n / 1000
    for name, contrasts, rois in RUNS:
        actions: tuple[Callable[[], object], ...] = (partial(decode, path), partial(evaluate, path, contrasts, rois))
        for action in actions:
            action()
        times: tuple[list[float], list[float]] = ([], [])
        processor: tuple[list[float], list[float]] = ([], [])
        for _ in range(REPEATS):
            for taken, worked, action in zip(times, processor, actions, strict=True):
                start, at_start = time.perf_counter(), time.process_time()
                action()
                taken.append((time.perf_counter() - start) / n * 1e3)
                worked.append((time.process_time() - at_start) / n * 1e3)
        alone, whole = map(median, times)
        cpu_alone, cpu_whole = map(median, processor)
        print(
            f"{path.name:12} {size:6.0f} kB  {name:34} decode and grey {alone:6.2f} ms (processor {cpu_alone:6.2f}), "
            f"whole {whole:6.2f} ms a frame ({cpu_whole:6.2f}), throughput x {alone / whole:.2f}",
            flush=True,
        )


def main() -> None:
    print(f"{datetime.now(UTC):%Y-%m-%d}, {os.cpu_count()} cores, OpenCV {cv2.__version__}")
    if sys.argv[1:]:
        for name in sys.argv[1:]:
            measure(Path(name))
        return
    with tempfile.TemporaryDirectory() as folder:
        for path in make(Path(folder)):
            measure(path)


if __name__ == "__main__":
    main()
