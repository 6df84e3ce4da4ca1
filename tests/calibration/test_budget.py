"""The budget: split out of what intervals are made of, complete, and nothing hidden."""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest

from labcdp.calibration import fit, patch_luminance
from labcdp.calibration.budget import SOURCES, budget, budget_exposure_s, combined
from labcdp.calibration.converter import common_errors
from labcdp.core.vignetting import FlatField, RadialVignetting

from .conftest import FEW_CD_M2, FEW_S, SimulatedMeter, bench, row
from .test_verify import CERTIFICATE

SIZE = (400, 4)


@pytest.fixture(scope="module")
def calibration(camera, setup):
    rng, meter = np.random.default_rng(5), SimulatedMeter()
    return fit(*bench(camera, lambda v: meter.read(v, rng), rng, FEW_CD_M2, FEW_S, 3), setup)


@pytest.mark.parametrize("luminance", [0.7, 8.0, 200.0])
@pytest.mark.parametrize("all_sources", [False, True])
def test_rows_make_the_uncertainty_of_a_patch(calibration, camera, luminance, all_sources):
    """Also with a flat field, and few degrees of freedom of flicker, black level, scatter and certificate."""
    if all_sources:
        calibration = replace(
            calibration,
            vignetting=RadialVignetting(0.0, 0.0, 0.0, slow_rel=0.004),
            noise=replace(calibration.noise, flicker_rel=0.01, flicker_dof=4, prnu_rel=0.02),
            dark=replace(calibration.dark, drift_dn=0.5, drift_dof=3),
            responsivity=replace(calibration.responsivity, scatter_rel=0.005, scatter_dof=3.0, scatter_dn=0.5),
            meter_scale=replace(calibration.meter_scale, certificate=CERTIFICATE),
        )
    exposure_s = budget_exposure_s(calibration, luminance)
    seen = camera.observe("P", luminance, exposure_s, None, SIZE)
    patch = patch_luminance(calibration, [replace(seen, vignetting=calibration.vignetting)])
    whole = combined(budget(calibration, luminance, exposure_s, *SIZE))
    # The budget takes K from photon transfer and the luminance as given; both within a part in a thousand.
    assert whole.standard_uncertainty_rel == pytest.approx(hypot(patch.random_rel, patch.common_rel), rel=2e-3)
    assert whole.expanded_95_rel == pytest.approx(patch.half_width_95_rel, rel=2e-3)


def test_every_source_has_a_row_that_is_a_common_error_or_says_why_it_is_not_known(calibration):
    squares = {}
    for error in common_errors(calibration, calibration.net_dn(8.0, 0.01), 0.01):
        squares[error.source] = squares.get(error.source, 0.0) + float(error.relative) ** 2
    rows = budget(calibration, 8.0, 0.01)
    u = {r.source: r.standard_uncertainty_rel for r in rows}
    assert list(u) == list(SOURCES)
    assert u["dark and temperature"] == pytest.approx(sqrt(squares["dark and temperature"]))
    assert hypot(u["fit"], u["meter repeatability"]) == pytest.approx(sqrt(squares["fit"]))
    assert not row(rows, "intercept").included


def test_a_flat_field_leaves_at_least_its_own_noise_of_the_pixels_sensitivity(calibration):
    flat = replace(calibration, vignetting=FlatField(np.ones((4, 4), np.float32), 0.004, 0.0, 9))
    for one, code in ((calibration, "budget-pixel-sensitivity"), (flat, "budget-pixel-sensitivity-flat-field")):
        found = row(budget(one, 8.0, 0.01, 4), "pixel sensitivity")
        assert (found.standard_uncertainty_rel, found.basis.code) == (pytest.approx(one.pixel_rel() / 2), code)
    assert flat.pixel_rel() == 0.004 > flat.noise.prnu_rel
