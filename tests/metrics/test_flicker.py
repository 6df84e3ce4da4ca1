"""Flicker of a pulsed lamp against closed forms, and the intervals against recordings that NumPy simulates."""

import numpy as np
import pytest

import labcdp
from labcdp.core.errors import InputError
from labcdp.core.quantity import Quantity
from labcdp.metrics.beat import find_wave
from labcdp.metrics.pulse import Pulse


def collected(phase, frequency_hz, duty, exposure_s, off):
    """Light of pulses that an exposure collects from a phase on, by the integral of the pulses."""
    period = 1 / frequency_hz

    def integral(t):
        return np.floor(t / period) * duty * period + np.minimum(t % period, duty * period)

    start = phase * period
    return off * exposure_s + (1 - off) * (integral(start + exposure_s) - integral(start))


def true_indices(frequency_hz, duty, exposure_s, off, noise, n_noises=2001, n_phases=4000, late=0.0):
    """FMI, FDI and MMP by a sweep over phases and noises at equal distances of their distributions."""
    phases = (np.arange(n_phases) + 0.5) / n_phases + np.atleast_2d(late)
    light = collected(phases, frequency_hz, duty, exposure_s, off).mean(axis=0)
    fmi = (light.max() - light.min()) / (light.max() + light.min())
    # Quantiles of normal noise, by the inverse of its distribution on a grid.
    deviations = np.linspace(-6, 6, n_noises)
    weights = np.exp(-(deviations**2) / 2)
    weights /= weights.sum()
    on, even = 0.0, 0.0
    for deviation, weight in zip(deviations, weights, strict=True):
        x = light + deviation * noise
        on += weight * np.mean(x > 1.1 * off * exposure_s)
        even += weight * np.mean(np.abs(x - light.mean()) < 0.1 * light.mean())
    return fmi, on, even


# Published definitions; the values agree with the closed form of a uniform phase.
@pytest.mark.parametrize(
    ("lamp", "fmi", "mmp", "fdi"),
    [
        ((90, 0.1, 1e-3, 0.1), 0.81818, 0.0076, 0.1880),
        ((90, 0.1, 8e-3, 0.1), 0.38462, 0.0608, 0.8040),
        ((90, 0.1, 11.2e-3, 0.05), 0.02547, 1, 1),
    ],
)
def test_indices_over_all_phases_are_those_of_the_closed_form(lamp, fmi, mmp, fdi):
    n = 30_011
    values = collected(np.arange(n) * 0.6180339887 % 1, *lamp)
    measured = labcdp.flicker(values, off=lamp[3] * lamp[2])
    assert measured.fmi.value == pytest.approx(fmi, abs=1e-5)
    # Equally distributed phases leave some frames of an error.
    assert measured.mmp.value == pytest.approx(mmp, abs=2e-4)
    assert measured.fdi.value == pytest.approx(fdi, abs=2e-4)
    assert (measured.n_evaluated, measured.few_phases) == (n, False)


def test_definitions_on_a_few_frames():
    measured = labcdp.flicker([1.0, 1.05, 2.0, 0.95, np.nan], off=0.9, threshold=0.2)
    assert measured.fmi.value == pytest.approx((2 - 0.95) / (2 + 0.95))
    assert measured.fdi.value == 0.25
    # The mean is 1.25: none is within 10 % of it.
    assert measured.mmp.value == 0
    assert (measured.n_frames, measured.n_evaluated, measured.few_phases) == (5, 4, True)


@pytest.mark.parametrize("rate_hz", [29.97, 36.5, 24.0])
def test_beat_and_drift_are_recovered(rate_hz):
    rng, frames = np.random.default_rng(2), np.arange(600)
    light = collected((frames / rate_hz * 217.3 + 0.3) % 1, 217.3, 0.3, 2e-3, 0.1)
    values = light * (1 + 0.04 * (frames / 599 - 0.5)) + rng.normal(0, 0.003 * light.mean(), 600)
    measured = labcdp.flicker(values, times_s=frames / rate_hz)
    beat_hz = abs(217.3 - rate_hz * round(217.3 / rate_hz))
    assert measured.beat_hz == pytest.approx(beat_hz, abs=1e-3)
    assert abs(measured.drift.value - 0.04) < 4 * measured.drift.u < 0.012
    assert measured.fmi.interval.low < true_indices(217.3, 0.3, 2e-3, 0.1, 1e-9)[0] < measured.fmi.interval.high


def recordings(rng, repeats, at_random=False, drift=0.0, rows_s=0.0):
    """Videos of lamps, frame rates, exposures, noises and lengths at random, with the true indices."""
    for _ in range(repeats):
        frequency_hz, rate_hz, duty = rng.uniform(60, 1000), rng.uniform(15, 60), rng.uniform(0.1, 0.6)
        exposure_s, off = 10 ** rng.uniform(-3.5, -1.7), rng.choice([0.05, 0.1, 0.3])
        frames = np.arange(rng.integers(100, 500))
        phases = rng.uniform(size=frames.size) if at_random else frequency_hz / rate_hz * frames + rng.uniform()
        late = np.linspace(0, rows_s, 12)[:, None] * frequency_hz if rows_s else np.zeros((1, 1))
        light = collected((phases + late) % 1, frequency_hz, duty, exposure_s, off).mean(axis=0)
        noise = rng.choice([1e-4, 0.002, 0.005, 0.02]) * exposure_s * (off + (1 - off) * duty)
        light = light * (1 + drift * (frames / frames.size - 0.5))
        truth = true_indices(frequency_hz, duty, exposure_s, off, noise, 61, late=late)
        yield light + rng.normal(0, noise, frames.size), off * exposure_s, noise, truth


@pytest.mark.parametrize(
    ("at_random", "drift", "rows_s", "repeats"),
    [(False, 0.0, 0.0, 40), (False, 0.0, 3e-4, 40), (False, 0.03, 0.0, 30), (True, 0.0, 0.0, 100)],
)
def test_intervals_hold(at_random, drift, rows_s, repeats):
    held, trials, n_few = np.zeros(3), np.zeros(3), 0
    for values, off, noise, truth in recordings(np.random.default_rng(8), repeats, at_random, drift, rows_s):
        measured = labcdp.flicker(values, off, u=noise if at_random else None)
        if measured.few_phases:
            n_few += 1
            continue
        for index, (quantity, true) in enumerate(zip((measured.fmi, measured.fdi, measured.mmp), truth, strict=True)):
            # A share of 0 or 1 holds by itself.
            if 1e-3 < true < 1 - 1e-3:
                trials[index] += 1
                held[index] += quantity.interval.low - 1e-6 <= true <= quantity.interval.high + 1e-6
    assert n_few < repeats / 3
    # 95 % within 3.5 standard deviations of the binomial distribution.
    tolerance = 3.5 * np.sqrt(0.95 * 0.05 / trials)
    assert (np.abs(held / trials - 0.95) < tolerance).all(), (held, trials)


def test_a_lamp_that_is_locked_to_the_frames_has_few_phases():
    frames = np.arange(300)
    # 90 Hz at 40 frames a second: each fourth frame sees the same.
    measured = labcdp.flicker(collected(frames * 2.25 % 1, 90, 0.1, 1e-3, 0.1))
    assert measured.few_phases
    assert measured.n_phases == pytest.approx(4, abs=0.1)
    assert measured.fmi.interval.high == 1
    # Nearly so: a beat that takes longer than the recording.
    measured = labcdp.flicker(collected(frames * 2.2502 % 1, 90, 0.1, 1e-3, 0.1))
    assert measured.few_phases
    # At 30 frames a second no frame differs: only who knows the lamp knows that.
    values = np.random.default_rng(0).normal(1, 1e-3, 300)
    assert labcdp.flicker(values, times_s=frames / 30).few_phases is False
    measured = labcdp.flicker(values, times_s=frames / 30, frequency_hz=90)
    assert measured.few_phases
    assert measured.fmi.interval.high == 1


def test_noise_alone_is_no_flicker():
    values = np.random.default_rng(3).normal(1, 0.01, 400)
    for u in (None, 0.01):
        measured = labcdp.flicker(values, u=u)
        assert not measured.flickers
        assert measured.fmi.interval.low == 0
        assert (measured.mmp.value, measured.mmp.interval.high) == (1, 1)


def test_light_that_is_the_same_in_each_frame():
    measured = labcdp.flicker(np.ones(50), off=0.5)
    assert (measured.fmi.value, measured.fdi.value, measured.mmp.value) == (0, 1, 1)


def test_without_light_of_the_lamp_that_is_off_there_is_no_fdi():
    measured = labcdp.flicker(np.linspace(1, 2, 30), off=0.0)
    assert np.isnan(measured.fdi.value)
    assert measured.fdi.note == "no light of the lamp when it is off"
    assert not np.isnan(labcdp.flicker(np.linspace(1, 2, 30), off=Quantity(0.5, 0.01)).fdi.value)


def test_frames_without_a_value_are_not_guessed():
    rng, frames = np.random.default_rng(5), np.arange(400)
    values = collected(frames * 0.377 % 1, 90, 0.3, 2e-3, 0.1)
    lost = rng.random(400) < 0.2
    measured = labcdp.flicker(np.where(lost, np.nan, values))
    assert (measured.n_frames, measured.n_evaluated) == (400, 400 - lost.sum())
    assert measured.wave.rate == pytest.approx(0.377, abs=1e-5)
    nothing = labcdp.flicker([np.nan] * 3)
    assert (nothing.n_evaluated, nothing.fmi.note) == (0, "no frame has a value")
    assert np.isnan([nothing.fmi.value, nothing.mmp.value, nothing.mean]).all()


def test_a_wave_that_no_pulse_explains_is_smoothed():
    def light(phases):
        return 1 + 0.3 * np.sin(2 * np.pi * phases) + 0.1 * np.sin(4 * np.pi * phases + 1)

    frames = np.arange(500)
    waves = light(0.23456 * frames)
    wave = find_wave(frames.astype(float), waves + np.random.default_rng(0).normal(0, 0.003, 500))
    assert wave.pulse is None
    assert wave.rate == pytest.approx(0.23456, abs=1e-4)
    # 5 standard deviations of the noise, and that of the rate where the light is steep.
    assert np.abs(wave.smooth - light(wave.phases[wave.order])).max() < 0.025
    measured = labcdp.flicker(waves)
    share = np.mean(np.abs(light((np.arange(20_000) + 0.5) / 20_000) - 1) < 0.1)
    assert measured.mmp.interval.low < share < measured.mmp.interval.high


def test_rows_of_a_rolling_shutter_are_part_of_the_pulse():
    rng, frames = np.random.default_rng(6), np.arange(400)
    # A region of 30 rows of 20 us: 0.38 periods of the lamp.
    rows = np.arange(30) * 20e-6 * 640
    light = collected((frames[:, None] * 640 / 29.97 + rows) % 1, 640, 0.3, 4e-4, 0.1).mean(axis=1)
    wave = find_wave(frames.astype(float), light + rng.normal(0, 2e-3 * light.mean(), 400))
    beat = 640 / 29.97 - round(640 / 29.97)
    assert wave.rate == pytest.approx(abs(beat), abs=1e-4)
    # Widths of exposure, pulse and rows in periods, of which the light does not say which is which.
    pulse = wave.pulse
    widths = sorted((pulse.base - pulse.top, pulse.base + pulse.top, pulse.rows))
    assert widths == pytest.approx([0.256, 0.3, 0.384], abs=0.02)
    assert wave.pulse.light(wave.phases) == pytest.approx(light, abs=1.5e-3 * light.mean())


@pytest.mark.parametrize(("top", "ramp", "rows"), [(0.1, 0.2, 0.1), (0.0, 0.4, 0.4), (0.2, 0.29, 0.0)])
def test_a_pulse_with_rows_is_the_mean_of_shifted_trapezoids(top, ramp, rows):
    phases = np.linspace(-1, 2, 500)
    shifts = ((np.arange(2000) + 0.5) / 2000 - 0.5) * rows
    mean = np.mean([Pulse(0.3 + shift, top, top + ramp, 1.0, 3.0).light(phases) for shift in shifts], axis=0)
    assert Pulse(0.3, top, top + ramp, 1.0, 3.0, rows).light(phases) == pytest.approx(mean, abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"values": [[1.0]]}, r"values has the shape \(1, 1\): give one for each frame"),
        ({"values": [1.0], "off": True}, "off is True: give a number"),
        ({"values": [1.0], "threshold": 0}, "threshold is 0: give a number above 0"),
        ({"values": [1.0, 2.0], "times_s": [1.0, 1.0]}, "times_s does not increase"),
        ({"values": [1.0, 2.0], "times_s": [1.0]}, r"times_s has the shape \(1,\) and values \(2,\)"),
        ({"values": [1.0, 2.0], "frequency_hz": 90}, "frequency_hz is given without times_s"),
        ({"values": ["a"]}, "values has type"),
        ({"values": [1e308, 1.7e308]}, "values reaches 1.7e.308: give light up to 1e.60"),
    ],
)
def test_what_cannot_be_used_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        labcdp.flicker(**arguments)
