"""An interrupted evaluation resumes with identical results; and it keeps no frames."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labcdp.core.errors import InputError
from labcdp.evaluate.video.evaluate import JOURNAL as FILE_NAME
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings

from .videos import MOVING, STILL, driving, write

ROIS = MOVING, STILL


def moving(path: Path, n: int, seed: int = 5) -> Path:
    return write(path, driving(n, 3, 3.0, seed))


@pytest.mark.parametrize(
    "settings",
    [VideoSettings((0.2, 1.0), ROIS, "follow", reference="first"), VideoSettings((0.2, 1.0))],
    ids=["regions", "neighbours"],
)
def test_a_journal_cut_anywhere_gives_the_same_result(tmp_path: Path, settings: VideoSettings) -> None:
    path = moving(tmp_path / "a.mkv", 9)
    whole = evaluate_video(path, settings, tmp_path / "whole")
    xr.testing.assert_identical(whole, evaluate_video(path, settings, None))
    text = (tmp_path / "whole" / FILE_NAME).read_bytes()
    lines = text.splitlines(keepends=True)
    assert len(lines) == 1 + 9 + 1
    starts = np.cumsum([0, *map(len, lines)])
    cuts = [5, int(starts[2]) + 9, int(starts[6]), int(starts[-2])]
    folder = shutil.copytree(tmp_path / "whole", tmp_path / "cut")
    for cut in cuts:
        (folder / FILE_NAME).write_bytes(text[:cut])
        xr.testing.assert_identical(evaluate_video(path, settings, folder), whole)
        assert (folder / FILE_NAME).read_bytes() == text


def test_a_line_that_was_altered_and_all_behind_it_are_evaluated_again(tmp_path: Path) -> None:
    path, settings = moving(tmp_path / "a.mkv", 8), VideoSettings((1.0,), ROIS, "fixed")
    whole = evaluate_video(path, settings, tmp_path / "out")
    journal = tmp_path / "out" / FILE_NAME
    text = journal.read_bytes()
    journal.write_bytes(text.replace(b'"frame": 4', b'"frame": 9'))
    xr.testing.assert_identical(evaluate_video(path, settings, tmp_path / "out"), whole)
    assert journal.read_bytes() == text


def test_killed_midway_it_resumes(tmp_path: Path) -> None:
    path = moving(tmp_path / "a.mkv", 18)
    settings = VideoSettings((0.2, 1.0), ROIS, "follow", reference="first")
    program = f"""
import sys, time
from pathlib import Path
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.core.roi import Roi
rois = Roi.rectangle("moving", 20, 40, 30, 30), Roi.rectangle("still", 20, 80, 30, 30)
settings = VideoSettings((0.2, 1.0), rois, "follow", reference="first")
def progress(done, total):
    print(done, flush=True)
    if done == 14:
        time.sleep(600)
evaluate_video(Path({str(path)!r}), settings, Path({str(tmp_path / "out")!r}), progress=progress)
"""
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if int(line) == 9:
            break
    process.send_signal(signal.SIGKILL)
    process.communicate()
    n_lines = (tmp_path / "out" / FILE_NAME).read_bytes().count(b"\n")
    # The first line is that of the settings.
    assert 1 + 9 <= n_lines <= 1 + 14
    told: list[int] = []
    resumed = evaluate_video(path, settings, tmp_path / "out", progress=lambda done, total: told.append(done))
    xr.testing.assert_identical(resumed, evaluate_video(path, settings, None))
    assert told == list(range(1, 19))


@pytest.mark.parametrize(
    ("video", "changed", "text"),
    [
        (1, VideoSettings((1.0,), ROIS, "fixed"), "another video"),
        (0, VideoSettings((2.0,), ROIS, "fixed"), "another settings"),
        (0, VideoSettings((1.0,), ROIS, "follow"), "another settings"),
        (0, VideoSettings((1.0,)), "another settings"),
    ],
)
def test_the_journal_of_another_evaluation_is_refused(
    tmp_path: Path, video: int, changed: VideoSettings, text: str
) -> None:
    paths = [moving(tmp_path / f"{n}.mkv", 3, seed=n) for n in range(2)]
    evaluate_video(paths[0], VideoSettings((1.0,), ROIS, "fixed"), tmp_path / "out")
    with pytest.raises(InputError, match=rf"holds the results of another evaluation \({text}\): give another folder"):
        evaluate_video(paths[video], changed, tmp_path / "out")


def test_memory_does_not_grow_with_the_video(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 255, (480, 640)).astype(np.uint8) for _ in range(4)]
    for n in (20, 70):
        write(tmp_path / f"{n}.avi", [images[number % 4] for number in range(n)], "MJPG")
    program = f"""
import resource
from pathlib import Path
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.core.roi import Roi
rois = (Roi.rectangle("a", 20, 40, 30, 30), Roi.rectangle("b", 20, 80, 30, 30))
for n in (20, 70):
    evaluate_video(Path({str(tmp_path)!r}) / f"{{n}}.avi", VideoSettings((1.0,), rois, "fixed"))
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    first, second = map(int, done.stdout.split())
    # 50 frames that are kept have 15 MB.
    assert second - first < 10_000
