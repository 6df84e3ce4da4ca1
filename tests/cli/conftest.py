import re
import shutil
import sys
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import cv2
import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.cli.app import app
from labcdp.regions import RectangleShape, save_regions
from labcdp.session import example_session

from ..conftest import valid
from ..evaluate.sweep.chains import small
from ..evaluate.video.videos import write

#: Bars of work done before a mistake could be seen, and what a person was asked, may stand before its line.
_PROGRESS = re.compile(r"\d+/\d+ +\d:\d\d:\d\d|then press Enter|^Resuming |^labcdp: simulated")
#: A bench whose frames are small.
SMALL_BENCH = Path(__file__).with_name("small-bench.toml")
#: Options of what runs on it in no time.
SIMULATED = ("--simulated-bench", SMALL_BENCH, "--virtual-clock")


@pytest.fixture
def labcdp_path():
    """The command's file."""
    return Path(sys.executable).with_name("labcdp")


@pytest.fixture(scope="session")
def inputs(tmp_path_factory):
    """Small inputs for all commands: picture, video, regions, chain, the example session `s`, a calibration in `c`."""
    folder = tmp_path_factory.mktemp("inputs")
    rng = np.random.default_rng(0)
    picture = np.clip(rng.normal(60, 3, (48, 64)) + 100 * (np.arange(64) > 32), 0, 255).astype(np.uint8)
    cv2.imwrite(str(folder / "a.png"), picture)
    save_regions(folder / "rois.json", [RectangleShape("dark", 4, 4, 12, 12), RectangleShape("bright", 44, 4, 12, 12)])
    write(folder / "a.avi", [picture] * 3, "MJPG")
    small(scene__width=24, scene__height=16, scene__square_px=4, scene__contrast=0.5).save(folder / "small.toml")
    shutil.copytree(example_session(), folder / "s")
    app(["calibrate", str(folder / "s"), "--output", str(folder / "c")], standalone_mode=False)
    # As if it was made from another session: its own one verifies nothing.
    calibration = load(folder / "c" / "calibration.json")
    earlier = calibration.provenance.measured - timedelta(days=1)
    provenance = replace(calibration.provenance, input_sha256="0" * 64, measured=earlier)
    (folder / "c" / "calibration.json").unlink()
    save(replace(calibration, provenance=provenance), folder / "c" / "calibration.json")
    return folder


def results_of(done, status=0):
    """Return what a finished command printed with --json."""
    assert done.returncode == status, done.stderr
    return valid(done.stdout)


def rows_of(done, table):
    """Rows of a table in what a finished command printed with --json."""
    return results_of(done)["tables"][table]["rows"]


def only_line(done):
    """Return the one line that a command says which fails."""
    assert done.returncode == 1, done
    lines = [line for line in done.stderr.splitlines() if not _PROGRESS.search(line)]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("labcdp: ")
    return lines[0]


def plan(patches, exposures_s):
    """Configuration of the example session with some patches, a pattern, and these exposures."""
    text = re.sub(r"\[\[contrast\]\][^\[]*", "", (example_session() / "session.toml").read_text())
    text = re.sub(r"exposures_s = .*", f"exposures_s = {exposures_s}", text)
    return re.sub(rf'\[\[target\.patch\]\]\nname = "(?!{patches})[^[]*\[[^\[]*', "", text)


@pytest.fixture(scope="module")
def running_bench(aravis, start_in, tmp_path_factory):
    """`labcdp simulate-bench` with small frames: its process, and the rows of camera and meter that it prints."""
    options = ("--simulated-bench", SMALL_BENCH, "--response-s", "0", "--json")
    plan = example_session() / "session.toml"
    bench = start_in(tmp_path_factory.mktemp("bench"), "simulate-bench", plan, *options, pipes=True)
    text = ""
    while not text.endswith("\n}\n"):
        line = bench.stdout.readline()
        assert line, bench.stderr.read()
        text += line
    yield bench, *valid(text)["tables"]["devices"]["rows"]
    if bench.poll() is None:
        # A pending fault does not keep it.
        bench.stdin.write("vanish for 1 h\nquit\n")
        bench.stdin.flush()
        assert bench.wait(300) == 0
    bench.end()
