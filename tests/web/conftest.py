"""A picture with known values, and the page served on it as a person starts it."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

CHROMIUM = shutil.which("chromium")
WIDTH, HEIGHT = 640, 400


def known_dn() -> NDArray[np.uint16]:
    """16-bit DN: the left half dark, the right half ten times as bright, with noise; one pixel that differs."""
    rng = np.random.default_rng(7)
    mean = np.where(np.arange(WIDTH) < WIDTH // 2, 3000.0, 30000.0)
    dn = np.rint(rng.normal(mean, 0.1 * mean, (HEIGHT, WIDTH))).astype(np.uint16)
    dn[100, 50] = 12340
    return dn


@dataclass
class Served:
    """A running `labcdp rois`."""

    process: subprocess.Popen[str]
    url: str
    port: int
    lines: list[str]

    def stop(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """End it; return its exit status and what it said last."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        _, said = self.process.communicate(timeout=300)
        return self.process.returncode, said


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("picture") / "bench.png"
    assert cv2.imwrite(str(path), known_dn())
    return path


@pytest.fixture(scope="module")
def serve() -> Iterator[Callable[..., Served]]:
    """Start `labcdp rois` with arguments, and wait for its address."""
    running: list[subprocess.Popen[str]] = []

    def start(*arguments: str | Path) -> Served:
        command = [str(Path(sys.executable).with_name("labcdp")), "rois", *map(str, arguments)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
        running.append(process)
        assert process.stderr is not None
        lines: list[str] = []
        for line in process.stderr:
            lines.append(line.rstrip())
            if line.startswith("Ctrl-C"):
                break
        found = re.search(r"Open: (http://\S+:(\d+)/\S*)", "\n".join(lines))
        assert found is not None, lines
        return Served(process, found[1], int(found[2]), lines)

    yield start
    for process in running:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_until(condition: Callable[[], bool], what: str, patience_s: float = 120) -> None:
    """Wait for something that another process does."""
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end, f"waited in vain until {what}"
        time.sleep(0.05)
