import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from labcdp.regions import RectangleShape, save_regions

REGIONS = [RectangleShape("sign", 22, 42, 26, 26), RectangleShape("ground", 22, 82, 26, 26)]
SIZE = (160, 120)


def frame(rng, number=0):
    """A noisy image with a bright and a dark square that move to the right."""
    image = 90 + rng.normal(0, 2, SIZE[::-1])
    image[40:70, 20 + number : 50 + number] = 200 + rng.normal(0, 4, (30, 30))
    image[80:110, 20 + number : 50 + number] = 60 + rng.normal(0, 4, (30, 30))
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "night.png"
    cv2.imwrite(str(path), frame(np.random.default_rng(4)))
    return path


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "drive.avi"
    rng = np.random.default_rng(5)
    flags = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, SIZE, flags)
    for number in range(5):
        writer.write(frame(rng, number))
    writer.release()
    return path


@pytest.fixture
def rois(tmp_path):
    path = tmp_path / "rois.json"
    save_regions(path, REGIONS, SIZE)
    return path


@pytest.fixture
def three(tmp_path):
    path = tmp_path / "three.json"
    save_regions(path, [*REGIONS, RectangleShape("sky", 100, 5, 30, 20)], SIZE)
    return path


@pytest.fixture
def command(tmp_path):
    """Run a command of labcdp in the test's folder and return what it printed."""

    def run(*arguments):
        words = [str(Path(sys.executable).with_name("labcdp")), *map(str, arguments)]
        return subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, text=True, timeout=240).stdout

    return run
