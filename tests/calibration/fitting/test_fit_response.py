"""A fit that is given the response of a bracket: the patches scale it, and may contradict it."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import fit
from labcdp.calibration.sensor.dark import fit_dark
from labcdp.calibration.sensor.noise import GainSetting, TemporalNoise, fit_noise
from labcdp.calibration.sensor.response import ResponseCurve
from labcdp.calibration.signal import net_signals
from labcdp.core.dn import Response
from labcdp.core.errors import CalibrationError

from ..conftest import SimulatedMeter, bench

EXPOSURES_S = tuple(0.001 * 2.0**k for k in range(6))


def curve(power=1.0, covers=(8, 4000)):
    """h = n^power, h = n at the first knot."""
    n = np.geomspace(*covers, 60)
    h = n[0] * (n / n[0]) ** power
    response = Response("table", (0.0, *n.tolist()), (0.0, *h.tolist()))
    return ResponseCurve(response, 0.002, (0.002,), (float(covers[0]), float(covers[1])), EXPOSURES_S, ())


@pytest.fixture
def data(camera):
    rng, meter = np.random.default_rng(1), SimulatedMeter()
    return bench(camera, lambda v: meter.read(v, rng), rng, np.geomspace(0.6, 300, 9), (0.002, 0.008, 0.032), 3)


def test_the_patches_scale_it(data, setup, camera):
    """A straight table gives what the linear fit gives, within the errors it is said to have."""
    given, linear = fit(*data, setup, response=curve()), fit(*data, setup)
    r = given.responsivity
    assert r.responsivity_dn_s_cd_m2 == pytest.approx(linear.responsivity.responsivity_dn_s_cd_m2, rel=0.003)
    assert r.responsivity_dn_s_cd_m2 == pytest.approx(camera.responsivity_dn_s_cd_m2, rel=5 * r.random_rel)
    assert r.random_rel > linear.responsivity.random_rel  # it has the error of the curve


@pytest.mark.parametrize("power", [1.05, 0.95])
def test_a_bent_curve_of_a_linear_camera_contradicts_the_patches(data, setup, power):
    with pytest.raises(CalibrationError, match=r"contradicts the patches, a linear one fits them clearly better"):
        fit(*data, setup, response=curve(power))


def test_signals_outside_the_curve_are_left_out(data, setup):
    calibration = fit(*data, setup, response=curve(covers=(40, 2000)))
    signals = {(o.patch, o.exposure_s): o.mean_dn - 64 - 40 * o.exposure_s for o in data[0]}
    left = [row for row in calibration.left_out if row.reason == "outside the response of the bracket"]
    assert left
    assert not any(42 < signals[row.patch, row.exposure_s] < 1950 for row in left)


def square_root(lowest, highest):
    """n = sqrt(400 h) as a table."""
    knots = np.geomspace(lowest, highest, 3000)
    return Response("table", (0.0, *knots.tolist()), (0.0, *(knots**2 / 400).tolist()))


def test_noise_is_that_of_the_light_before_the_curve(camera):
    """K and read noise of h come back, and the noise of n."""
    model, _ = fit_dark([camera.dark(0.008, None)])
    light = np.geomspace(20, 3000, 8)
    n = np.sqrt(400 * light)
    variance, one = (0.25 * light + 4.0) / (n / 200) ** 2 + 1 / 12, camera.observe("P", 1.0, 0.008, None)
    seen = [
        replace(one, mean_dn=model.mean_dn(0.008) + x, temporal_variance_dn2=v)
        for x, v in zip(n, variance, strict=True)
    ]
    noise, _ = fit_noise(seen, model, square_root(20, 2000))
    assert (noise.k_dn_per_e, noise.dark_noise_dn) == pytest.approx((0.25, 2.0), rel=0.02)
    assert [noise.variance_dn2(x) for x in n[2:7]] == pytest.approx(variance[2:7], rel=0.03)


def test_the_mean_over_noisy_pixels_is_that_of_the_light(camera):
    """Brute force: noisy light through a square root, averaged in DN, and back."""
    tone = square_root(10, 4000)
    model, _ = fit_dark([camera.dark(0.008, None)])
    settings = (GainSetting(0.0, 1.0, 0.0, model, TemporalNoise(0.25, 2.0, tone)),)
    light = 40 + 6 * np.random.default_rng(3).normal(size=2_000_000)
    n = np.sqrt(400 * light)
    o = camera.observe("grey", 1.0, 0.008, None)
    o = replace(o, mean_dn=model.mean_dn(0.008) + n.mean(), temporal_variance_dn2=n.var() + 1 / 12)
    assert float(tone.linearise(n.mean())) == pytest.approx(40 - 0.225, abs=0.03)
    assert tone.linearise(net_signals([o], settings).net_dn) == pytest.approx(light.mean(), abs=0.03)
