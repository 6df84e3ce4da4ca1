from math import sqrt

import numpy as np
import pytest

from labcdp.calibration import DarkObservation
from labcdp.calibration.emva.quantities import fit_dark_current
from labcdp.calibration.emva.result import SeriesPoint
from labcdp.calibration.emva.transfer import find_saturation, linearity, system_gain
from labcdp.calibration.frames.statistics import Level
from labcdp.core.quantity import Quantity

from ..conftest import STATE

K, R, DARK_VARIANCE, PIXELS = 0.25, 0.1, 4.0, 5000
COVERED = 1.959963984540054
RUNS = 300
#: Four standard deviations of a share of 95 % in so many runs; a widened uncertainty covers a little more.
TOLERANCE = 4 * sqrt(0.95 * 0.05 / RUNS)


def level(mean_dn, variance_dn2):
    return Level(mean_dn, variance_dn2, PIXELS, (mean_dn, mean_dn))


def point(photons, net_dn, variance, dark_variance=DARK_VARIANCE):
    return SeriesPoint("", photons * 1e-6, photons, level(20 + net_dn, variance), level(20.0, dark_variance))


def drawn_points(rng, photons):
    """What images would give: means and variances drawn from their own distributions."""
    points = []
    for light in photons:
        variance = K * R * light + DARK_VARIANCE
        chi = rng.chisquare(PIXELS - 1, 2) / (PIXELS - 1)
        mean, dark = rng.normal(0, np.sqrt(np.array([variance, DARK_VARIANCE]) / (2 * PIXELS)))
        points.append(point(light, R * light + mean - dark, variance * chi[0], DARK_VARIANCE * chi[1]))
    return points


def drawn_dark(rng, exposure_s, mean_dn, variance, drift_dn=0.0):
    """A pair of dark frames whose black level drifts from one to the next."""
    means = mean_dn + rng.normal(0, sqrt(variance / PIXELS + drift_dn**2), 2)
    return DarkObservation(
        exposure_s=exposure_s,
        mean_dn=means.mean(),
        frame_means_dn=tuple(means),
        n_pixels=PIXELS,
        temporal_variance_dn2=variance * rng.chisquare(PIXELS - 1) / (PIXELS - 1),
        nonuniformity_dn=0.0,
        state=STATE,
    )


@pytest.mark.parametrize("weighted", [False, True])
def test_k_is_covered_by_its_uncertainty(weighted):
    rng = np.random.default_rng(11)
    photons = np.geomspace(100, 20_000, 12) if weighted else np.linspace(500, 20_000, 12)
    hits, values = 0, []
    for _ in range(RUNS):
        fit = system_gain(drawn_points(rng, photons), weighted)
        hits += abs(fit.value - K) <= COVERED * fit.u
        values.append(fit.value)
    assert hits / RUNS == pytest.approx(0.955, abs=TOLERANCE)
    assert np.mean(values) == pytest.approx(K, abs=4 * np.std(values) / sqrt(RUNS))


@pytest.mark.parametrize("drift_dn", [0.0, 0.1])
def test_dark_current_is_covered_by_its_uncertainty(drift_dn):
    """With a black level that drifts by 0.1 DN, ten times as far as noise moves a mean."""
    rng = np.random.default_rng(13)
    exposures, rate, gain = np.linspace(0.01, 1.0, 8), 40.0, Quantity(K, 0.0, "DN/e-")
    hits = by_variance = 0
    for _ in range(RUNS):
        darks = [drawn_dark(rng, t, 20 + K * rate * t, DARK_VARIANCE + K**2 * rate * t, drift_dn) for t in exposures]
        found = fit_dark_current(darks).quantities(gain)
        current, noisy = found["dark_current_e_s"], found["dark_current_by_variance_e_s"]
        hits += abs(current.value - rate) <= COVERED * current.u
        by_variance += abs(noisy.value - rate) <= COVERED * noisy.u
    assert hits / RUNS == pytest.approx(0.955, abs=TOLERANCE)
    assert by_variance / RUNS == pytest.approx(0.955, abs=TOLERANCE)


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
    expected = [deviation.min(), deviation.max(), np.abs(deviation).mean()]
    assert [one.value for one in found.errors().values()] == pytest.approx(expected, abs=1e-12)


def test_saturation_is_the_peak_of_the_variance_above_dark_and_known_as_well_as_it_is_flat():
    photons = np.linspace(1000, 20_000, 20)
    rising = K * R * photons
    flat = np.minimum(rising, rising[14]) - np.where(photons > 18_000, 100.0, 0.0)
    dark = np.where(photons == photons[9], 40.0, 4.0)  # one exposure with a noisy dark signal
    found = find_saturation([point(p, R * p, v + d, d) for p, v, d in zip(photons, flat, dark, strict=True)])
    assert (14 <= found.index <= 17, found.limit) == (True, "full well")
    # From half a step below the first of the four alike to half a step above the last; noise may add a point below.
    uncertainty_rel = found.net_uncertainty_dn / found.net_dn
    assert uncertainty_rel * photons[found.index] == pytest.approx(2000 / sqrt(3), rel=0.26)
