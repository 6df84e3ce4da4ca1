"""Exact predictions against closed forms, sums over all outcomes, convolutions and simulations."""

from dataclasses import replace
from itertools import product
from math import inf, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import fftconvolve
from scipy.special import ndtr
from scipy.stats import poisson

from labcdp.chain import Context, ExposureSettings, Hdr, Sensor, Signal, ToneCurve
from labcdp.chain.hdr import ExposureLadder, Method, merge_dn
from labcdp.chain.predict.camera import CameraModel
from labcdp.chain.predict.prediction import PatchRates, predict
from labcdp.metrics import Distribution, cdp

FloatArray = NDArray[np.float64]

IDEAL = {"read_noise_e": 0.0, "dark_current_e_s": 0.0, "k_dn_per_e": 1.0, "quantum_efficiency": 0.5}
QUIET = Sensor(pixel_pitch_m=3e-6, width=100, height=100, full_well_e=50_000, bits=16, **IDEAL)  # type: ignore[arg-type]
USUAL = replace(QUIET, full_well_e=7000, k_dn_per_e=0.6, read_noise_e=5.0, bits=12, black_level_dn=64.0)
COARSE = replace(USUAL, full_well_e=9000, k_dn_per_e=0.02, bits=8, black_level_dn=10.0)


def single(sensor: Sensor) -> CameraModel:
    return CameraModel(sensor, ExposureSettings((1.0,)))


def test_shot_noise_alone() -> None:
    # 250 against 300 quanta, contrasts of 0.1 to 0.3: reference value of exact Poisson sums.
    prediction = predict(single(QUIET), PatchRates(250.0, 300.0), 0.2)
    assert float(prediction.cdp) == pytest.approx(0.6706, abs=5e-5)
    assert float(prediction.snr_dark) == pytest.approx(sqrt(250), rel=1e-6)
    assert float(prediction.snr_bright) == pytest.approx(sqrt(300), rel=1e-6)


def test_contrast_moments_of_shot_noise() -> None:
    counts = np.arange(1, 2000)
    dark = poisson.pmf(counts, 60.0)
    inverse, inverse_2 = (dark / counts).sum() / dark.sum(), (dark / counts**2).sum() / dark.sum()
    mean = 90 * inverse - 1
    variance = (90**2 + 90) * inverse_2 - (90 * inverse) ** 2
    prediction = predict(single(QUIET), PatchRates(60.0, 90.0), 0.5)
    assert float(prediction.mean_contrast) == pytest.approx(mean, rel=1e-7)
    assert float(prediction.csnr) == pytest.approx(mean / sqrt(variance), rel=1e-6)


def temporal(sensor: Sensor, mean_e: float, offset_e: float = 0.0) -> FloatArray:
    """Probability of each DN of one pixel, by all electron counts."""
    counts = np.arange(int(mean_e + 12 * sqrt(mean_e) + 40))
    share = poisson.pmf(counts, mean_e)
    electrons = np.minimum(counts, sensor.full_well_e) + offset_e
    top = 2**sensor.bits
    edges = (np.arange(top + 1) - 0.5 - sensor.black_level_dn) / sensor.k_dn_per_e
    edges[[0, -1]] = -inf, inf
    below = share @ ndtr((edges - electrons[:, None]) / sensor.read_noise_e)
    return np.maximum(np.diff(below), 0)


def merged_by_hand(camera: CameraModel, rate_e_s: float) -> Distribution:
    """Distribution of the merged value by all combinations of DN, pixel offset by pixel offset."""
    assert camera.hdr is not None
    sensor = camera.sensor
    ladder = ExposureLadder(camera.exposures_s, sensor.saturation_dn() - sensor.black_level_dn, sensor.k_dn_per_e)
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


def pairs_by_hand(
    dark: Distribution, bright: Distribution, zero: float, low: float, high: float
) -> tuple[float, float, float]:
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
def test_values_of_a_tiny_sensor_by_hand(method: str, dsnu_e: float) -> None:
    times, hdr = ((1.0,), Hdr("linear")) if method == "single" else ((1.0, 0.5, 0.125), Hdr(method, bits=7))  # type: ignore[arg-type]
    merged = CameraModel(replace(TINY, dsnu_e=dsnu_e), ExposureSettings(times), hdr)
    camera = replace(merged, hdr=None) if method == "single" else merged
    contrast = 0.8
    rates = np.array([0.0, 1.5, 5.0, 8.0, 25.0, 60.0])
    veil = np.array([0.0, 0.0, 1.3, 0.0, 4.1, 0.0])
    prediction = predict(camera, PatchRates(rates + veil, rates * (1 + contrast) + veil, veil), contrast)
    for i, (rate, haze) in enumerate(zip(rates, veil, strict=True)):
        dark, bright = (merged_by_hand(merged, one + haze) for one in (rate, rate * (1 + contrast)))
        expected = pairs_by_hand(dark, bright, 0.25 * haze, 0.5 * contrast, 1.5 * contrast)
        # Where an exposure fades, values are binned, which a sensor of eight DN feels.
        tolerance = 0.006 if method == "weighted" and rate > 2 else 2e-6
        assert (prediction.cdp[i], prediction.below[i], prediction.above[i]) == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(
    ("exposures_s", "steps", "tolerance"),
    [
        ((16e-3, 4e-3, 1e-3), (1, 4, 16), 1e-8),
        # 1.7 million values, which are nearly those of (1, 3, 16): too many to be tabulated, but not without lumps.
        ((16e-3, 5.33e-3, 1e-3), (533, 1600, 8528), 2e-4),
    ],
)
def test_linear_merge_of_twelve_bits_by_convolution(
    exposures_s: tuple[float, ...], steps: tuple[int, ...], tolerance: float
) -> None:
    camera = CameraModel(USUAL, ExposureSettings(exposures_s), Hdr("linear"))
    rate, zero = 2e4, 0.6 * 16e-3 * 0.3 * 2e4

    def values(mean: float) -> Distribution:
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
    assert float(prediction.cdp) == pytest.approx(expected.cdp, abs=tolerance)
    assert float(prediction.below) == pytest.approx(expected.below, abs=tolerance)


def simulated(camera: CameraModel, rate_e_s: float, seed: int) -> FloatArray:
    """Values of a patch of the camera's sensor, as a device of its own."""
    sensor, settings = replace(camera.sensor, device_seed=seed), camera.settings
    lux = Signal(np.full(sensor.shape, rate_e_s / sensor.electrons_per_lx_s("D65")), "illuminance", lambda lx: lx)
    context = Context("D65", seed, settings=settings)
    captures = [sensor.capture(lux, context, index) for index in range(len(settings.exposure_s))]
    dn = captures[0].dn if camera.hdr is None else camera.hdr.merge(captures).dn
    if camera.tone_curve is not None:
        dn = camera.tone_curve.decode(camera.tone_curve.encode(dn))
    return dn.astype(np.float64)


SENSORS = {
    "temporal noise alone": USUAL,
    "fixed pattern": replace(USUAL, prnu_rel=0.02, dsnu_e=3.0, dark_current_e_s=50.0, dsnu_e_s=30.0),
    "coarse steps": COARSE,
    "coarse steps, fixed pattern": replace(COARSE, prnu_rel=0.01, dsnu_e=8.0),
    "hot": replace(USUAL, dark_current_e_s=20_000.0, dsnu_e_s=8000.0, prnu_rel=0.01),
    "small well": replace(USUAL, full_well_e=2000, prnu_rel=0.01),
}
BRACKET = (16e-3, 4e-3, 1e-3)
CAMERAS = {
    "single": (BRACKET[:1], None, None),
    "normal": (BRACKET, Hdr("normal"), None),
    "linear": (BRACKET, Hdr("linear"), None),
    "weighted": (BRACKET, Hdr("weighted"), None),
    "weighted, tone curve": (BRACKET, Hdr("weighted"), ToneCurve()),
}


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.long)])
def test_simulation_agrees(step: int) -> None:
    """Of all sensors with all cameras every fourth, by which each of them is met."""
    contrast = 0.25
    rates = np.array([500.0, 4e3, 3e4, 2.6e5, 3.6e5, 1.2e6])
    veil = 0.3 * rates
    scores = []
    for number, (sensor, made) in list(enumerate(product(SENSORS.values(), CAMERAS.values())))[::step]:
        exposures_s, hdr, tone_curve = made
        if tone_curve is not None and sensor.bits == 8:
            continue
        camera = CameraModel(sensor, ExposureSettings(exposures_s), hdr, tone_curve)
        prediction = predict(camera, PatchRates(rates + veil, rates * (1 + contrast) + veil, veil), contrast)
        for i in range(rates.size):
            # Saturated patches have equal means, of which either may come out larger.
            if not 0.02 < prediction.cdp[i] < 0.98 or prediction.saturated_share[i] > 0.5:
                continue
            seed = 20_000 + 1000 * number + 2 * i
            dark = simulated(camera, float(rates[i] + veil[i]), seed)
            bright = simulated(camera, float(rates[i] * (1 + contrast) + veil[i]), seed + 1)
            zero = camera.dark_dn + camera.dn_per_e_s * float(veil[i])
            result = cdp(bright - zero, dark - zero, contrast)
            scores.append((result.cdp - float(prediction.cdp[i])) / result.u)
    assert len(scores) > 80 / step
    assert max(np.abs(scores)) < 4
    assert sqrt(np.mean(np.square(scores))) == pytest.approx(1, abs=4 / sqrt(2 * len(scores)))


@pytest.mark.parametrize(
    ("method", "exposures_s", "fill", "contrast"),
    [("linear", (0.014, 0.01), 0.8, 0.3), ("weighted", (0.014, 0.01), 0.8, 0.3), ("weighted", (0.02, 0.01), 0.3, 0.2)],
)
def test_single_electrons_that_show_in_the_dn(
    method: Method, exposures_s: tuple[float, float], fill: float, contrast: float
) -> None:
    # Five DN to an electron and no read noise: only every fifth DN occurs, and ties on the interval's ends count.
    sensor = replace(QUIET, full_well_e=10_000, k_dn_per_e=5.0, bits=12)
    camera = CameraModel(sensor, ExposureSettings(exposures_s), Hdr(method))
    dark_e_s = fill * 819 / exposures_s[0]

    def summed(rate_e_s: float) -> Distribution:
        electrons = np.arange(1200)
        shares = [poisson.pmf(electrons, rate_e_s * time) for time in exposures_s]
        dn = np.minimum(5 * electrons, 4095)
        values = merge_dn(method, 20, [dn[:, None], dn[None, :]], camera.ladder)
        distinct, place = np.unique(values, return_inverse=True)
        weights = np.bincount(place.ravel(), np.outer(*shares).ravel())
        return Distribution(distinct[weights > 1e-14], weights[weights > 1e-14])

    dark, bright = summed(dark_e_s), summed(dark_e_s * (1 + contrast))
    predicted = predict(camera, PatchRates(dark_e_s, dark_e_s * (1 + contrast)), contrast)
    assert float(predicted.cdp) == pytest.approx(cdp(bright, dark, contrast).cdp, abs=4e-4)
    assert float(predicted.cdp + predicted.below + predicted.above) == pytest.approx(1.0, abs=1e-6)
