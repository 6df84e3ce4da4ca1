"""Dynamic range against closed forms of a camera with photon noise, read noise and full well."""

import numpy as np
import pytest

from labcdp.core.errors import InputError
from labcdp.metrics import dynamic_range

#: Electrons per unit of luminance, read noise and full well in electrons.
E_PER_CD_M2, READ_E, FULL_E = 20.0, 3.0, 30_000.0


def snr_of(luminance, glare=0.0):
    signal = E_PER_CD_M2 * luminance
    return signal / np.sqrt(signal + E_PER_CD_M2 * glare + READ_E**2)


def low_end(limit, glare=0.0):
    """Luminance at which signal^2 = limit^2 (signal + glare + read noise^2)."""
    background = E_PER_CD_M2 * glare + READ_E**2
    return (limit**2 + np.sqrt(limit**4 + 4 * limit**2 * background)) / 2 / E_PER_CD_M2


@pytest.mark.parametrize("limit", [1, 2, 4, 10])
@pytest.mark.parametrize("n_patches", [12, 20, 36])
@pytest.mark.parametrize("glare", [0.0, 0.5])
def test_ends_lie_where_the_closed_form_has_them(limit, n_patches, glare):
    luminance = np.geomspace(0.02, 3000, n_patches)
    saturated = luminance >= FULL_E / E_PER_CD_M2
    found = dynamic_range(
        luminance, snr_of(luminance, glare), limit, saturated=saturated, saturation=FULL_E / E_PER_CD_M2
    )
    assert abs(np.log2(found.low / low_end(limit, glare))) < 0.05
    assert abs(found.stops - np.log2(FULL_E / E_PER_CD_M2 / low_end(limit, glare))) < 0.05
    assert (found.low_end, found.high_end, found.bound) == ("noise", "saturation", "")
    assert found.decibels == pytest.approx(found.stops * 20 * np.log10(2))


def test_intervals_hold_in_simulated_charts():
    rng, luminance, n_pixels, repeats = np.random.default_rng(4), np.geomspace(0.02, 1000, 36), 1600, 200
    held = dict.fromkeys((1, 2, 4, 10), 0)
    for _ in range(repeats):
        # Mean and standard deviation of normal pixels are independent.
        signal = E_PER_CD_M2 * luminance
        sigma = np.sqrt(signal + READ_E**2)
        mean = rng.normal(signal, sigma / np.sqrt(n_pixels))
        std = sigma * np.sqrt(rng.chisquare(n_pixels - 1, luminance.size) / (n_pixels - 1))
        snr = mean / std
        for limit in held:
            found = dynamic_range(luminance, snr, limit, np.sqrt((1 + snr**2 / 2) / n_pixels))
            held[limit] += found.low_interval.low <= low_end(limit) <= found.low_interval.high
    # 95 % within 3.5 standard deviations of the binomial distribution.
    tolerance = 3.5 * np.sqrt(0.95 * 0.05 / repeats)
    for limit, count in held.items():
        assert abs(count / repeats - 0.95) < tolerance, (limit, count)


def test_intervals_hold_where_the_stated_luminances_are_uncertain():
    """Each has an error of 4 %, and all have one of 6 % in common, which cancels in the ratio."""
    rng, true, repeats, limit = np.random.default_rng(8), np.geomspace(0.02, 3000, 24), 300, 4
    full = true >= FULL_E / E_PER_CD_M2
    snr, held = snr_of(true), np.zeros(3)
    stops = np.log2(FULL_E / E_PER_CD_M2 / low_end(limit))
    for _ in range(repeats):
        stated = true * np.exp(rng.normal(0, 0.04, true.size) + rng.normal(0, 0.06))
        # Beyond the brightest patch that is not saturated, light and mean rise in proportion.
        saturation = stated[~full][-1] * FULL_E / E_PER_CD_M2 / true[~full][-1]
        found = dynamic_range(
            stated, snr, limit, saturated=full, saturation=saturation, u_luminance_rel=0.04, u_scale_rel=0.06
        )
        held += (
            found.low_interval.low <= low_end(limit) <= found.low_interval.high,
            found.high_interval.low <= FULL_E / E_PER_CD_M2 <= found.high_interval.high,
            abs(found.stops - stops) <= 1.96 * found.u_stops,
        )
    # 95 % within 3.5 standard deviations of the binomial distribution.
    assert (np.abs(held / repeats - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / repeats)).all(), held / repeats


def test_what_the_luminances_have_in_common_is_no_part_of_their_ratio():
    luminance = np.geomspace(0.1, 100, 20)
    plain, scaled = (dynamic_range(luminance, snr_of(luminance), 2, 0.1, u_scale_rel=u) for u in (0.0, 0.03))
    assert scaled.u_stops == pytest.approx(plain.u_stops, rel=1e-9)
    low, high = np.log(scaled.low_interval)
    known = np.diff(np.log(plain.low_interval))[0] / 2
    assert (high - low) / 2 == pytest.approx(np.hypot(known, 1.96 * 0.03), rel=1e-4)
    assert scaled.high_interval.high == pytest.approx(100 * np.exp(1.96 * 0.03), rel=1e-4)


def test_a_chart_that_ends_first_gives_a_bound():
    found = dynamic_range([1, 2, 4, 8], [10, 14, 20, 28], 2)
    assert (found.low, found.high, found.bound) == (1, 8, ">")
    assert (found.low_end, found.high_end) == ("chart", "chart")


def test_without_a_patch_that_reaches_the_limit_there_is_no_range():
    found = dynamic_range([1, 2, 4], [0.1, 0.2, 0.3], 2)
    assert np.isnan(found.low)
    assert np.isnan(found.stops)
    assert found.low_end is None


def test_a_dip_is_no_end():
    luminance = np.geomspace(1, 1000, 10)
    snr = np.array([0.5, 2.0, 4.0, 8.0, 1.5, 6.0, 9.0, 12.0, 15.0, 20.0])
    found = dynamic_range(luminance, snr, 2)
    assert found.dips == (pytest.approx(luminance[4]),)
    assert found.high == pytest.approx(1000)


def test_order_and_unit_do_not_matter():
    luminance = np.geomspace(0.1, 100, 20)
    figures = snr_of(luminance)
    found = dynamic_range(luminance, figures, 2)
    shuffled = np.random.default_rng(1).permutation(20)
    again = dynamic_range(7 * luminance[shuffled], figures[shuffled], 2)
    assert again.low == pytest.approx(7 * found.low, rel=1e-9)
    assert again.stops == pytest.approx(found.stops, rel=1e-9)


@pytest.mark.parametrize(
    ("luminance", "figure", "limit"),
    [([1], [1], 2), ([1, 2], [1, 2, 3], 2), ([0, 1], [1, 2], 2), ([1, 2], [1, 2], 0), ([1, np.nan], [1, 2], 1)],
)
def test_what_is_not_possible_is_refused(luminance, figure, limit):
    with pytest.raises(InputError):
        dynamic_range(luminance, figure, limit)
