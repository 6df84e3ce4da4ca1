"""Frames per second and processor time per frame, beside Debian's arv-camera-test on the same simulated camera.

Run ``python benchmarks/bench_grab.py``. A simulated camera in a process of its own streams over GigE Vision on
loopback; arv-camera-test and labcdp take turns receiving from it, and each ratio is the median of those of the rounds.
Camera and both threads that receive packets have priority where that is permitted. Both receivers are watched from
outside in the same way, once every buffer has been filled: start, stop and memory used for the first time are left out.
Processor time is that of the whole process; frames are those that the camera sends meanwhile, less the share that was
lost. Where one lost more than a few per mille, the computer did something else, and the ratios say nothing.

The last line grabs small frames and tells how many were lost, and whether memory, file descriptors and threads grew on
the way. ``python benchmarks/bench_grab.py small`` does that alone.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from itertools import pairwise
from statistics import median
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from labcdp.drivers import open_camera
from labcdp.drivers.simulated import SimulatedDevice, SimulatedGigECamera

SERIAL, ADDRESS = "SIM-BENCH", "127.0.0.1"
#: Frames before a receiver is watched, more than either has buffers, and for how long it is watched.
N_SETTLING, WATCHED_S = 100, 5.0
ROUNDS = 6
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
    n_sent = 0

    def __init__(self, height: int, width: int) -> None:
        self._dn = np.random.default_rng(1).integers(0, 4096, (height, width), dtype=np.uint16)

    def next_key(self) -> tuple[int, ...]:
        """Return the key of a noise that is not there."""
        return (0,)

    def expose(self, exposure_s: float, gain_db: float, key: tuple[int, ...]) -> NDArray[np.uint16]:
        """Return the picture."""
        self.n_sent += 1
        return self._dn


def serve(width: int, height: int, frame_rate_hz: float) -> None:
    # A real camera computes elsewhere.
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    device = SimulatedDevice(SERIAL, width=width, height=height, frame_rate_hz=frame_rate_hz)
    still = Still(height, width)
    with SimulatedGigECamera(device, still):
        print("ready", flush=True)
        for _ in sys.stdin:
            print(still.n_sent, flush=True)


def receive(pixel_format: str, frame_rate_hz: float) -> None:
    """Grab until interrupted, and print Aravis' counter of complete frames as arv-camera-test does."""
    with open_camera(ADDRESS) as camera:
        camera.configure(pixel_format=pixel_format, exposure_s=100e-6, frame_rate_hz=frame_rate_hz)
        with suppress(KeyboardInterrupt):
            for _ in camera.grab(10**9, on_refused=lambda _error: None):
                pass
        print(f"n_completed_buffers = {camera.statistics.completed}")


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


def ours(pixel_format: str, frame_rate_hz: float) -> list[str]:
    return [sys.executable, __file__, "receive", pixel_format, str(frame_rate_hz)]


def theirs(pixel_format: str, frame_rate_hz: float) -> list[str]:
    return [
        "arv-camera-test-0.8", "-n", ADDRESS, "-a", "-f", str(frame_rate_hz), "-e", "100", "--high-priority",
        f"--features=PixelFormat={pixel_format}",
    ]  # fmt: skip


def cpu_s(pid: int) -> float:
    """Processor time that a process has taken, by the clock of Linux that counts it (clock_getcpuclockid)."""
    return time.clock_gettime(~pid << 3 | 2)


class Camera:
    """The simulated camera in a process of its own while the context lasts."""

    def __init__(self, width: int, height: int, frame_rate_hz: float) -> None:
        self._command = [sys.executable, __file__, "serve", str(width), str(height), str(frame_rate_hz)]

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"
        return self

    def __exit__(self, *exc: object) -> None:
        self._process.communicate()

    @property
    def n_sent(self) -> int:
        """Frames it has sent."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return int(self._process.stdout.readline())

    @property
    def cpu_s(self) -> float:
        """Processor time it has taken."""
        return cpu_s(self._process.pid)


class Run(NamedTuple):
    """What a receiver did."""

    rate_hz: float
    cost_ms: float
    lost_percent: float


def watch(command: list[str], sender: Camera) -> Run:
    """Run a receiver and watch it from outside."""
    n_before = sender.n_sent
    receiver = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while sender.n_sent < n_before + N_SETTLING and receiver.poll() is None:
        time.sleep(0.1)
    seen = []
    for pause_s in (0.0, WATCHED_S):
        time.sleep(pause_s)
        seen.append((time.perf_counter(), sender.n_sent, cpu_s(receiver.pid)))
    receiver.send_signal(signal.SIGINT)
    text, errors = receiver.communicate()
    completed = re.search(r"n_completed_buffers\s*=\s*(\d+)", text)
    assert completed, text + errors
    complete = min(1.0, int(completed[1]) / (sender.n_sent - n_before))
    wall_s, sent, used_s = (end - start for start, end in zip(*seen, strict=True))
    return Run(sent * complete / wall_s, 1e3 * used_s / (sent * complete), 100 * (1 - complete))


def compare(label: str, width: int, height: int, pixel_format: str, frame_rate_hz: float) -> None:
    rounds = []
    with Camera(width, height, frame_rate_hz) as sender:
        for number in range(ROUNDS):
            # What else the computer does changes meanwhile: each is first as often as the other.
            order = (theirs, ours) if number % 2 else (ours, theirs)
            found = {one: watch(one(pixel_format, frame_rate_hz), sender) for one in order}
            rounds.append((found[theirs], found[ours]))
    print(label)
    for name, of in (("frames/s", 0), ("processor ms a frame", 1), ("lost %", 2)):
        pairs = [(other[of], own[of]) for other, own in rounds]
        line = f"  {name:22s}" + "".join(f"{median(column):9.2f}" for column in zip(*pairs, strict=True))
        if of < 2:
            ratios = [own / other for other, own in pairs]
            line += f"   ratio {median(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f}"
        print(line, flush=True)


def small_frames() -> None:
    with Camera(256, 256, SMALL_RATE_HZ):
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
        case "receive", [pixel_format, rate]:
            receive(pixel_format, float(rate))
        case "many", [frames]:
            receive_many(int(frames))
        case "small", []:
            small_frames()
        case _:
            print("medians of arv-camera-test and of labcdp, and labcdp as a multiple of the other in each round")
            for stream in STREAMS:
                compare(*stream)
            small_frames()


if __name__ == "__main__":
    main()
