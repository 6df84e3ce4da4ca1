"""The live bench in Chromium: frames shown, time from exposure to screen, processor time, lost frames and memory.

Run ``python benchmarks/bench_live.py``; ``--seconds 28800`` watches for eight hours. A simulated camera in a process of
its own streams over GigE Vision on loopback, ``labcdp bench`` receives it, and headless Chromium shows the page at
1280 x 800 pixels with four regions and their CDP, or with ``--regions 36`` the matrix of all. Each frame carries the
time at which it was sent, as a row of black and white squares that the browser reads from what it has drawn: the delay
is that of the whole way, for the shipped program as it is. A line each ``--every`` seconds tells what
changed since the last one.

Processor time is that of the server, and of all processes of the browser, which draws without a graphics processor.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from numpy.typing import NDArray

from labcdp.drivers.simulated import SimulatedDevice, SimulatedGigECamera
from labcdp.drivers.simulated.device import FORMATS, Wanted
from labcdp.drivers.simulated.genicam import standard_features
from labcdp.regions import RectangleShape, save_regions

ADDRESS = "127.0.0.1"
#: Squares of the time, their number and side in pixels; milliseconds beyond the highest count start again.
N_BITS, SIDE_PX = 16, 32
#: Times of the newest frame on the screen minus those in the frames, in ms.
WATCH = """([n_bits, side, wrap]) => {
  const figure = Bokeh.documents[0].get_model_by_name("picture")
  const source = figure.renderers[1].data_source
  window.delays = []
  window.seen = null
  source.properties.data.change.connect(() => requestAnimationFrame(() => {
    const [image] = source.get_column("image")
    const [x, y, dw, dh] = ["x", "y", "dw", "dh"].map(name => source.get_column(name)[0])
    const [rows, columns] = image.shape
    const row = Math.floor((side / 2 - y) / dh * rows)
    let sent = 0
    for (let bit = 0; bit < n_bits; bit++) {
      const column = Math.floor(((bit + 0.5) * side - x) / dw * columns)
      sent += image[row * columns + column] > 127 ? 2 ** bit : 0
    }
    if (sent === window.seen)
      return
    window.seen = sent
    window.delays.push(((Date.now() - sent) % wrap + wrap) % wrap)
  }))
  window.matrices = 0
  const matrix = Bokeh.documents[0].get_model_by_name("matrix")
  if (matrix !== null)
    matrix.renderers[0].data_source.properties.data.change.connect(() => { window.matrices += 1 })
}"""


class Stamped:
    """Frames with the time at which they are sent, instead of rendered ones: the camera's side shall cost little."""

    def __init__(self, height: int, width: int) -> None:
        rng = np.random.default_rng(1)
        levels = np.linspace(300, 3000, 8).repeat(width // 8 + 1)[:width]
        self._dn = np.rint(rng.normal(levels, np.sqrt(levels), (height, width))).astype(np.uint16)

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def next(self, wanted: Wanted) -> NDArray[np.uint8]:
        """Return a frame."""
        now_ms = round(1e3 * time.time())
        bits = [4095 * (now_ms >> bit & 1) for bit in range(N_BITS)]
        self._dn[:SIDE_PX, : N_BITS * SIDE_PX] = np.repeat(bits, SIDE_PX)
        return wanted.readout.payload(self._dn, FORMATS[wanted.format_code])


def serve(width: int, height: int, rate_hz: float, colour_filter: str | None) -> None:
    """Run the camera until the end of the input."""
    features = standard_features(colour_filter=colour_filter)
    device = SimulatedDevice("SIM-LIVE", width=width, height=height, frame_rate_hz=rate_hz, features=features)
    camera = SimulatedGigECamera(device, None)  # type: ignore[arg-type]
    camera._renderer = Stamped(height, width)  # type: ignore[assignment]
    with camera:
        print("ready", flush=True)
        sys.stdin.read()


class Processes:
    """Processor time, memory, descriptors and threads of a process and those that it started."""

    def __init__(self, first: psutil.Process, *, with_first: bool) -> None:
        self._first, self._with_first = first, with_first

    def _all(self) -> list[psutil.Process]:
        return [*([self._first] * self._with_first), *self._first.children(recursive=True)]

    def cpu_s(self) -> float:
        """Return the processor time used so far."""
        return float(sum(one.cpu_times().user + one.cpu_times().system for one in self._all()))

    def pss_mb(self) -> float:
        """Return the resident memory, with shared pages divided by those that share them."""
        return float(sum(one.memory_full_info().pss for one in self._all()) / 1e6)

    def counts(self) -> tuple[int, int]:
        """Return the numbers of descriptors and threads."""
        return sum(one.num_fds() for one in self._all()), sum(one.num_threads() for one in self._all())


def regions(n: int, width: int, height: int) -> list[RectangleShape]:
    """Return regions in rows below the squares of the time, each of a tenth of the width at most."""
    across = max(round(n**0.5), 2)
    down = -(-n // across)
    box_px = min(width // 10, width // (2 * across)), min(height // 10, height // (2 * down))
    return [
        RectangleShape(
            f"P{number:02d}",
            width * (2 * (number % across) + 1) // (2 * across) - box_px[0] // 2,
            height // 10 + height * 9 // 10 * (2 * (number // across) + 1) // (2 * down) - box_px[1] // 2,
            *box_px,
        )
        for number in range(n)
    ]


def watch(options: argparse.Namespace, folder: Path) -> None:
    """Show the page of a running camera, and print what it costs."""
    from playwright.sync_api import sync_playwright

    width, height = options.width, options.height
    shapes = regions(options.regions, width, height)
    save_regions(folder / "bench.rois.json", shapes, (width, height))
    command = [str(Path(sys.executable).with_name("labcdp")), "bench", "--camera", ADDRESS, "--no-open", "--json"]
    server = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert server.stderr is not None
    url = next(line.split()[1] for line in server.stderr if line.startswith("Open: "))
    with sync_playwright() as playwright:
        before = set(psutil.Process().children(recursive=True))
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        (first,) = (one for one in set(psutil.Process().children(recursive=True)) - before if _is_browser(one))
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url)
        card = page.locator(".card").first.filter(has_text=re.compile(" fps"))
        card.wait_for(timeout=120_000)
        if options.format:
            page.get_by_text("Camera", exact=True).last.click()
            page.get_by_label("Pixel format").select_option(options.format)
            page.get_by_text("Live", exact=True).first.click()
        page.wait_for_timeout(5000)
        page.evaluate(WATCH, [N_BITS, SIDE_PX, 2**N_BITS])
        sides = Processes(psutil.Process(server.pid), with_first=True), Processes(first, with_first=True)
        follow(page, sides, options)
        browser.close()
    server.send_signal(signal.SIGINT)
    result = json.loads(server.communicate()[0])
    print("; ".join(f"{row['quantity']} {row['value']:g}" for row in result["tables"]["frames"]["rows"]))


def follow(page, sides: tuple[Processes, Processes], options: argparse.Namespace) -> None:  # type: ignore[no-untyped-def]
    """Print a line each while, and a summary."""
    print(
        f"{'min':>6s} {'shown/s':>8s} {'matrix/s':>8s} "
        f"{'delay p50':>9s} {'p90':>5s} {'p99':>5s} {'server cores':>12s} {'browser':>8s} "
        f"{'ms/frame':>8s} {'browser':>8s} {'server MB':>9s} {'browser':>8s} {'files':>9s} {'threads':>9s}"
    )
    began_s = last_s = time.monotonic()
    used = [side.cpu_s() for side in sides]
    lines = []
    while last_s - began_s < options.seconds:
        page.wait_for_timeout(1000 * min(options.every, options.seconds))
        delays = page.evaluate("() => window.delays.splice(0)")
        n_matrices = page.evaluate("() => { const n = window.matrices; window.matrices = 0; return n }")
        now_s, now_used = time.monotonic(), [side.cpu_s() for side in sides]
        spent, during_s, last_s = np.subtract(now_used, used), now_s - last_s, now_s
        used, n = now_used, max(len(delays), 1)
        counts = [side.counts() for side in sides]
        memory = [side.pss_mb() for side in sides]
        p50, p90, p99 = np.percentile(delays or [np.nan], (50, 90, 99))
        per_frame = 1e3 * spent / n
        print(
            f"{(now_s - began_s) / 60:6.1f} {len(delays) / during_s:8.2f} "
            f"{n_matrices / during_s:8.2f} {p50:6.0f} ms {p90:5.0f} {p99:5.0f} "
            f"{spent[0] / during_s:12.2f} {spent[1] / during_s:8.2f} {per_frame[0]:8.1f} {per_frame[1]:8.1f} "
            f"{memory[0]:9.1f} {memory[1]:8.1f} "
            f"{counts[0][0]:5d} {counts[1][0]:4d} {counts[0][1]:5d} {counts[1][1]:4d}",
            flush=True,
        )
        lines.append((now_s - began_s, *memory))
    # The first fifth is left out: what is loaded once.
    later = np.array(lines[len(lines) // 5 :])
    if len(later) > 2:
        slopes = [3600 * np.polyfit(later[:, 0], later[:, side], 1)[0] for side in (1, 2)]
        print(f"memory after the first fifth: server {slopes[0]:+.1f} MB/h, browser {slopes[1]:+.1f} MB/h")


def _is_browser(process: psutil.Process) -> bool:
    return "chromium" in process.name() and "--type=" not in " ".join(process.cmdline())


def main() -> None:
    parser = argparse.ArgumentParser(description="see the head of this file")
    parser.add_argument("role", nargs="?", choices=("serve",))
    parser.add_argument("--width", type=int, default=2452)
    parser.add_argument("--height", type=int, default=2056)
    parser.add_argument("--rate", type=float, default=15.0)
    parser.add_argument("--regions", type=int, default=4, help="all against all are shown from 7 on")
    parser.add_argument("--format", default="", help="pixel format, for example BayerRG8")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--every", type=float, default=20.0)
    options = parser.parse_args()
    if options.role == "serve":
        bayer = options.format.removeprefix("Bayer")
        serve(options.width, options.height, options.rate, bayer[:2] if bayer != options.format else None)
        return
    command = [
        sys.executable,
        __file__,
        "serve",
        *(f"--{one}={getattr(options, one)}" for one in ("width", "height", "rate", "format")),
    ]
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as camera,
    ):
        assert camera.stdout is not None
        assert camera.stdout.readline() == "ready\n"
        watch(options, Path(folder))
        camera.communicate()


if __name__ == "__main__":
    main()
