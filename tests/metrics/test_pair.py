from functools import partial
from math import inf, isnan, sqrt

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter

from labcdp.core.errors import InputError
from labcdp.core.luminance import CommonError, Invalid
from labcdp.core.roi import Roi
from labcdp.metrics import cdp, csnr
from labcdp.metrics.pair import evaluate_pair
from labcdp.metrics.region import evaluate_region

from .closed_forms import share_of_normal
from .conftest import map_of

SHAPE = (60, 90)
LEFT, RIGHT = Roi.rectangle("left", 5, 5, 30, 40), Roi.rectangle("right", 50, 10, 30, 40)


def _scene(seed=0, bright=120.0, noise=5.0, shape=SHAPE):
    rng = np.random.default_rng(seed)
    luminance = rng.normal(100.0, noise, shape)
    luminance[:, shape[1] // 2 :] += bright - 100.0
    return luminance


#: Of normal regions of 120 and 100 with noise of 5.
CSNR = csnr(*(np.random.default_rng(0).normal(mean, 5.0, 10**6) for mean in (120, 100))).value


def test_without_errors_of_a_calibration_a_pair_is_that_of_its_pixels_and_of_their_correlation():
    smooth = 100 + 5 * uniform_filter(np.random.default_rng(1).normal(0, 3, SHAPE), 3)
    smooth[:, 45:] *= 1.2
    for luminance, left in ((_scene(3), Roi("triangle", ((2, 3), (38, 8), (20.5, 50)))), (smooth, LEFT)):
        for contrast in (0.2, 0.3):
            found = evaluate_pair(map_of(luminance), left, RIGHT, (contrast,), 0.4).cdp[0]
            expected = cdp(*(roi.select(luminance) for roi in (left, RIGHT)), contrast, 0.4)
            assert (found.cdp, found.below, found.above) == (expected.cdp, expected.below, expected.above)
    assert found.correlation_inflation > 1.5


def test_an_error_both_regions_share_cancels_in_contrast_cdp_and_ratios_but_not_in_the_luminance():
    luminance = _scene(2)
    plain = evaluate_pair(map_of(luminance), LEFT, RIGHT, (0.3,))
    for shared in (0.05, np.full(SHAPE, 0.05)):
        found = evaluate_pair(map_of(luminance, (CommonError("scale", shared),)), LEFT, RIGHT, (0.3,))
        assert found.contrast.u == pytest.approx(plain.contrast.u)
        assert found.csnr.u == pytest.approx(plain.csnr.u)
        assert found.a.snr.u == pytest.approx(plain.a.snr.u)
        assert found.cdp[0].u == pytest.approx(plain.cdp[0].u)
        expected = sqrt(plain.a.u**2 + 5.0**2)
        assert found.a.u == pytest.approx(expected, rel=0.01)
    # A scale of which nothing is known leaves the luminance alone without an uncertainty.
    found = evaluate_pair(map_of(_scene(2), (CommonError("guess", inf),)), LEFT, RIGHT, (0.3,))
    assert isnan(found.a.u)
    assert (found.contrast, repr(found.cdp)) == (plain.contrast, repr(plain.cdp))


def test_a_slow_change_across_a_region_is_no_noise():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    slow = 1 + 0.2 * (x / 90) + 0.1 * (y / 60) ** 2
    plain, sloped = (evaluate_pair(map_of(_scene(8) * factor), LEFT, RIGHT, (0.2,)) for factor in (1, slow))
    assert sloped.a.u < 1.5 * plain.a.u
    assert sloped.cdp[0].correlation_inflation == 1
    # Where all pairs agree too, and where there is no noise at all.
    for luminance in (_scene(8) * slow, np.where(x < 45, 100.0, 120.0) * slow):
        assert evaluate_pair(map_of(luminance), LEFT, RIGHT, (5.0,)).cdp[0].interval[1] < 0.01


@pytest.mark.parametrize("blurred", [np.asarray, partial(uniform_filter, size=2), partial(gaussian_filter, sigma=2)])
def test_the_intervals_cover_the_truth(blurred):
    """Noise, blurred or not, and errors of the calibration drawn anew for each image; 3 sigma of 95 %."""
    rng, repeats = np.random.default_rng(20), 150
    contrast, scale, slow, offset = 0.3, 0.05, 0.004, 0.3
    truth, covered = share_of_normal((120, 5), (100, 5), 0.5 * contrast, 1.5 * contrast), np.zeros(4)
    # As large as without blur: by the sum of the squares of the filter.
    impulse = np.pad([[1.0]], 20)
    loss = sqrt(np.square(blurred(impulse)).sum())
    for _ in range(repeats):
        luminance = 100 + 5 * blurred(rng.normal(size=(100, 130)))[20:80, 20:110] / loss
        luminance[:, 45:] += 20.0
        luminance[:, 45:] *= 1 + rng.normal(0, slow)
        luminance[:, :45] *= 1 + rng.normal(0, slow)
        luminance = luminance * (1 + rng.normal(0, scale)) + rng.normal(0, offset)
        image = map_of(
            luminance, (CommonError("scale", scale), CommonError("offset", offset / luminance)), slow_rel=slow
        )
        found = evaluate_pair(image, LEFT, RIGHT, (contrast,))
        of = found.contrast, found.csnr
        values = [*((one.value, one.u) for one in of), (found.b.mean, found.b.u)]
        inside = [abs(value - true) <= 1.96 * u for (value, u), true in zip(values, (0.2, CSNR, 120), strict=True)]
        low, high = found.cdp[0].interval
        covered += [*inside, low <= truth <= high]
    assert (covered / repeats >= 0.95 - 3 * sqrt(0.95 * 0.05 / repeats)).all(), covered / repeats


def test_the_uncertainty_of_the_snr_has_the_dark_signal_in_it():
    luminance = _scene(6, noise=2.0)
    plain, offset = (
        evaluate_region(map_of(luminance, common), LEFT).snr for common in ((), (CommonError("d", 5 / luminance),))
    )
    # An offset of 5 changes the mean by 5 and the noise not at all.
    expected = sqrt(plain.u**2 + (5 / LEFT.select(luminance).std(ddof=1)) ** 2)
    assert offset.u == pytest.approx(expected)


def test_pixels_that_are_not_valid_count_and_are_warned_about():
    invalid = np.zeros(SHAPE, dtype=np.uint8)
    invalid[5:15, 5:35] = Invalid.OUTSIDE_CALIBRATED
    # Fewer saturated pixels than make a bound of the mean.
    invalid[5, 5:15] |= np.uint8(Invalid.SATURATED)
    invalid[10, 50:62] = Invalid.BELOW_BLACK
    invalid[11, 50:53] = Invalid.DEFECT
    luminance = _scene()
    found = evaluate_pair(map_of(luminance, invalid=invalid), LEFT, RIGHT, (0.2,))
    assert found.a.invalid_shares == {"saturated": pytest.approx(1 / 120), "outside_calibrated": 0.25}
    assert found.b.invalid_shares == {"below_black": 0.01, "defect": 0.0025}
    assert found.cdp[0].cdp == cdp(LEFT.select(luminance), RIGHT.select(luminance), 0.2).cdp
    named = [("saturated", "left"), ("outside-calibrated", "left"), ("below-black", "right"), ("defect", "right")]
    assert [(one.code, one.subject) for one in found.findings] == [(f"region-{what}", where) for what, where in named]


def test_regions_that_overlap_by_their_pixels_or_hold_no_numbers_are_refused():
    with pytest.raises(InputError, match="regions 'left' and 'x' have 24 pixels in common"):
        evaluate_pair(map_of(_scene()), LEFT, Roi.rectangle("x", 29, 41, 10, 10), (0.2,))
    luminance = _scene()
    luminance[12, 55:58] = np.nan, np.inf, 1.0
    with pytest.raises(InputError, match=r"region 'right' has 2 pixels that are not finite: correct the image"):
        evaluate_pair(map_of(luminance), LEFT, RIGHT, (0.2,))


def test_a_dark_region_below_the_black_has_no_finite_contrast():
    luminance = _scene() - 100.0
    luminance[:, :45] -= 3
    found = evaluate_pair(map_of(luminance, (CommonError("d", 0.1 / luminance),)), LEFT, RIGHT, (1.0,))
    assert found.contrast.value == inf
    assert np.isnan([found.contrast.u, found.csnr.value]).all()
    assert found.cdp[0].above > 0.5


def test_a_small_error_propagates_by_the_derivative_of_the_closed_form():
    n, u, rng = 2000, 0.002, np.random.default_rng(0)
    a, b = rng.normal(120, 5, n), rng.normal(100, 5, n)
    # At a contrast of 30 % the interval's lower end cuts the distribution, the CDP has a slope.
    above, below = (share_of_normal((120 * (1 + sign * u), 5), (100, 5), 0.15, 0.45) for sign in (1, -1))
    expected = (above - below) / 2
    luminance = np.concatenate((a, b)).reshape(2, n)
    regions = Roi.rectangle("a", 0, 0, n, 1), Roi.rectangle("b", 0, 1, n, 1)
    errors = u * np.array([[1.0], [0.0]]) * np.ones((2, n))
    (found,) = evaluate_pair(map_of(luminance, (CommonError("scale of a", errors),)), *regions, (0.3,)).cdp
    # The slope is a density at the end, which 2000 x 2000 pixels give to about 1 / sqrt(2000 x 0.1).
    assert found.u_calibration == pytest.approx(abs(expected), rel=4 / sqrt(n * 0.1))
    assert found.interval.high > cdp(a, b, 0.3).interval.high


@pytest.mark.parametrize("size", [0.9, 1.0, 1.5, 20.0])
@pytest.mark.parametrize("kind", ["scale of both", "scale of one", "veil"])
def test_an_error_of_the_light_itself_makes_an_uncertainty_and_no_failure(size, kind):
    """An error of 100 % or more of the darker region, as by a veil that may be all of it."""
    luminance = _scene(8, noise=2.0)
    relative = {"scale of both": size, "scale of one": 0.0, "veil": size * 100 / luminance}[kind]
    slow = {"slow_rel": size} if kind == "scale of one" else {}
    plain = evaluate_pair(map_of(luminance), LEFT, RIGHT, (0.2,))
    found = evaluate_pair(map_of(luminance, (CommonError("v", relative),), **slow), LEFT, RIGHT, (0.2,))
    assert found.cdp[0].cdp == plain.cdp[0].cdp
    assert np.isfinite(found.cdp[0].u_calibration)
    low, high = found.cdp[0].interval
    assert 0 <= low <= high <= 1
