"""A pulsed lamp against sums over phases by plain NumPy, and the published definitions."""

import numpy as np
import pytest

import labcdp
from labcdp.chain import PulsedLamp
from labcdp.core.errors import InputError


def seen(phases, frequency_hz, duty, exposure_s, off, n_steps=20_001):
    """Light of an exposure over its time, by samples of the pulses."""
    times = (np.arange(n_steps) + 0.5) / n_steps * exposure_s
    on = ((np.asarray(phases)[:, None] + times * frequency_hz) % 1) < duty
    return off + (1 - off) * on.mean(axis=1)


def indices_of(light, off, noise=0.0):
    """FMI, FDI and MMP of light at phases at equal distances, noise by quantiles of the normal distribution."""
    from scipy.stats import norm

    mean, fmi = light.mean(), (light.max() - light.min()) / (light.max() + light.min())
    if noise == 0:
        return fmi, np.mean(light > 1.1 * off), np.mean(np.abs(light - mean) < 0.1 * mean)
    s = noise * mean
    on = norm.sf(1.1 * off, light, s).mean()
    return fmi, on, (norm.cdf(1.1 * mean, light, s) - norm.cdf(0.9 * mean, light, s)).mean()


@pytest.mark.parametrize(
    ("lamp", "exposure_s", "fmi", "mmp", "fdi"),
    [
        ((90, 0.1, 0.1), 1e-3, 0.81818, 0.0076, 0.1880),
        ((90, 0.1, 0.1), 8e-3, 0.38462, 0.0608, 0.8040),
        ((90, 0.1, 0.05), 11.2e-3, 0.02547, 1, 1),
    ],
)
def test_published_values(lamp, exposure_s, fmi, mmp, fdi):
    flicker = PulsedLamp(*lamp).flicker(exposure_s)
    assert (flicker.fmi, flicker.mmp, flicker.fdi) == pytest.approx((fmi, mmp, fdi), abs=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_indices_are_those_of_a_sweep_over_the_phase(seed):
    rng = np.random.default_rng(seed)
    frequency_hz, duty, off = rng.uniform(50, 1000), rng.uniform(0.05, 0.9), rng.uniform(0.02, 0.5)
    exposure_s, noise = 10 ** rng.uniform(-4, -1.7), rng.uniform(0.002, 0.05)
    lamp, phases = PulsedLamp(frequency_hz, duty, off), (np.arange(400_000) + 0.5) / 400_000
    light = lamp.collected(exposure_s, phases) / exposure_s
    # Samples of the pulses are off by one at either end.
    assert light[::40_000] == pytest.approx(seen(phases[::40_000], frequency_hz, duty, exposure_s, off), abs=2e-4)
    for noise_rel in (0.0, noise):
        flicker = lamp.flicker(exposure_s, noise_rel=noise_rel)
        assert (flicker.fmi, flicker.fdi, flicker.mmp) == pytest.approx(indices_of(light, off, noise_rel), abs=1e-5)
    assert flicker.mean == pytest.approx(light.mean(), abs=1e-9)


def test_rows_of_a_rolling_shutter_and_captures_are_averaged():
    lamp, phases = PulsedLamp(210, 0.2, 0.1), (np.arange(200_000) + 0.5) / 200_000
    rows = [lamp.collected(2e-3, phases + row * 30e-6 * 210) / 2e-3 for row in range(50)]
    flicker = lamp.flicker(2e-3, n_rows=50, row_time_s=30e-6)
    assert (flicker.fmi, flicker.fdi, flicker.mmp) == pytest.approx(indices_of(np.mean(rows, axis=0), 0.1), abs=1e-5)
    long, short = lamp.collected(8e-3, phases) / 8e-3, lamp.collected(1e-3, phases + 8e-3 * 210) / 1e-3
    flicker = lamp.flicker([8e-3, 1e-3], start_s=[0, 8e-3], weights=[0.7, 0.3], noise_rel=0.01)
    expected = indices_of(0.7 * long + 0.3 * short, 0.1, 0.01)
    assert (flicker.fmi, flicker.fdi, flicker.mmp) == pytest.approx(expected, abs=1e-5)


def test_limits():
    lamp = PulsedLamp(90, 0.1)
    assert np.isnan(lamp.flicker(1e-3).fdi)
    assert lamp.flicker(1e-3).fmi == 1
    # Whole periods, and a lamp that is always on, do not flicker.
    for steady in (lamp.flicker(3 / 90), PulsedLamp(90, 1.0).flicker(1e-3)):
        assert (steady.fmi, steady.mmp) == pytest.approx((0, 1), abs=1e-9)


def test_a_recording_measures_what_is_predicted():
    lamp, rng = PulsedLamp(217.3, 0.3, 0.1), np.random.default_rng(0)
    light = lamp.collected(2e-3, np.arange(900) * 217.3 / 36 + 0.2) / 2e-3 + rng.normal(0, 0.002, 900)
    measured, predicted = labcdp.flicker(light, off=0.1), lamp.flicker(2e-3, noise_rel=0.002 / lamp.mean_level)
    for name in ("fmi", "fdi", "mmp"):
        low, high = getattr(measured, name).interval
        assert low - 1e-9 <= getattr(predicted, name) <= high + 1e-9


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"exposure_s": 0.0}, "an exposure time is not above 0"),
        ({"exposure_s": "1ms"}, "an exposure time, a start or a weight is not a number: give times in s"),
        ({"exposure_s": [1e-3, 2e-3], "start_s": [0.0]}, "there are 2 exposure times, 1 starts"),
        ({"exposure_s": [1e-3, 2e-3], "weights": [0.2, 0.2]}, "the weights add up to 0.4"),
        ({"exposure_s": 1e-3, "noise_rel": -1.0}, "noise_rel is -1"),
    ],
)
def test_what_cannot_be_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        PulsedLamp(90, 0.1).flicker(**arguments)
    with pytest.raises(InputError, match="duty is True"):
        PulsedLamp(90, True)
