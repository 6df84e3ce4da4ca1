import numpy as np
import pytest

from labcdp.calibration.regions import region_contrast, region_luminance
from labcdp.calibration.uncertainty import expanded_half_width
from labcdp.errors import CalibrationError
from labcdp.luminance import CommonError, Invalid, LuminanceMap
from labcdp.roi import Roi

BRIGHT, DARK = Roi.rectangle("bright", 2, 2, 20, 10), Roi.rectangle("dark", 30, 20, 10, 20)


def two_levels(rng=None, common=(), **changes):
    luminance = np.full((48, 64), 50.0)
    luminance[:, 26:] = 10.0
    if rng is not None:
        luminance *= 1 + 0.05 * rng.normal(size=luminance.shape)
    return LuminanceMap(luminance, np.full((48, 64), 0.05), common, np.zeros((48, 64), np.uint8), **changes)


def test_mean_and_its_noise():
    seen = region_luminance(two_levels(), BRIGHT)
    assert (seen.mean_cd_m2, seen.n_pixels, seen.invalid_share) == (50.0, 200, 0.0)
    assert seen.random_cd_m2 == pytest.approx(50 * 0.05 / np.sqrt(200))


def test_the_stated_noise_is_the_scatter_of_means():
    means = [region_luminance(two_levels(np.random.default_rng(i)), BRIGHT) for i in range(400)]
    stated = np.mean([m.random_cd_m2 for m in means])
    assert np.std([m.mean_cd_m2 for m in means]) == pytest.approx(stated, rel=4 / np.sqrt(800))


def test_a_pattern_beyond_the_noise_counts():
    luminance = two_levels()
    luminance.luminance_cd_m2[:] *= 1 + 0.2 * np.random.default_rng(1).normal(size=(48, 64))
    seen = region_luminance(luminance, BRIGHT)
    assert seen.random_cd_m2 == pytest.approx(50 * 0.2 / np.sqrt(200), rel=4 / np.sqrt(2 * 190))


def test_a_gradient_is_no_noise():
    luminance = two_levels()
    luminance.luminance_cd_m2[:] *= np.linspace(0.9, 1.1, 64)
    seen = region_luminance(luminance, BRIGHT)
    assert seen.random_rel == pytest.approx(0.05 / np.sqrt(200), rel=0.02)


def test_common_errors_of_a_region_are_weighted_by_luminance():
    pattern = np.random.default_rng(2).normal(size=(48, 64))
    luminance = two_levels(common=(CommonError("fit", pattern), CommonError("meter scale", 0.01, True)))
    luminance.luminance_cd_m2[2:12, 2:12] = 90.0
    fit, scale = region_luminance(luminance, BRIGHT).common
    inside = luminance.luminance_cd_m2[2:12, 2:22]
    assert fit.relative == pytest.approx((pattern[2:12, 2:22] * inside).sum() / inside.sum())
    assert (scale.relative, scale.rectangular) == (0.01, True)


def test_slow_parts_do_not_average_down():
    seen = region_luminance(two_levels(slow_rel=0.01, slow_cd_m2=0.3), BRIGHT)
    assert seen.slow_cd_m2 == pytest.approx(np.hypot(0.5, 0.3))
    assert seen.standard_uncertainty_cd_m2 == pytest.approx(np.sqrt(0.5**2 + 0.3**2 + 2.5**2 / 200))


def test_interval_of_a_rectangular_scale_and_a_normal_rest():
    common = (CommonError("meter scale", 0.02 / np.sqrt(3), True), CommonError("fit", 0.005))
    seen = region_luminance(two_levels(common=common), BRIGHT)
    half_width = 50 * expanded_half_width(0.02, float(np.hypot(0.005, 0.05 / np.sqrt(200))))
    assert seen.interval_95_cd_m2 == pytest.approx((50 - half_width, 50 + half_width))


def test_what_both_regions_share_cancels_in_a_contrast():
    pattern = np.full((48, 64), 0.03)
    pattern[:, 26:] = -0.01
    common = (CommonError("meter scale", 0.02 / np.sqrt(3), True), CommonError("fit", pattern))
    result = region_contrast(two_levels(common=common, slow_rel=0.002), BRIGHT, DARK)
    noise = np.sqrt(2 * (0.05**2 / 200 + 0.002**2))
    assert result.contrast == pytest.approx(4.0)
    assert result.standard_uncertainty == pytest.approx(5 * np.hypot(noise, 0.04))
    half_width = 5 * 1.959964 * np.hypot(noise, 0.04)
    assert result.interval_95 == pytest.approx((4 - half_width, 4 + half_width), rel=1e-5)


def test_intervals_of_contrasts_cover_the_truth():
    """The regions' own errors are drawn, the shared scale is drawn and must not matter."""
    covered, n = 0, 600
    for seed in range(n):
        rng = np.random.default_rng(seed)
        luminance = two_levels(rng, common=(CommonError("meter scale", 0.02 / np.sqrt(3), True),), slow_rel=0.004)
        luminance.luminance_cd_m2[:] *= 1 + rng.uniform(-0.02, 0.02)
        luminance.luminance_cd_m2[:, :26] *= 1 + rng.normal(0, 0.004)
        luminance.luminance_cd_m2[:, 26:] *= 1 + rng.normal(0, 0.004)
        low, high = region_contrast(luminance, BRIGHT, DARK).interval_95
        covered += low <= 4 <= high
    assert covered / n == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / n))


def flagged(reason, n):
    luminance = two_levels()
    luminance.invalid[2:12, 2:22].reshape(-1)[:n] = reason
    invalid = luminance.invalid.copy()
    invalid[2:12, 2:22] = np.where(np.arange(200) < n, reason, 0).reshape(10, 20)
    luminance.luminance_cd_m2[invalid != 0] = 1e4
    return LuminanceMap(luminance.luminance_cd_m2, luminance.random_rel, (), invalid)


def test_defect_pixels_are_left_out():
    seen = region_luminance(flagged(Invalid.DEFECT, 3), BRIGHT)
    assert (seen.mean_cd_m2, seen.n_pixels, seen.invalid_share) == (50.0, 197, 0.015)


def test_a_saturated_region_is_refused():
    with pytest.raises(
        CalibrationError, match=r"1\.5% of the pixels of region 'bright' are saturated.*shorter exposure"
    ):
        region_luminance(flagged(Invalid.SATURATED, 3), BRIGHT)


def test_a_region_without_usable_pixels_is_refused():
    with pytest.raises(CalibrationError, match="region 'bright' has no usable pixel"):
        region_luminance(flagged(Invalid.DEFECT, 200), BRIGHT)


def test_regions_of_the_image_on_a_map_of_half_its_size():
    whole, half = two_levels(), two_levels(step=2)
    twice = Roi("bright", tuple((2 * x, 2 * y) for x, y in BRIGHT.corners))
    assert (half.select(twice) == whole.select(BRIGHT)).all()
    assert region_luminance(half, twice).n_pixels == 200
