"""A picture with known values, and a page served as a person starts it."""

import re
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

WIDTH, HEIGHT = 640, 400


def known_dn():
    """16-bit DN: the left half dark, the right half ten times as bright, with noise; one pixel that differs."""
    rng = np.random.default_rng(7)
    mean = np.where(np.arange(WIDTH) < WIDTH // 2, 3000.0, 30000.0)
    dn = np.rint(rng.normal(mean, 0.1 * mean, (HEIGHT, WIDTH))).astype(np.uint16)
    dn[100, 50] = 12340
    return dn


@dataclass
class Served:
    """A running command with a page, and what it said so far."""

    process: Any
    url: str
    port: int
    lines: list[str]

    def stop(self, number=signal.SIGINT):
        """End it; return its exit status and what it said last."""
        self.process.send_signal(number)
        said = self.process.stderr.read()
        assert "Traceback" not in said
        return self.process.wait(300), said.splitlines()


@pytest.fixture(scope="session")
def picture(tmp_path_factory):
    path = tmp_path_factory.mktemp("picture") / "bench.png"
    assert cv2.imwrite(str(path), known_dn())
    return path


@pytest.fixture(scope="module")
def serve(start_in):
    """Start a command with arguments, and wait for the address of its page."""
    running = []

    def start(*arguments, folder=Path(), environment=(), opened=False):
        shown = () if opened else ("--no-open",)
        environment = {"OMP_NUM_THREADS": "1", **dict(environment)}
        process = start_in(folder.absolute(), *arguments, *shown, pipes=True, environment=environment)
        running.append(process)
        lines = []
        for line in process.stderr:
            lines.append(line.rstrip())
            if line.startswith("Ctrl-C"):
                break
        found = re.search(r"Open: (http://\S+:(\d+)/\S*)", "\n".join(lines))
        assert found is not None, lines
        return Served(process, found[1], int(found[2]), lines)

    yield start
    for process in running:
        process.end()
