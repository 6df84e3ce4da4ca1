import json

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile

from labcdp.core.luminance import CommonError, Invalid, LuminanceMap
from labcdp.files import read_picture
from labcdp.files.luminance_file import load_luminance, save_luminance

ABOUT = {"calibration": {"camera": "Manta µ"}, "exposures_s": [0.008]}


@pytest.fixture
def luminance():
    rng = np.random.default_rng(1)
    invalid = np.zeros((30, 40), np.uint8)
    invalid[2, 3] = Invalid.SATURATED | Invalid.DEFECT
    values, random = rng.uniform(0.1, 1000, (30, 40)), rng.uniform(0.01, 0.1, (30, 40))
    fit = CommonError("fit", rng.normal(0, 0.01, (30, 40)).astype(np.float32))
    common = CommonError("meter scale", 0.01, rectangular=True), fit
    errors = {"slow_rel": 0.01, "fixed_rel": 0.002, "fixed_cd_m2": 0.03}
    return LuminanceMap(values.astype(np.float32), random.astype(np.float32), common, invalid, step=2, **errors)


@pytest.mark.parametrize("name", ["a.npz", "a.tiff", "a.EXR"])
def test_round_trip(luminance, tmp_path, name):
    save_luminance(luminance, tmp_path / name, ABOUT)
    loaded, about = load_luminance(tmp_path / name)
    for values in ("luminance_cd_m2", "random_rel", "invalid"):
        assert (getattr(loaded, values) == getattr(luminance, values)).all()
        assert getattr(loaded, values).dtype == getattr(luminance, values).dtype
    np.testing.assert_allclose(loaded.common_rel, luminance.common_rel, rtol=1e-6)
    assert (loaded.slow_rel, loaded.fixed_rel, loaded.fixed_cd_m2, loaded.step) == (0.01, 0.002, 0.03, 2)
    assert (about["calibration"], about["unit"]) == (ABOUT["calibration"], "cd/m^2")
    assert about["invalid_share"] == {"SATURATED": 1 / 1200, "DEFECT": 1 / 1200}
    picture = read_picture(tmp_path / name)
    assert (picture.light_is_cd_m2, np.array_equal(picture.light, luminance.luminance_cd_m2)) == (True, True)
    if name == "a.npz":
        # An archive keeps common errors apart.
        assert [(e.source, e.rectangular) for e in loaded.common] == [("meter scale", True), ("fit", False)]
        assert (loaded.common[1].relative == luminance.common[1].relative).all()
    guessed = LuminanceMap(luminance.luminance_cd_m2, luminance.random_rel, np.inf, luminance.invalid)
    save_luminance(guessed, tmp_path / name, {}, force=True)
    assert np.isinf(load_luminance(tmp_path / name)[0].common_rel).all()


def test_tiff_and_exr_open_elsewhere(luminance, tmp_path):
    for name in ("a.tif", "a.exr"):
        save_luminance(luminance, tmp_path / name, ABOUT)
    assert (cv2.imread(str(tmp_path / "a.tif"), cv2.IMREAD_UNCHANGED) == luminance.luminance_cd_m2).all()
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff:
        assert json.loads(tiff.pages.first.description)["unit"] == "cd/m^2"
        assert [page.dtype for page in tiff.pages] == [np.float32] * 3 + [np.uint8]
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        channels, header = file.channels(), file.header()
        assert (channels["Y"].pixels == luminance.luminance_cd_m2).all()
        assert (channels["invalid"].pixels == luminance.invalid).all()
        assert (header["whiteLuminance"], json.loads(header["labcdp"])["exposures_s"]) == (1.0, [0.008])
