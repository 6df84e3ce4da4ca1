"""Speed and accuracy in ratio to others in the same run: NumPy, OpenCV's decoder and tracker, and Pyxel."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import bench_cdp
import bench_pyxel
import bench_sensor
import bench_video
import cv2
import numpy as np
from tracking_disturbances import CASES, frames_of
from tracking_real import Csrt

import labcdp
from labcdp.chain import Chain
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.tracking import make_tracker
from tests.tracking.simulated import SimulatedFrame

from .check import Check, not_run, stated

_LOWER, _HIGHER = "lower is better", "higher is better"
_FOLLOWED, _NEAR_PX = ("shift", "larger", "turned", "heavy noise"), 2.0
_VIDEO_FRAMES, _REPEATS = 60, 3


def speeds() -> Iterator[Check]:
    """Compare speeds, and the accuracy of the tracker, with what others offer."""
    yield from _numpy()
    yield from _pyxel()
    yield from _decoding()
    yield from _csrt()


def _numpy() -> Iterator[Check]:
    floats = bench_cdp.regions(1000)
    whole = [region.round().astype("uint16") for region in floats]
    for name, floor, peer, pair in (
        ("12 bits", bench_cdp.count, "np.bincount", whole),
        ("distinct floats", bench_cdp.sort, "np.sort", floats),
    ):
        cdp = partial(labcdp.cdp, *pair, bench_cdp.CONTRAST, bench_cdp.EPSILON)
        floor_ms, cdp_ms = bench_cdp.interleaved_ms(partial(floor, *pair), cdp)
        yield stated(f"exact CDP of two megapixels of {name}", cdp_ms / floor_ms, f"times {peer}", _LOWER)
    sensor = Chain.load("manta-g505").camera().sensor
    bench_sensor.expose(sensor, 0.0, None)
    expose, draw = (partial(one, sensor, 3000.0, None) for one in (bench_sensor.expose, bench_sensor.draw))
    ratio = bench_sensor.best_s(expose) / bench_sensor.best_s(draw)
    yield stated("simulated exposure, 3000 electrons", ratio, "times drawing its random numbers", _LOWER)


def _pyxel() -> Iterator[Check]:
    name, electrons = "the same exposure in Pyxel, run_mode", bench_pyxel.LEVELS_E[-1]
    own = bench_pyxel.default_environment() / "bin" / "python"
    if find_spec("pyxel") is None and not own.exists():
        yield not_run(name, f"not installed: pip install {bench_pyxel.PYXEL}, or python benchmarks/bench_pyxel.py")
        return
    python = Path(sys.executable) if find_spec("pyxel") else own
    with bench_pyxel.pyxel_exposures(python, electrons) as ask:
        ours = partial(bench_pyxel.labcdp_exposure, bench_pyxel.SENSOR, electrons, None)
        best, _ = bench_pyxel.measure({"labcdp": ours, "Pyxel": partial(ask, "all models")})
    yield stated(name, best["Pyxel, run_mode"] / best["labcdp"], "times labcdp's time", _HIGHER)


def _decoding() -> Iterator[Check]:
    with tempfile.TemporaryDirectory() as folder:
        for path in bench_video.make(Path(folder), (("mjpeg", "yuvj420p", "avi"),), _VIDEO_FRAMES):
            for what, rois in (("nearest-neighbour", ()), ("two followed regions", bench_video.ROIS)):
                whole = partial(evaluate_video, path, VideoSettings((1.0,), rois))
                ratio = _best_s(whole) / _best_s(partial(bench_video.decode, path))
                name = f"CDP of a video of 1920 x 1080, Motion JPEG, {what}"
                yield stated(name, ratio, "times decoding to grey by OpenCV, processor time", _LOWER)


def _best_s(action: Callable[[], object]) -> float:
    """Least processor time of all threads."""
    times = []
    for _ in range(_REPEATS):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return min(times)


def _csrt() -> Iterator[Check]:
    if not hasattr(cv2, "TrackerCSRT_create"):
        yield not_run("OpenCV's CSRT", "not installed: pip install opencv-contrib-python-headless")
        return
    videos = [list(frames_of(CASES[name], 0)) for name in _FOLLOWED]
    (ours, ours_s), (theirs, theirs_s) = (
        [sum(column) for column in zip(*map(follow, videos), strict=True)] for follow in (_by_labcdp, _by_csrt)
    )
    places = sum(len(frame.rois) for frames in videos for frame in frames[1:])
    source = f"{len(videos)} simulated videos, {places} places of regions within even patches"
    yield stated("places of labcdp within 2 pixels", ours / places, "share", source)
    yield stated("places of OpenCV's CSRT within 2 pixels", theirs / places, "share", source)
    yield stated("following two regions of 480 x 320", ours_s / theirs_s, "times CSRT, processor time", _LOWER)


def _by_labcdp(frames: list[SimulatedFrame]) -> tuple[int, float]:
    """Places near the truth, and the processor time."""
    tracker, near, start = make_tracker("follow", frames[0].grey, frames[0].rois), 0, time.process_time()
    for frame in frames[1:]:
        near += sum(_near(one.roi.centre, true.centre) for one, true in
                    zip(tracker.update(frame.grey), frame.rois, strict=True) if not one.lost)  # fmt: skip
    return near, time.process_time() - start


def _by_csrt(frames: list[SimulatedFrame]) -> tuple[int, float]:
    images = [cv2.cvtColor(frame.grey, cv2.COLOR_GRAY2BGR) for frame in frames]
    near, taken = 0, 0.0
    for number, roi in enumerate(frames[0].rois):
        x, y, right, bottom = (round(value) for value in roi.bounds)
        tracker, start = Csrt(images[0], [x, y, right - x, bottom - y]), time.process_time()
        found = [tracker.find(image) for image in images[1:]]
        taken += time.process_time() - start
        true = (frame.rois[number].centre for frame in frames[1:])
        near += sum(_near(one, place) for one, place in zip(found, true, strict=True) if one is not None)
    return near, taken


def _near(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return bool(np.hypot(*np.subtract(one, other)) <= _NEAR_PX)
