"""Codes that nobody states are recognised by the knees in their histogram, and ordinary pictures are taken for none."""

from functools import partial

import numpy as np
import pytest
import tifffile

import labcdp
from labcdp.files import PictureOptions, read_picture, shipped_curve
from labcdp.files.companded import likely_curve
from labcdp.files.video.open import open_video
from labcdp.session import example_session

from .video_files import write as write_video


def scenes(rng):
    """Linear values: skies and roads, a night with lamps, a ramp, and a chart of steps on a grey ground."""
    yield "day", rng.lognormal(9, 1.5, 400_000)
    yield "night", np.concatenate([rng.lognormal(6, 1.5, 380_000), rng.lognormal(12, 1, 20_000)])
    yield "ramp", np.geomspace(20, 900_000, 400_000) * rng.normal(1, 0.02, 400_000)
    steps = np.repeat(np.geomspace(60, 600_000, 14), 20_000)
    yield "chart", np.concatenate([steps, np.full(200_000, 9000.0)]) * rng.normal(1, 0.03, 480_000)


@pytest.mark.parametrize("name", ["AR0231", "OX03C10"])
@pytest.mark.parametrize("shift", [0, 4])
def test_codes_of_a_scene_show_their_curve(name, shift):
    curve = shipped_curve(name)
    for scene, linear in scenes(np.random.default_rng(2)):
        found = likely_curve(np.bincount(curve.code(linear) << shift), 16)
        # A chart has no densities to compare.
        if scene != "chart":
            assert (found.name, found.shift) == (name, shift)
        else:
            assert found is None or found.name == name


def as_linear(bits, gain, linear):
    return np.clip(np.rint(gain * linear), 0, 2**bits - 1).astype(int)


def as_gamma(bits, top, linear):
    return np.rint((2**bits - 1) * np.clip(linear / top, 0, 1) ** 0.45).astype(int)


def as_logarithm(bits, linear):
    return np.clip(np.rint((2**bits - 1) * np.log1p(linear) / np.log1p(1e6)), 0, 2**bits - 1).astype(int)


STORED = [
    *(partial(as_linear, bits, gain) for bits in (10, 12, 14, 16) for gain in (0.01, 0.1, 1.0)),
    *(partial(as_gamma, bits, top) for bits in (10, 12, 16) for top in (1e4, 1e6)),
    *(partial(as_logarithm, bits) for bits in (10, 12)),
]


@pytest.mark.parametrize("seed", range(3))
def test_linear_gamma_and_logarithmic_pictures_are_not_taken_for_codes(seed):
    for _, linear in scenes(np.random.default_rng(seed)):
        for stored in STORED:
            assert likely_curve(np.bincount(stored(linear)), 16) is None


def test_frames_of_the_example_session_are_no_codes():
    for path in sorted((example_session() / "frames").iterdir()):
        assert likely_curve(np.bincount(tifffile.imread(path).ravel()), 16) is None


def test_a_picture_and_a_video_without_their_curve_have_a_warning_that_names_it(tmp_path):
    linear = np.random.default_rng(1).lognormal(9, 1.5, (400, 600))
    codes = shipped_curve("AR0231").code(linear)
    tifffile.imwrite(tmp_path / "codes.tif", codes)
    found = {f.code: f.values for f in read_picture(tmp_path / "codes.tif").findings}
    assert found["companded-likely"] == {"curve": "AR0231", "shift": 0}
    for encoding in ("AR0231", "linear"):
        image = labcdp.read_image(tmp_path / "codes.tif", encoding=encoding)
        assert "companded-likely" not in [finding.code for finding in image.findings]
    video = open_video(write_video(tmp_path / "codes.mkv", "ffv1", "gray16le", [codes]), PictureOptions())
    assert "companded-likely" in [finding.code for finding in video.findings]
