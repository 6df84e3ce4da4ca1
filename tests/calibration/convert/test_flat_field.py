from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration.frames.defects import Defect
from labcdp.calibration.frames.measure import measure_whole
from labcdp.calibration.sensor.dark_library import dark_library
from labcdp.calibration.sensor.defects import find_defects
from labcdp.calibration.sensor.flat_field import measure_vignetting
from labcdp.core.vignetting import FlatField, RadialVignetting

from ..conftest import expose, statistics

SHAPE = (120, 150)
TRUE = RadialVignetting(-0.4, 0.06, -0.02)
V = TRUE.relative_illuminance(SHAPE)
PRNU = 1 + 0.008 * np.random.default_rng(11).normal(size=SHAPE)


def uniform(prnu=PRNU, source=1.0, n=8, luminance=150.0):
    """Vignetting by light and dark frames of a uniform source seen through a lens."""
    rng, light, exposures = np.random.default_rng(1), np.full(SHAPE, luminance) * source, (0.004, 0.012)
    lights = [statistics(light, t, n, rng, v=V * prnu) for t in exposures]
    darks = [statistics(np.zeros(SHAPE), t, n, rng) for t in exposures]
    return measure_vignetting(lights, darks, 0.005)


def test_flat_field_and_polynomial_are_the_truth_within_their_uncertainty():
    good = uniform()
    error = good.radial.relative_illuminance(SHAPE) / V - 1
    assert (np.abs(error) < 4 * np.linalg.norm(good.radial.common_patterns(SHAPE), axis=0) + 1e-9).all()
    (reason,) = good.findings
    assert reason.values["prnu_rel"] == pytest.approx(0.008, rel=0.03)
    assert isinstance(good.chosen, FlatField)
    deviation = good.flat.relative / (V * PRNU)
    deviation /= deviation.mean()
    n = deviation.size
    # The stated noise is that of a typical pixel; at the edge there is less light.
    assert deviation.std() == pytest.approx(good.flat.random_rel, rel=0.15)
    assert np.median(np.abs(deviation - 1)) * 1.4826 == pytest.approx(good.flat.random_rel, rel=0.05 + 4 / np.sqrt(n))


def test_sources_and_sensors_that_are_not_even_are_noticed():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    spot = 1 - 0.06 * np.exp(-((x - 60) ** 2 + (y - 50) ** 2) / 2 / 4**2)
    for code, value, expected, options in (
        ("flat-not-radial", "change_rel", 0.06, {"source": 0.97 + 0.06 * x / SHAPE[1]}),
        ("flat-spots", "x_px", 60, {"prnu": PRNU * spot}),
        ("flat-step", "step_rel", 0.02, {"prnu": PRNU * np.where(x < 80, 1.0, 1.02)}),
    ):
        seen = uniform(**options)
        (found,) = [one for one in seen.findings if one.code == code]
        assert found.values[value] == pytest.approx(expected, rel=0.2)
        assert code != "flat-not-radial" or seen.radial.slow_rel > 0.015
    even = uniform(prnu=1.0, n=2, luminance=30.0).chosen
    assert (type(even), even.slow_rel) == (RadialVignetting, pytest.approx(0.005, abs=0.002))


def test_defects_are_found_with_their_reason():
    rng = np.random.default_rng(5)
    pattern = rng.normal(0, 1.0, SHAPE)
    pattern[10, 11] += 120
    gain = np.ones(SHAPE)
    gain[20, 21] = 0.3
    darks, lights = [], []
    for i in range(16):
        dark = expose(np.zeros(SHAPE), 0.01, rng, pattern_dn=pattern, frame_id=i)
        light = expose(np.full(SHAPE, 150.0), 0.01, rng, pattern_dn=pattern, v=V * PRNU * gain, frame_id=i)
        for frame, group in ((dark, darks), (light, lights)):
            dn = frame.dn.copy()
            dn[30, 31] = 500
            dn[40, 41] += rng.integers(0, 60, dtype=np.uint16)
            group.append(frame.with_pixels(dn))
    found = find_defects(measure_whole(darks), measure_whole(lights))
    named = {(int(r), int(c)): Defect(int(f)) for r, c, f in zip(found.rows, found.columns, found.reasons, strict=True)}
    expected = {(10, 11): Defect.HOT, (20, 21): Defect.DEAD, (30, 31): Defect.STUCK, (40, 41): Defect.NOISY}
    assert set(named) == set(expected)
    assert all(reason in named[place] for place, reason in expected.items())


def test_dark_library_finds_the_doubling_temperature():
    rng = np.random.default_rng(9)
    rate = np.abs(rng.normal(2000, 300, SHAPE))

    def frames(t, temperature_c):
        pattern = (rate * 2 ** ((temperature_c - 27.0) / 7.0) - 40) * t
        for i in range(4):
            yield replace(expose(np.zeros(SHAPE), t, rng, pattern, frame_id=i), temperature_c=temperature_c)

    library = dark_library([measure_whole(frames(t, c)) for c in (20.0, 27.0, 34.0) for t in (0.001, 0.03)])
    assert library.doubling_temperature_c == pytest.approx(7.0, rel=0.02)
    error = library.pattern_dn(SHAPE, 0.03, 27.0) - (rate - rate.mean()) * 0.03
    assert error.std() == pytest.approx(library.noise_dn(0.03, 27.0), rel=0.05)
    assert library.pattern_dn(SHAPE, 0.03, 34.0) == pytest.approx(library.pattern_dn(SHAPE, 0.06, 27.0), abs=5)


@pytest.mark.parametrize("exposures_s", [(0.1,), (0.1, 1.0)])
def test_dark_library_at_another_temperature_scales_or_says_that_it_cannot(exposures_s):
    rng = np.random.default_rng(4)
    rate = 50 * (1 + rng.exponential(1.0, SHAPE))
    library = dark_library([statistics(np.zeros(SHAPE), t, 16, rng, pattern_dn=rate * t) for t in exposures_s])
    # A true doubling temperature of 6 to 10 K, the frames' being 30 degC.
    pattern = library.correction_dn(SHAPE, 0.1, 35.0)
    for truth in (rate * 0.1 * 2 ** (5 / doubling_k) for doubling_k in (6.0, 7.5, 10.0)):
        if pattern is not None:
            assert (pattern - (truth - truth.mean())).std() < 2 * library.noise_dn(0.1, 35.0)
    assert library.worth_applying(0.1, 30.0)
    for temperature_c in (60.0,) if pattern is not None else (35.0, 60.0):
        assert library.correction_dn(SHAPE, 0.1, temperature_c) is None
        assert [one.code for one in library.verdict(0.1, temperature_c)] == ["dark-pattern-of-other-frames"]
