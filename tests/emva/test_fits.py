from math import sqrt

import numpy as np
import pytest

from labcdp.calibration.emva import DarkPoint, Quantity, SeriesPoint
from labcdp.calibration.emva.dark_current import doubling_temperature, fit_darkness
from labcdp.calibration.emva.fits import line, slope_through_origin
from labcdp.calibration.emva.linearity import linearity
from labcdp.calibration.emva.photon_transfer import points_to_fit, responsivity, system_gain
from labcdp.calibration.emva.saturation import find_saturation
from labcdp.calibration.emva.snr import sensitivity_threshold_e, snr
from labcdp.errors import CalibrationError

K, R, DARK_VARIANCE, PIXELS = 0.25, 0.1, 4.0, 5000
COVERED = 1.959963984540054
RUNS = 600
#: Four standard deviations of a share of 95 % in so many runs; a widened uncertainty covers a little more.
TOLERANCE = 4 * sqrt(0.95 * 0.05 / RUNS)


def point(photons, net_dn, variance, **others):
    values = {
        "label": "",
        "exposure_s": photons * 1e-6,
        "photons": photons,
        "mean_dn": 20 + net_dn,
        "variance_dn2": variance,
        "dark_mean_dn": 20.0,
        "dark_variance_dn2": DARK_VARIANCE,
        "n_pixels": PIXELS,
        "n_frames": 2,
        "dark_n_pixels": PIXELS,
        "dark_n_frames": 2,
        "saturated_share": 0.0,
        "dark_black_share": 0.0,
    }
    return SeriesPoint(**values | others)


def drawn_points(rng, photons):
    """What images would give: means and variances drawn from their own distributions."""
    points = []
    for light in photons:
        variance = K * R * light + DARK_VARIANCE
        chi = rng.chisquare(PIXELS - 1, 2) / (PIXELS - 1)
        mean, dark = rng.normal(0, np.sqrt(np.array([variance, DARK_VARIANCE]) / (2 * PIXELS)))
        points.append(
            point(
                light,
                R * light + mean - dark,
                variance * chi[0],
                dark_variance_dn2=DARK_VARIANCE * chi[1],
            )
        )
    return points


@pytest.mark.parametrize("weighted", [False, True])
def test_k_is_covered_by_its_uncertainty(weighted):
    rng = np.random.default_rng(11)
    photons = np.geomspace(100, 20_000, 12) if weighted else np.linspace(500, 20_000, 12)
    hits, values = 0, []
    for _ in range(RUNS):
        fit = system_gain(drawn_points(rng, photons), weighted)
        hits += abs(fit.value - K) <= COVERED * fit.standard_uncertainty
        values.append(fit.value)
    assert hits / RUNS == pytest.approx(0.955, abs=TOLERANCE)
    assert np.mean(values) == pytest.approx(K, abs=4 * np.std(values) / sqrt(RUNS))


def test_r_is_covered_by_its_uncertainty():
    rng = np.random.default_rng(12)
    hits = 0
    for _ in range(RUNS):
        fit = responsivity(drawn_points(rng, np.linspace(500, 20_000, 12)))
        hits += abs(fit.value - R) <= COVERED * fit.standard_uncertainty
    assert hits / RUNS == pytest.approx(0.955, abs=TOLERANCE)


def test_dark_current_is_covered_by_its_uncertainty():
    rng = np.random.default_rng(13)
    exposures, rate, gain = np.linspace(0.01, 1.0, 8), 40.0, Quantity(K, 0.0, "DN/e-")
    hits = by_variance = 0
    for _ in range(RUNS):
        points = []
        for t in exposures:
            variance = DARK_VARIANCE + K**2 * rate * t
            mean = 20 + K * rate * t + rng.normal(0, sqrt(variance / (2 * PIXELS)))
            points.append(
                DarkPoint(t, mean, variance * rng.chisquare(PIXELS - 1) / (PIXELS - 1), n_pixels=PIXELS, n_frames=2)
            )
        darkness = fit_darkness(points)
        current, noisy = darkness.current_e_s(gain), darkness.current_by_variance_e_s(gain)
        hits += abs(current.value - rate) <= COVERED * current.standard_uncertainty
        by_variance += abs(noisy.value - rate) <= COVERED * noisy.standard_uncertainty
    assert hits / RUNS == pytest.approx(0.955, abs=TOLERANCE)
    assert by_variance / RUNS == pytest.approx(0.955, abs=TOLERANCE)


def test_through_the_origin_without_weights_is_the_closed_form():
    x, y, u = np.array([1.0, 2.0, 4.0]), np.array([2.1, 3.9, 8.2]), np.array([1.0, 1.0, 1.0])
    fit = slope_through_origin(x, y, u)
    assert fit.value == pytest.approx((2.1 + 7.8 + 32.8) / 21)
    assert fit.standard_uncertainty == pytest.approx(1 / sqrt(21))


def test_points_that_scatter_more_widen_the_uncertainty():
    x, u = np.linspace(1, 10, 10), np.full(10, 0.01)
    y = 2 * x + np.array([1.0, -1.0] * 5)
    fit = slope_through_origin(x, y, u)
    assert fit.standard_uncertainty == pytest.approx(sqrt(np.sum((y - fit.value * x) ** 2) / 9 / np.sum(x**2)))


def test_line_is_numpys_polyfit():
    rng = np.random.default_rng(14)
    x, u = np.linspace(0.01, 5, 9), np.linspace(0.1, 0.5, 9)
    y = 3 + 0.5 * x + u * rng.standard_normal(9)
    fit = line(x, y, u)
    (slope, intercept), covariance = np.polyfit(x, y, 1, w=1 / u, cov="unscaled")
    assert (fit.slope, fit.intercept) == (pytest.approx(slope), pytest.approx(intercept))
    ratio = max(1.0, np.sum(((y - intercept - slope * x) / u) ** 2) / 7)
    assert np.allclose(fit.covariance, ratio * covariance[::-1, ::-1])


def test_saturation_is_where_the_variance_is_largest():
    photons = np.linspace(1000, 20_000, 20)
    points = [point(p, R * p, K * R * p + 4) for p in photons[:15]]
    clipped = [point(p, 1500, 0.0, saturated_share=1.0) for p in photons[15:]]
    assert find_saturation([*points, *clipped]).index == 14
    assert find_saturation([*points, *clipped]).limit == "converter"
    full = [point(p, 1500, 5.0) for p in photons[15:]]
    assert find_saturation([*points, *full]).limit == "full well"
    assert find_saturation(points).limit == "not reached"
    # A dip within chance is no peak.
    dip = point(photons[15], 1500, points[-1].variance_dn2 * (1 - 2 * sqrt(2 / PIXELS)))
    assert find_saturation([*points, dip]).limit == "not reached"


def test_linearity_is_that_of_the_standards_closed_form():
    rng = np.random.default_rng(15)
    photons = np.linspace(1000, 20_000, 20)
    y = 5 + R * photons * (1 + 0.01 * rng.standard_normal(20))
    found = linearity([point(p, v, 10.0) for p, v in zip(photons, y, strict=True)], saturation_net_dn=2200.0)
    inside = (y >= 0.05 * 2200) & (y <= 0.95 * 2200)
    slope, intercept = np.polyfit(photons[inside], y[inside], 1, w=1 / y[inside])
    deviation = y[inside] / (intercept + slope * photons[inside]) - 1
    assert found.intercept_dn == pytest.approx(intercept, rel=1e-6)
    assert found.slope_dn == pytest.approx(slope, rel=1e-9)
    assert found.lowest().value == pytest.approx(deviation.min(), abs=1e-12)
    assert found.highest().value == pytest.approx(deviation.max(), abs=1e-12)
    assert found.mean_absolute().value == pytest.approx(np.abs(deviation).mean(), abs=1e-12)


def test_doubling_temperature_is_found_and_covered():
    rng = np.random.default_rng(16)
    hits, runs = 0, 100
    for _ in range(runs):
        points = [
            DarkPoint(t, rng.normal(64 + 30 * t * 2 ** ((c - 30) / 8.0), sqrt(9 / 10_000)), 9.0, 5000, 2, c)
            for t in (0.01, 0.1, 0.4)
            for c in (20.0, 30.0, 40.0)
        ]
        found = doubling_temperature(points)
        hits += abs(found.value - 8.0) <= COVERED * found.standard_uncertainty
    assert hits / runs == pytest.approx(0.955, abs=4 * sqrt(0.95 * 0.05 / runs))


def test_doubling_temperature_needs_a_spread_of_temperatures():
    points = [DarkPoint(t, 64 + 30 * t, 9.0, 5000, 2, c) for t in (0.01, 0.4) for c in (30.0, 31.0, 34.0)]
    assert doubling_temperature(points) is None
    warm = [DarkPoint(p.exposure_s, p.mean_dn, 9.0, 5000, 2, None) for p in points]
    assert doubling_temperature(warm) is None


def test_noise_that_does_not_grow_is_refused():
    points = [point(p, R * p, 4.0 - 1e-4 * p) for p in np.linspace(1000, 10_000, 8)]
    with pytest.raises(CalibrationError, match=r"noise does not grow with the signal \(K is -0\.00"):
        system_gain(points)


def test_too_few_points_are_refused():
    points = [point(p, R * p, 10.0) for p in (5000, 9000, 10_000)]
    with pytest.raises(CalibrationError, match=r"1 of 3 points lie between darkness and 70% of saturation: record at"):
        points_to_fit(points, 1000.0)


def test_snr_is_one_at_the_threshold():
    k, dark_dn = Quantity(K, 0.0, "DN/e-"), 2.0
    threshold = sensitivity_threshold_e(Quantity(dark_dn, 0.0, "DN"), k)
    dark_e = sqrt(dark_dn**2 - 1 / 12) / K
    # The standard's threshold leaves out (1/2)^2 beside the variance of darkness.
    assert snr(np.array([threshold.value]), dark_e, K)[0] == pytest.approx(1.0, abs=0.25 / 2 / 8**2 * 2)
    bright = np.array([1e6])
    assert snr(bright, 0.0, K)[0] == pytest.approx(1e3, rel=1e-5)
    assert snr(bright, 0.0, K, prnu=0.01)[0] == pytest.approx(100, rel=0.01)
