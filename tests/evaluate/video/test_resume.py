"""An interrupted evaluation resumes with identical results; and it keeps no frames."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labcdp.core.errors import InputError
from labcdp.evaluate.video.evaluate import JOURNAL, evaluate_video
from labcdp.evaluate.video.settings import VideoSettings, video_configuration

from .videos import MOVING, STILL, driving, write

ROIS = MOVING, STILL
FOLLOWED = VideoSettings((0.2, 1.0), ROIS, "follow", reference="first")
PROGRAM = """
import resource, sys, time
from pathlib import Path
from labcdp.core.roi import Roi
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
rois = Roi.rectangle("moving", 20, 40, 30, 30), Roi.rectangle("still", 20, 80, 30, 30)
folder = Path(sys.argv[1])
"""


def moving(path: Path, n: int, seed: int = 5) -> Path:
    return write(path, driving(n, 3, 3.0, seed))


@pytest.mark.parametrize("settings", [FOLLOWED, VideoSettings((0.2, 1.0))], ids=["regions", "neighbours"])
def test_a_journal_cut_or_altered_anywhere_gives_the_same_result(tmp_path: Path, settings: VideoSettings) -> None:
    path, journal = moving(tmp_path / "a.mkv", 9), tmp_path / "out" / JOURNAL
    whole = evaluate_video(path, settings, tmp_path / "out")
    xr.testing.assert_identical(whole, evaluate_video(path, settings, None))
    text = journal.read_bytes()
    lines = text.splitlines(keepends=True)
    assert len(lines) == 1 + 9 + 1
    starts = np.cumsum([0, *map(len, lines)])
    cut = [text[:length] for length in (5, int(starts[2]) + 9, int(starts[6]), int(starts[-2]))]
    for damaged in (*cut, text.replace(b'"frame": 4', b'"frame": 9')):
        journal.write_bytes(damaged)
        xr.testing.assert_identical(evaluate_video(path, settings, tmp_path / "out"), whole)
        assert journal.read_bytes() == text


def test_killed_midway_it_resumes(tmp_path: Path) -> None:
    path = moving(tmp_path / "a.mkv", 18)
    program = f"""{PROGRAM}
def progress(done, total):
    print(done, flush=True)
    if done == 14:
        time.sleep(600)
settings = VideoSettings((0.2, 1.0), rois, "follow", reference="first")
evaluate_video(folder / "a.mkv", settings, folder / "out", progress=progress)
"""
    with subprocess.Popen([sys.executable, "-c", program, tmp_path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "9\n" in process.stdout
        process.kill()
    n_lines = (tmp_path / "out" / JOURNAL).read_bytes().count(b"\n")
    # The first line is that of the settings.
    assert 1 + 9 <= n_lines <= 1 + 14
    told: list[int] = []
    resumed = evaluate_video(path, FOLLOWED, tmp_path / "out", progress=lambda done, total: told.append(done))
    xr.testing.assert_identical(resumed, evaluate_video(path, FOLLOWED, None))
    assert told == list(range(1, 19))


def test_the_journal_of_another_evaluation_is_refused(tmp_path: Path) -> None:
    first, other = (moving(tmp_path / f"{n}.mkv", 2, seed=n) for n in range(2))
    settings = VideoSettings((1.0,), ROIS, "fixed")
    evaluate_video(first, settings, tmp_path / "out")
    for path, changed, text in (
        (other, settings, "another video"),
        (first, VideoSettings((2.0,), ROIS, "fixed"), "another settings"),
        (first, VideoSettings((1.0,)), "another settings"),
    ):
        with pytest.raises(InputError, match=rf"holds the results of another evaluation \({text}\): give another"):
            evaluate_video(path, changed, tmp_path / "out")


def test_memory_does_not_grow_with_the_video(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 255, (480, 640)).astype(np.uint8) for _ in range(4)]
    for n in (20, 70):
        write(tmp_path / f"{n}.avi", [images[number % 4] for number in range(n)], "MJPG")
    program = f"""{PROGRAM}
for n in (20, 70):
    evaluate_video(folder / f"{{n}}.avi", VideoSettings((1.0,), rois, "fixed"))
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
    done = subprocess.run([sys.executable, "-c", program, tmp_path], capture_output=True, text=True, check=True)
    first, second = map(int, done.stdout.split())
    # 50 frames that are kept have 15 MB.
    assert second - first < 10_000


def test_a_changed_curve_that_a_camera_specification_names_is_another_evaluation(tmp_path: Path) -> None:
    curve, camera = tmp_path / "curve.toml", tmp_path / "camera.toml"
    camera.write_text(
        'name = "series"\nadc_bits = 12\nexposure_s = 0.01\nquantum_efficiency = 0.5\npixel_pitch_m = 3e-6\n'
        f'f_number = 1.8\nk_dn_per_e = 1.0\nlens_transmittance = 0.9\nspectrum = "D65"\nencoding = "{curve}"\n'
    )
    configurations = []
    for last in (100, 200):
        curve.write_text(f'name = "curve"\nbits = 12\ncodes = [0, 10, 20]\nvalues = [0, 10, {last}]\n')
        configurations.append(video_configuration(VideoSettings((1.0,), ROIS, "fixed", camera=camera), None))
    first, second = configurations
    assert first["camera_sha256"] == second["camera_sha256"]
    assert first != second
