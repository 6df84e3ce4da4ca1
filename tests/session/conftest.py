"""A small configuration, frames and readings for the session tests."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.reading import MeterIdentity, Reading
from labcdp.session import SessionConfiguration

BENCH = """\
format = 1
name = "Four patches"
operator = "A. Müller"
notes = "first line\\nsecond line"

[camera]
vendor = "Allied Vision Technologies"
model = "Manta_G-505B"
serial = "503363706"
pixel_pitch_m = 3.45e-6

[lens]
model = "LM6NCL"
serial = "0117"
focal_length_m = 0.006
f_number = 2.6

[meter]
model = "LS-110"
serial = "73323007"
calibration_date = 2025-03-31

[source]
spectrum = "LED-B4"

[target]
name = "checkerboard"

[[target.patch]]
name = "upper left"
roi = [2, 3, 4, 5]
nominal_luminance_cd_m2 = 356

[[target.patch]]
name = "upper right"
corners = [[10, 3], [14, 3], [12, 8.5]]

[[contrast]]
bright = "upper left"
dark = "upper right"
contrast = 3.7

[plan]
exposures_s = [0.005, 0.02]
"""


@pytest.fixture(scope="session")
def bench():
    return BENCH


@pytest.fixture(scope="session")
def configuration():
    return SessionConfiguration.from_toml(BENCH, "bench.toml")


@pytest.fixture(scope="session")
def make_frame():
    def make(seed=0, exposure_s=0.005, shape=(12, 16), dtype=np.uint16):
        bits = 12 if dtype == np.uint16 else 8
        return Frame(
            dn=np.random.default_rng(seed).integers(0, 2**bits, shape, dtype=dtype),
            exposure_s=exposure_s, gain_db=0.1, bit_depth=bits, saturation_dn=2**bits - 1, black_level_dn=16.25,
            pixel_format=f"Mono{bits}", colour_filter=None, temperature_c=41.3,
            timestamp=datetime(2026, 3, 1, 12, 0, 0, 123456, tzinfo=timezone(timedelta(hours=1))),
            camera_timestamp_ns=2**62 + seed, frame_id=seed,
            camera=CameraIdentity("Allied Vision Technologies", "Manta_G-505B", "503363706"),
        )  # fmt: skip

    return make


@pytest.fixture(scope="session")
def make_reading():
    def make(value=75.6):
        return Reading(
            value=value, unit="cd/m2", resolution=0.01, scale_half_width_rel=0.02, digits_half_width=0.02,
            repeatability_rel=0.001, peak=False, correction="preset", held=False,
            meter=MeterIdentity("LS-110", "73323007", "2025-03-31"),
            timestamp=datetime(2026, 3, 1, 12, 0, tzinfo=UTC), raw=f"OK00,CcPM{value:6.2f}",
        )  # fmt: skip

    return make
