from dataclasses import replace

import numpy as np
import pytest

from labcdp.core.errors import CalibrationError
from labcdp.core.frame import CameraIdentity
from labcdp.core.luminance import Invalid

from .conftest import CAMERA, expose, make_frame

SHAPE = (48, 64)


def test_noise_does_not_push_the_end_patches_out_of_range(calibrated):
    rng = np.random.default_rng(1)
    for luminance, exposure_s in ((0.5, 0.064), (2000.0, 0.001)):
        frame = expose(np.full(SHAPE, luminance), exposure_s, rng)
        outside = calibrated.to_luminance(frame).invalid & Invalid.OUTSIDE_CALIBRATED
        assert np.count_nonzero(outside) <= SHAPE[0] * SHAPE[1] * 0.00135 + 4 * np.sqrt(3072 * 0.00135)


@pytest.mark.parametrize(
    "change",
    [
        *({"camera": one} for one in (CameraIdentity("A", "B", "1"), replace(CAMERA, simulated=True))),
        {"gain_db": 6.0},
        {"pixel_format": "Mono12Packed"},
        {"bit_depth": 14},
        {"saturation_dn": 4000.0},
        {"dn": np.zeros((24, 32), np.uint16)},
        {"colour_filter": "RG"},
    ],
)
def test_other_frames_are_refused(calibrated, change):
    with pytest.raises(CalibrationError, match=r"of the calibration is .*, but frame 0 has|has a colour filter \(RG\)"):
        calibrated.to_luminance(replace(make_frame(np.full(SHAPE, 500.0)), **change))
