"""A command imports what it needs: the number of modules of labcdp that each has imported when it ends."""

import json
import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest

from labcdp.core.roi import Roi
from labcdp.regions import PolygonShape, save_regions
from labcdp.session import example_session

_RUN = """
import json, sys
from labcdp.cli import main
sys.argv = ["labcdp", *sys.argv[2:]]
status = 0
try:
    main()
except SystemExit as end:
    status = end.code or 0
finally:
    count = sum(name.partition(".")[0] == "labcdp" for name in sys.modules)
    print(json.dumps([status, count]), file=sys.stderr)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A picture, a video of four frames with the same scene, their regions, and a session."""
    path, rng = tmp_path_factory.mktemp("imports"), np.random.default_rng(1)
    scene = np.full((120, 160), 60.0)
    scene[30:90, 20:80] = 150
    frames = [np.clip(rng.normal(scene, 5), 0, 255).astype(np.uint8) for _ in range(4)]
    assert cv2.imwrite(str(path / "night.png"), frames[0])
    writer = cv2.VideoWriter(str(path / "drive.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (160, 120))
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    boxes = [Roi.rectangle("bright", 30, 40, 40, 40), Roi.rectangle("dark", 100, 40, 40, 40)]
    save_regions(path / "rois.json", [PolygonShape(roi.name, roi.corners) for roi in boxes], (160, 120))
    shutil.copytree(example_session(), path / "session")
    return path


def n_imported(folder, *arguments):
    done = subprocess.run(
        [sys.executable, "-c", _RUN, "labcdp", *arguments], cwd=folder, capture_output=True, text=True, check=True
    )
    status, count = json.loads(done.stderr.splitlines()[-1])
    assert status == 0, done.stderr
    return count


@pytest.mark.parametrize(
    ("arguments", "most"), [(["image", "night.png", "--roi", "rois.json"], 95), (["--help"], 15),
                            (["video", "drive.avi", "--roi", "rois.json"], 140)]
)  # fmt: skip
def test_pictures_and_videos_import_few_modules(folder, arguments, most):
    assert n_imported(folder, *arguments) <= most


def test_calibrate_and_evaluate_import_few_modules(folder):
    assert n_imported(folder, "calibrate", "session", "--output", "c") <= 150
    assert n_imported(folder, "evaluate", "session", "--calibration", "c/calibration.json") <= 150
