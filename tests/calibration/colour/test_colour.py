"""A camera with measured spectral sensitivities looks at a chart with measured reflectances."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labcdp.calibration import save
from labcdp.calibration.colour.conversion import colour_patch_luminance, colourfulness, mismatch_errors
from labcdp.calibration.colour.fit import fit_colour
from labcdp.calibration.colour.weights import ColourData, Prior, combine, leave_one_out
from labcdp.calibration.convert.patch import patch_luminance
from labcdp.calibration.record import load_any
from labcdp.core.frame import PLANES
from labcdp.core.photometry import spectral_weights
from labcdp.core.spectra import SpectralTable, f1_prime

from ..conftest import RESPONSIVITIES, SimulatedMeter, codes, colour_bench, make_frame
from ..convert.test_region import assert_part_of

#: Reflectance of patches of ideal grey, and the grey patches of the chart, which are a little coloured.
REFLECTANCES = {"grey 90": 0.9, "grey 55": 0.55, "grey 35": 0.35, "grey 20": 0.2, "grey 8": 0.08, "grey 3": 0.03}
GREYS = tuple(REFLECTANCES)
REAL_GREYS = ("white 9.5 (.05 D)", "neutral 8 (.23 D)", "neutral 6.5 (.44 D)", "neutral 5 (.70 D)",
              "neutral 3.5 (1.05 D)", "black 2 (1.5 D)")  # fmt: skip
COLOURS = ("blue", "green", "red", "yellow", "magenta", "cyan", "orange", "foliage", "blue sky")
#: What red, green and blue see.
SEEN = arrays(float, 3, elements=st.floats(0.1, 10))
#: cd/m^2 of a perfect white in the light of the chart.
WHITE_CD_M2 = 300.0


@pytest.fixture(scope="module")
def chart():
    """Luminance of each patch for the meter and, in cd/m^2 of a grey patch, for each colour of the camera."""
    import colour

    nm, power, visibility = spectral_weights("LED-B3")
    camera = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    curves = dict(zip("RGB", camera.values.T, strict=True))
    tables = {c: SpectralTable(tuple(camera.wavelengths.tolist()), tuple(v.tolist())) for c, v in curves.items()}
    chart = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]
    reflectances = {name: np.interp(nm, one.wavelengths, one.values) for name, one in chart.items()} | REFLECTANCES

    def seen_by(weights):
        light = power * weights
        return {name: WHITE_CD_M2 * np.sum(light * one) / light.sum() for name, one in reflectances.items()}

    by_plane = {plane: seen_by(tables[plane[0]].at(nm)) for plane in PLANES}
    return SimpleNamespace(luminance=seen_by(visibility), by_plane=by_plane, sensitivities=tables)


@pytest.fixture
def bench(chart):
    """Return observations and darks of patches."""

    def make(names, seed=3):
        rng = None if seed is None else np.random.default_rng(seed)
        return colour_bench(lambda plane, name: chart.by_plane[plane][name], names, rng)

    return make


@pytest.fixture
def fitted(bench, chart, setup):
    def make(names, seed=3, **options):
        rng, meter = None if seed is None else np.random.default_rng(seed), SimulatedMeter()
        readings = {name: [meter.read(chart.luminance[name], rng, second) for second in range(3)] for name in names}
        return fit_colour(*bench(names, seed), readings, replace(setup, source_spectrum="LED-B3"), **options)

    return make


def of_patch(observations, name):
    return {plane: [o for o in group if o.patch == name] for plane, group in observations.items()}


def test_held_out_colours_are_much_better_by_the_combination_than_by_any_plane(fitted, bench, chart):
    combined, alone, covered = [], [], 0
    for name in COLOURS:
        calibration = fitted([*REAL_GREYS, *COLOURS], held_out=[name])
        observations, _ = bench([name], seed=11)
        truth = chart.luminance[name]
        seen = colour_patch_luminance(calibration, of_patch(observations, name))
        combined.append(seen.luminance_cd_m2 / truth - 1)
        planes = [patch_luminance(plane, observations[plane.state.plane]) for plane in calibration.planes]
        alone.append([one.luminance_cd_m2 / truth - 1 for one in planes])
        low, high = seen.interval_95_cd_m2
        covered += low < truth < high
    # Greys that are a little coloured are not taken for glare.
    assert "intercept" not in codes(calibration)
    rms = np.sqrt(np.mean(np.square(combined)))
    assert rms < 0.08
    assert rms < 0.3 * np.sqrt(np.mean(np.square(alone), axis=0)).min()
    # Each of these saturated colours is unlike all others: for no fewer than 7 of 9 the interval holds.
    assert covered >= 7


def test_planes_are_fitted_to_grey_and_combined_by_the_leave_one_out_error(fitted, chart):
    calibration = fitted([*GREYS, *COLOURS])
    rows = {row.patch: row for row in calibration.residuals}
    for name in GREYS:
        assert rows[name].luminance_cd_m2 == pytest.approx(chart.luminance[name], rel=0.01)
    for plane in calibration.planes:
        assert {row.patch for row in plane.residuals} == set(GREYS)
    steps = {step.name: step for step in calibration.ladder}
    assert steps["combination"].chosen
    assert steps["combination"].leave_one_out_rel < 0.4 * min(steps[name].leave_one_out_rel for name in "RGB")


def test_sensitivities_choose_the_combination_nearest_to_v_lambda(fitted, bench, chart):
    calibration = fitted(GREYS, sensitivities=chart.sensitivities)
    assert calibration.f1_prime < 0.5 * min(f1_prime(one) for one in chart.sensitivities.values())
    by_noise = fitted(GREYS)
    errors = {"f1'": [], "noise": []}
    for name in COLOURS:
        observations, _ = bench([name], seed=13)
        for how, one in (("f1'", calibration), ("noise", by_noise)):
            seen = colour_patch_luminance(one, of_patch(observations, name))
            errors[how].append(seen.luminance_cd_m2 / chart.luminance[name] - 1)
    rms = {how: np.sqrt(np.mean(np.square(values))) for how, values in errors.items()}
    assert rms["f1'"] < 0.5 * rms["noise"]


def test_a_calibration_of_planes_outlives_saving(tmp_path, fitted, chart):
    calibration = fitted([*GREYS, *COLOURS], sensitivities=chart.sensitivities, held_out=["cyan"])
    save(calibration, tmp_path / "colour.json")
    assert load_any(tmp_path / "colour.json") == calibration


def test_maps_and_patches_have_one_luminance_and_one_uncertainty_of_contrasts(fitted, bench, chart):
    calibration = fitted([*GREYS, *COLOURS], seed=None)
    assert calibration.spectral_rel > 0.05
    found = {}
    for name in ("grey 20", "grey 55", "red", "blue"):
        # A frame of RG pattern whose planes hold the DN without noise.
        r, gr, gb, b = (64 + 0.008 * (40 + RESPONSIVITIES[p] * chart.by_plane[p][name]) for p in PLANES)
        format_ = {"colour_filter": "RG", "pixel_format": calibration.state.pixel_format}
        seen = calibration.to_luminance(make_frame(np.tile([[r, gr], [gb, b]], (48, 64)), 0.008, **format_))
        assert (seen.invalid == 0).all()
        # Rounding to whole DN is below 0.5 %.
        row = next(row for row in calibration.residuals if row.patch == name)
        assert seen.luminance_cd_m2 == pytest.approx(row.luminance_cd_m2, rel=0.005)
        patch = colour_patch_luminance(calibration, of_patch(bench([name], seed=None)[0], name))
        of_map = [np.mean(e.relative) for e in seen.common if e.source in ("fit", "spectral mismatch")]
        of_patch_ = [e.relative for e in patch.common if e.source in ("fit", "spectral mismatch")]
        found[name] = np.array(of_map), np.array(of_patch_)
    for how in (0, 1):
        u = {(a, b): np.linalg.norm(found[a][how] - found[b][how]) for a in found for b in found}
        assert u["grey 20", "grey 55"] < 0.002
        # Both colours are saturated: each has about 0.6 times the spectral uncertainty, and neither cancels.
        assert u["red", "blue"] > max(u["grey 20", "red"], u["grey 20", "blue"]) > 0.3 * calibration.spectral_rel
    for name, (of_map, of_one) in found.items():
        assert of_map == pytest.approx(of_one, abs=0.003), name


def test_weights_without_noise_are_those_of_the_closed_form():
    # Luminance is 0.3 R + 0.8 G - 0.1 B exactly; the patches span all directions.
    rng = np.random.default_rng(2)
    colours = rng.uniform(0.5, 1.5, (12, 3))
    true = np.array([0.3, 0.8, -0.1])
    relative = colours / (colours @ true)[:, None]
    data = ColourData(relative, np.full((12, 3), 1e-4), np.full(12, 1e-4), colourfulness(relative))
    prior = Prior(np.array([0.3, 0.5, 0.2]), 0.5)
    found = combine(data, prior)
    assert found.weights == pytest.approx(true, abs=0.002)
    assert found.spectral == 0
    assert np.abs(leave_one_out(data, prior, 0.0)).max() < 0.002
    assert np.abs(leave_one_out(data.only(1), Prior(np.ones(1), 1.0), 0.0)).max() > 0.1


def test_noise_of_planes_is_no_colour(fitted, bench):
    """Grey patches say little of the weights, which therefore must not act on the noise of another grey patch."""
    calibration, shares = fitted(GREYS), []
    for seed in range(20):
        observations, _ = bench(["grey 20", "grey 55"], seed=100 + seed)
        pair = [colour_patch_luminance(calibration, of_patch(observations, name)) for name in ("grey 55", "grey 20")]
        rows = np.array([[float(e.relative) for e in one.common if e.source == "fit"] for one in pair])
        own = np.square([one.random_rel for one in pair]).sum()
        shares.append(np.sum((rows[0] - rows[1]) ** 2) / own)
    assert np.mean(shares) < 0.06
    # Their sum is that of the readings: a weighted mean.
    u = [row.residual_rel / row.standardised_residual for row in calibration.residuals]
    assert np.sum(calibration.weight_covariance) == pytest.approx(1 / np.sum(1 / np.square(u)), rel=0.02)


def test_a_window_of_a_frame_is_that_of_the_whole(fitted):
    calibration, window = fitted([*GREYS, *COLOURS]), (slice(5, 20), slice(3, 30))
    format_ = {"colour_filter": "RG", "pixel_format": calibration.state.pixel_format}
    frame = make_frame(np.random.default_rng(3).integers(60, 4096, (96, 128)), 0.008, **format_)
    assert_part_of(calibration.to_luminance(frame, window), calibration.to_luminance(frame), window)


@given(one=SEEN, other=SEEN, factor=st.floats(0.01, 100))
def test_errors_have_the_stated_size_and_cancel_for_one_chromaticity_only(one, other, factor):
    def errors(by_colour, spectral_rel):
        return np.array([error.relative for error in mismatch_errors(by_colour, spectral_rel)])

    for by_colour in (one, other):
        assert np.linalg.norm(errors(by_colour, 0.3)) == pytest.approx(0.3 * np.std(by_colour) / np.mean(by_colour))
    assert errors(factor * one, 1.0) == pytest.approx(errors(one, 1.0), abs=1e-9)
    assert colourfulness(one) == pytest.approx(np.std(one) / np.mean(one))
