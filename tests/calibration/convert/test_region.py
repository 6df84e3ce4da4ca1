"""A window of a frame, and a frame of a part of the sensor, have the luminances of that part of the whole."""

from types import SimpleNamespace

import numpy as np
import pytest

from labcdp.calibration import CameraState
from labcdp.calibration.frames.defects import DefectMap
from labcdp.calibration.frames.measure import split
from labcdp.core.errors import CalibrationError
from labcdp.core.frame import Readout
from labcdp.core.vignetting import Cos4Vignetting, RadialVignetting
from labcdp.evaluate.bench.corrections import natural_vignetting, pixel_area_m2

from ..conftest import flat_field, large_dark_library, make_frame

WHOLE, PART = (48, 64), (slice(3, 27), slice(8, 40))


_COVARIANCE = tuple(tuple(row) for row in (np.eye(3) * 1e-4 + 1e-5).tolist())
VIGNETTINGS = {
    "none": None,
    "cos4": Cos4Vignetting(0.0002, 3.45e-6, None, 0.05),
    "radial": RadialVignetting(-0.3, -0.1, 0.02, (30.0, 25.0), _COVARIANCE, 0.003),
    "flat": flat_field(),
}


def _state(readout, shape=WHOLE, **changes):
    return CameraState.of(make_frame(np.zeros(shape), readout=readout, **changes))


def assert_part_of(part, whole, window):
    for name in ("luminance_cd_m2", "random_rel", "common_rel", "fixed_cd_m2", "invalid"):
        theirs = np.broadcast_to(getattr(whole, name), whole.shape)[window]
        np.testing.assert_allclose(getattr(part, name), theirs, rtol=1e-5, err_msg=name)
    rows, columns = window
    there = slice(rows.start + 2, rows.start + 9), slice(columns.start + 3, columns.start + 11)
    mine, theirs = part.common_in((slice(2, 9), slice(3, 11))), whole.common_in(there)
    # The same covariance of any two pixels; the patterns it is split into may be others.
    a, b = (np.array([np.broadcast_to(e.relative, (7, 8)).ravel() for e in errors]) for errors in (mine, theirs))
    np.testing.assert_allclose(a.T @ a, b.T @ b, rtol=1e-4)


@pytest.mark.parametrize("library", [None, large_dark_library()], ids=["no library", "library"])
@pytest.mark.parametrize("kind", VIGNETTINGS)
def test_a_part_of_the_sensor_has_the_luminances_of_the_whole(kind, library, make_calibration):
    calibration = make_calibration(
        state=_state(Readout(4, 2)),
        range_cd_m2=(20.0, 300.0),
        vignetting=VIGNETTINGS[kind],
        dark_library=library,
        defects=DefectMap(np.array([12, 40]), np.array([9, 60]), np.array([1, 1]), WHOLE),
    )
    frame = make_frame(np.random.default_rng(1).integers(60, 4096, WHOLE), readout=Readout(4, 2))
    whole = calibration.to_luminance(frame)
    part = make_frame(frame.dn[PART], readout=Readout(12, 5))
    assert_part_of(calibration.to_luminance(part), whole, PART)
    window = calibration.to_luminance(frame, PART)
    assert_part_of(window, whole, PART)
    assert len(np.unique(window.invalid)) > 2


@pytest.mark.parametrize(
    ("size", "readout", "named"),
    [
        (20, Readout(0, 0), "column 10, row 10, .* column 0, row 0"),
        (20, Readout(10, 10, binning=(2, 1)), "binning .* 1 x 1, .* 2 x 1"),
        (20, Readout(10, 10, mirrored=(True, False)), "mirroring .* columns"),
        (10, Readout(25, 10), "image size"),
        (10, Readout(12, 12, decimation=(2, 2)), "image size"),
        (10, None, "image size"),
    ],
)
def test_another_part_of_the_sensor_is_refused(size, readout, named, make_calibration):
    centre = make_calibration(state=_state(Readout(10, 10), (20, 20)))
    with pytest.raises(CalibrationError, match=named):
        centre.to_luminance(make_frame(np.full((size, size), 500), readout=readout))


def test_vignetting_of_binned_frames_and_of_planes_is_that_of_the_sensor():
    whole = Cos4Vignetting(0.001, 1e-5).relative_illuminance((40, 60))
    of_blocks = whole.reshape(20, 2, 30, 2).mean(axis=(1, 3))
    camera, lens = SimpleNamespace(pixel_pitch_m=1e-5), SimpleNamespace(focal_length_m=0.001, vignetting_rel=0.0)
    configuration = SimpleNamespace(camera=camera, lens=lens)
    for readout, area_m2 in ((Readout(binning=(2, 2)), 4e-10), (Readout(decimation=(2, 2)), 1e-10)):
        seen = natural_vignetting(configuration, _state(readout, (20, 30))).relative_illuminance((20, 30))
        np.testing.assert_allclose(seen, of_blocks, rtol=3e-4)
        assert pixel_area_m2(1e-5, readout) == pytest.approx(area_m2)
    frame = make_frame(np.full((40, 60), 9), colour_filter="GB", pixel_format="BayerGB12")
    for plane, part in split(frame).items():
        seen = natural_vignetting(configuration, CameraState.of(part)).relative_illuminance((20, 30))
        row, column = {"Gb": (0, 0), "B": (0, 1), "R": (1, 0), "Gr": (1, 1)}[plane]
        np.testing.assert_allclose(seen, whole[row::2, column::2], rtol=1e-12)
