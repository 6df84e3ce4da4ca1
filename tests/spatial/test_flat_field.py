import numpy as np
import pytest

from labcdp.calibration.dark_library import dark_library
from labcdp.calibration.defects import Defect, find_defects
from labcdp.calibration.flat_field import measure_fall_off
from labcdp.calibration.pixel_statistics import pixel_statistics
from labcdp.errors import CalibrationError, InputError
from labcdp.vignetting import FlatField, RadialVignetting

SHAPE = (160, 200)
TRUE = RadialVignetting(-0.4, 0.06, -0.02)
V = TRUE.relative_illuminance(SHAPE)
PRNU = 1 + 0.008 * np.random.default_rng(11).normal(size=SHAPE)


@pytest.fixture(scope="module")
def uniform(statistics):
    """Light and dark frames of a uniform source seen through a lens; options go to the source and the sensor."""

    def measure(prnu=PRNU, source=1.0, n=8, exposures=(0.004, 0.012), luminance=150.0, seed=1):
        rng = np.random.default_rng(seed)
        light = np.full(SHAPE, luminance) * source
        lights = [statistics(light, t, n, rng, v=V * prnu) for t in exposures]
        darks = [statistics(np.zeros(SHAPE), t, n, rng) for t in exposures]
        return measure_fall_off(lights, darks, 0.005)

    return measure


@pytest.fixture(scope="module")
def good(uniform):
    return uniform()


def test_flat_field_is_the_truth_within_its_noise(good):
    truth = V * PRNU
    deviation = good.flat.relative / truth
    deviation /= deviation.mean()
    n = deviation.size
    # The stated noise is that of a typical pixel; at the edge there is less light.
    assert deviation.std() == pytest.approx(good.flat.random_rel, rel=0.15)
    assert np.median(np.abs(deviation - 1)) * 1.4826 == pytest.approx(good.flat.random_rel, rel=0.05 + 4 / np.sqrt(n))
    assert good.flat.n_frames == 16


def test_polynomial_is_the_truth_within_its_covariance(good):
    patterns = np.array(good.radial.common_patterns(SHAPE))
    error = good.radial.relative_illuminance(SHAPE) / V - 1
    assert (np.abs(error) < 4 * np.sqrt((patterns**2).sum(axis=0)) + 1e-9).all()
    assert np.abs(error).max() < 0.002


def test_pattern_of_the_pixels_is_found(good):
    assert good.prnu_rel == pytest.approx(0.008, rel=0.03)
    assert good.not_radial_rel < 0.0005
    assert isinstance(good.chosen, FlatField)
    assert good.reason.startswith("the flat field: the pixels differ by 0.8")
    assert good.warnings == ()


def test_a_noisy_flat_field_of_an_even_sensor_is_not_chosen(uniform):
    seen = uniform(prnu=1.0, n=2, luminance=30.0)
    assert isinstance(seen.chosen, RadialVignetting)
    assert "would add more than the pattern of the pixels" in seen.reason
    assert seen.chosen.slow_rel == pytest.approx(0.005, abs=0.002)


def test_a_source_brighter_on_one_side_is_noticed(uniform):
    seen = uniform(source=np.linspace(0.97, 1.03, SHAPE[1]))
    assert seen.not_radial_rel == pytest.approx(0.06 / np.sqrt(12), rel=0.1)
    assert "changes by 5" in seen.warnings[0] or "changes by 6" in seen.warnings[0]
    assert "is the source uniform" in seen.warnings[0]
    assert seen.radial.slow_rel > 0.015


def test_taps_with_different_gains_are_noticed(uniform):
    seen = uniform(prnu=PRNU * np.where(np.arange(SHAPE[1]) < 100, 1.0, 1.02))
    (warning,) = [w for w in seen.warnings if "steps by" in w]
    assert "steps by 2." in warning or "steps by 1.9" in warning
    assert "at column 100:" in warning


def test_dust_is_noticed(uniform):
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    spot = 1 - 0.06 * np.exp(-((x - 60) ** 2 + (y - 50) ** 2) / 2 / 4**2)
    seen = uniform(prnu=PRNU * spot)
    (warning,) = [w for w in seen.warnings if "dark spot" in w]
    assert warning.startswith("1 dark spot of more than")
    assert "one at x 60, y 50" in warning or "one at x 59" in warning or "one at x 60" in warning


def test_saturated_pixels_of_one_exposure_come_from_the_other(uniform):
    seen = uniform(exposures=(0.004, 0.024))  # the middle saturates at the longer
    error = seen.flat.relative / V / PRNU
    assert error.std() / error.mean() < 0.01
    assert seen.n_replaced == 0


def test_light_that_saturates_everywhere_is_refused(uniform):
    with pytest.raises(CalibrationError, match=r"of the pixels are saturated or black in all light frames"):
        uniform(exposures=(0.2,))


def test_dead_pixels_get_their_neighbours_value(uniform):
    prnu = PRNU.copy()
    prnu[70, 80] = 0.001
    seen = uniform(prnu=prnu)
    assert seen.n_replaced == 1
    assert seen.flat.relative[70, 80] == pytest.approx(V[70, 80], rel=0.03)


def test_missing_dark_frames_and_single_frames_are_refused(statistics):
    rng = np.random.default_rng(1)
    light = statistics(np.full(SHAPE, 100.0), 0.01, 3, rng)
    dark = statistics(np.zeros(SHAPE), 0.02, 3, rng)
    with pytest.raises(CalibrationError, match=r"no dark frames at 0\.01 s, the exposure of light frames"):
        measure_fall_off([light], [dark], 0.01)
    single = statistics(np.zeros(SHAPE), 0.01, 1, rng)
    with pytest.raises(CalibrationError, match=r"a single frame at 0\.01 s: take at least 2 light and 2 dark"):
        measure_fall_off([light], [single], 0.01)
    with pytest.raises(CalibrationError, match="there is no light frame"):
        measure_fall_off([], [single], 0.01)


def test_statistics_are_those_of_numpy(expose):
    rng = np.random.default_rng(3)
    frames = [expose(np.full((20, 30), 50.0), 0.01, rng, frame_id=i) for i in range(5)]
    stack = np.stack([frame.dn for frame in frames]).astype(float)
    seen = pixel_statistics(iter(frames))
    np.testing.assert_allclose(seen.mean_dn, stack.mean(axis=0))
    np.testing.assert_allclose(seen.variance_dn2, stack.var(axis=0, ddof=1), atol=1e-9)
    assert (seen.n_frames, seen.exposure_s, seen.temperature_c) == (5, 0.01, 30.0)


def pattern_with_defects():
    pattern = np.random.default_rng(4).normal(0, 1.0, SHAPE)
    pattern[10, 11] += 120
    return pattern


def test_defects_are_found_with_their_reason(expose):
    rng = np.random.default_rng(5)
    pattern = pattern_with_defects()
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
    found = find_defects(pixel_statistics(darks), pixel_statistics(lights))
    named = {(int(r), int(c)): Defect(int(f)) for r, c, f in zip(found.rows, found.columns, found.reasons, strict=True)}
    assert set(named) == {(10, 11), (20, 21), (30, 31), (40, 41)}
    assert Defect.HOT in named[10, 11]
    assert Defect.DEAD in named[20, 21]
    assert Defect.STUCK in named[30, 31]
    assert Defect.NOISY in named[40, 41]
    assert found.count(Defect.NOISY) == 1
    mask = found.mask(SHAPE)
    assert mask.sum() == found.n_pixels == 4
    with pytest.raises(InputError, match="the defect map is for 200 x 160 pixels, the image has 20 x 10"):
        found.mask((10, 20))


def test_a_sound_sensor_has_no_defects(statistics):
    rng = np.random.default_rng(6)
    dark = statistics(np.zeros(SHAPE), 0.01, 16, rng)
    light = statistics(np.full(SHAPE, 150.0), 0.01, 16, rng, v=V * PRNU)
    assert find_defects(dark, light).n_pixels == 0


def test_dead_pixels_cannot_be_found_in_the_dark(statistics):
    rng = np.random.default_rng(6)
    dark = statistics(np.zeros(SHAPE), 0.01, 4, rng)
    with pytest.raises(CalibrationError, match="too little to find dead pixels"):
        find_defects(dark, dark)


def test_dark_library_finds_offset_and_rate(statistics):
    rng = np.random.default_rng(7)
    offset, rate = rng.normal(0, 2, SHAPE), rng.normal(0, 300, SHAPE)
    exposures = (0.001, 0.01, 0.02)
    library = dark_library([statistics(np.zeros(SHAPE), t, 8, rng, pattern_dn=offset + rate * t) for t in exposures])
    n = offset.size
    for t in exposures:
        truth = offset + rate * t
        error = library.pattern_dn(SHAPE, t) - (truth - truth.mean())
        assert error.std() == pytest.approx(library.noise_dn(t), rel=0.05 + 4 / np.sqrt(2 * n))
        assert library.nonuniformity_dn(t) == pytest.approx(truth.std(), rel=0.03)
        assert abs(library.pattern_dn(SHAPE, t).mean()) < 1e-4
        assert library.worth_applying(t)
    assert "worth subtracting" in library.verdict(0.01)


def test_a_library_of_few_frames_of_an_even_sensor_is_not_worth_it(statistics):
    rng = np.random.default_rng(8)
    pattern = rng.normal(0, 0.3, SHAPE)
    library = dark_library([statistics(np.zeros(SHAPE), 0.01, 2, rng, pattern_dn=pattern)])
    assert not library.worth_applying(0.01)
    assert "subtracting it would add more than it removes; take" in library.verdict(0.01)


def test_hot_pixels_do_not_speak_for_the_others(statistics):
    """Twenty hot pixels of an even sensor, which the map of defects takes care of anyway."""
    rng = np.random.default_rng(10)
    rate = np.zeros(SHAPE)
    rate.flat[rng.choice(rate.size, 20, replace=False)] = rng.uniform(5e3, 2e4, 20)
    darks = [statistics(np.zeros(SHAPE), t, 2, rng, pattern_dn=rate * t) for t in (0.005, 0.05)]
    defects = find_defects(darks[1])
    assert (defects.mask(SHAPE) == (rate > 0)).all()
    assert dark_library(darks).worth_applying(0.05)
    library = dark_library(darks, defects)
    assert not library.worth_applying(0.05)
    assert library.pattern_dn(SHAPE, 0.05)[rate == 0].mean() == pytest.approx(0, abs=1e-5)


def test_doubling_temperature(expose):
    rng = np.random.default_rng(9)
    rate = np.abs(rng.normal(2000, 300, SHAPE))
    sets = []
    for temperature in (20.0, 27.0, 34.0):
        growth = 2 ** ((temperature - 27.0) / 7.0)
        for t in (0.001, 0.03):
            frames = [
                expose(np.zeros(SHAPE), t, rng, pattern_dn=rate * growth * t - 40 * t, frame_id=i) for i in range(4)
            ]
            sets.append(pixel_statistics(type(f)(**{**vars(f), "temperature_c": temperature}) for f in frames))
    library = dark_library(sets)
    assert library.doubling_temperature_c == pytest.approx(7.0, rel=0.02)
    assert library.temperature_c == pytest.approx(27.0)
    error = library.pattern_dn(SHAPE, 0.03, 27.0) - (rate - rate.mean()) * 0.03
    assert error.std() == pytest.approx(library.noise_dn(0.03, 27.0), rel=0.05)
    assert library.pattern_dn(SHAPE, 0.03, 34.0) == pytest.approx(library.pattern_dn(SHAPE, 0.06, 27.0), abs=5)


def test_libraries_are_equal_by_content(statistics):
    rng = np.random.default_rng(8)
    seen = [statistics(np.zeros(SHAPE), 0.01, 3, rng)]
    assert dark_library(seen) == dark_library(seen)
    assert dark_library(seen) != dark_library([statistics(np.zeros(SHAPE), 0.01, 3, rng)])
    with pytest.raises(CalibrationError, match="at least 2 dark frames"):
        dark_library([statistics(np.zeros(SHAPE), 0.01, 1, rng)])
    with pytest.raises(InputError, match="the dark library is for 200 x 160 pixels"):
        dark_library(seen).pattern_dn((10, 20), 0.01)
