"""Truths that need a stream or a clock: losses of a grab, Aravis' own programs."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from itertools import pairwise

import bench_grab

import labcdp

from .check import Check, absolute, not_run, stated

_ARAVIS = ("arv-tool-0.8", "arv-camera-test-0.8")


def grabbing(frames: int = 500) -> Iterator[Check]:
    """Frames that labcdp receives of those the simulated camera sent, and its speed beside Aravis' program."""
    if missing := [one for one in _ARAVIS if shutil.which(one) is None]:
        yield not_run("simulated camera", f"{missing[0]} is not installed (make setup-test)")
        return
    with bench_grab.Camera(2048, 2048, 100.0) as sender:
        yield from _aravis_tools(sender)
        with labcdp.drivers.open_camera(bench_grab.ADDRESS) as camera:
            camera.configure(pixel_format="Mono8", exposure_s=100e-6, frame_rate_hz=100.0)
            numbers = [frame.frame_id for frame in camera.grab(frames, on_refused=lambda _error: None)]
            statistics = camera.statistics
        source = "numbers of the frames, which the camera counts; 2048 x 2048 Mono8 at 100/s on loopback"
        # After 65535 comes 1.
        gaps = sum((after - before - 1) % 65535 for before, after in pairwise(numbers))
        yield absolute(f"frames missing between {len(numbers)} received", 0, gaps, 0, source)
        yield absolute("incomplete frames", 0, statistics.failed, 0, "statistics of the stream")
        theirs, ours = (
            bench_grab.watch(command("Mono8", 100.0), sender) for command in (bench_grab.theirs, bench_grab.ours)
        )
    yield stated("frames per second", ours.rate_hz / theirs.rate_hz, "times arv-camera-test", "higher is better")


def aravis_version() -> str:
    """Version of the installed programs, as the first of them states it."""
    if shutil.which(_ARAVIS[0]) is None:
        return "not installed"
    return subprocess.run([_ARAVIS[0], "--version"], capture_output=True, text=True).stdout.strip()


def _aravis_tools(sender: bench_grab.Camera) -> Iterator[Check]:
    """Debian's programs against the simulated camera."""
    select = ["arv-tool-0.8", "-a", bench_grab.ADDRESS]
    text = subprocess.run([*select, "control", "Width", "Height", "PixelFormat"], capture_output=True, text=True).stdout
    for name, truth in (("Width", 2048), ("Height", 2048)):
        value = re.search(rf"{name} = (\d+)", text)
        source = "arv-tool-0.8 control"
        yield absolute(f"arv-tool: {name}", truth, int(value[1]), 0, source) if value else not_run(name, text[:80])
    found = bench_grab.watch(bench_grab.theirs("Mono8", 100.0), sender)
    yield stated("arv-camera-test: completed frames", found.rate_hz, "frames/s", "arv-camera-test-0.8")
