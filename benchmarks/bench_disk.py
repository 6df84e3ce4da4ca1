"""Full frames of a Manta to the disk at its 15 frames/s, and how fast the disk would let them go.

Run ``python benchmarks/bench_disk.py [FOLDER]``; FOLDER is on the disk to try, by default a temporary one. A
simulated camera in a process of its own, with priority where that is permitted, streams 2452 x 2056 pixels of 16 bits
over GigE Vision on loopback; each frame is recorded in a session, with its checksum, and flushed. The frame ids tell
whether one is missing. Rates begin with the first frame; processor time is that of the whole process from the start of
the stream, and that of the camera beside it, which a real one does not need. The first line is a program that does
nothing but write and flush as many bytes. The third line, and the fourth in the packed format, in which Gigabit
Ethernet carries this rate, are with two other processes that compute all the time. At 60
frames/s the disk is what limits: every frame that was grabbed is there, and the ids left out are those the camera sent
while the grab waited.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

from bench_grab import ADDRESS, Camera

from labcdp.acquire.recording import FrameWriter
from labcdp.core.clock import SystemClock
from labcdp.drivers import CameraError, open_camera
from labcdp.session import Session, SessionConfiguration, example_session

N_FRAMES = 300
HEIGHT, WIDTH = 2056, 2452


def floor_per_s(folder: Path) -> float:
    """Frames a second that can be written and flushed by doing nothing else."""
    data = os.urandom(2 * HEIGHT * WIDTH)
    start, n = time.perf_counter(), 40
    for _ in range(n):
        with open(folder / "floor", "wb", buffering=0) as file:
            file.write(data)
            os.fsync(file.fileno())
    (folder / "floor").unlink()
    return n / (time.perf_counter() - start)


@contextmanager
def busy(n: int) -> Iterator[None]:
    """Other processes that compute all the time."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(n)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def record(folder: Path, frame_rate_hz: float, n_busy: int = 0, pixel_format: str = "Mono12") -> None:
    configuration = SessionConfiguration.load(example_session() / "session.toml")
    ids: list[int] = []
    refused: list[CameraError] = []
    start = 0.0
    with (
        busy(n_busy),
        Camera(WIDTH, HEIGHT, frame_rate_hz) as sender,
        open_camera(ADDRESS) as opened,
        Session.create(folder / f"session {frame_rate_hz:g} {n_busy} {pixel_format}", configuration) as session,
    ):
        opened.configure(pixel_format=pixel_format, exposure_s=1e-3, frame_rate_hz=frame_rate_hz)
        cpu, sender_cpu, n_sent = time.process_time(), sender.cpu_s, sender.n_sent
        with FrameWriter(session, SystemClock()) as writer:
            for frame in opened.grab(N_FRAMES, on_refused=refused.append):
                start = start if ids else time.perf_counter()
                ids.append(frame.frame_id)
                writer.put(frame, "light", None)
            grabbed_s = time.perf_counter() - start
        wall_s, cpu_s = time.perf_counter() - start, time.process_time() - cpu
        sender_ms = 1e3 * (sender.cpu_s - sender_cpu) / (sender.n_sent - n_sent)
        # Ids have 16 bits, and 0 is left out.
        left_out = sum((after - before) % 65535 - 1 for before, after in pairwise(ids))
        throughput = writer.throughput
        on_disk = len(session.frames())
    print(
        f"{pixel_format} at {frame_rate_hz:3g}/s beside {n_busy} busy loops: "
        f"grabbed {(N_FRAMES - 1) / grabbed_s:5.1f}/s, "
        f"on the disk {on_disk} of {N_FRAMES} ({(N_FRAMES - 1) / wall_s:.1f}/s), ids left out {left_out}, "
        f"refused {len(refused)}, waited for the disk {throughput.waited_s:.2f} s"
        f"{' (limited by the disk)' if throughput.limited_by_disk else ''}, processor "
        f"{1e3 * cpu_s / N_FRAMES:.1f} ms a frame, of the camera {sender_ms:.1f} ms"
    )


def main() -> None:
    with tempfile.TemporaryDirectory(dir=sys.argv[1] if len(sys.argv) > 1 else None) as name:
        folder = Path(name)
        print(f"writing and flushing alone: {floor_per_s(folder):.1f} frames/s of {2 * HEIGHT * WIDTH / 1e6:.1f} MB")
        record(folder, 15.0)
        for pixel_format in ("Mono12", "Mono12Packed"):
            record(folder, 15.0, 2, pixel_format)
        record(folder, 60.0)


if __name__ == "__main__":
    main()
