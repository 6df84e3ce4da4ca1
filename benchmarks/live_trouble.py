"""The live bench under trouble in Chromium: a browser that sleeps, a line that is cut, a flood of messages.

Run ``python benchmarks/live_trouble.py``; ``--asleep-s 3600`` lets the browser sleep for an hour. It prints the memory
of the server and what waits to be sent while the browser is stopped, whether images go on afterwards, how long the page
takes to come back after its websocket was closed, and the memory after 30 MB of messages that mean nothing.
"""

from __future__ import annotations

import argparse
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
from bench_live import ADDRESS

#: Keeps the websockets of the page, so that they can be closed and flooded.
WATCHED = """window.sockets = []
const Plain = WebSocket
window.WebSocket = class extends Plain {
  constructor(...given) { super(...given); window.sockets.push(this) }
}"""
LINK = "Bokeh.documents[0].get_model_by_name('picture').tags[0]"


def waiting_bytes(port: int) -> int:
    """Return the bytes that the server has sent and the browser has not taken."""
    command = ["ss", "-tnH", "state", "established", f"( sport = :{port} )"]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    return sum(int(line.split()[1]) for line in lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="see the head of this file")
    parser.add_argument("--asleep-s", type=float, default=60.0)
    asleep_s = parser.parse_args().asleep_s
    of_camera = [sys.executable, str(Path(__file__).with_name("bench_live.py")), "serve", "--width=640", "--height=480"]
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(of_camera, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as camera,
    ):
        assert camera.stdout is not None
        assert camera.stdout.readline() == "ready\n"
        command = [str(Path(sys.executable).with_name("labcdp")), "bench", "--camera", ADDRESS, "--no-open"]
        with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as server:
            assert server.stderr is not None
            trouble(next(line.split()[1] for line in server.stderr if line.startswith("Open: ")), server.pid, asleep_s)
            server.send_signal(signal.SIGINT)
        camera.communicate()


def trouble(url: str, server_pid: int, asleep_s: float) -> None:
    """Open the page, and let the troubles happen one after the other."""
    from playwright.sync_api import sync_playwright

    server, port = psutil.Process(server_pid), int(re.search(r":(\d+)/", url)[1])  # type: ignore[index]

    def resident_mb() -> float:
        return float(server.memory_info().rss / 1e6)

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(120_000)
        page.add_init_script(WATCHED)
        page.goto(url)
        frames = page.locator(".card").first.filter(has_text=re.compile(" fps"))
        frames.wait_for()
        page.wait_for_timeout(5000)

        processes = [one for one in psutil.Process().children(recursive=True) if "chromium" in one.name()]
        before_mb, drawn = resident_mb(), page.evaluate(f"{LINK}.drawn")
        for one in processes:
            one.send_signal(signal.SIGSTOP)
        time.sleep(asleep_s)
        print(f"asleep for {asleep_s:g} s: {before_mb:.1f} to {resident_mb():.1f} MB, {waiting_bytes(port)} bytes wait")
        for one in processes:
            one.send_signal(signal.SIGCONT)
        page.wait_for_function(f"() => {LINK}.drawn > {drawn + 3}")
        print("awake: images go on")

        began_s = time.monotonic()
        page.evaluate("() => { window.before = true; window.sockets.forEach((one) => one.close()) }")
        page.wait_for_function("() => window.before === undefined")
        frames.wait_for()
        print(f"websocket closed: images again after {time.monotonic() - began_s:.1f} s")

        before_mb = resident_mb()
        page.evaluate("() => { for (let i = 0; i < 300; i++) window.sockets.at(-1).send('x'.repeat(100000)) }")
        page.wait_for_timeout(5000)
        frames.wait_for()
        print(f"30 MB of nonsense: {before_mb:.1f} to {resident_mb():.1f} MB, images go on")
        browser.close()


if __name__ == "__main__":
    main()
