import re
from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration import fit, observe_dark, observe_patches
from labcdp.calibration.converter import EXPOSURE_TIME_REL, common_errors
from labcdp.core.errors import CalibrationError, LabcdpError
from labcdp.core.reading import MeterIdentity
from labcdp.core.response import Response
from labcdp.core.result import info, warning
from labcdp.core.roi import Roi
from labcdp.core.vignetting import Cos4Vignetting


def changed(observations, patch, **changes):
    return [replace(o, **changes) if o.patch == patch else o for o in observations]


def subjects(one, code):
    """Subjects of the findings of a code."""
    return [finding.subject for finding in one.findings if finding.code == code]


EXPOSURES_S = (0.001, 0.008, 0.064)
LUMINANCES = tuple(float(v) for v in np.geomspace(0.5, 2000, 12))
#: A meter without any error, to test the camera's side alone.
EXACT = {"repeatability_rel": 0.0, "digits_half_width": 0.0}


def bench(camera, new_reading, rng=None, luminances=LUMINANCES, exposures_s=EXPOSURES_S, reading=None):
    """Observations, darks and readings of patches P0, P1, ..."""
    observations = [camera.observe(f"P{i}", v, t, rng) for i, v in enumerate(luminances) for t in exposures_s]
    darks = [camera.dark(t, rng) for t in exposures_s]
    readings = {f"P{i}": [new_reading(v, **(EXACT if reading is None else reading))] for i, v in enumerate(luminances)}
    return observations, darks, readings


def codes(one):
    """Codes of what was found."""
    return {finding.code for finding in one.findings}


def test_exact_data_give_the_exact_responsivity(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading), setup)
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=1e-9)
    assert calibration.responsivity.chi_squared == pytest.approx(0, abs=1e-9)
    # 36 observations, of which 5 patches saturate at 8 of their exposures, less one parameter.
    assert calibration.responsivity.degrees_of_freedom == 27
    assert (calibration.response, calibration.responsivity.scatter_rel) == (Response(), 0.0)
    assert calibration.range_net_dn == (pytest.approx(0.6), pytest.approx(3.54e3, rel=0.01))
    assert calibration.responsivity.intercept_dn_s == pytest.approx(0, abs=1e-6)
    assert "intercept" not in codes(calibration)
    assert calibration.noise.k_dn_per_e == pytest.approx(0.25)
    assert calibration.range_cd_m2 == (pytest.approx(0.5), pytest.approx(2000))
    assert calibration.exposures_s == EXPOSURES_S
    assert max(abs(row.residual_rel) for row in calibration.residuals) < 1e-9
    assert [row.patch for row in calibration.residuals] == [f"P{i}" for i in range(12)]


def test_common_uncertainty_is_that_of_the_scale_and_the_fit(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading), setup)
    fit_rel = calibration.responsivity.random_rel
    assert calibration.responsivity_common_rel == pytest.approx(np.hypot(0.02 / np.sqrt(3), fit_rel))


def test_weights_save_the_dark_patches(camera, new_reading, setup):
    """Unweighted least squares of a + b x errs by tens of percent at 0.6 cd/m^2 (reference: 30 %, weighted 2 %)."""
    rng = np.random.default_rng(1)
    luminances = tuple(np.geomspace(0.6, 2000, 10))
    unweighted, weighted = [], []
    for _ in range(30):
        shown = [v * (1 + rng.normal(0, 0.005)) for v in luminances]
        observations, darks, _ = bench(camera, new_reading, rng, luminances)
        readings = {f"P{i}": [new_reading(v, repeatability_rel=0.005)] for i, v in enumerate(shown)}
        calibration = fit(observations, darks, readings, setup)
        rates = [
            row.luminance_cd_m2 * calibration.responsivity.responsivity_dn_s_cd_m2 for row in calibration.residuals
        ]
        slope, intercept = np.polyfit(shown, rates, 1)
        unweighted.append((rates[0] - intercept) / slope / 0.6 - 1)
        weighted.append(calibration.residuals[0].luminance_cd_m2 / 0.6 - 1)
    assert np.sqrt(np.mean(np.square(unweighted))) > 0.3
    assert np.sqrt(np.mean(np.square(weighted))) < 0.02


def test_glare_makes_the_intercept_significant(camera, new_reading, setup):
    _, darks, readings = bench(camera, new_reading, reading={})
    observations = bench(camera, new_reading, luminances=[v + 0.2 for v in LUMINANCES])[0]
    calibration = fit(observations, darks, readings, setup)
    assert "intercept" in codes(calibration)
    glare = next(t for t in calibration.tests if t.name == "glare")
    assert glare.significant
    assert glare.value == pytest.approx(0.2, rel=1e-6)
    assert calibration.responsivity.intercept_dn_s == pytest.approx(0.2 * 1200, rel=0.1)
    assert calibration.left_out == tuple(row for row in calibration.left_out if row.exposure_s is not None)


def test_a_negative_intercept_is_not_called_glare(camera, new_reading, setup):
    _, darks, readings = bench(camera, new_reading, reading={})
    observations = bench(camera, new_reading, luminances=[v - 0.1 for v in LUMINANCES])[0]
    calibration = fit(observations, darks, readings, setup)
    assert "intercept-negative" in codes(calibration)
    assert "intercept" not in codes(calibration)
    assert calibration.responsivity.glare_cd_m2 == 0


def test_short_exposure_times_jitter(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading), setup)
    for exposure_s, expected in ((1e-2, 5e-5), (1e-3, 5e-5), (2e-5, 2.5e-3)):
        (own,) = [e for e in common_errors(calibration, 100.0, exposure_s) if e.source == "exposure time"]
        assert own.relative == pytest.approx(expected)


def test_glare_that_the_patches_do_not_show_is_bounded(camera, new_reading, setup):
    """Half of the intercept's standard uncertainty is not counted; twice is, but is not significant."""
    darks, readings = bench(camera, new_reading, reading={"repeatability_rel": 0.01, "digits_half_width": 0.05})[1:]
    stated = next(t for t in fit(*bench(camera, new_reading)[:2], readings, setup).tests if t.name == "glare")
    for share, counted in ((0.5, 0.0), (2.0, sqrt(3))):
        u = stated.standard_uncertainty
        observations = bench(camera, new_reading, luminances=[v + share * u for v in LUMINANCES])[0]
        calibration = fit(observations, darks, readings, setup)
        assert calibration.responsivity.glare_cd_m2 == pytest.approx(counted * u, rel=0.05)
        (found,) = [one for one in calibration.findings if one.code.startswith("intercept")]
        assert found.code == "intercept-not-excluded"
        assert found.values["glare_cd_m2"] == pytest.approx((share + 1.96) * u, rel=0.05)


def test_a_wrong_dark_is_distinguished_from_glare(camera, new_reading, setup):
    observations, _, readings = bench(camera, new_reading, reading={})
    wrong = bench(replace(camera, dark_offset_dn=54.0), new_reading)[1]
    calibration = fit(observations, wrong, readings, setup)
    (found,) = [one for one in calibration.findings if one.code == "dark-differs"]
    assert found.values["difference_dn"] == pytest.approx(10, abs=0.5)
    assert "intercept" not in codes(calibration)


@pytest.mark.parametrize("n", [30, pytest.param(400, marks=pytest.mark.long)])
def test_without_glare_the_intercept_keeps_quiet(camera, meter_class, setup, n):
    rng, fired = np.random.default_rng(2), 0
    for _ in range(n):
        observations = [camera.observe(f"P{i}", v, t, rng) for i, v in enumerate(LUMINANCES) for t in EXPOSURES_S]
        readings = {f"P{i}": [meter_class().read(v, rng)] for i, v in enumerate(LUMINANCES)}
        calibration = fit(observations, [camera.dark(t, rng) for t in EXPOSURES_S], readings, setup)
        fired += "intercept" in codes(calibration)
    # 0.27 % of normal errors lie beyond three standard uncertainties.
    assert fired <= n * 0.0027 + 4 * np.sqrt(n * 0.0027)


def test_frames_with_vignetting_give_the_axial_responsivity(camera, new_reading, setup):
    shape, rng = (48, 64), np.random.default_rng(3)
    vignetting = Cos4Vignetting(focal_length_m=0.006, pixel_pitch_m=1e-4)
    regions = [Roi.rectangle(f"P{i}", 16 * (i % 4) + 1, 16 * (i // 4) + 1, 14, 14) for i in range(12)]
    scene = np.zeros(shape)
    for region, luminance in zip(regions, LUMINANCES, strict=True):
        scene[region.window(shape)] = luminance
    on_sensor = scene * vignetting.relative_illuminance(shape)
    observations, darks = [], []
    for t in EXPOSURES_S:
        observations += observe_patches(camera.frames(on_sensor, t, 8, rng), regions, vignetting)
        darks.append(observe_dark(camera.frames(0 * on_sensor, t, 8, rng)))
    readings = {r.name: [new_reading(v)] for r, v in zip(regions, LUMINANCES, strict=True)}
    calibration = fit(observations, darks, readings, setup)
    fit_rel = calibration.responsivity.random_rel
    assert fit_rel < 0.002
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=4 * fit_rel)
    assert calibration.noise.k_dn_per_e == pytest.approx(0.25, rel=0.05)
    assert calibration.vignetting == vignetting
    frame = next(camera.frames(on_sensor, 0.001, 1, rng))
    seen = calibration.to_luminance(frame).luminance_cd_m2
    assert regions[11].select(seen).mean() == pytest.approx(2000, rel=0.01)


def test_dark_error_is_shared_by_the_patches(camera, new_reading, setup):
    """Twelve patches do not average the error of one dark down."""
    observations, darks, readings = bench(camera, new_reading, luminances=(1.0, 1.5, 2.5) * 4, exposures_s=(0.01,))
    # One frame of few pixels.
    vague = [replace(darks[0], n_pixels=225, n_frames=1, frame_means_variance_dn2=0.0)]
    calibration = fit(observations, vague, readings, setup)
    # As if all patches were one with their weighted mean: generalised least squares, error over the signal.
    signal = 1200 * 0.01 * np.array([1.0, 1.5, 2.5] * 4)
    covariance = np.diag([camera.pixel_variance_dn2(v, 0.01) / 1600 for v in (1.0, 1.5, 2.5) * 4]) + 0.01
    covariance += EXPOSURE_TIME_REL**2 * np.outer(signal, signal)
    expected = 1 / np.sqrt(signal @ np.linalg.solve(covariance, signal))
    assert calibration.responsivity.random_rel == pytest.approx(expected, rel=1e-6)
    assert expected > 0.1 / signal.max() / 2


def test_saturated_exposures_are_left_out_by_name(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading), setup)
    assert info("exposure-saturated", "P11", exposures_s=[0.008, 0.064]) in calibration.findings
    assert calibration.residuals[11].exposures_s == (0.001,)


def test_a_wrong_exposure_time_is_reported(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    late = [
        replace(o, signal_dn=64.04 + (o.signal_dn - 64.04) * 1.05) if o.exposure_s == 0.001 else o for o in observations
    ]
    calibration = fit(late, darks, readings, setup)
    reciprocity = next(t for t in calibration.tests if t.name == "exposure reciprocity")
    assert reciprocity.significant
    assert reciprocity.value == pytest.approx(0.05, rel=0.05)
    assert reciprocity.finding in calibration.findings
    assert reciprocity.finding.values["exposure_s"] == 0.001
    assert "exposures-scatter" in codes(calibration)
    assert calibration.response.kind == "linear"
    # Whichever exposure is right, the truth is within the stated uncertainty.
    r = calibration.responsivity
    assert r.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=0.05 + 2 * r.random_rel)


def test_light_and_dark_swapped(camera, new_reading, setup):
    observations, _, readings = bench(camera, new_reading)
    bright = [replace(camera, dark_offset_dn=5000.0).dark(t, None) for t in EXPOSURES_S]
    with pytest.raises(CalibrationError, match="0 of 12 patches are usable"):
        fit(observations, bright, readings, setup)


def with_gain(states, gain_db):
    return [replace(one, state=replace(one.state, gain_db=gain_db)) for one in states]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda o, d, r, _: ([], d, r), "there is no observation of a patch"),
        (lambda o, d, r, _: (o, d, {name: r[name] for name in r if name != "P4"}), "patch 'P4' has no meter reading"),
        (lambda o, d, r, new: (o, d, r | {"P99": [new(1.0)]}), "there are readings of patch 'P99', but no frames"),
        (lambda o, d, r, new: (o, d, r | {"P1": [new(50.0, unit="%")]}), "is a ratio in %, not a luminance"),
        (lambda o, d, r, new: (o, d, r | {"P1": [new(50.0, peak=True)]}), "is a held peak: set the meter to CONT"),
        (
            lambda o, d, r, new: (o, d, r | {"P1": [new(1.0, meter=MeterIdentity("LS-100", "1"))]}),
            "calibrate with one meter",
        ),
        (lambda o, d, r, _: (o, with_gain(d, 6.0), r), "gain of the light frames is 0 dB, but the set of dark frames"),
        (
            lambda o, d, r, _: ([*o[:-1], replace(o[-1], vignetting=Cos4Vignetting(0.006, 3.45e-6))], d, r),
            "was observed with vignetting Cos4Vignetting",
        ),
        (
            lambda o, d, r, _: ([one for one in o if one.patch in ("P0", "P1")], d, {"P0": r["P0"], "P1": r["P1"]}),
            "2 of 2 patches are usable, a calibration needs at least 3",
        ),
    ],
)
def test_what_does_not_belong_together_is_refused(camera, new_reading, setup, change, message):
    with pytest.raises(LabcdpError, match=re.escape(message)):
        fit(*change(*bench(camera, new_reading), new_reading), setup)


def test_clipped_exposures_are_left_out_by_name(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    observations = [
        replace(o, black_share=0.5) if (o.patch, o.exposure_s) == ("P0", 0.001) else o for o in observations
    ]
    calibration = fit(observations, darks, readings, setup)
    assert info("exposure-clipped", "P0", exposures_s=[0.001]) in calibration.findings


def test_a_patch_saturated_throughout_is_left_out_of_the_fit(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    calibration = fit(changed(observations, "P11", saturated_share=0.5), darks, readings, setup)
    assert subjects(calibration, "patch-not-usable") == ["P11"]
    assert len(calibration.residuals) == 11
    assert calibration.range_cd_m2[1] < 1000


def test_a_black_patch_is_left_out_of_the_fit(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading, luminances=(1e-6, *LUMINANCES)), setup)
    assert info("exposure-not-above-dark", "P0", exposures_s=[0.001, 0.008, 0.064]) in calibration.findings
    assert subjects(calibration, "patch-not-usable") == ["P0"]


def test_a_patch_that_reads_zero_is_left_out_of_the_fit(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    calibration = fit(observations, darks, readings | {"P0": [new_reading(0.0, **EXACT)]}, setup)
    assert subjects(calibration, "patch-reads-zero") == ["P0"]


def test_few_patches_are_reported(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading, luminances=LUMINANCES[:5]), setup)
    assert warning("few-patches", count=5, advised=6) in calibration.findings
    assert "few-patches" not in codes(fit(*bench(camera, new_reading, luminances=LUMINANCES[:6]), setup))


def test_few_exposures_are_reported(camera, new_reading, setup):
    one = fit(*bench(camera, new_reading, exposures_s=(0.001,)), setup)
    assert warning("few-exposures", exposures_s=[0.001], advised=3) in one.findings
    calibration = fit(*bench(camera, new_reading, exposures_s=(0.001, 0.008)), setup)
    assert warning("few-exposures", exposures_s=[0.001, 0.008], advised=3) in calibration.findings


def test_light_exposures_beyond_the_darks_are_reported(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    calibration = fit(observations, darks[:2], readings, setup)
    (found,) = [one for one in calibration.findings if one.code == "dark-extrapolated"]
    assert found.values["dark_exposures_s"] == [0.001, 0.008]
