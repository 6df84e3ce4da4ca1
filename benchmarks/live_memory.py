"""Memory of the live bench's process while it is used: settings, pairs, contrasts, maps, browsers, with a calibration.

Run ``python benchmarks/live_memory.py --minutes 60``. It records and calibrates on the simulated bench, starts
``labcdp bench``, does in Chromium what a person does, round after round, and prints the memory after each act; at the
end the highest, and the mean of the first and of the last third of the rounds without the first. It fails if the mean
has grown by a tenth. The simulated camera is in the same process: the line *no page* is mostly its target.
"""

from __future__ import annotations

import argparse
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil

LABCDP = str(Path(sys.executable).with_name("labcdp"))
#: Largest growth from the first to the last third of the rounds.
MOST_GROWTH = 1.1


def main() -> None:
    parser = argparse.ArgumentParser(description="see the head of this file")
    parser.add_argument("--minutes", type=float, default=60.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for arguments in (
            ("init", "bench", "bench.toml"),
            ("acquire", "bench.toml", "session", "--simulated", "--virtual-clock"),
            ("calibrate", "session"),
        ):
            subprocess.run([LABCDP, *arguments], cwd=folder, check=True, capture_output=True)
        calibration = "session-calibrate/calibration.json"
        command = [LABCDP, "bench", "bench.toml", "--simulated", "--no-open", "--calibration", calibration]
        with subprocess.Popen(
            command, cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        ) as server:
            assert server.stderr is not None
            url = next(line.split()[1] for line in server.stderr if line.startswith("Open: "))
            try:
                used = use(url, psutil.Process(server.pid), options.minutes)
            finally:
                server.send_signal(signal.SIGINT)
    later = np.array(used[1:])
    third = max(len(later) // 3, 1)
    first, last = (part.mean() for part in (later[:third], later[-third:]))
    print(f"highest {later.max():.0f} MB; first third {first:.0f} MB, last third {last:.0f} MB")
    if last > MOST_GROWTH * first:
        raise SystemExit("the memory grows")


def use(url: str, server: psutil.Process, minutes: float) -> list[list[float]]:
    """Use the page; return the memory in MB after each act, a list for each round."""
    from playwright.sync_api import sync_playwright

    began_s, rounds = time.monotonic(), []

    def resident(what: str) -> float:
        mb = float(server.memory_info().rss / 1e6)
        print(f"{(time.monotonic() - began_s) / 60:6.1f} min {mb:7.0f} MB {what}", flush=True)
        return mb

    resident("no page")
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        page = opened(browser, url)
        while time.monotonic() - began_s < 60 * minutes:
            acts = {"settings": settings, "contrasts": contrasts, "pairs": pairs, "maps": maps}
            rounds.append([done(act, page, what, resident) for what, act in acts.items()])
            other = opened(browser, url)
            other.wait_for_timeout(2000)
            other.close()
            rounds[-1].append(resident("another browser"))
        browser.close()
    return rounds


def opened(browser: Any, url: str) -> Any:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(120_000)
    page.goto(url)
    page.locator(".card").first.filter(has_text="fps").wait_for()
    return page


def done(act: Callable[[Any], None], page: Any, what: str, resident: Callable[[str], float]) -> float:
    act(page)
    return resident(what)


def fill(page: Any, label: str, text: str) -> None:
    field = page.get_by_label(label).first
    field.fill(text)
    field.press("Enter")
    page.wait_for_timeout(1500)


def tab(page: Any, number: int) -> None:
    page.evaluate("document.activeElement?.blur()")
    page.keyboard.press(str(number))
    page.wait_for_timeout(300)


def settings(page: Any) -> None:
    tab(page, 1)
    for exposure in ("2", "5", "8", "3"):
        fill(page, "Exposure (ms)", exposure)
    for gain in ("3", "0"):
        fill(page, "Gain (dB)", gain)


def contrasts(page: Any) -> None:
    for contrast in ("100", "50%, 100%, 300%", "1000"):
        fill(page, "Target contrast", contrast)


def pairs(page: Any) -> None:
    for number in range(4):
        page.locator(".planned tbody tr").nth(number).click()
        page.wait_for_timeout(1500)


def maps(page: Any) -> None:
    tab(page, 4)
    page.get_by_label("Picture").select_option("Luminance in false colours")
    fill(page, "Isolines", "1, 10, 100")
    fill(page, "Profile from", "100, 100, 2000, 1800")
    page.wait_for_timeout(3000)
    fill(page, "Isolines", "")
    fill(page, "Profile from", "")
    page.get_by_label("Picture").select_option("Values of the camera")


if __name__ == "__main__":
    main()
