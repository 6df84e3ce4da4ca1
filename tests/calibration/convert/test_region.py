"""Calibrations know which part of the sensor they are of."""

from types import SimpleNamespace

import numpy as np
import pytest

from labcdp.calibration import CameraState
from labcdp.calibration.sensor.dark_library import DarkLibrary
from labcdp.calibration.sensor.defects import DefectMap
from labcdp.core.errors import CalibrationError
from labcdp.core.frame import Readout
from labcdp.core.vignetting import Cos4Vignetting, FlatField, RadialVignetting
from labcdp.evaluate.bench.corrections import natural_vignetting, pixel_area_m2

WHOLE, PART = (48, 64), (slice(3, 27), slice(8, 40))


def _flat_field():
    y, x = np.mgrid[0:48, 0:64]
    relative = 1 - ((x - 31.5) ** 2 + (y - 23.5) ** 2) / 2500
    relative /= relative[22:26, 29:35].mean()
    return FlatField(relative.astype(np.float32), 0.001, 0.002, 10)


_COVARIANCE = tuple(tuple(row) for row in (np.eye(3) * 1e-4 + 1e-5).tolist())
VIGNETTINGS = {
    "none": None,
    "cos4": Cos4Vignetting(0.0002, 3.45e-6),
    "radial": RadialVignetting(-0.3, -0.1, 0.02, (30.0, 25.0), _COVARIANCE, 0.003),
    "flat": _flat_field(),
}


def _library():
    rng = np.random.default_rng(4)
    offset, rate = (rng.normal(0, 20, WHOLE).astype(np.float32) for _ in range(2))
    noise, pattern = ((0.01, 0.0), (0.0, 0.01)), ((400.0, 0.0), (0.0, 400.0))
    return DarkLibrary(offset, rate, noise, pattern, 30.0, 8.0, 16)


def _calibration(make_calibration, make_frame, readout, shape=WHOLE, **changes):
    frame = make_frame(np.zeros(shape), readout=readout)
    return make_calibration(state=CameraState.of(frame), **changes)


@pytest.mark.parametrize("library", [None, _library()], ids=["no library", "library"])
@pytest.mark.parametrize("kind", VIGNETTINGS)
def test_a_part_of_the_sensor_has_the_luminances_of_the_whole(kind, library, make_calibration, make_frame):
    reasons = np.zeros(WHOLE, np.uint8)
    reasons[5, 9] = reasons[40, 50] = 1
    calibration = _calibration(
        make_calibration,
        make_frame,
        Readout(4, 2),
        vignetting=VIGNETTINGS[kind],
        dark_library=library,
        defects=DefectMap.of(reasons),
    )
    dn = np.random.default_rng(1).integers(100, 4000, WHOLE)
    whole = calibration.to_luminance(make_frame(dn, readout=Readout(4, 2)))
    part = calibration.to_luminance(make_frame(dn[PART], readout=Readout(12, 5)))
    np.testing.assert_allclose(part.luminance_cd_m2, whole.luminance_cd_m2[PART], rtol=1e-6)
    np.testing.assert_allclose(part.random_rel, whole.random_rel[PART], rtol=1e-5)
    np.testing.assert_allclose(part.common_rel, whole.common_rel[PART], rtol=1e-5)
    np.testing.assert_array_equal(part.invalid, whole.invalid[PART])


@pytest.mark.parametrize(
    ("shape", "readout", "message"),
    [
        ((20, 20), Readout(0, 0), "region of the sensor .* is from column 10 and row 10, .* from column 0 and row 0"),
        ((20, 20), Readout(10, 10, binning=(2, 2)), "is from column 10 and row 10, .* binning 2 x 2"),
        ((20, 20), Readout(10, 10, mirrored=(True, False)), "columns mirrored"),
        ((10, 10), Readout(25, 10), "image size of the calibration is 20 x 20 pixels, but frame 0 has 10 x 10"),
        ((10, 10), Readout(9, 12), "image size"),
        ((10, 10), Readout(12, 12, decimation=(2, 2)), "image size"),
        ((10, 10), None, "image size"),
        ((48, 64), Readout(0, 0), "image size"),
    ],
)
def test_another_part_of_the_sensor_is_refused(shape, readout, message, make_calibration, make_frame):
    centre = _calibration(make_calibration, make_frame, Readout(10, 10), (20, 20), vignetting=VIGNETTINGS["cos4"])
    with pytest.raises(CalibrationError, match=message):
        centre.to_luminance(make_frame(np.full(shape, 500), readout=readout))


def test_frames_that_do_not_say_where_they_lie_are_taken_as_before(make_calibration, make_frame):
    dn = np.full((20, 20), 500)
    stated, silent = Readout(10, 10), None
    maps = [
        _calibration(make_calibration, make_frame, mine, (20, 20)).to_luminance(make_frame(dn, readout=theirs))
        for mine, theirs in ((stated, stated), (stated, silent), (silent, stated), (silent, silent))
    ]
    assert len({one.luminance_cd_m2.tobytes() for one in maps}) == 1


def test_pixels_of_binned_frames_are_larger(make_frame):
    whole = Cos4Vignetting(0.001, 1e-5).relative_illuminance((40, 60))
    of_blocks = whole.reshape(20, 2, 30, 2).mean(axis=(1, 3))
    camera, lens = SimpleNamespace(pixel_pitch_m=1e-5), SimpleNamespace(focal_length_m=0.001)
    configuration = SimpleNamespace(camera=camera, lens=lens)
    for readout, area_m2 in ((Readout(binning=(2, 2)), 4e-10), (Readout(decimation=(2, 2)), 1e-10)):
        state = CameraState.of(make_frame(np.full((20, 30), 9), readout=readout))
        seen = natural_vignetting(configuration, state).relative_illuminance((20, 30))
        np.testing.assert_allclose(seen, of_blocks, rtol=3e-4)
        assert pixel_area_m2(1e-5, readout) == pytest.approx(area_m2)
