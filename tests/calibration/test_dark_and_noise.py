from dataclasses import replace
from math import log, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.calibration.dark import fit_dark
from labcdp.calibration.noise import fit_noise
from labcdp.errors import CalibrationError

EXPOSURES_S = (0.001, 0.01, 0.1)


def test_dark_line_through_exact_points(camera):
    dark, warnings = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    assert warnings == []
    assert dark.offset_dn == pytest.approx(64.0, abs=1e-9)
    assert dark.rate_dn_s == pytest.approx(40.0, abs=1e-7)
    assert dark.noise_dn == pytest.approx(1.5)
    assert dark.exposures_s == EXPOSURES_S


@given(t=st.floats(1e-4, 0.2))
def test_dark_variance_is_that_of_the_line(camera, t):
    dark, _ = fit_dark([camera.dark(e, None) for e in EXPOSURES_S])
    design = np.column_stack([np.ones(3), EXPOSURES_S])
    covariance = np.linalg.inv(design.T @ design) * 1.5**2 / (3072 * 4)
    assert dark.variance_dn2(t) == pytest.approx(np.array([1, t]) @ covariance @ np.array([1, t]), rel=1e-6)


def test_dark_scatters_as_stated(camera):
    n, rng = 2000, np.random.default_rng(1)
    fits = [fit_dark([camera.dark(t, rng) for t in EXPOSURES_S[:2]])[0] for _ in range(n)]
    stated = sqrt(fits[0].variance_dn2(0.005))
    scatter = np.std([f.mean_dn(0.005) for f in fits])
    assert scatter == pytest.approx(stated, rel=4 / sqrt(2 * n))


def test_dark_at_one_exposure_is_constant_and_says_so(camera):
    dark, (warning,) = fit_dark([camera.dark(0.01, None)])
    assert warning.startswith("dark frames at one exposure only (0.01 s): the offset is taken as constant")
    assert (dark.mean_dn(0.01), dark.rate_dn_s) == (pytest.approx(64.4), 0.0)
    assert dark.mean_dn(10.0) == pytest.approx(64.4)


def test_darkness_at_another_than_the_only_exposure_is_uncertain(camera):
    """It may grow by all that it is above the black level of 64 DN, or by half a DN if that is more."""
    for dark_rate_dn_s, above_dn in ((40.0, 0.5), (400.0, 4.0)):
        observation = replace(camera, dark_rate_dn_s=dark_rate_dn_s).dark(0.01, None)
        dark, _ = fit_dark([observation])
        assert dark.variance_dn2(0.01) == pytest.approx(observation.mean_variance_dn2)
        for t in (0.001, 0.1):
            assert dark.variance_dn2(t) == pytest.approx(
                observation.mean_variance_dn2 + (above_dn * (t - 0.01) / 0.01) ** 2
            )


def test_frames_outside_the_temperatures_of_the_dark_frames_are_named(camera):
    dark, _ = fit_dark(warm_darks(camera, temperatures_c=(24.0, 25.0)))
    taken = [(0.01, 40.0), (0.1, 34.0), (0.1, 26.0), (0.1, None)]
    (warning,) = dark.temperature_warnings(taken)
    assert warning == (
        "the light frames at 0.1 s were taken at 34.0 degC, the dark frames at 24.0 to 25.0 degC, so the darkness is "
        "less certain: take dark frames at this temperature"
    )
    assert dark.temperature_warnings([(0.1, 26.9), (0.1, None), (1e-4, 40.0)]) == []


def test_dark_that_is_no_line_is_less_certain(camera):
    darks = [camera.dark(t, None) for t in EXPOSURES_S]
    bent = [darks[0], replace(darks[1], mean_dn=darks[1].mean_dn + 1.0), darks[2]]
    straight, crooked = fit_dark(darks)[0], fit_dark(bent)[0]
    assert crooked.variance_dn2(0.01) > 100 * straight.variance_dn2(0.01)


def spoiled(camera, index, by_dn):
    """Dark frames at four exposures, one of them too bright."""
    darks = [camera.dark(t, None) for t in (0.0005, 0.002, 0.008, 0.032)]
    return [replace(d, mean_dn=d.mean_dn + by_dn) if i == index else d for i, d in enumerate(darks)]


@pytest.mark.parametrize(("index", "exposure"), [(0, "0.0005"), (1, "0.002"), (2, "0.008"), (3, "0.032")])
def test_a_dark_exposure_that_contradicts_the_others_is_named(camera, index, exposure):
    warnings = fit_dark(spoiled(camera, index, 20.0))[1]
    assert f"the dark frames at {exposure} s do not fit the others" in warnings[0]
    assert "was the lens covered" in warnings[0]


def test_a_darkness_that_falls_with_the_exposure_is_reported(camera):
    darks = [camera.dark(t, None) for t in (0.001, 0.1)]
    warnings = fit_dark([replace(darks[0], mean_dn=darks[0].mean_dn + 40), darks[1]])[1]
    assert warnings[0].startswith("the darkness falls with the exposure by 364 DN/s, which no sensor does")


def test_wander_of_the_black_level_is_no_contradiction(camera):
    assert fit_dark(spoiled(camera, 1, 0.4))[1] == []


def test_clipped_dark_is_reported(camera):
    darks = [replace(camera.dark(t, None), black_share=0.25) for t in EXPOSURES_S[:2]]
    warnings = fit_dark(darks)[1]
    assert warnings[0].startswith("25.0% of the pixels of the dark frames at 0.001 s are 0 DN")


def warm_darks(camera, rng=None, temperatures_c=(20.0, 35.0), doubling_c=7.0):
    """Dark frames at four exposures and several temperatures; 40 DN/s at 25 degC."""
    darks = []
    for temperature_c in temperatures_c:
        rate = 40.0 * 2 ** ((temperature_c - 25.0) / doubling_c)
        warm = replace(camera, dark_rate_dn_s=rate)
        darks += [replace(warm.dark(t, rng), temperature_c=temperature_c) for t in (0.001, 0.01, 0.1, 1.0)]
    return darks


def test_doubling_temperature_of_exact_darks(camera):
    dark, warnings = fit_dark(warm_darks(camera))
    assert warnings == []
    assert dark.doubling_temperature_c == pytest.approx(7.0, rel=1e-6)
    assert dark.temperature_c == pytest.approx(27.5)
    assert dark.mean_dn(0.5, 25.0) == pytest.approx(64 + 20.0)
    assert dark.mean_dn(0.5, 32.0) == pytest.approx(64 + 40.0)
    assert dark.mean_dn(0.5) == dark.mean_dn(0.5, 27.5)


def test_darkness_at_another_temperature_scatters_as_stated(camera):
    n, rng = 1000, np.random.default_rng(4)
    fits = [fit_dark(warm_darks(camera, rng))[0] for _ in range(n)]
    for temperature_c in (20.0, 28.0, 40.0):
        stated = sqrt(np.mean([f.variance_dn2(0.3, temperature_c) for f in fits]))
        scatter = np.std([f.mean_dn(0.3, temperature_c) for f in fits])
        # Widening by the Birge ratio only ever widens: with 5 degrees of freedom by 12 % on average (chi distribution).
        assert stated / 1.2 < scatter < stated * (1 + 4 / sqrt(2 * n))


def test_errors_of_the_dark_are_its_covariance(camera):
    dark, _ = fit_dark(warm_darks(camera))
    rows = dark.errors()
    assert rows.T @ rows == pytest.approx(np.array(dark.covariance), rel=1e-6, abs=1e-12)


def test_equal_temperatures_give_a_line(camera):
    dark, _ = fit_dark(warm_darks(camera, temperatures_c=(24.0, 25.0)))
    assert dark.doubling_temperature_c is None
    # Of silicon, a doubling every 7.5 degC, a third of which is uncertain.
    rate_dn_s = dark.rate_dn_s
    assert dark.mean_dn(0.1, 32.0) == pytest.approx(dark.offset_dn + 0.1 * rate_dn_s * 2)
    by_growth_dn = 0.1 * rate_dn_s * 2 * log(2) / 3
    of_the_line = dark.variance_dn2(0.2, 24.5)
    assert dark.variance_dn2(0.1, 32.0) == pytest.approx(of_the_line + by_growth_dn**2)


def test_temperature_and_exposure_that_go_together_cannot_be_told_apart(camera):
    darks = warm_darks(camera)
    tied = [darks[0], darks[-1]]
    assert fit_dark(tied)[0].doubling_temperature_c is None


def test_no_dark():
    with pytest.raises(CalibrationError, match="there are no dark frames: cover the lens and take at least 2"):
        fit_dark([])


def test_darks_of_two_gains(camera):
    other = replace(camera.dark(0.1, None), state=replace(camera.state, gain_db=6.0))
    with pytest.raises(
        CalibrationError, match=r"gain of the first dark frames is 0 dB, but the set of dark frames at 0\.1 s has 6 dB"
    ):
        fit_dark([camera.dark(0.01, None), other])


def observations(camera, rng=None, luminances=(1.0, 10.0, 100.0, 230.0)):
    return [camera.observe(f"P{v}", v, 0.01, rng) for v in luminances]


def test_k_of_exact_variances(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    noise, warnings = fit_noise(observations(camera), dark)
    assert warnings == []
    assert noise.k_dn_per_e == pytest.approx(0.25)
    assert noise.variance_dn2(400.0) == pytest.approx(0.25 * 400 + 1.5**2)
    assert noise.variance_dn2(-5.0) == pytest.approx(1.5**2)


def test_k_is_unbiased(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    rng = np.random.default_rng(2)
    k = [fit_noise(observations(camera, rng), dark)[0].k_dn_per_e for _ in range(300)]
    assert np.mean(k) == pytest.approx(0.25, abs=4 * np.std(k) / sqrt(len(k)))


def test_k_weights_each_point_with_the_variance_of_a_variance(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    seen = observations(camera, np.random.default_rng(3))
    k = fit_noise(seen, dark)[0].k_dn_per_e
    net = np.array([o.net_dn(dark.mean_dn(0.01)) for o in seen])
    excess = np.array([o.temporal_variance_dn2 for o in seen]) - 1.5**2
    pull = (excess - k * net) * net / (k * net + 1.5**2) ** 2
    assert pull.sum() == pytest.approx(0, abs=1e-6 * np.abs(pull).sum())


def test_the_bend_above_70_percent_of_saturation_is_left_out(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    seen = observations(camera, luminances=(10.0, 100.0, 300.0))
    bent = [*seen[:2], replace(seen[2], temporal_variance_dn2=5.0)]
    assert fit_noise(bent, dark)[0].k_dn_per_e == pytest.approx(0.25)


def test_repeated_frames_are_noticed(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    still = [replace(o, temporal_variance_dn2=0.0) for o in observations(camera)]
    noise, (warning,) = fit_noise(still, dark)
    assert noise.k_dn_per_e == 0.0
    assert warning.startswith("the temporal noise does not grow with the signal (K = -")


def test_no_patch_for_photon_transfer(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    noise, (warning,) = fit_noise(observations(camera, luminances=(300.0,)), dark)
    assert (noise.k_dn_per_e, noise.dark_noise_dn) == (0.0, pytest.approx(1.5))
    assert warning.startswith("no patch lies between dark and 70% of saturation, so K is unknown")
