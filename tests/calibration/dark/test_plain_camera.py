"""Dark noise, flicker and drift of the black level, by frames of a camera in plain NumPy."""

from math import sqrt

import numpy as np
import pytest

from labcdp.calibration import GainSetting, observe_dark, observe_patches
from labcdp.calibration.frames.measure import measure_whole
from labcdp.calibration.sensor.dark import fit_dark
from labcdp.calibration.sensor.dark_library import dark_library
from labcdp.calibration.sensor.noise import fit_noise
from labcdp.calibration.signal import net_signal
from labcdp.core.roi import Roi

from ..conftest import make_frame

SHAPE = (48, 64)
#: K in DN/e-, read noise in DN, dark current in e-/s.
K, READ_DN, CURRENT_E_S = 0.5, 1.0, 100.0
PATCHES = [Roi.rectangle(f"P{i}", 16 * i, 8, 16, 32) for i in range(4)]
LIGHT_E_S = np.repeat([300.0, 1000.0, 2500.0, 4500.0], 16) * np.ones((48, 1))


@pytest.fixture
def frames():
    """Frames of a scene in e-/s; each with its own light and black level."""

    def taken(light_e_s, exposure_s, n, rng, flicker_rel=0.0, drift_dn=0.0, row_dn=0.0, current_e_s=CURRENT_E_S):
        for i in range(n):
            light = light_e_s * (1 + flicker_rel * rng.standard_normal())
            electrons = rng.poisson((light + current_e_s) * exposure_s * np.ones(SHAPE))
            level = 64 + drift_dn * rng.standard_normal() + row_dn * rng.standard_normal((SHAPE[0], 1))
            yield make_frame(K * electrons + level + READ_DN * rng.standard_normal(SHAPE), exposure_s, i)

    return taken


@pytest.fixture
def bench(frames):
    """Dark model, noise and observations by dark and light frames of two exposures."""

    def measured(rng, n=2, exposures_s=(0.001, 1.0), **world):
        dark_world = {name: value for name, value in world.items() if name != "flicker_rel"}
        darks = [observe_dark(frames(0.0, t, n, rng, **dark_world)) for t in exposures_s]
        observations = [o for t in exposures_s for o in observe_patches(frames(LIGHT_E_S, t, n, rng, **world), PATCHES)]
        dark = fit_dark(darks)[0]
        return dark, fit_noise(observations, dark)[0], observations

    return measured


def test_dark_noise_and_k_are_those_of_the_exposure(bench):
    """100 e-/s at 1 ms and at 1 s: 1.0 and 5.1 DN, K 0.5 DN/e-."""
    dark, noise, _ = bench(np.random.default_rng(1), n=8)
    for t in (0.001, 1.0):
        truth = READ_DN**2 + 1 / 12 + K**2 * CURRENT_E_S * t
        assert dark.noise_variance_dn2(t) == pytest.approx(truth, rel=5 * sqrt(2 / (SHAPE[0] * SHAPE[1] * 7)))
    assert noise.k_dn_per_e == pytest.approx(K, rel=0.02)


@pytest.mark.parametrize(
    "world",
    [
        {},
        pytest.param({"flicker_rel": 0.01}, id="flicker of 1 %"),
        pytest.param({"drift_dn": 0.5}, id="drift of the black level"),
        pytest.param({"row_dn": 2.0}, id="noise of rows"),
    ],
)
def test_signals_scatter_as_stated(bench, world):
    """Two frames of each exposure; what is common to all patches of a frame is pooled over exposures and patches."""
    rng, runs = np.random.default_rng(2), 30
    scores, drawn, stated = [], [], []
    for _ in range(runs):
        dark, noise, observations = bench(rng, exposures_s=(0.1, 0.3, 1.0, 0.5), **world)
        for o in observations:
            signal = net_signal(o, [GainSetting(0.0, 1.0, 0.0, dark, noise)])
            light = LIGHT_E_S[0, int(o.centre_px[0])]
            scores.append((signal.net_dn - K * light * o.exposure_s) / sqrt(signal.variance_dn2))
            drawn.append(signal.net_dn - K * light * o.exposure_s)
            stated.append(signal.variance_dn2)
    # Errors are common to the four patches of an exposure, and each run has few degrees of freedom.
    assert np.sqrt(np.mean(np.square(drawn)) / np.mean(stated)) == pytest.approx(1, abs=0.25)
    assert np.mean(np.abs(scores) < 1.96) > 0.85


@pytest.mark.parametrize("exposures_s", [(0.1,), (0.1, 1.0)])
def test_library_at_another_temperature_scales_or_says_that_it_cannot(frames, exposures_s):
    rng = np.random.default_rng(4)
    current = CURRENT_E_S * (1 + rng.exponential(1.0, SHAPE))
    darks = [measure_whole(frames(0.0, t, 16, rng, current_e_s=current)) for t in exposures_s]
    library = dark_library(darks)
    # A true doubling temperature of 6 to 10 K, the frames' being 30 degC.
    for doubling_k in (6.0, 7.5, 10.0):
        truth = K * current * 0.1 * 2 ** (5 / doubling_k)
        pattern = library.correction_dn(SHAPE, 0.1, 35.0)
        if pattern is None:
            assert library.verdict(0.1, 35.0).code == "dark-pattern-of-other-frames"
        else:
            error = pattern - (truth - truth.mean())
            assert error.std() < 2 * library.noise_dn(0.1, 35.0)
    assert library.worth_applying(0.1, 30.0)
    assert library.correction_dn(SHAPE, 0.1, 60.0) is None
    assert library.verdict(0.1, 60.0).code == "dark-pattern-of-other-frames"
