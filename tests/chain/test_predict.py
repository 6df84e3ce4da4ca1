"""Exact predictions against closed forms, sums over all outcomes, convolutions and simulations; their memory.

First of all the distribution of DN, against sums over electron counts, integrals over pixels, and exposures.
"""

import subprocess
import sys
from dataclasses import replace
from math import exp, gamma, inf, log, sqrt

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import fftconvolve
from scipy.special import ndtr
from scipy.stats import norm, poisson

from labcdp import Chain
from labcdp.chain import ExposureSettings, Hdr, Sensor
from labcdp.chain.hdr import CaptureLadder, merge_dn
from labcdp.chain.predict.camera import CameraModel
from labcdp.chain.predict.prediction import PatchRates, predict
from labcdp.chain.predict.value_bins import ValueBins
from labcdp.chain.predict.value_table import value_table
from labcdp.core.errors import PredictionError
from labcdp.metrics import Distribution, cdp

IDEAL = {"read_noise_e": 0.0, "dark_current_e_s": 0.0, "k_dn_per_e": 1.0, "quantum_efficiency": 0.5}
QUIET = Sensor(pixel_pitch_m=3e-6, width=100, height=100, full_well_e=50_000, bits=16, **IDEAL)
USUAL = replace(QUIET, full_well_e=7000, k_dn_per_e=0.6, read_noise_e=5.0, bits=12, black_level_dn=64.0)


def test_contrast_and_signal_to_noise_of_shot_noise():
    counts = np.arange(1, 2000)
    dark = poisson.pmf(counts, 60.0)
    inverse, inverse_2 = (dark / counts).sum() / dark.sum(), (dark / counts**2).sum() / dark.sum()
    mean = 90 * inverse - 1
    variance = (90**2 + 90) * inverse_2 - (90 * inverse) ** 2
    prediction = predict(CameraModel(QUIET, ExposureSettings((1.0,))), PatchRates(60.0, 90.0), 0.5)
    assert float(prediction.mean_contrast) == pytest.approx(mean, rel=1e-7)
    assert (float(prediction.snr_dark), float(prediction.snr_bright)) == pytest.approx((sqrt(60), sqrt(90)), rel=1e-6)
    assert float(prediction.csnr) == pytest.approx(mean / sqrt(variance), rel=1e-6)
    # Where all pixels are saturated, no contrast is left, and its noise is rounding.
    for bits in (8, 10, 12):
        camera = CameraModel(replace(USUAL, bits=bits), ExposureSettings((1.0,)))
        prediction = predict(camera, PatchRates(np.geomspace(1e5, 1e8, 9), np.geomspace(2e5, 2e8, 9)), 1.0)
        assert (prediction.mean_contrast == 0).all()
        assert np.isnan(prediction.csnr).all()


def of(sensor, rate, temperature_c=25.0, gain_db=0.0):
    """Probability of each DN of the pixels of a uniform patch."""
    table = value_table(CameraModel(sensor, ExposureSettings((1.0,), gain_db, temperature_c)), np.array([rate]))
    ((_, first, share, _),) = table.blocks(np.array([rate]))
    return np.pad(share[0], (first, 2**sensor.bits - first - share.shape[1]))


def test_without_noise_dn_are_poisson_counts(sensor):
    for rate in (0.0, 0.02, 3.0, 40.0, 1000.0, 30_000.0):
        for one in (sensor, replace(sensor, dark_current_e_s=1e-14, dsnu_e_s=0.1)):
            np.testing.assert_allclose(np.cumsum(of(one, rate)), poisson.cdf(np.arange(65536), rate), atol=1e-7)


@pytest.mark.parametrize(("prnu_rel", "mean_e"), [(0.005, 2000.0), (0.02, 5000.0), (0.08, 9000.0)])
def test_gains_of_pixels(sensor, prnu_rel, mean_e):
    device = replace(sensor, prnu_rel=prnu_rel, bits=14)
    for dn in (int(mean_e * (1 - 1.5 * prnu_rel)), int(mean_e), int(mean_e * (1 + prnu_rel))):
        expected = norm.expect(lambda z, dn=dn: poisson.cdf(dn, mean_e * (1 + prnu_rel * z)), lb=-8, ub=8, limit=400)
        assert np.cumsum(of(device, mean_e))[dn] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("dsnu_e_s", [40.0, 300.0, 900.0])
def test_dark_currents_of_pixels(sensor, dsnu_e_s):
    device = replace(sensor, dark_current_e_s=400.0, dsnu_e_s=dsnu_e_s, bits=14)
    order = (400 / dsnu_e_s) ** 2
    for dn in (110, 310, 450, 700):
        # In the logarithm of the dark current, where its gamma density is smooth.
        of_pixels = lambda y, dn=dn: poisson.cdf(dn, 100 + 400 * exp(y)) * exp(order * (log(order) + y - exp(y)))  # noqa: E731
        expected = quad(of_pixels, -14 / min(order, 1) - 3, 4, epsabs=1e-11, limit=400)[0] / gamma(order)
        assert np.cumsum(of(device, 100.0))[dn] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"prnu_rel": 0.03, "dsnu_e": 6.0, "dark_current_e_s": 300.0, "dsnu_e_s": 200.0},
        {"k_dn_per_e": 0.02, "bits": 6, "dsnu_e": 30.0},
    ],
)
@pytest.mark.parametrize("mean_e", [0.0, 60.0, 2500.0])
def test_simulated_exposures_are_distributed_so(sensor, changes, mean_e):
    device = replace(sensor, k_dn_per_e=0.3, read_noise_e=8.0, bits=11, black_level_dn=5.0, full_well_e=6000)
    device = replace(device, width=600, height=500, device_seed=7, **changes)
    dn = device.expose(mean_e, 1.0, temperature_c=25.0, seed=3, exposure_index=0)
    expected = of(device, mean_e) * dn.size
    counts = np.bincount(dn.ravel(), minlength=expected.size)
    usual = expected > 20
    dof = usual.sum() - 1
    chi2 = ((counts - expected) ** 2)[usual] / expected[usual]
    assert (chi2.sum() - dof) / sqrt(2 * dof) < 4


def temporal(sensor, mean_e, offset_e=0.0):
    """Probability of each DN of one pixel, by all electron counts."""
    counts = np.arange(int(mean_e + 12 * sqrt(mean_e) + 40))
    share = poisson.pmf(counts, mean_e)
    electrons = np.minimum(counts, sensor.full_well_e) + offset_e
    top = 2**sensor.bits
    edges = (np.arange(top + 1) - 0.5 - sensor.black_level_dn) / sensor.k_dn_per_e
    edges[[0, -1]] = -inf, inf
    below = share @ ndtr((edges - electrons[:, None]) / sensor.read_noise_e)
    return np.maximum(np.diff(below), 0)


def merged_by_hand(camera, rate_e_s):
    """Distribution of the merged value by all combinations of DN, pixel offset by pixel offset."""
    assert camera.hdr is not None
    sensor = camera.sensor
    top_dn = sensor.saturation_dn() - sensor.black_level_dn
    ladder = CaptureLadder.of_exposures(camera.exposures_s, top_dn, sensor.k_dn_per_e)
    net_dn = np.arange(2.0**sensor.bits) - sensor.black_level_dn
    grids = np.meshgrid(*[net_dn] * len(ladder), indexing="ij")
    values = merge_dn(camera.hdr.method, camera.hdr.bits, grids, ladder).ravel()
    nodes, weights = np.polynomial.hermite_e.hermegauss(1 if sensor.dsnu_e == 0 else 60)
    total = np.zeros(values.size)
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        joint = np.ones(1)
        for exposure_s in camera.exposures_s:
            joint = np.multiply.outer(joint, temporal(sensor, rate_e_s * exposure_s, node * sensor.dsnu_e))
        total += weight * joint.ravel()
    distinct, place = np.unique(np.round(values, 9), return_inverse=True)
    return Distribution(distinct, np.bincount(place, total))


def pairs_by_hand(dark, bright, zero, low, high):
    """Shares inside, below and above, every pair visited."""
    inside = below = above = 0.0
    for x, p in zip(dark.values - zero, dark.weights, strict=True):
        y, share = bright.values - zero, bright.weights * p
        if x > 0:
            is_below, is_above = y < (1 + low) * x * (1 - 1e-7), y > (1 + high) * x * (1 + 1e-7)
        else:
            is_below, is_above = y <= 1e-8, y > 1e-8
        below += share[is_below].sum()
        above += share[is_above].sum()
        inside += share[~is_below & ~is_above].sum()
    return inside, below, above


TINY = replace(QUIET, bits=3, full_well_e=30.0, k_dn_per_e=0.25, read_noise_e=0.6, black_level_dn=1.0)


@pytest.mark.parametrize("dsnu_e", [0.0, 0.5])
@pytest.mark.parametrize("method", ["single", "normal", "linear", "weighted"])
def test_values_of_a_tiny_sensor_by_hand(method, dsnu_e):
    times, hdr = ((1.0,), Hdr("linear")) if method == "single" else ((1.0, 0.5, 0.125), Hdr(method, bits=7))
    merged = CameraModel(replace(TINY, dsnu_e=dsnu_e), ExposureSettings(times), hdr)
    camera = replace(merged, hdr=None) if method == "single" else merged
    contrast = 0.8
    rates = np.array([0.0, 1.5, 5.0, 8.0, 25.0, 60.0])
    veil = np.array([0.0, 0.0, 1.3, 0.0, 4.1, 0.0])
    prediction = predict(camera, PatchRates(rates + veil, rates * (1 + contrast) + veil, veil), contrast)
    for i, (rate, haze) in enumerate(zip(rates, veil, strict=True)):
        dark, bright = (merged_by_hand(merged, one + haze) for one in (rate, rate * (1 + contrast)))
        expected = pairs_by_hand(dark, bright, 0.25 * haze, 0.5 * contrast, 1.5 * contrast)
        assert (prediction.cdp[i], prediction.below[i], prediction.above[i]) == pytest.approx(expected, abs=2e-6)


def test_a_fading_exposure_that_is_clipped_in_some_pixels_by_all_combinations():
    """Of the bright patch many pixels share values, which the bins of the dark one do not tell apart."""
    sensor = replace(USUAL, full_well_e=320.0, k_dn_per_e=1.7, read_noise_e=10.0, bits=10)
    # Of nearly equal exposures the longer one may be unclipped where the shorter one is clipped.
    cases = ((0.5625e-3, 62e3, 2e-4), (0.5625e-3, 67.5e3, 2e-4), (2.9e-3, 62e3, 1e-3), (2.5e-3, 75e3, 1e-3))
    for shorter_s, rate, error in cases:
        camera = CameraModel(sensor, ExposureSettings((3e-3, shorter_s)), Hdr("weighted"))
        shown = [merged_by_hand(camera, light + 0.1 * rate) for light in (rate, 1.48 * rate)]
        dark, bright = (Distribution(one.values - 1.7 * 3e-4 * rate, one.weights) for one in shown)
        expected = cdp(bright, dark, 0.48)
        found = predict(camera, PatchRates(1.1 * rate, 1.58 * rate, 0.1 * rate), 0.48)
        assert (found.cdp, found.below) == pytest.approx((expected.cdp, expected.below), abs=error)


# The second one has 1.7 million values, nearly those of (1, 3, 16): too many to be tabulated, but not without lumps.
LADDERS = ((16e-3, 4e-3, 1e-3), (1, 4, 16)), ((16e-3, 5.33e-3, 1e-3), (533, 1600, 8528))


@pytest.mark.parametrize(("exposures_s", "steps"), LADDERS)
def test_linear_merge_of_twelve_bits_by_convolution(exposures_s, steps):
    camera = CameraModel(USUAL, ExposureSettings(exposures_s), Hdr("linear"))
    rate, zero = 2e4, 0.6 * 16e-3 * 0.3 * 2e4

    def values(mean):
        share = np.ones(1)
        for exposure_s, step in zip(exposures_s, steps, strict=True):
            one = temporal(USUAL, mean * exposure_s)[:600]
            spaced = np.zeros((one.size - 1) * step + 1)
            spaced[::step] = one
            share = fftconvolve(share, spaced) if step > 16 else np.convolve(share, spaced)
        occurs = np.flatnonzero(share > 1e-14)
        return Distribution((occurs - 64 * sum(steps)) / (3 * steps[0]) - zero, share[occurs])

    expected = cdp(values(1.3 * rate), values(1.7 * rate), 0.4)
    prediction = predict(camera, PatchRates(1.3 * rate, 1.7 * rate, 0.3 * rate), 0.4)
    assert (prediction.cdp, prediction.below) == pytest.approx((expected.cdp, expected.below), abs=2e-4)


# In a process of its own: what the other tests have used does not count.
PROGRAM = """
import re
from pathlib import Path
from labcdp.chain import Chain
chain = Chain.load("manta-g505")
run = chain.run(seed=0)
height, width = chain.scene.shape
# Unlike what getrusage tells, it does not begin with the peak of the process that started this one.
peak_mb = int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024
print(peak_mb, len(run), 4e-6 * height * width)
"""


def test_peak_memory_of_a_full_frame():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=600, check=True)
    peak_mb, stages, frame_mb = map(float, done.stdout.split())
    assert peak_mb < 2 * frame_mb * stages + 300


def test_a_merge_of_many_values_has_bins_that_fit_in_memory():
    """Its values are 134 and 51 parts of 4556 apart: 9 million, one of which took 1 GB for 16 pixels."""
    chain = Chain.load("manta-g505")
    settings = replace(chain.settings, exposure_s=(1e-4, 2.66e-4, 2.66e-2))
    sensor = replace(chain.camera().sensor, read_noise_e=10.0, dsnu_e=0.0, column_dsnu_e=0.0, row_dsnu_e=0.0)
    camera = CameraModel(sensor, settings, Hdr("weighted", 24))
    found = ValueBins.for_merge(camera)
    assert found.values.size < 500_000
    assert (np.diff(found.edges) > 0).all()
    assert found.values[found.exact][0] == 0
    camera = replace(camera, settings=replace(settings, exposure_s=(0.01, 0.003, 0.001, 3e-4, 1e-4, 3e-5)))
    assert ValueBins.for_merge(camera).values.size < 500_000
    with pytest.raises(PredictionError, match="too many values of the merge"):
        ValueBins.for_merge(replace(camera, sensor=replace(sensor, read_noise_e=0.0)))
