"""Contrasts, ranges of them, and their distribution over all pairs; ratios of signal and noise."""

from decimal import Decimal
from fractions import Fraction
from math import inf, log10, nan, sqrt
from sys import float_info

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import poisson

from labcdp.metrics import (
    DetectionInterval,
    Distribution,
    cnr,
    contrast_distribution,
    csnr,
    d_prime,
    snr,
    snr_10log10_db,
    snr_20log10_db,
    weber_contrast,
    weber_contrast_of_means,
)
from labcdp.metrics.contrast import detected_contrasts, detected_ratios

region = st.lists(st.one_of(st.integers(-2, 8), st.integers(90, 130)), min_size=1, max_size=10)
edges = st.lists(st.decimals("-1", "5", places=2), min_size=1, max_size=8, unique=True).map(sorted)


def test_weber_contrast_is_the_ratio_less_one():
    # Patches of the thesis' experiment: 412 against 33.6 cd/m^2.
    assert weber_contrast([110, 100, 412], [100, 100, 33.6]).tolist() == pytest.approx([0.1, 0, 11.2619], abs=5e-5)
    unlit = weber_contrast([5, 5, 0, -1], [0, -1, 0, -2]).tolist()
    assert unlit == pytest.approx([inf, inf, np.nan, np.nan], nan_ok=True)
    assert weber_contrast_of_means([90, 110], [[120, 130], [110, 120]]) == pytest.approx(0.2)
    assert weber_contrast_of_means([100], [-1, 0, 1]) == inf
    assert np.isnan(weber_contrast_of_means([-9, 3], [-9, 3]))


@given(region, region, edges)
def test_the_distribution_is_the_share_of_all_pairs_up_to_each_edge(all_contrasts, a, b, bins):
    assume(max(a + b) > 0)
    flat = [value for row in all_contrasts(a, b) for value in row]
    expected = [float(Fraction(sum(not value > edge for value in flat), len(flat))) for edge in map(Fraction, bins)]
    result = contrast_distribution(a, b, np.array(bins, dtype=float))
    assert result.cumulative.tolist() == expected
    assert result.undefined == pytest.approx(sum(value != value for value in flat) / len(flat), abs=1e-15)
    assert result.unbounded == pytest.approx(flat.count(inf) / len(flat), abs=1e-15)


def test_bins_cover_all_but_a_thousandth_of_the_contrasts():
    rng = np.random.default_rng(23)
    a, b = rng.normal(100, 5, 300), rng.normal(120, 5, 200)
    edges = contrast_distribution(a, b, 50).edges
    low, high = np.quantile(np.divide.outer(b, a).ravel() - 1, [0.0005, 0.9995], method="inverted_cdf")
    width = (high - low) / 50
    assert np.diff(edges) == pytest.approx(np.full(edges.size - 1, width))
    assert low - width < edges[0] <= low < high <= edges[-1] < high + width


# Signal and noise

several = st.lists(st.integers(90, 130), min_size=2, max_size=8)
METRICS = {
    "snr": lambda a, b: snr(a),
    "snr in dB": lambda a, b: snr_20log10_db(a),
    "csnr": csnr,
    "cnr": cnr,
    "d'": d_prime,
}


@given(several)
def test_snr_is_mean_over_deviation(pixels):
    deviation = np.std(pixels, ddof=1)
    if deviation == 0:
        assert snr(pixels).value == inf
        return
    ratio = np.mean(pixels) / deviation
    for metric, expected in ((snr, ratio), (snr_20log10_db, 20 * log10(ratio)), (snr_10log10_db, 10 * log10(ratio))):
        assert metric(pixels).value == pytest.approx(expected)


@given(several, several)
def test_cnr_and_d_prime_are_their_formulas(a, b):
    bright, dark = (a, b) if sum(a) * len(b) >= sum(b) * len(a) else (b, a)
    difference = np.mean(bright) - np.mean(dark)
    pooled = sqrt((np.var(a, ddof=1) + np.var(b, ddof=1)) / 2)
    if np.std(dark) > 0:
        assert cnr(a, b).value == pytest.approx(difference / np.std(dark, ddof=1))
        assert d_prime(a, b).value == pytest.approx(difference / pooled, abs=1e-12)


def test_d_prime_of_shot_noise_is_the_published_one():
    quanta = np.arange(1000)
    patches = [Distribution(quanta, poisson.pmf(quanta, mean)) for mean in (250, 300)]
    assert d_prime(*patches).value == pytest.approx(3.015, abs=5e-4)
    assert snr(patches[0]).value == pytest.approx(sqrt(250))


@pytest.mark.parametrize("metric", METRICS)
def test_the_standard_error_is_the_scatter_of_repeated_measurements(metric):
    rng = np.random.default_rng(12)
    repeats, n = 800, 200
    # Skewed noise, so that the third and fourth moments matter.
    results = [
        METRICS[metric](120 + 5 * rng.exponential(size=n), 100 + 5 * rng.exponential(size=n)) for _ in range(repeats)
    ]
    scatter = np.std([result.value for result in results])
    stated = sqrt(np.mean([result.u**2 for result in results]))
    # 12 %: first order in 1 / n, with the moments of 200 pixels; the scatter itself is known to 3.5 %.
    assert stated == pytest.approx(scatter, rel=0.12)


@pytest.mark.parametrize(
    ("metric", "regions", "expected"),
    [
        *(("snr", [one], value) for one, value in (([7, 7], inf), ([0, 0], nan), ([7], nan))),
        *(("snr in dB", [one], value) for one, value in (([-1, 1], -inf), ([-5, -4], nan))),
        *(("csnr", two, value) for two, value in (([[7, 7], [5]], inf), ([[5, 5], [5]], nan), ([[7, 9], [5, 0]], nan))),
        *(("cnr", two, value) for two, value in (([[7, 9], [5, 5]], inf), ([[7, 9], [5]], nan))),
        *(("d'", two, value) for two, value in (([[7, 7], [5, 5]], inf), ([[7, 9]] * 2, 0))),
    ],
)
def test_without_scatter_or_light_the_values_say_so(metric, regions, expected):
    assert METRICS[metric](regions[0], regions[-1]).value == pytest.approx(expected, nan_ok=True)


@given(
    st.one_of(st.floats(1e-12, 1e12), st.sampled_from([0.1, 0.2, 5e-324, 1e-300, 1.7e308])),
    st.floats(0, 1),
    st.one_of(st.none(), st.floats(0, 5)),
)
def test_ends_of_intervals_are_those_of_exact_fractions_of_the_written_decimals(contrast, below, above):
    assume(below > 0 or above != 0)
    largest = Fraction(float_info.max) / 2
    k, low, high = (None if x is None else Fraction(Decimal(repr(x))) for x in (contrast, below, above))
    ends = k * (1 - low), None if high is None else k * (1 + high)
    interval = DetectionInterval(below, above)

    def nearest(end):
        return inf if end is None else float(min(end, largest))

    assert detected_contrasts(contrast, interval) == tuple(map(nearest, ends))
    assert detected_ratios(contrast, interval) == tuple(nearest(None if end is None else 1 + end) for end in ends)
    if contrast < 1:
        ratios = (None if end is None or end >= 1 else (1 + end) / (1 - end) for end in ends)
        assert detected_ratios(contrast, interval, "michelson") == tuple(map(nearest, ratios))
