"""A fit that is given the response of a bracket: the patches scale it, and may contradict it."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import fit
from labcdp.calibration.sensor.dark import fit_dark
from labcdp.calibration.sensor.noise import GainSetting, TemporalNoise, fit_noise
from labcdp.calibration.sensor.response import ResponseCurve
from labcdp.calibration.signal import net_signal
from labcdp.core.dn import Response
from labcdp.core.errors import CalibrationError

LUMINANCES = np.geomspace(0.6, 300, 9)
EXPOSURES_S = (0.002, 0.008, 0.032)
POWERS_OF_TWO = tuple(0.001 * 2.0**k for k in range(6))


def curve(power=1.0, residual_rel=0.002):
    """h = n^power over 8 to 4000 DN, h = n at the first knot."""
    n = np.geomspace(8, 4000, 60)
    h = n[0] * (n / n[0]) ** power
    response = Response("table", (0.0, *n.tolist()), (0.0, *h.tolist()))
    return ResponseCurve(response, residual_rel, (8.0, 4000.0), POWERS_OF_TWO, ())


@pytest.fixture(scope="module")
def bench(camera, meter_class):
    """Observations, darks and readings of a linear camera."""

    def measure(seed):
        rng = np.random.default_rng(seed)
        meter = meter_class()
        observations = [
            camera.observe(f"{k}", luminance, t, rng) for k, luminance in enumerate(LUMINANCES) for t in EXPOSURES_S
        ]
        readings = {f"{k}": [meter.read(v, rng, 60 * k + j) for j in range(3)] for k, v in enumerate(LUMINANCES)}
        return observations, [camera.dark(t, rng) for t in EXPOSURES_S], readings

    return measure


def test_the_patches_scale_it(bench, setup, camera):
    """A straight table gives what the linear fit gives, within the errors it is said to have."""
    data = bench(1)
    given, linear = fit(*data, setup, response=curve()), fit(*data, setup)
    assert [(step.kind, step.chosen) for step in given.ladder][:2] == [("table", True), ("linear", False)]
    assert given.range_net_dn == (8.0, 4000.0)
    r = given.responsivity
    assert r.responsivity_dn_s_cd_m2 == pytest.approx(linear.responsivity.responsivity_dn_s_cd_m2, rel=0.003)
    assert r.responsivity_dn_s_cd_m2 == pytest.approx(camera.responsivity_dn_s_cd_m2, rel=5 * r.random_rel)
    assert r.random_rel > linear.responsivity.random_rel  # it has the error of the curve


@pytest.mark.parametrize("power", [1.05, 0.95])
def test_a_bent_curve_of_a_linear_camera_contradicts_the_patches(bench, setup, power):
    with pytest.raises(
        CalibrationError,
        match=r"the response of the bracket contradicts the patches, a linear one fits them clearly better \(leave-one",
    ):
        fit(*bench(2), setup, response=curve(power))


def test_signals_outside_the_curve_are_left_out(bench, setup):
    short = replace(curve(), range_net_dn=(40.0, 2000.0))
    n = np.geomspace(40, 2000, 40)
    short = replace(short, response=Response("table", (0.0, *n.tolist()), (0.0, *n.tolist())))
    calibration = fit(*bench(1), setup, response=short)
    left = [row for row in calibration.left_out if row.reason == "outside the response of the bracket"]
    assert left
    for row in left:
        net = 1200 * LUMINANCES[int(row.patch)] * row.exposure_s
        assert not 42 < net < 1950


def test_noise_is_that_of_the_light_before_the_curve(camera):
    """Observations through n = sqrt(400 h): K and read noise of h come back, and the noise of n."""
    knots = np.geomspace(20, 2000, 3000)
    tone = Response("table", (0.0, *knots.tolist()), (0.0, *(knots**2 / 400).tolist()))
    dark = camera.dark(0.008, None)
    model, _ = fit_dark([dark])
    seen = []
    for k, h in enumerate(np.geomspace(20, 3000, 8)):
        n = np.sqrt(400 * h)
        variance = (0.25 * h + 4.0) / (2 * n / 400) ** 2 + 1 / 12
        o = camera.observe(f"{k}", 1.0, 0.008, None)
        seen.append(replace(o, signal_dn=model.mean_dn(0.008) + n, temporal_variance_dn2=variance, saturated_share=0.0))
    noise, findings = fit_noise(seen, model, tone)
    assert not findings
    assert noise.k_dn_per_e == pytest.approx(0.25, rel=0.01)
    assert noise.dark_noise_dn == pytest.approx(2.0, rel=0.02)
    assert [noise.variance_dn2(float(np.sqrt(400 * h))) for h in (50.0, 800.0)] == pytest.approx(
        [(0.25 * h + 4) / (np.sqrt(400 * h) / 200) ** 2 + 1 / 12 for h in (50.0, 800.0)], rel=0.03
    )


def test_the_mean_over_noisy_pixels_is_that_of_the_light(camera):
    """Brute force: noisy light through a square root, averaged in DN, and back."""
    knots = np.geomspace(10, 4000, 600)
    tone = Response("table", (0.0, *knots.tolist()), (0.0, *(knots**2 / 400).tolist()))
    model, _ = fit_dark([camera.dark(0.008, None)])
    settings = (GainSetting(0.0, 1.0, 0.0, model, TemporalNoise(0.25, 2.0, tone)),)
    light = 40 + 6 * np.random.default_rng(3).normal(size=2_000_000)
    n = np.sqrt(400 * light)
    o = camera.observe("grey", 1.0, 0.008, None)
    o = replace(o, signal_dn=model.mean_dn(0.008) + n.mean(), temporal_variance_dn2=n.var() + 1 / 12)
    plain = float(tone.linearise(n.mean()))
    linearised = float(tone.linearise(net_signal(o, settings).net_dn))
    assert plain == pytest.approx(40 - 0.225, abs=0.03)
    assert linearised == pytest.approx(light.mean(), abs=0.03)
