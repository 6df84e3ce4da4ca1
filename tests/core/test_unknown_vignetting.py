"""What the vignetting of an unknown lens may be, against lenses that are known."""

from itertools import pairwise
from math import cos, hypot, log, radians, sqrt, tan

import numpy as np
import pytest

from labcdp.core.frame import Readout
from labcdp.core.table import Z_95
from labcdp.core.vignetting import Cos4Vignetting, Lens, assumed_in_part, unknown_vignetting

SHAPE = (300, 400)
#: Half the diagonal in pixels.
HALF_PX = 250


def log_ratio_u(vignetting, a, b, shape=SHAPE):
    """Standard uncertainty of the logarithm of the ratio of two places (x, y)."""
    x, y = (np.array(one, dtype=float) for one in zip(a, b, strict=True))
    patterns = (pattern.diagonal() for pattern in vignetting.patterns_at(shape, y, x))
    return hypot(*(first - second for first, second in patterns))


def test_it_is_that_of_80_degrees_in_full_or_not_at_all():
    u = log_ratio_u(unknown_vignetting(SHAPE), (400, 300), (200, 150))
    natural = -4 * log(cos(radians(40)))
    # The axis adds a little, by the slope of cos^4 in the corner.
    slope = 4 * tan(radians(40)) ** 2 * cos(radians(40)) ** 2 * 0.05
    assert u == pytest.approx(hypot(natural, slope) / sqrt(3), rel=1e-9)


def test_it_covers_lenses_up_to_80_degrees_wherever_their_axis_is():
    random, unknown = np.random.default_rng(7), unknown_vignetting(SHAPE)
    for _ in range(300):
        focal_px = HALF_PX / tan(radians(random.uniform(1, 40)))
        axis = (200, 150) + random.uniform(-0.035, 0.035, 2) * HALF_PX
        v = Cos4Vignetting(focal_px * 1e-6, 1e-6, tuple(axis)).relative_illuminance(SHAPE)
        (xa, ya), (xb, yb) = random.integers(0, (400, 300), (2, 2))
        u = log_ratio_u(unknown, (xa + 0.5, ya + 0.5), (xb + 0.5, yb + 0.5))
        assert abs(log(v[ya, xa] / v[yb, xb])) <= Z_95 * u + 1e-12


def test_it_grows_with_the_distance_from_the_axis_and_of_the_places():
    unknown = unknown_vignetting(SHAPE)
    outwards = [log_ratio_u(unknown, (x, 150), (x + 20, 150)) for x in range(200, 380, 20)]
    assert all(a < b for a, b in pairwise(outwards))
    apart = [log_ratio_u(unknown, (100, 150), (x, 150)) for x in (100, 120, 160, 200)]
    assert all(a < b for a, b in pairwise(apart))
    # Two places that are as far from the middle may differ, too, if the axis is beside it.
    assert log_ratio_u(unknown, (100, 150), (300, 150)) > log_ratio_u(unknown, (100, 150), (100, 150)) == 0


def test_a_part_of_an_image_has_the_errors_of_the_whole_there():
    y, x = np.arange(5) + 20.5, np.arange(7) + 330.5
    for whole in (unknown_vignetting(SHAPE), Lens(6e-3, 12e-6, 0.05).on(SHAPE)):
        part = assumed_in_part(whole, SHAPE, (330, 20), (5, 7))
        of_part = part.patterns_at((5, 7), y - 20, x - 330)
        np.testing.assert_allclose(of_part, whole.patterns_at(SHAPE, y, x), rtol=1e-9, atol=1e-15)
    # So has a frame that shows a part of the sensor.
    shown = Readout(x=330, y=20, sensor_size=(400, 300))
    of_frame = unknown_vignetting((5, 7), shown).patterns_at((5, 7), y - 20, x - 330)
    np.testing.assert_allclose(of_frame, unknown_vignetting(SHAPE).patterns_at(SHAPE, y, x), rtol=1e-9, atol=1e-15)


def test_pixels_that_are_joined_are_larger():
    joined = Lens(6e-3, 3e-6).on(SHAPE, Readout(binning=(2, 2), decimation=(2, 2)))
    assert joined.pixel_pitch_m == pytest.approx(12e-6)


def test_a_part_of_the_sensor_has_the_uncertainty_of_its_places_on_the_sensor():
    whole, part = (300, 400), Readout(x=330, y=20, sensor_size=(400, 300))
    lens = Lens(6e-3, 3e-6)
    seen, all_of_it = lens.on((50, 60), part), lens.on(whole, Readout(sensor_size=(400, 300)))
    # The same place, counted from the corner of the part and from that of the sensor.
    found = (
        seen.patterns_at((50, 60), np.array([5.0]), np.array([7.0])),
        all_of_it.patterns_at(whole, np.array([25.0]), np.array([337.0])),
    )
    np.testing.assert_allclose(*found, rtol=1e-12)
