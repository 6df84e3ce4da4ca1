"""The plain package suffices for counting, pictures, chains and sessions; other commands name their extra."""

import tomllib
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from .conftest import Started, connected, forking_server, runs_with

ROOT = Path(__file__).parents[1]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
#: Libraries that only extras bring.
LIBRARIES = ("av", "distributed", "panel", "plotly")
SESSION = ROOT / "labcdp" / "data" / "example-session"


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Run labcdp in a process that has no library of the extras; returns the finished process."""
    with forking_server(LIBRARIES) as path, connected(path) as stream:
        start = partial(Started, stream)
        yield runs_with(
            lambda folder, *words, **options: start(folder, words, tmp_path_factory.mktemp("streams"), **options),
            tmp_path_factory,
        )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    cv2.imwrite(str(folder / "board.png"), (np.indices((40, 40)).sum(axis=0) % 2 * 100 + 100).astype(np.uint8))
    return folder


@pytest.mark.parametrize(
    "arguments",
    [
        ["image", "board.png", "--neighbours", "--contrast", "100%"],
        ["image-map", "board.png"],
        ["info", "board.png"],
        ["calibrate", SESSION],
        ["evaluate", SESSION, "--recalibrate"],
        ["characterise", SESSION],
        ["simulate", "manta-g505", "--exact"],
        ["sweep", "manta-g505", "--exact", "--over", "scene.luminance_cd_m2=1:10:3"],
        ["compare", "manta-g505", "thesis-sensor", "--over", "scene.luminance_cd_m2=1:10:3"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_the_plain_package_suffices(plain, folder, arguments, tmp_path):
    output = [] if arguments[0] == "info" else ["--output", tmp_path / "out"]
    done = plain(folder, *arguments, *output)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (["image", "board.png", "--neighbours", "--surface"], "web"),
        (["rois", "board.png", "--no-open"], "web"),
        (["view", "board.png", "--no-open"], "web"),
        (["bench", "--simulated", "--no-open"], "web"),
        (["video", "drive.mp4", "--neighbours"], "video"),
        (["init", "samples", "street"], "video"),
        (["sweep", "manta-g505", "--over", "scene.contrast=1:2:2", "--cluster", "tcp://127.0.0.1:1"], "cluster"),
    ],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_a_command_that_lacks_a_library_says_which_extra_brings_it(plain, folder, arguments, extra, tmp_path):
    (folder / "drive.mp4").write_bytes(b"\0\0\0\x18ftypisom")
    done = plain(folder, *arguments)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert f"pip install 'labcdp[{extra}]'" in line
    assert extra in EXTRAS
