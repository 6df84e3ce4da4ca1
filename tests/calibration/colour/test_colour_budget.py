"""The budget of a grey patch by the combination of planes: what intervals are made of, and nothing hidden."""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest

from labcdp.calibration import colour_patch_luminance, fit_colour
from labcdp.calibration.budget import budget, budget_exposure_s, combined
from labcdp.core.frame import PLANES

EXPOSURES = (0.002, 0.01, 0.1)
RESPONSIVITIES = (700.0, 1200.0, 1180.0, 800.0)
LUMINANCES = (0.5, 1.0, 2.5, 6.0, 15.0, 40.0, 100.0, 250.0)
#: Two coloured patches, by what red, green and blue see.
COLOURED = {"red": (50.0, 20.0, 15.0), "blue": (10.0, 15.0, 60.0)}
SIZE = (250, 2)


@pytest.fixture(scope="module")
def planes(camera, camera_class):
    return {
        plane: camera_class(responsivity_dn_s_cd_m2=r, state=replace(camera.state, plane=plane))
        for plane, r in zip(PLANES, RESPONSIVITIES, strict=True)
    }


@pytest.fixture(scope="module")
def calibration(planes, meter_class, setup):
    rng, meter = np.random.default_rng(8), meter_class()
    seen = {f"P{i}": (v, v, v) for i, v in enumerate(LUMINANCES)} | COLOURED
    observations = {
        p: [one.observe(n, v["RGB".index(p[0])], t, rng, SIZE) for n, v in seen.items() for t in EXPOSURES]
        for p, one in planes.items()
    }
    darks = {p: [one.dark(t, rng) for t in EXPOSURES] for p, one in planes.items()}
    readings = {n: [meter.read(float(np.dot((0.2, 0.9, -0.1), v)), rng, s) for s in range(3)] for n, v in seen.items()}
    return fit_colour(observations, darks, readings, setup)


def row(rows, source):
    return next(r for r in rows if r.source == source)


@pytest.mark.parametrize("luminance", [0.7, 8.0, 200.0])
@pytest.mark.parametrize("scatter_rel", [0.0, 0.004])
def test_rows_make_the_uncertainty_of_a_grey_patch(calibration, planes, luminance, scatter_rel):
    scattered = replace(calibration, scatter_rel=scatter_rel)
    exposure_s = budget_exposure_s(calibration, luminance)
    observations = {p: [one.observe("P", luminance, exposure_s, None, SIZE)] for p, one in planes.items()}
    patch = colour_patch_luminance(scattered, observations)
    whole = combined(budget(scattered, luminance, exposure_s, *SIZE))
    # Fitted planes see a grey patch a little coloured, and photon transfer gives K: a part in a hundred.
    assert whole.standard_uncertainty_rel == pytest.approx(hypot(patch.random_rel, patch.common_rel), rel=0.01)
    assert whole.expanded_95_rel == pytest.approx(patch.half_width_95_rel, rel=0.01)


def test_the_fit_is_that_of_the_weights_for_grey(calibration):
    rows = budget(calibration, 8.0)
    parts = [row(rows, source).standard_uncertainty_rel for source in ("fit", "meter repeatability")]
    ones = np.ones(4)
    variance = ones @ np.array(calibration.weight_covariance) @ ones
    assert hypot(*parts) == pytest.approx(sqrt(variance) / sum(calibration.weights), rel=1e-6)
    assert row(rows, "meter scale").standard_uncertainty_rel == pytest.approx(0.02 / sqrt(3))
    assert row(rows, "meter scale").distribution == "rectangular"
    # Steps of the exposure time are the same for all planes: they add up to one share.
    assert row(rows, "exposure time").standard_uncertainty_rel == pytest.approx(5e-5)
