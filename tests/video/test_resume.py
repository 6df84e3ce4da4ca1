"""An evaluation that was broken off goes on and gives the same, bit for bit; and it keeps no frames."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr

from labcdp.errors import InputError
from labcdp.evaluate.video import evaluate_video
from labcdp.evaluate.video_journal import FILE_NAME, VideoJournal
from labcdp.evaluate.video_settings import VideoSettings
from labcdp.roi import Roi

ROIS = (Roi.rectangle("a", 20, 40, 30, 30), Roi.rectangle("b", 20, 80, 30, 30))


@pytest.fixture(autouse=True)
def _quiet() -> None:
    os.environ["OPENCV_FFMPEG_LOGLEVEL"] = "-8"
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def write(path: Path, n: int, seed: int = 5) -> Path:
    """A patch that moves and one that stays."""
    rng = np.random.default_rng(seed)
    ground = cv2.GaussianBlur(rng.normal(90, 60, (120, 160)), (0, 0), 2)
    flags = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 25, (160, 120), flags)
    for number in range(n):
        image = ground + rng.normal(0, 3, ground.shape)
        left = 20 + 3 * (number % 30)
        image[40:70, left : left + 30] += 100
        writer.write(np.clip(image, 0, 255).astype(np.uint8))
    writer.release()
    return path


def result_of(path: Path, settings: VideoSettings, folder: Path | None) -> xr.Dataset:
    return evaluate_video(path, settings, folder)


@pytest.mark.parametrize(
    "settings",
    [VideoSettings((0.2, 1.0), ROIS, "kcf", reference="first"), VideoSettings((0.2, 1.0))],
    ids=["regions", "neighbours"],
)
def test_a_journal_cut_anywhere_gives_the_same_result(tmp_path: Path, settings: VideoSettings) -> None:
    path = write(tmp_path / "a.mkv", 9)
    whole = result_of(path, settings, tmp_path / "whole")
    xr.testing.assert_identical(whole, result_of(path, settings, None))
    text = (tmp_path / "whole" / FILE_NAME).read_bytes()
    lines = text.splitlines(keepends=True)
    assert len(lines) == 1 + 9 + 1
    starts = np.cumsum([0, *map(len, lines)])
    cuts = [5, int(starts[1]), int(starts[2]) + 9, int(starts[6]) - 1, int(starts[6]), int(starts[-2])]
    folder = tmp_path / "cut"
    folder.mkdir()
    for cut in cuts:
        (folder / FILE_NAME).write_bytes(text[:cut])
        xr.testing.assert_identical(result_of(path, settings, folder), whole)
        assert (folder / FILE_NAME).read_bytes() == text


def test_a_line_that_was_altered_and_all_behind_it_are_evaluated_again(tmp_path: Path) -> None:
    path, settings = write(tmp_path / "a.mkv", 8), VideoSettings((1.0,), ROIS, "fixed")
    whole = result_of(path, settings, tmp_path)
    journal = tmp_path / FILE_NAME
    text = journal.read_bytes()
    journal.write_bytes(text.replace(b'"frame": 4', b'"frame": 9'))
    xr.testing.assert_identical(result_of(path, settings, tmp_path), whole)
    assert journal.read_bytes() == text


def test_killed_in_the_midst_it_goes_on(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", 24)
    settings = VideoSettings((0.2, 1.0), ROIS, "kcf", reference="first")
    program = f"""
import sys, time
from pathlib import Path
from labcdp.evaluate.video import evaluate_video
from labcdp.evaluate.video_settings import VideoSettings
from labcdp.roi import Roi
rois = (Roi.rectangle("a", 20, 40, 30, 30), Roi.rectangle("b", 20, 80, 30, 30))
settings = VideoSettings((0.2, 1.0), rois, "kcf", reference="first")
def progress(done, total):
    print(done, flush=True)
    time.sleep(0.02)
evaluate_video(Path({str(path)!r}), settings, Path({str(tmp_path / "out")!r}), progress=progress)
"""
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if int(line) == 9:
            break
    time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    n_lines = (tmp_path / "out" / FILE_NAME).read_bytes().count(b"\n")
    assert 10 <= n_lines < 25
    told: list[int] = []
    resumed = evaluate_video(path, settings, tmp_path / "out", progress=lambda done, total: told.append(done))
    xr.testing.assert_identical(resumed, result_of(path, settings, None))
    assert told == list(range(1, 25))


def test_what_is_done_is_not_decoded_again(tmp_path: Path) -> None:
    path, settings = write(tmp_path / "a.mkv", 6), VideoSettings((1.0,), ROIS, "fixed")
    whole = result_of(path, settings, tmp_path)
    told: list[int] = []
    again = evaluate_video(path, settings, tmp_path, progress=lambda done, total: told.append(done))
    xr.testing.assert_identical(again, whole)
    assert told == []
    seen: list[int] = []
    evaluate_video(path, settings, tmp_path, observer=lambda number, grey, regions, row: seen.append(number))
    assert seen == list(range(6))


@pytest.mark.parametrize(
    ("video", "changed", "text"),
    [
        (1, VideoSettings((1.0,), ROIS, "fixed"), "another video"),
        (0, VideoSettings((2.0,), ROIS, "fixed"), "another settings"),
        (0, VideoSettings((1.0,), ROIS, "kcf"), "another settings"),
        (0, VideoSettings((1.0,)), "another settings"),
    ],
)
def test_the_journal_of_another_evaluation_is_refused(
    tmp_path: Path, video: int, changed: VideoSettings, text: str
) -> None:
    paths = [write(tmp_path / f"{n}.mkv", 3, seed=n) for n in range(2)]
    result_of(paths[0], VideoSettings((1.0,), ROIS, "fixed"), tmp_path)
    with pytest.raises(InputError, match=rf"holds the results of another evaluation \({text}\): give another folder"):
        result_of(paths[video], changed, tmp_path)


def test_the_journal_of_another_version_is_refused(tmp_path: Path) -> None:
    journal = VideoJournal.open(tmp_path, {"format": 1, "versions": {"labcdp": "0.0.1"}})
    journal.add({"frame": 0})
    journal.close()
    with pytest.raises(InputError, match=r"another evaluation \(another versions\)"):
        VideoJournal.open(tmp_path, {"format": 1, "versions": {"labcdp": "0.0.2"}})


def test_a_journal_without_a_row_is_replaced(tmp_path: Path) -> None:
    VideoJournal.open(tmp_path, {"format": 1, "settings": "refused"}).close()
    journal = VideoJournal.open(tmp_path, {"format": 1, "settings": "good"})
    journal.add({"frame": 0})
    journal.close()
    again = VideoJournal.open(tmp_path, {"format": 1, "settings": "good"})
    assert list(again.rows()) == [{"frame": 0}]
    again.close()
    with pytest.raises(InputError, match=r"another evaluation \(another settings\)"):
        VideoJournal.open(tmp_path, {"format": 1, "settings": "refused"})


def test_rows_are_read_back_bit_for_bit(tmp_path: Path) -> None:
    row = {"frame": 3, "cdp": [0.1 + 0.2, float("nan"), float("inf")], "note": "ä\tb"}
    journal = VideoJournal.open(tmp_path, {"format": 1})
    journal.add(row)
    journal.add({"frame": 4})
    journal.close()
    again = VideoJournal.open(tmp_path, {"format": 1})
    assert json.dumps(next(iter(again.rows()))) == json.dumps(row)
    assert again.row(1) == {"frame": 4}
    assert len(again) == 2
    again.close()


def test_a_folder_that_cannot_be_used_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="cannot be used"):
        VideoJournal.open(tmp_path / "file", {"format": 1})


def test_memory_does_not_grow_with_the_video(tmp_path: Path) -> None:
    flags = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 255, (240, 320)).astype(np.uint8) for _ in range(4)]
    for n in (40, 300):
        path = str(tmp_path / f"{n}.avi")
        writer = cv2.VideoWriter(path, cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, (320, 240), flags)
        for number in range(n):
            writer.write(images[number % 4])
        writer.release()
    program = f"""
import resource
from pathlib import Path
from labcdp.evaluate.video import evaluate_video
from labcdp.evaluate.video_settings import VideoSettings
from labcdp.roi import Roi
rois = (Roi.rectangle("a", 20, 40, 30, 30), Roi.rectangle("b", 20, 80, 30, 30))
for n in (40, 300):
    evaluate_video(Path({str(tmp_path)!r}) / f"{{n}}.avi", VideoSettings((1.0,), rois, "fixed"))
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    first, second = map(int, done.stdout.split())
    # 260 frames that are kept have 20 MB.
    assert second - first < 10_000
