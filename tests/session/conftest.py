"""A small configuration, and frames, for the session tests."""

import numpy as np
import pytest

from labcdp.session import SessionConfiguration

BENCH = """\
format = 1
name = "Two patches"
operator = "A. Müller"
notes = "first line\\nsecond line"
lens = {model = "LM6NCL", serial = "0117", focal_length_m = 0.006, f_number = 2.6}
source = {spectrum = "LED-B4"}
contrast = [{bright = "upper left", dark = "upper right", contrast = 3.7}]
[camera]
serial = "503363706"
pixel_pitch_m = 3.45e-6
[meter]
model = "LS-110"
serial = "73323007"
calibration_date = 2025-03-31
[target]
name = "checkerboard"
[[target.patch]]
name = "upper left"
roi = [2, 3, 4, 5]
nominal_luminance_cd_m2 = 356
[[target.patch]]
name = "upper right"
corners = [[10, 3], [14, 3], [12, 8.5]]
[plan]
exposures_s = [0.005, 0.02]
"""


@pytest.fixture(scope="session")
def configuration():
    return SessionConfiguration.from_toml(BENCH, "bench.toml")


@pytest.fixture(scope="session")
def make_frame(new_frame):
    def make(seed=0, exposure_s=0.005, shape=(12, 16)):
        dn = np.random.default_rng(seed).integers(0, 4096, shape)
        return new_frame(dn, seed, exposure_s=exposure_s, gain_db=0.1)

    return make
