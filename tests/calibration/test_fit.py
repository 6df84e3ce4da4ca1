from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import fit, observe_dark, observe_patches
from labcdp.calibration.common_errors import EXPOSURE_TIME_REL
from labcdp.errors import CalibrationError, InputError
from labcdp.reading import MeterIdentity
from labcdp.response import Response
from labcdp.roi import Roi
from labcdp.vignetting import Cos4Vignetting

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


def changed(observations, patch, **changes):
    return [replace(o, **changes) if o.patch == patch else o for o in observations]


def test_exact_data_give_the_exact_responsivity(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading), setup)
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=1e-9)
    assert calibration.responsivity.chi_squared == pytest.approx(0, abs=1e-9)
    # 36 observations, of which 5 patches saturate at 8 of their exposures, less one parameter.
    assert calibration.responsivity.degrees_of_freedom == 27
    assert (calibration.response, calibration.responsivity.scatter_rel) == (Response(), 0.0)
    assert calibration.range_net_dn == (pytest.approx(0.6), pytest.approx(3.54e3, rel=0.01))
    assert calibration.responsivity.intercept_dn_s == pytest.approx(0, abs=1e-6)
    assert not any("intercept" in w for w in calibration.warnings)
    assert calibration.noise.k_dn_per_e == pytest.approx(0.25)
    assert calibration.range_cd_m2 == (pytest.approx(0.5), pytest.approx(2000))
    assert calibration.exposures_s == EXPOSURES_S
    assert max(abs(row.residual_rel) for row in calibration.residuals) < 1e-9
    assert [row.patch for row in calibration.residuals] == [f"P{i}" for i in range(12)]


def test_it_keeps_who_and_what(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading), setup)
    assert calibration.state == camera.state
    assert calibration.lens.model == "Kowa LM6NCL"
    assert calibration.source_spectrum == "LED-B4"
    assert calibration.meter_scale.meter.serial == "73323007"
    assert calibration.provenance.input_sha256 == "0" * 64
    assert set(calibration.provenance.versions) == {"python", "labcdp", "numpy", "scipy"}
    assert calibration.provenance.measured == new_reading(1.0).timestamp


def test_same_input_gives_the_same_calibration(camera, new_reading, setup):
    assert fit(*bench(camera, new_reading), setup) == fit(*bench(camera, new_reading), setup)


def test_common_uncertainty_is_that_of_the_scale_and_the_fit(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading), setup)
    fit_rel = calibration.responsivity.random_rel
    assert calibration.responsivity_common_rel == pytest.approx(np.hypot(0.02 / np.sqrt(3), fit_rel))


def test_weights_save_the_dark_patches(camera, new_reading, setup):
    """Unweighted least squares of a + b x errs by tens of percent at 0.6 cd/m^2 (reference: 30 %, weighted 2 %)."""
    rng = np.random.default_rng(1)
    luminances = tuple(np.geomspace(0.6, 2000, 10))
    unweighted, weighted = [], []
    for _ in range(100):
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
    assert any("glare or a wrong dark" in w for w in calibration.warnings)
    glare = next(t for t in calibration.tests if t.name == "glare")
    assert glare.significant
    assert glare.value == pytest.approx(0.2, rel=1e-6)
    assert calibration.responsivity.intercept_dn_s == pytest.approx(0.2 * 1200, rel=0.1)
    assert calibration.left_out == tuple(row for row in calibration.left_out if row.exposure_s is not None)


def test_a_wrong_dark_is_told_from_glare(camera, new_reading, setup):
    observations, _, readings = bench(camera, new_reading, reading={})
    wrong = bench(replace(camera, dark_offset_dn=54.0), new_reading)[1]
    calibration = fit(observations, wrong, readings, setup)
    assert any("the light frames lie 10 +- " in w and "a wrong dark" in w for w in calibration.warnings)
    assert not any("intercept" in w for w in calibration.warnings)


def test_without_glare_the_intercept_keeps_quiet(camera, meter_class, setup):
    rng, n, fired = np.random.default_rng(2), 300, 0
    for _ in range(n):
        observations = [camera.observe(f"P{i}", v, t, rng) for i, v in enumerate(LUMINANCES) for t in EXPOSURES_S]
        readings = {f"P{i}": [meter_class().read(v, rng)] for i, v in enumerate(LUMINANCES)}
        calibration = fit(observations, [camera.dark(t, rng) for t in EXPOSURES_S], readings, setup)
        fired += any("intercept" in w for w in calibration.warnings)
    # 0.27 % of normal errors lie beyond three standard uncertainties.
    assert fired <= n * 0.0027 + 4 * np.sqrt(n * 0.0027)


def test_frames_with_fall_off_give_the_axial_responsivity(camera, new_reading, setup):
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


def test_an_uneven_patch_counts_less(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading, reading={})
    uneven = replace(observations[0].unevenness, between=(1e6, 0.0, 0.0))
    even = fit(observations, darks, readings, setup)
    all_uneven = fit([replace(o, unevenness=uneven) for o in observations], darks, readings, setup)
    assert all_uneven.responsivity.random_rel > 2 * even.responsivity.random_rel


def test_dark_error_is_shared_by_the_patches(camera, new_reading, setup):
    """Twelve patches do not average the error of one dark down."""
    observations, darks, readings = bench(camera, new_reading, luminances=(1.0, 1.5, 2.5) * 4, exposures_s=(0.01,))
    vague = [replace(darks[0], mean_variance_dn2=0.01)]
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
    assert "patch 'P11' is saturated at 0.008 s, 0.064 s: left out there" in calibration.warnings
    assert calibration.residuals[11].exposures_s == (0.001,)


def test_clipped_exposures_are_left_out_by_name(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    observations = [
        replace(o, black_share=0.5) if (o.patch, o.exposure_s) == ("P0", 0.001) else o for o in observations
    ]
    calibration = fit(observations, darks, readings, setup)
    assert "patch 'P0' is clipped at 0 DN at 0.001 s: left out there" in calibration.warnings


def test_a_patch_saturated_throughout_is_left_out_of_the_fit(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    calibration = fit(changed(observations, "P11", saturated_share=0.5), darks, readings, setup)
    assert "patch 'P11' is usable at no exposure: left out of the fit" in calibration.warnings
    assert len(calibration.residuals) == 11
    assert calibration.range_cd_m2[1] < 1000


def test_a_black_patch_is_left_out_of_the_fit(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading, luminances=(1e-6, *LUMINANCES)), setup)
    assert (
        "patch 'P0' is not brighter than the dark at 0.001 s, 0.008 s, 0.064 s: left out there" in calibration.warnings
    )
    assert "patch 'P0' is usable at no exposure: left out of the fit" in calibration.warnings


def test_a_patch_that_reads_zero_is_left_out_of_the_fit(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    calibration = fit(observations, darks, readings | {"P0": [new_reading(0.0, **EXACT)]}, setup)
    assert "patch 'P0' reads 0 cd/m^2, below the meter's range: left out of the fit" in calibration.warnings


def test_a_wrong_exposure_time_is_reported(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    late = [
        replace(o, signal_dn=64.04 + (o.signal_dn - 64.04) * 1.05) if o.exposure_s == 0.001 else o for o in observations
    ]
    calibration = fit(late, darks, readings, setup)
    reciprocity = next(t for t in calibration.tests if t.name == "exposure reciprocity")
    assert reciprocity.significant
    assert reciprocity.value == pytest.approx(0.05, rel=0.05)
    assert any(w.startswith("at 0.001 s the signal is off by +4.") for w in calibration.warnings)
    assert any("the exposures of a patch disagree by" in w for w in calibration.warnings)
    assert calibration.response.kind == "linear"
    # Whichever exposure is right, the truth is within the stated uncertainty.
    r = calibration.responsivity
    assert r.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=0.05 + 2 * r.random_rel)


def test_few_patches_are_reported(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading, luminances=LUMINANCES[:5]), setup)
    assert "the fit rests on 5 patches: use at least 6, better 8 to 12, log spaced" in calibration.warnings
    assert not any("rests on" in w for w in fit(*bench(camera, new_reading, luminances=LUMINANCES[:6]), setup).warnings)


def test_few_exposures_are_reported(camera, new_reading, setup):
    one = fit(*bench(camera, new_reading, exposures_s=(0.001,)), setup)
    assert any(w.startswith("patches were usable at 1 exposure: reciprocity not testable; use") for w in one.warnings)
    calibration = fit(*bench(camera, new_reading, exposures_s=(0.001, 0.008)), setup)
    assert any(w.startswith("patches were usable at 2 exposures: use at least 3") for w in calibration.warnings)


def test_light_exposures_beyond_the_darks_are_reported(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    calibration = fit(observations, darks[:2], readings, setup)
    assert any(
        w.startswith("dark frames at 0.001 to 0.008 s do not enclose the exposures") for w in calibration.warnings
    )


def test_warnings_of_darks_readings_and_noise_are_kept(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    observations = [replace(o, temporal_variance_dn2=0.0) for o in observations]
    readings["P3"] = [new_reading(v) for v in (8.0, 9.0, 10.0)]
    text = "\n".join(fit(observations, darks[:1], readings, setup).warnings)
    assert "dark frames at one exposure only" in text
    assert "the temporal noise does not grow" in text
    assert "the readings of patch 'P3' scatter" in text


def test_warnings_are_logged(camera, new_reading, setup, caplog):
    calibration = fit(*bench(camera, new_reading, luminances=LUMINANCES[:5]), setup)
    assert [record.getMessage() for record in caplog.records] == list(calibration.warnings)


def test_two_patches_are_too_few(camera, new_reading, setup):
    with pytest.raises(
        CalibrationError, match=r"2 of 2 patches are usable, a calibration needs at least 3 .* add patches"
    ):
        fit(*bench(camera, new_reading, luminances=LUMINANCES[:2]), setup)


def test_no_light(camera, new_reading, setup):
    _, darks, readings = bench(camera, new_reading)
    unlit = bench(camera, new_reading, luminances=(0.0,) * 12)[0]
    with pytest.raises(CalibrationError, match=r"0 of 12 patches are usable.*'P0' is not brighter than the dark"):
        fit(unlit, darks, readings, setup)


def test_light_and_dark_swapped(camera, new_reading, setup):
    observations, _, readings = bench(camera, new_reading)
    bright = [replace(camera, dark_offset_dn=5000.0).dark(t, None) for t in EXPOSURES_S]
    with pytest.raises(CalibrationError, match="0 of 12 patches are usable"):
        fit(observations, bright, readings, setup)


def test_patch_without_reading(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    del readings["P4"]
    with pytest.raises(CalibrationError, match="patch 'P4' has no meter reading: measure it, or leave the patch out"):
        fit(observations, darks, readings, setup)


def test_reading_without_patch(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    with pytest.raises(CalibrationError, match="there are readings of patch 'P99', but no frames show it"):
        fit(observations, darks, readings | {"P99": [new_reading(1.0)]}, setup)


def test_no_observations(camera, new_reading, setup):
    _, darks, readings = bench(camera, new_reading)
    with pytest.raises(CalibrationError, match="there is no observation of a patch"):
        fit([], darks, readings, setup)


def test_ratio_reading(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    with pytest.raises(InputError, match="is a ratio in %, not a luminance"):
        fit(observations, darks, readings | {"P1": [new_reading(50.0, unit="%")]}, setup)


def test_two_meters(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    other = new_reading(1.0, meter=MeterIdentity("LS-100", "1"))
    with pytest.raises(CalibrationError, match="calibrate with one meter"):
        fit(observations, darks, readings | {"P1": [other]}, setup)


def test_darks_of_another_gain(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    other = [replace(d, state=replace(d.state, gain_db=6.0)) for d in darks]
    with pytest.raises(
        CalibrationError, match=r"gain of the light frames is 0 dB, but the set of dark frames at 0\.001 s"
    ):
        fit(observations, other, readings, setup)


def test_patches_of_another_format(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    mixed = changed(observations, "P5", state=replace(camera.state, pixel_format="Mono8", bit_depth=8))
    with pytest.raises(CalibrationError, match=r"Mono12, but patch 'P5' at 0\.001 s has Mono8"):
        fit(mixed, darks, readings, setup)


def test_patches_of_another_vignetting(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    mixed = changed(observations, "P5", vignetting=Cos4Vignetting(0.006, 3.45e-6))
    with pytest.raises(CalibrationError, match=r"patch 'P5' at 0\.001 s was observed with vignetting Cos4Vignetting"):
        fit(mixed, darks, readings, setup)
