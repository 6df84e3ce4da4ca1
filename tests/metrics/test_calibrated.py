from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr

from labcdp.core.errors import InputError
from labcdp.metrics import cdp_range, cdp_with_common_errors

PIXELS = 2000


def _regions(seed=0, bright=120.0, noise=5.0):
    rng = np.random.default_rng(seed)
    return rng.normal(bright, noise, PIXELS), rng.normal(100.0, noise, PIXELS)


def _normal_cdp(bright, dark, noise, contrast):
    """Closed form of two normal patches."""

    def share(ratio):
        return ndtr((ratio * dark - bright) / (noise * sqrt(ratio**2 + 1)))

    return share(1 + 1.5 * contrast) - share(1 + 0.5 * contrast)


def test_an_error_both_regions_share_cancels():
    a, b = _regions()
    result = cdp_with_common_errors(a, b, 0.2, 0.5, [(0.02, 0.02), (np.full(PIXELS, 0.1), np.full(PIXELS, 0.1))])
    assert result.calibration_standard_uncertainty == pytest.approx(0, abs=1e-12)
    assert (result.result,) == cdp_range(a, b, [0.2], 0.5)
    assert result.confidence_interval == pytest.approx(result.result.confidence_interval)


def test_a_small_error_propagates_by_the_derivative_of_the_closed_form():
    a, b = _regions()
    # At a contrast of 30 % the interval's lower end cuts the distribution, the CDP has a slope.
    u = 0.002
    expected = (_normal_cdp(120 * (1 + u), 100, 5, 0.3) - _normal_cdp(120 * (1 - u), 100, 5, 0.3)) / 2
    found = cdp_with_common_errors(a, b, 0.3, 0.5, [(u, 0.0)]).calibration_standard_uncertainty
    # The slope is a density at the end, which 2000 x 2000 pixels give to about 1 / sqrt(2000 x 0.1).
    assert found == pytest.approx(abs(expected), rel=4 / sqrt(PIXELS * 0.1))


def test_arrays_say_the_same_as_numbers():
    a, b = _regions()
    of_numbers = cdp_with_common_errors(a, b, 0.3, 0.5, [(0.005, -0.002)])
    of_arrays = cdp_with_common_errors(a, b, 0.3, 0.5, [(np.full(PIXELS, 0.005), np.full(PIXELS, -0.002))])
    assert of_arrays.calibration_standard_uncertainty == pytest.approx(
        of_numbers.calibration_standard_uncertainty, rel=0.02
    )


def test_the_interval_covers_the_true_cdp():
    """With a wrong conversion drawn anew for each pair of regions: 400 pairs, 3 sigma of 95 % is 3.3 points."""
    rng = np.random.default_rng(11)
    u, truth, repeats, covered = 0.01, _normal_cdp(120, 100, 5, 0.3), 400, 0
    for seed in range(repeats):
        a, b = _regions(seed)
        result = cdp_with_common_errors(a * (1 + rng.normal(0, u)), b, 0.3, 0.5, [(u, 0.0)])
        low, high = result.confidence_interval
        covered += low <= truth <= high
    assert covered / repeats == pytest.approx(0.95, abs=3 * sqrt(0.95 * 0.05 / repeats))


@given(error=st.floats(0.0, 0.05), seed=st.integers(0, 5))
def test_the_interval_is_not_a_narrower_than_by_pixels_alone(error, seed):
    a, b = _regions(seed)
    result = cdp_with_common_errors(a, b, 0.2, 0.5, [(error, 0.0)])
    low, high = result.result.confidence_interval
    assert result.confidence_interval[0] <= low + 1e-12
    assert result.confidence_interval[1] >= high - 1e-12
    assert result.standard_uncertainty >= result.result.standard_error


@pytest.mark.parametrize("error", [np.ones(3), np.inf])
def test_errors_that_do_not_fit_are_refused(error):
    with pytest.raises(InputError, match=r"an error of a has the shape .*, or is not finite: give a finite number"):
        cdp_with_common_errors([2.0, 2.1], [1.0, 1.1], 1.0, 0.5, [(error, 0.0)])
