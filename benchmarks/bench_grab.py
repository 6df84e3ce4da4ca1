"""Frames per second and processor time per frame, beside Debian's arv-camera-test on the same simulated camera.

Run ``python benchmarks/bench_grab.py``. A simulated camera in a process of its own streams over GigE Vision on
loopback, with priority where that is permitted; arv-camera-test and labcdp take turns receiving from it, and each ratio
is the median of those of the rounds. The rate is compared where the camera sends as fast as it can, the processor time
also at the 15 frames/s of a Manta. Processor time is that of the receiving process alone, its start left out. The last
line grabs small frames and tells how many were lost, and whether memory, file descriptors and threads grew on the way.
``python benchmarks/bench_grab.py small`` does that alone.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np
from numpy.typing import NDArray

from labcdp.drivers import open_camera
from labcdp.drivers.simulated import SimulatedDevice, SimulatedGigECamera

SERIAL, ADDRESS = "SIM-BENCH", "127.0.0.1"
#: Seconds of a short and a long run, whose difference leaves out the start.
SHORT_S, LONG_S = 2, 8
ROUNDS = 4
N_SMALL_FRAMES = 20_000
SMALL_RATE_HZ = 500.0
#: Label, width, height, pixel format, frame rate asked for.
STREAMS = (
    ("2048 x 2048 Mono8, as fast as it goes", 2048, 2048, "Mono8", 500.0),
    ("2048 x 2048 Mono8 at 15/s", 2048, 2048, "Mono8", 15.0),
    ("2452 x 2056 Mono12 at 15/s", 2452, 2056, "Mono12", 15.0),
)


class Still:
    """One picture for ever: the camera's side shall cost little."""

    state = 0

    def __init__(self, height: int, width: int) -> None:
        self._dn = np.random.default_rng(1).integers(0, 4096, (height, width), dtype=np.uint16)

    def expose(self, exposure_s: float, gain_db: float, index: int) -> NDArray[np.uint16]:
        """Return the picture."""
        return self._dn


@dataclass(frozen=True)
class Run:
    """What a receiver did."""

    frames: int
    wall_s: float
    cpu_s: float


def serve(width: int, height: int, frame_rate_hz: float) -> None:
    # A real camera computes elsewhere.
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    device = SimulatedDevice(SERIAL, width=width, height=height, frame_rate_hz=frame_rate_hz)
    with SimulatedGigECamera(device, Still(height, width)):
        print("ready", flush=True)
        sys.stdin.read()


def receive(seconds: float, pixel_format: str, frame_rate_hz: float) -> None:
    """Grab for a while and print frames, time and processor time."""
    with open_camera(ADDRESS) as camera:
        camera.configure(pixel_format=pixel_format, exposure_s=100e-6, frame_rate_hz=frame_rate_hz)
        start, cpu, frames = time.perf_counter(), time.process_time(), 0
        for _ in camera.grab(10**9, on_refused=lambda _error: None):
            frames += 1
            if time.perf_counter() - start > seconds:
                break
        print(frames, time.perf_counter() - start, time.process_time() - cpu)


def receive_many(frames: int) -> None:
    """Grab small frames; print lost and refused ones, and on the way resident bytes, file descriptors and threads."""
    ids: list[int] = []
    refused: list[Exception] = []
    with open_camera(ADDRESS) as camera:
        camera.configure(pixel_format="Mono8", exposure_s=100e-6, frame_rate_hz=SMALL_RATE_HZ)
        for number, frame in enumerate(camera.grab(frames, on_refused=refused.append), start=1):
            ids.append(frame.frame_id)
            if number % (frames // 20) == 0:
                with open("/proc/self/statm") as status:
                    resident = int(status.read().split()[1]) * resource.getpagesize()
                print(resident, len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task")), flush=True)
    # Ids have 16 bits, and 0 is left out.
    print(sum((after - before) % 65535 - 1 for before, after in pairwise(ids)), len(refused))


def ours(seconds: float, pixel_format: str, frame_rate_hz: float) -> Run:
    command = [sys.executable, __file__, "receive", str(seconds), pixel_format, str(frame_rate_hz)]
    frames, wall_s, cpu_s = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return Run(int(frames), float(wall_s), float(cpu_s))


def theirs(seconds: int, pixel_format: str, frame_rate_hz: float) -> Run:
    used, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [
        "arv-camera-test-0.8", "-n", ADDRESS, "-a", "-f", str(frame_rate_hz), "-e", "100", f"--duration={seconds}",
        f"--features=PixelFormat={pixel_format}",
    ]  # fmt: skip
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    # Its seconds are ticks of a timer, which come late on a busy computer.
    wall_s, after = time.perf_counter() - began_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    completed = re.search(r"n_completed_buffers\s*=\s*(\d+)", text)
    assert completed, text
    cpu_s = after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime
    return Run(int(completed[1]), wall_s, cpu_s)


def rate_and_cost(receiver, pixel_format: str, frame_rate_hz: float) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """Frames per second and processor milliseconds per frame, from the difference of two runs."""
    # The first run pays for memory that the other receiver's did not use, as much as 0.7 s in a virtual machine.
    _, short, long = (receiver(seconds, pixel_format, frame_rate_hz) for seconds in (SHORT_S, SHORT_S, LONG_S))
    frames = long.frames - short.frames
    return frames / (long.wall_s - short.wall_s), 1e3 * (long.cpu_s - short.cpu_s) / frames


def compare(label: str, width: int, height: int, pixel_format: str, frame_rate_hz: float) -> None:
    rounds = []
    with camera(width, height, frame_rate_hz):
        for number in range(ROUNDS):
            # What else the computer does changes meanwhile: each is first as often as the other.
            first, second = (theirs, ours) if number % 2 else (ours, theirs)
            found = {one: rate_and_cost(one, pixel_format, frame_rate_hz) for one in (first, second)}
            rounds.append((*found[theirs], *found[ours]))
    rate, cost, own_rate, own_cost = (median(column) for column in zip(*rounds, strict=True))
    faster, dearer = (median(row[2 + which] / row[which] for row in rounds) for which in (0, 1))
    print(
        f"{label:38s}  {rate:7.1f}/s  {own_rate:7.1f}/s  {faster:5.2f}   "
        f"{cost:6.2f} ms  {own_cost:6.2f} ms  {dearer:5.2f}"
    )


class camera:  # noqa: N801
    """The simulated camera in a process of its own while the context lasts."""

    def __init__(self, width: int, height: int, frame_rate_hz: float) -> None:
        self._command = [sys.executable, __file__, "serve", str(width), str(height), str(frame_rate_hz)]

    def __enter__(self) -> None:
        self._process = subprocess.Popen(self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def __exit__(self, *exc: object) -> None:
        self._process.communicate()


def small_frames() -> None:
    with camera(256, 256, SMALL_RATE_HZ):
        command = [sys.executable, __file__, "many", str(N_SMALL_FRAMES)]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    *seen, (lost, refused) = [tuple(map(int, line.split())) for line in text.splitlines()]
    resident, files, threads = zip(*seen, strict=True)
    print(
        f"{N_SMALL_FRAMES} frames of 256 x 256 at {SMALL_RATE_HZ:g}/s: lost {lost}, refused {refused}; resident "
        f"{resident[0] / 1e6:.1f} MB after {N_SMALL_FRAMES // 20}, {resident[-1] / 1e6:.1f} MB after all, at most "
        f"{max(resident) / 1e6:.1f} MB; file descriptors {min(files)} to {max(files)}, threads {min(threads)} to "
        f"{max(threads)}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="see the head of this file")
    parser.add_argument("role", nargs="?", choices=("serve", "receive", "many", "small"))
    parser.add_argument("values", nargs="*")
    arguments = parser.parse_args()
    match arguments.role, arguments.values:
        case "serve", [width, height, rate]:
            serve(int(width), int(height), float(rate))
        case "receive", [seconds, pixel_format, rate]:
            receive(float(seconds), pixel_format, float(rate))
        case "many", [frames]:
            receive_many(int(frames))
        case "small", []:
            small_frames()
        case _:
            print(f"{'':38s}  arv-camera-test  labcdp  ratio  arv-camera-test   labcdp  ratio")
            for stream in STREAMS:
                compare(*stream)
            small_frames()


if __name__ == "__main__":
    main()
