from dataclasses import replace

import numpy as np
import pytest

from labcdp.core.errors import CalibrationError, InputError
from labcdp.core.frame import CameraIdentity
from labcdp.core.luminance import Invalid

SHAPE = (48, 64)


def test_noise_does_not_push_the_end_patches_out_of_range(calibrated, camera, new_frame):
    rng = np.random.default_rng(1)
    for luminance, exposure_s in ((0.5, 0.064), (2000.0, 0.001)):
        frame = next(camera.frames(np.full(SHAPE, luminance), exposure_s, 1, rng))
        outside = calibrated.to_luminance(frame).invalid & Invalid.OUTSIDE_CALIBRATED
        assert np.count_nonzero(outside) <= SHAPE[0] * SHAPE[1] * 0.00135 + 4 * np.sqrt(3072 * 0.00135)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"camera": CameraIdentity("Allied Vision", "Manta G-505C", "1")},
            r"camera of the calibration is Allied Vision Manta G-505C \(503363706\), but frame 0 has .*\(1\): use the "
            "same, or calibrate this one",
        ),
        (
            {"camera": CameraIdentity("Allied Vision", "Manta G-505C", "503363706", simulated=True)},
            r"but frame 0 has Allied Vision Manta G-505C \(503363706, simulated\)",
        ),
        ({"gain_db": 6.0}, "gain of the calibration is 0 dB, but frame 0 has 6 dB"),
        ({"pixel_format": "Mono12Packed"}, "pixel format of the calibration is Mono12, but frame 0 has Mono12Packed"),
        ({"bit_depth": 14}, "bit depth of the calibration is 12, but frame 0 has 14"),
        ({"saturation_dn": 4000.0}, "saturation of the calibration is 4095 DN, but frame 0 has 4000 DN"),
        (
            {"dn": np.zeros((24, 32), np.uint16)},
            "image size of the calibration is 64 x 48 pixels, but frame 0 has 32 x 24",
        ),
        ({"colour_filter": "RG"}, r"the frame has a colour filter \(RG\)"),
    ],
)
def test_other_frames_are_refused(calibrated, new_frame, change, message):
    frame = replace(new_frame(np.full(SHAPE, 500.0)), **change)
    with pytest.raises(CalibrationError, match=message):
        calibrated.to_luminance(frame)


def test_a_gain_that_was_not_calibrated_is_refused_by_name(calibrated):
    gain = replace(calibrated.setting(0.0), gain_db=6.0, factor=2.0)
    two = replace(calibrated, gains=(gain,))
    assert two.setting(6.0) == gain
    assert two.luminance_cd_m2(1200.0, 0.01, 6.0) == pytest.approx(two.luminance_cd_m2(1200.0, 0.01) / 2)
    two.require(replace(two.state, gain_db=6.0), "this frame")
    with pytest.raises(CalibrationError, match=r"gain of the calibration is 0 dB or 6 dB, but this frame has 12 dB"):
        two.require(replace(two.state, gain_db=12.0), "this frame")
    with pytest.raises(CalibrationError, match=r"is for a gain of 0 dB or 6 dB, not 12 dB: calibrate this gain too"):
        two.setting(12.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"range_cd_m2": (0.0, 10.0)}, "range_cd_m2 is 0 to 10: give two positive luminances, the lower first"),
        ({"range_cd_m2": (20.0, 10.0)}, "range_cd_m2 is 20 to 10"),
        ({"exposures_s": ()}, "at least one exposure in exposures_s"),
        ({"residuals": ()}, "one row in residuals"),
    ],
)
def test_values_are_checked(calibrated, change, message):
    with pytest.raises(InputError, match=message):
        replace(calibrated, **change)
