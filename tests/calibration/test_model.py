from dataclasses import replace

import numpy as np
import pytest

from labcdp.core.errors import CalibrationError
from labcdp.core.frame import CameraIdentity
from labcdp.core.luminance import Invalid

from .conftest import expose, make_frame

SHAPE = (48, 64)
OTHER, SIMULATED = CameraIdentity("A", "B", "1"), CameraIdentity("Allied Vision", "Manta G-505C", "503363706", True)


def test_noise_does_not_push_the_end_patches_out_of_range(calibrated):
    rng = np.random.default_rng(1)
    for luminance, exposure_s in ((0.5, 0.064), (2000.0, 0.001)):
        frame = expose(np.full(SHAPE, luminance), exposure_s, rng)
        outside = calibrated.to_luminance(frame).invalid & Invalid.OUTSIDE_CALIBRATED
        assert np.count_nonzero(outside) <= SHAPE[0] * SHAPE[1] * 0.00135 + 4 * np.sqrt(3072 * 0.00135)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera": OTHER}, r"Allied Vision Manta G-505C \(503363706\), but frame 0 has A B \(1\): use the same, or"),
        ({"camera": SIMULATED}, r"but frame 0 has Allied Vision Manta G-505C \(503363706, simulated\)"),
        ({"gain_db": 6.0}, "gain of the calibration is 0 dB, but frame 0 has 6 dB"),
        ({"pixel_format": "Mono12Packed"}, "pixel format of the calibration is Mono12, but frame 0 has Mono12Packed"),
        ({"bit_depth": 14}, "bit depth of the calibration is 12, but frame 0 has 14"),
        ({"saturation_dn": 4000.0}, "saturation of the calibration is 4095 DN, but frame 0 has 4000 DN"),
        ({"dn": np.zeros((24, 32), np.uint16)}, "size of the calibration is 64 x 48 pixels, but frame 0 has 32 x 24"),
        ({"colour_filter": "RG"}, r"the frame has a colour filter \(RG\)"),
    ],
)  # fmt: skip
def test_other_frames_are_refused(calibrated, change, message):
    with pytest.raises(CalibrationError, match=message):
        calibrated.to_luminance(replace(make_frame(np.full(SHAPE, 500.0)), **change))


def test_a_gain_that_was_not_calibrated_is_refused_by_name(calibrated):
    two = replace(calibrated, gains=(replace(calibrated.setting(0.0), gain_db=6.0, factor=2.0),))
    assert two.luminance_cd_m2(1200.0, 0.01, 6.0) == pytest.approx(two.luminance_cd_m2(1200.0, 0.01) / 2)
    two.require(replace(two.state, gain_db=6.0), "this frame")
    with pytest.raises(CalibrationError, match=r"gain of the calibration is 0 dB or 6 dB, but this frame has 12 dB"):
        two.require(replace(two.state, gain_db=12.0), "this frame")
