"""The budget: split out of what intervals are made of, complete, and nothing hidden."""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest

from labcdp.calibration import fit, fit_colour, patch_luminance
from labcdp.calibration.budget import SOURCES, budget, budget_exposure_s, darkest_corner_px
from labcdp.calibration.camera import common_errors
from labcdp.core.vignetting import Cos4Vignetting, FlatField, RadialVignetting

from .conftest import FEW_CD_M2, FEW_S, STATE, SimulatedMeter, bench, colour_bench, make_reading, row
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
    whole = budget(calibration, luminance, exposure_s, *SIZE)
    # The budget takes K from photon transfer and the luminance as given; both within a part in a thousand.
    assert whole.u_rel == pytest.approx(hypot(patch.random_rel, patch.common_rel), rel=2e-3)
    assert whole.U_rel == pytest.approx(patch.U_rel, rel=2e-3)


@pytest.mark.parametrize(
    "vignetting",
    [
        None,
        Cos4Vignetting(0.006, 1e-4, corner_rel=0.05),
        Cos4Vignetting(0.006, 1e-4, (20.0, 30.0), 0.05),
        RadialVignetting(-0.4, 0.1, 0.0, covariance=((9e-4, 0, 0), (0, 4e-4, 0), (0, 0, 0)), slow_rel=0.004),
    ],
)
def test_rows_in_the_corner_are_those_of_a_patch_there(calibration, camera, vignetting):
    """The patch is small, and lies in the darkest corner, which V of every pixel shows."""
    calibration = replace(calibration, vignetting=vignetting)
    corner, (height, width) = darkest_corner_px(calibration), STATE.image_shape
    v = 1.0
    if vignetting is not None:
        image = vignetting.relative_illuminance(STATE.image_shape)
        square = [slice(0, 32) if at == 0 else slice(n - 32, n) for at, n in zip(corner, (width, height), strict=True)]
        v = float(image[square[1], square[0]].mean())
        ends = [image[y, x] for y in (0, -1) for x in (0, -1)]
        assert image[(0 if corner[1] == 0 else -1), (0 if corner[0] == 0 else -1)] == pytest.approx(min(ends))
    exposure_s = budget_exposure_s(calibration, 8.0)
    seen = camera.observe("P", 8.0 * v, exposure_s, None, SIZE)
    dark_dn = camera.mean_dn(0.0, exposure_s)
    in_corner = replace(
        seen, mean_dn=dark_dn / v + (seen.mean_dn - dark_dn) / v, mean_inverse_v=1 / v, vignetting=vignetting,
        centre_px=corner,
    )  # fmt: skip
    patch = patch_luminance(calibration, [in_corner])
    assert patch.luminance_cd_m2 == pytest.approx(8.0, rel=0.01)
    whole = budget(calibration, 8.0, exposure_s, *SIZE, position_px=corner)
    assert whole.u_rel == pytest.approx(hypot(patch.random_rel, patch.common_rel), rel=5e-3)
    assert whole.U_rel == pytest.approx(patch.U_rel, rel=5e-3)
    if isinstance(vignetting, Cos4Vignetting):
        assert whole.u_rel > vignetting.corner_rel


def test_every_source_has_a_row_that_is_a_common_error_or_says_why_it_is_not_known(calibration):
    squares = {}
    for error in common_errors(calibration, calibration.net_dn(8.0, 0.01), 0.01):
        squares[error.source] = squares.get(error.source, 0.0) + float(error.relative) ** 2
    rows = budget(calibration, 8.0, 0.01).rows
    u = {r.source: r.u_rel for r in rows}
    assert list(u) == list(SOURCES)
    assert u["dark and temperature"] == pytest.approx(sqrt(squares["dark and temperature"]))
    assert hypot(u["fit"], u["meter repeatability"]) == pytest.approx(sqrt(squares["fit"]))
    assert not row(rows, "intercept").included


def test_a_flat_field_leaves_at_least_its_own_noise_of_the_pixels_sensitivity(calibration):
    flat = replace(calibration, vignetting=FlatField(np.ones((4, 4), np.float32), 0.004, 0.0, 9))
    for one, code in ((calibration, "budget-pixel-sensitivity"), (flat, "budget-pixel-sensitivity-flat-field")):
        found = row(budget(one, 8.0, 0.01, 4).rows, "pixel sensitivity")
        assert (found.u_rel, found.basis.code) == (pytest.approx(one.pixel_rel() / 2), code)
    assert flat.pixel_rel() == 0.004 > flat.noise.prnu_rel


def test_the_corner_of_a_camera_with_colour_filters_is_that_of_its_planes(setup):
    """Whose pixels are half as many: an error of the vignetting of 5 % in the corner is one of the sum."""
    names = [f"P{i}" for i in range(8)]
    luminances = dict(zip(names, np.geomspace(1, 200, 8).tolist(), strict=True))
    seen, darks = colour_bench(lambda _, name: luminances[name], names, np.random.default_rng(1))
    vignetting = Cos4Vignetting(0.006, 2e-4, corner_rel=0.05)
    of_middle = {"vignetting": vignetting, "centre_px": (32.0, 24.0)}
    observations = {plane: [replace(o, **of_middle) for o in group] for plane, group in seen.items()}
    readings = {name: [make_reading(value)] for name, value in luminances.items()}
    calibration = fit_colour(observations, darks, readings, setup)
    positions = None, darkest_corner_px(calibration)
    at = [budget(calibration, 20.0, n_pixels=250, position_px=position).rows for position in positions]
    of_vignetting = [row(rows, "vignetting").u_rel for rows in at]
    assert of_vignetting == pytest.approx([0.0, 0.05], abs=1e-9)
    noise = [row(rows, "shot and read noise").u_rel for rows in at]
    v = vignetting.relative_illuminance((48, 64))[:32, :32].mean()
    assert noise[1] / noise[0] == pytest.approx(v**-0.5, rel=0.05)
