"""A camera with measured spectral sensitivities looks at a chart with measured reflectances."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.calibration.colour.conversion import colour_patch_luminance, colourfulness
from labcdp.calibration.colour.fit import fit_colour
from labcdp.calibration.colour.model import ColourCalibration
from labcdp.calibration.colour.weights import NO_PRIOR, ColourData, Prior, combine, leave_one_out
from labcdp.calibration.convert.patch import patch_luminance
from labcdp.calibration.record import load_any
from labcdp.core.errors import InputError
from labcdp.core.frame import PLANES
from labcdp.core.photometry import spectral_weights
from labcdp.core.spectra import SpectralTable, f1_prime

from ..conftest import EXPOSURES_S, SimulatedCamera, SimulatedMeter, codes, make_frame

#: Reflectance of patches of ideal grey, and the grey patches of the chart, which are a little coloured.
REFLECTANCES = {"grey 90": 0.9, "grey 55": 0.55, "grey 35": 0.35, "grey 20": 0.2, "grey 8": 0.08, "grey 3": 0.03}
GREYS = tuple(REFLECTANCES)
REAL_GREYS = ("white 9.5 (.05 D)", "neutral 8 (.23 D)", "neutral 6.5 (.44 D)", "neutral 5 (.70 D)",
              "neutral 3.5 (1.05 D)", "black 2 (1.5 D)")  # fmt: skip
COLOURS = ("blue", "green", "red", "yellow", "magenta", "cyan", "orange", "foliage", "blue sky")
#: Pairs of like and unlike colours.
PAIRS = (("grey 20", "grey 55"), ("grey 20", "red"), ("grey 20", "blue"), ("red", "blue"))
#: cd/m^2 of a perfect white in the light of the chart.
WHITE_CD_M2 = 300.0


@dataclass(frozen=True)
class Chart:
    """Luminance of each patch for the meter and, in cd/m^2 of a grey patch, for each colour of the camera."""

    luminance: dict[str, float]
    by_plane: dict[str, dict[str, float]]
    sensitivities: dict[str, SpectralTable]


def make_chart(light: str = "LED-B3") -> Chart:
    import colour

    nm, power, visibility = spectral_weights(light)
    camera = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    curves = dict(zip(("R", "G", "B"), camera.values.T, strict=True))
    tables = {c: SpectralTable(tuple(camera.wavelengths.tolist()), tuple(v.tolist())) for c, v in curves.items()}
    luminance, by_plane = {}, {plane: {} for plane in PLANES}
    chart = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]
    reflectances = {name: np.interp(nm, one.wavelengths, one.values) for name, one in chart.items()}
    for name, reflectance in (reflectances | REFLECTANCES).items():
        reflected = power * reflectance
        luminance[name] = WHITE_CD_M2 * float(reflected @ visibility / (power @ visibility))
        for plane in PLANES:
            s = tables[plane[0]].at(nm)
            by_plane[plane][name] = WHITE_CD_M2 * float(reflected @ s / (power @ s))
    return Chart(luminance, by_plane, tables)


@pytest.fixture(scope="module")
def chart() -> Chart:
    return make_chart()


@pytest.fixture
def bench(camera, chart):
    """Return observations, darks and truth of patches; planes differ in responsivity, black level and noise."""

    def make(names, seed: int | None = 3):
        rng = None if seed is None else np.random.default_rng(seed)
        observations, darks = {}, {}
        for plane, responsivity in zip(PLANES, (700.0, 1200.0, 1180.0, 800.0), strict=True):
            one = SimulatedCamera(responsivity, state=replace(camera.state, plane=plane))
            observations[plane] = [one.observe(n, chart.by_plane[plane][n], t, rng) for n in names for t in EXPOSURES_S]
            darks[plane] = [one.dark(t, rng) for t in EXPOSURES_S]
        return observations, darks

    return make


@pytest.fixture
def read(chart):
    def make(names, seed: int | None = 5):
        rng = None if seed is None else np.random.default_rng(seed)
        meter = SimulatedMeter()
        return {name: [meter.read(chart.luminance[name], rng, second) for second in range(3)] for name in names}

    return make


@pytest.fixture
def fitted(bench, read, setup):
    def make(names, seed: int | None = 3, **options) -> ColourCalibration:
        observations, darks = bench(names, seed)
        return fit_colour(observations, darks, read(names, seed), replace(setup, source_spectrum="LED-B3"), **options)

    return make


def of_patch(observations, name):
    return {plane: [o for o in group if o.patch == name] for plane, group in observations.items()}


@pytest.mark.parametrize("greys", [REAL_GREYS, pytest.param(GREYS, marks=pytest.mark.long)])
def test_held_out_colours_are_much_better_by_the_combination_than_by_any_plane(fitted, bench, chart, greys):
    combined, alone, covered = [], [], 0
    for name in COLOURS:
        calibration = fitted([*greys, *COLOURS], held_out=[name])
        observations, _ = bench([name], seed=11)
        truth = chart.luminance[name]
        seen = colour_patch_luminance(calibration, of_patch(observations, name))
        combined.append(seen.luminance_cd_m2 / truth - 1)
        planes = [patch_luminance(plane, observations[plane.state.plane]) for plane in calibration.planes]
        alone.append([one.luminance_cd_m2 / truth - 1 for one in planes])
        low, high = seen.interval_95_cd_m2
        covered += low < truth < high
        assert [row.patch for row in calibration.held_out] == [name]
    # Greys that are a little coloured are not taken for glare.
    assert "intercept" not in codes(calibration)
    assert ("planes-intercepts-differ" in codes(calibration)) == (greys is REAL_GREYS)
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
        assert plane.response.kind == "linear"
    assert "patches-of-another-colour" in codes(calibration)
    steps = {step.name: step for step in calibration.ladder}
    assert set(steps) == {"combination", "R", "G", "B"}
    assert steps["combination"].chosen
    assert steps["combination"].leave_one_out_rel < 0.4 * min(steps[name].leave_one_out_rel for name in "RGB")


def test_sensitivities_choose_the_combination_nearest_to_v_lambda(fitted, bench, chart):
    calibration = fitted(GREYS, sensitivities=chart.sensitivities)
    assert calibration.f1_prime is not None
    assert calibration.f1_prime < 0.5 * min(f1_prime(one) for one in chart.sensitivities.values())
    assert "patches-of-one-colour-f1" in codes(calibration)
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
    with pytest.raises(InputError, match=r"colour"):
        load(tmp_path / "colour.json")


def bayer_frame(calibration, by_plane):
    """A frame of RG pattern whose planes hold the DN without noise for one patch."""
    mean = np.empty((2 * 48, 2 * 64))
    for plane, (row, column) in {"R": (0, 0), "Gr": (0, 1), "Gb": (1, 0), "B": (1, 1)}.items():
        mean[row::2, column::2] = by_plane[plane]
    return make_frame(mean, EXPOSURES_S[1], colour_filter="RG", pixel_format=calibration.state.pixel_format)


def test_maps_and_patches_have_one_luminance_and_one_uncertainty_of_contrasts(fitted, bench, chart):
    calibration = fitted([*GREYS, *COLOURS], seed=None)
    assert calibration.spectral_rel > 0.05
    found = {}
    for name in ("grey 20", "grey 55", "red", "blue"):
        dn = {
            plane: 64 + EXPOSURES_S[1] * (40 + r * chart.by_plane[plane][name])
            for plane, r in zip(PLANES, (700.0, 1200.0, 1180.0, 800.0), strict=True)
        }
        seen = calibration.to_luminance(bayer_frame(calibration, dn))
        assert (seen.shape, seen.step) == ((48, 64), 2)
        assert (seen.invalid == 0).all()
        # Rounding to whole DN is below 0.5 %.
        row = next(row for row in calibration.residuals if row.patch == name)
        assert seen.luminance_cd_m2 == pytest.approx(row.luminance_cd_m2, rel=0.005)
        patch = colour_patch_luminance(calibration, of_patch(bench([name], seed=None)[0], name))
        of_map = [np.mean(e.relative) for e in seen.common if e.source in ("fit", "spectral mismatch")]
        of_patch_ = [e.relative for e in patch.common if e.source in ("fit", "spectral mismatch")]
        found[name] = np.array(of_map), np.array(of_patch_)
    for how in (0, 1):
        u = {pair: np.linalg.norm(found[pair[0]][how] - found[pair[1]][how]) for pair in PAIRS}
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
    assert np.abs(leave_one_out(data.only(1), NO_PRIOR, 0.0)).max() > 0.1


def test_an_unknown_light_leaves_the_sensitivities_aside(bench, read, setup, chart):
    observations, darks = bench(GREYS)
    other = replace(setup, source_spectrum="bicycle lamp")
    calibration = fit_colour(observations, darks, read(GREYS), other, sensitivities=chart.sensitivities)
    assert calibration.f1_prime is None
    assert "sensitivities-not-used" in codes(calibration)


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
