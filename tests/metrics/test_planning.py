from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm, poisson

from labcdp.core.errors import InputError
from labcdp.metrics import Distribution, cdp, pixels_needed

PATCHES = Distribution.normal(120, 5), Distribution.normal(100, 5)


def exact_standard_error(n):
    """Of the CDP of normal patches of n pixels, (100, 5) and (120, 5), by numerical integration."""

    def per_dark(value):
        return norm.cdf(1.3 * value, 120, 5) - norm.cdf(1.1 * value, 120, 5)

    def per_bright(value):
        return norm.cdf(value / 1.1, 100, 5) - norm.cdf(value / 1.3, 100, 5)

    share = norm.expect(per_dark, loc=100, scale=5)
    zeta = norm.expect(lambda value: (per_dark(value) - share) ** 2, loc=100, scale=5)
    zeta += norm.expect(lambda value: (per_bright(value) - share) ** 2, loc=120, scale=5)
    return sqrt((n - 1) * zeta + share * (1 - share)) / n


@pytest.mark.parametrize(("n", "published"), [(400, 0.01180), (10_000, 0.00236)])
def test_normal_patches_need_as_many_pixels_as_the_closed_form_says(n, published):
    exact = exact_standard_error(n)
    assert exact == pytest.approx(published, abs=5e-6)
    # A little more than exact is reached with n pixels, a little less only with more.
    assert pixels_needed(*PATCHES, 0.2, standard_error=exact * (1 + 1e-5)) == n
    assert pixels_needed(*PATCHES, 0.2, standard_error=exact * (1 - 1e-5)) == n + 1


def test_as_many_pixels_have_the_standard_error_planned_for():
    rng = np.random.default_rng(22)
    n = pixels_needed(*PATCHES, 0.2, standard_error=0.02)
    repeats = 600
    found = [cdp(rng.normal(120, 5, n), rng.normal(100, 5, n), 0.2).cdp for _ in range(repeats)]
    assert np.std(found) == pytest.approx(0.02, rel=4 / sqrt(2 * repeats))


@given(st.floats(0.001, 0.5), st.floats(0.001, 0.5))
def test_a_smaller_standard_error_never_needs_fewer_pixels(one, other):
    small, large = sorted((one, other))
    needed = [pixels_needed([118, 125, 131], [100, 102, 109], 0.2, standard_error=wanted) for wanted in (small, large)]
    assert needed[0] >= needed[1] >= 2


@pytest.mark.parametrize(
    ("regions", "standard_error", "message"),
    [
        (([120, 130], [100, 110]), 0, "standard_error is 0: give a number above 0, up to 0.5"),
        (([120, 130], [100, 110]), float("nan"), "standard_error is nan"),
        (([120, 130], [100]), 0.01, "a region of the pilot has one pixel only: give two or more"),
        (([120, 120], [100, 100]), 0.01, "all pairs agree, so there is no scatter to plan with: take a larger pilot"),
        (([0, 0], [0, 0]), 0.01, "neither region holds a value above 0"),
    ],
)
def test_unusable_plans_are_refused(regions, standard_error, message):
    with pytest.raises(InputError, match=message):
        pixels_needed(*regions, 0.2, standard_error=standard_error)


@pytest.mark.parametrize(
    ("patches", "published"),
    [
        ((100, 5, 120, 5), 0.79940),
        ((100, 10, 120, 10), 0.47840),
        ((100, 20, 150, 25), 0.47971),
        ((50, 10, 60, 10), 0.25145),
        ((1000, 30, 1100, 35), 0.70136),
        ((250, sqrt(250), 300, sqrt(300)), 0.66962),
    ],
)
def test_normal_distributions_have_the_published_cdp(patches, published):
    dark, dark_std, bright, bright_std = patches
    result = cdp(Distribution.normal(bright, bright_std), Distribution.normal(dark, dark_std), bright / dark - 1)
    assert result.cdp == pytest.approx(published, abs=1e-5)


def test_veiling_glare_equal_to_the_dark_patch_brings_cdp_down_to_a_half():
    # 100 and 120 with 100 added to both, SNR 100: the contrast left is the lower end of the interval.
    assert cdp(Distribution.normal(220, 2.2), Distribution.normal(200, 2), 0.2).cdp == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize("contrast", [0.1, 0.2])
@pytest.mark.parametrize("target", [0.5, 0.9, 0.95])
def test_shot_noise_needs_the_published_number_of_dark_electrons(contrast, target):
    published = {0.1: (420, 2502, 3555), 0.2: (120, 717, 1020)}[contrast][(0.5, 0.9, 0.95).index(target)]

    def normal(electrons):
        mean = electrons * (1 + contrast)
        return cdp(Distribution.normal(mean, sqrt(mean)), Distribution.normal(electrons, sqrt(electrons)), contrast).cdp

    # The nearest integer, by the slope of the CDP.
    slope = normal(published + 1) - normal(published)
    assert abs(normal(published) - target) < slope
    exact = [Distribution(np.arange(6000), poisson.pmf(np.arange(6000), n)) for n in (1.2 * 717, 717)]
    assert cdp(*exact, 0.2).cdp == pytest.approx(0.9, abs=2e-3)
