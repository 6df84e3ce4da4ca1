"""A window of a frame is converted as that part of the whole."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import CameraState
from labcdp.calibration.colour.model import ColourCalibration
from labcdp.calibration.frames.measure import split
from labcdp.calibration.sensor.dark_library import DarkLibrary
from labcdp.calibration.sensor.defects import DefectMap
from labcdp.core.frame import PLANES
from labcdp.core.vignetting import FlatField, RadialVignetting, middle_of

SHAPE = (48, 64)
WINDOW = (slice(11, 37), slice(7, 50))
RADIAL = RadialVignetting(-0.4, 0.05, 0.0, covariance=((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 0.0)))


def flat():
    relative = np.random.default_rng(1).normal(1, 0.02, SHAPE)
    return FlatField(relative / relative[middle_of(SHAPE)].mean(), 0.004, 0.01, 8)


def library():
    rng, noise = np.random.default_rng(2), ((4.0, 0.0), (0.0, 0.0))
    return DarkLibrary(rng.normal(0, 6, SHAPE), np.zeros(SHAPE), noise, ((36.0, 0.0), (0.0, 0.0)), None, None, 4)


def noise(make_frame):
    return make_frame(np.random.default_rng(3).integers(60, 4096, SHAPE))


def assert_part_of(part, whole, window):
    for name in ("luminance_cd_m2", "random_rel", "invalid"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[window])
    np.testing.assert_array_equal(part.fixed_cd_m2, whole.fixed_cd_m2[window] if np.ndim(whole.fixed_cd_m2) else 0.0)
    np.testing.assert_allclose(part.common_rel, np.broadcast_to(whole.common_rel, whole.shape)[window], rtol=1e-6)
    rows, columns = window
    inner = slice(2, 9), slice(3, 11)
    there = slice(rows.start + 2, rows.start + 9), slice(columns.start + 3, columns.start + 11)
    mine, theirs = part.common_in(inner), whole.common_in(there)
    assert [e.source for e in mine] == [e.source for e in theirs]
    for a, b in zip(mine, theirs, strict=True):
        np.testing.assert_allclose(a.relative, b.relative, rtol=1e-6)


@pytest.mark.parametrize("vignetting", [None, RADIAL, flat()])
@pytest.mark.parametrize("dark_library", [None, library()])
def test_monochrome(make_calibration, make_frame, vignetting, dark_library):
    defects = DefectMap(np.array([12, 40]), np.array([9, 60]), np.array([1, 1]), SHAPE)
    calibration = make_calibration(
        range_cd_m2=(20.0, 300.0), vignetting=vignetting, dark_library=dark_library, defects=defects
    )
    frame = noise(make_frame)
    part = calibration.to_luminance(frame, WINDOW)
    assert_part_of(part, calibration.to_luminance(frame), WINDOW)
    assert len(np.unique(part.invalid)) > 2


def test_colour(make_calibration, make_frame):
    frame = replace(noise(make_frame), colour_filter="RG", pixel_format="BayerRG12")
    planes = split(frame)
    calibration = ColourCalibration(
        planes=tuple(make_calibration(state=CameraState.of(planes[name])) for name in PLANES),
        weights=(0.2, 0.3, 0.4, 0.1),
        weight_covariance=tuple(map(tuple, np.diag([1e-4] * 4))),
        spectral_rel=0.05,
        scatter_rel=0.0,
        range_cd_m2=(20.0, 300.0),
        residuals=(),
        held_out=(),
        left_out=(),
        ladder=(),
        sensitivity=None,
        f1_prime=None,
        findings=(),
    )
    window = slice(5, 20), slice(3, 30)
    assert_part_of(calibration.to_luminance(frame, window), calibration.to_luminance(frame), window)
